"""What the simulated table is: its model, the specimen as it really is, and its sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import (
    ADDED_MASS,
    COEFFICIENT,
    DISPLACEMENT_NOISE,
    DRIFT,
    FORCE_NOISE,
    NOISE,
    POLE,
    POLE_DAMPING,
)
from bmd_rths_core.structure.config import NO_FILE
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.shear_building import chain_of
from bmd_rths_core.structure.story_springs import BilinearSpring
from bmd_rths_core.table.models.dynamics import series, servo_sections
from bmd_rths_core.table.models.plant import Plant, commanded_through, driven_plant, interacting_plant
from bmd_rths_core.table.models.sensors import Sensors

FloatArray = NDArray[np.float64]

#: The further mode of `SimulatedTableConfig.unmodelled_mode` [rad/s, 1].
_UNMODELLED_FREQUENCY, _UNMODELLED_DAMPING = 2.0 * np.pi * 25.0, 0.02


@dataclass(frozen=True)
class SimulatedTableConfig:
    """The virtual shake table and its sensors."""

    SECTION: ClassVar[str] = "simulated_table"

    dynamics: str = parameter(
        "interacting_servo",
        description="Model of the table: third-order servo, the same with the specimen pulling at it "
        "(control-structure interaction), the sections given, those fitted to frequency_response, or an ideal table",
        choices=("servo", "interacting_servo", "sections", "measured", "perfect"),
    )
    frequency_response: str = parameter(
        NO_FILE,
        description="File (CSV: frequency_hz, magnitude, phase_deg, coherence) of the acceleration of the table with "
        "the specimen on it over its command, without the hold; used when dynamics is measured, none otherwise",
    )
    fit_error: float = parameter(
        0.0,
        description="Root mean square of frequency_response minus its fit, over that of frequency_response, filled in "
        "when it was fitted",
        unit="1",
        lower=0.0,
        upper=1e6,
    )
    servo_real_pole: float = parameter(
        43.08,
        description="Real pole of the servo table",
        unit="rad/s",
        source="fitted to the paper's Tables 2 and 3, docs/decisions/0013",
        **POLE,
    )
    servo_frequency: float = parameter(
        134.8,
        description="Natural frequency of the oscillatory pair of the servo table",
        unit="rad/s",
        source="fitted to the paper's Tables 2 and 3, docs/decisions/0013",
        **POLE,
    )
    servo_damping_ratio: float = parameter(
        0.0508,
        description="Damping ratio of the oscillatory pair of the servo table",
        unit="1",
        source="fitted to the paper's Tables 2 and 3, docs/decisions/0013",
        **POLE_DAMPING,
    )
    sections: tuple[float, ...] = parameter(
        (),
        description="Analog sections in series, rows of b2 b1 b0 a2 a1 a0, used when dynamics is sections; filled in "
        "when it is measured",
        unit="coefficients of s2, s and 1",
        source="Eq. 9 of Chen et al. 2020 has this form",
        **COEFFICIENT,
    )
    command_delay: float = parameter(
        0.0,
        description="Pure delay of the command before the table, in full or fractional time steps",
        unit="s",
        lower=0.0,
        upper=1.0,
    )
    platen_mass: float = parameter(
        6353.0,
        description="Mass of platen and piston, for the actuator force and for what the specimen does to an "
        "interacting servo",
        unit="kg",
        source="fitted to the paper's Tables 2 and 3, docs/decisions/0013",
        **ADDED_MASS,
    )
    acceleration_noise: float = parameter(
        0.0524,
        description="Noise of every accelerometer, root mean square",
        unit="m/s2",
        source="Chen et al. 2020",
        **NOISE,
    )
    acceleration_resolution: float = parameter(
        0.0, description="Quantisation step of every accelerometer, 0 for none", unit="m/s2", **NOISE
    )
    shear_noise: float = parameter(
        20.0, description="Noise of the load cells, root mean square", unit="N", source="assumed", **FORCE_NOISE
    )
    displacement_noise: float = parameter(
        5e-5,
        description="Noise of the table displacement, root mean square",
        unit="m",
        source="assumed",
        **DISPLACEMENT_NOISE,
    )
    force_noise: float = parameter(
        20.0, description="Noise of the actuator force, root mean square", unit="N", source="assumed", **FORCE_NOISE
    )
    specimen_stiffness_factor: float = parameter(
        1.0,
        description="Stiffness of every story of the simulated specimen over that of its model, the section specimen",
        unit="1",
        lower=0.1,
        upper=10.0,
    )
    specimen_damping_factor: float = parameter(
        1.0,
        description="Damping of every story of the simulated specimen over that of its model",
        unit="1",
        lower=0.0,
        upper=100.0,
    )
    command_gain: float = parameter(
        1.0, description="Gain of the simulated table over that of its dynamics", unit="1", lower=0.01, upper=100.0
    )
    unmodelled_mode: float = parameter(
        0.0,
        description="Share of a further mode of the simulated table at 25 Hz, damping ratio 2 %, in what it does; 0 "
        "for none",
        unit="1",
        source="assumed: for studies of robustness",
        lower=0.0,
        upper=0.9,
    )
    softening_factor: float = parameter(
        1.0,
        description="Stiffness of every story of the simulated specimen after softening_time over that before; 1 for "
        "a specimen that stays as it is",
        unit="1",
        lower=0.1,
        upper=10.0,
    )
    softening_time: float = parameter(
        0.0, description="Time of the test at which the simulated specimen softens", unit="s", lower=0.0, upper=1e5
    )
    yield_drifts: tuple[float, ...] = parameter(
        (),
        description="Drift at first yield of every story of the simulated specimen, from the table up; none for "
        "stories that do not yield",
        unit="m",
        **DRIFT,
    )
    post_yield_ratio: float = parameter(
        0.3,
        description="Stiffness after yield over initial stiffness of the simulated specimen, bilinear",
        unit="1",
        source="assumed",
        lower=0.0,
        upper=1.0,
    )

    def __post_init__(self) -> None:
        """Check the values and the table model."""
        check_parameters(self)
        if self.dynamics == "sections" and not self.sections:
            raise InputError("simulated_table.sections: empty; dynamics 'sections' requires at least one row of six")
        if not self.frequency_response:
            raise InputError(f"simulated_table.frequency_response: empty; a file, or {NO_FILE}, is required")
        if self.dynamics == "measured" and self.frequency_response == NO_FILE:
            raise InputError(f"simulated_table.frequency_response: {NO_FILE}; dynamics 'measured' requires a file")
        if self.dynamics == "interacting_servo" and self.platen_mass == 0.0:
            raise InputError("simulated_table.platen_mass: 0 kg; dynamics 'interacting_servo' requires > 0 kg")
        if self.yield_drifts and self.softening_factor != 1.0:
            raise InputError("simulated_table: softening_factor and yield_drifts; only one of them is possible")
        series(self.sections if self.dynamics == "measured" else self.own_sections)

    @property
    def damaged(self) -> bool:
        """The specimen does not stay what it is: it softens or yields, and the table is not one linear system."""
        return self.softening_factor != 1.0 or bool(self.yield_drifts)

    def softened(self, specimen: LinearBuilding) -> LinearBuilding:
        """Return a specimen with its stiffness after `softening_time`.

        Parameters
        ----------
        specimen : LinearBuilding
            As it is before.
        """
        return specimen.with_factors(stiffness=self.softening_factor)

    def softening_step(self, time_step: float) -> int:
        """Return the first step with the softer specimen.

        Parameters
        ----------
        time_step : float
            Δt [s].
        """
        return math.ceil(self.softening_time / time_step - 1e-9)

    def springs(self, specimen: LinearBuilding) -> tuple[BilinearSpring, ...]:
        """Return the stories of a specimen that yields, from the table up.

        Parameters
        ----------
        specimen : LinearBuilding
            With its initial stiffness; whatever its share of the true one is, it yields at the same drifts.

        Raises
        ------
        InputError
            There is not one yield drift a story, or the specimen has no stories.
        """
        chain = chain_of(specimen, "simulated_table.yield_drifts")
        if len(self.yield_drifts) != specimen.stories:
            raise InputError(
                f"simulated_table.yield_drifts: {len(self.yield_drifts)} entries; the specimen has {specimen.stories}"
            )
        pairs = zip(chain.stiffnesses, self.yield_drifts, strict=True)
        return tuple(BilinearSpring(stiffness, drift, self.post_yield_ratio) for stiffness, drift in pairs)

    def sensors(self, floors: int, seed: int) -> Sensors:
        """Return the simulated sensors.

        Parameters
        ----------
        floors : int
            Number of floors n.
        seed : int
            Seed of the noise.
        """
        accelerations = self.acceleration_noise, self.acceleration_resolution
        return Sensors(floors, *accelerations, self.shear_noise, self.displacement_noise, self.force_noise, seed)

    def specimen(self, model: LinearBuilding) -> LinearBuilding:
        """Return the true specimen on the simulated table: the model with `specimen_stiffness_factor`.

        Parameters
        ----------
        model : LinearBuilding
            The specimen as the section ``specimen`` describes it.
        """
        return model.with_factors(stiffness=self.specimen_stiffness_factor, damping=self.specimen_damping_factor)

    def plant(self, specimen: LinearBuilding) -> Plant:
        """Return table and specimen as one system, without the pure delay.

        Parameters
        ----------
        specimen : LinearBuilding
            What stands on the table.

        Returns
        -------
        Plant
        """
        if self.dynamics == "interacting_servo":
            plant = interacting_plant(*self._servo(), self.platen_mass, specimen)
        else:
            plant = driven_plant(series(self.own_sections), specimen)
        plant = plant._replace(b=self.command_gain * plant.b, feedthrough=self.command_gain * plant.feedthrough)
        if self.unmodelled_mode == 0.0:
            return plant
        numerator, denominator = self._mode()
        return commanded_through(series((*numerator, *denominator)), plant)

    @property
    def mode_zeros(self) -> NDArray[np.complex128]:
        """Zeros of the further mode, empty without one [rad/s]."""
        return np.roots(self._mode()[0]).astype(complex) if self.unmodelled_mode else np.zeros(0, complex)

    @property
    def mode_poles(self) -> NDArray[np.complex128]:
        """Poles of the further mode, empty without one [rad/s]."""
        return np.roots(self._mode()[1]).astype(complex) if self.unmodelled_mode else np.zeros(0, complex)

    def _mode(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator of 1 − g + g ω² / (s² + 2 ζ ω s + ω²)."""
        omega, rest = _UNMODELLED_FREQUENCY, 1.0 - self.unmodelled_mode
        damped = 2.0 * _UNMODELLED_DAMPING * omega
        return (rest, rest * damped, omega**2), (1.0, damped, omega**2)

    @property
    def own_sections(self) -> tuple[float, ...]:
        """Analog sections of the table as if nothing stood on it."""
        if self.dynamics == "measured" and not self.sections:
            raise InputError("simulated_table.frequency_response: not fitted yet; with_fitted_table(config) does it")
        if self.dynamics in ("sections", "measured"):
            return self.sections
        return () if self.dynamics == "perfect" else servo_sections(*self._servo())

    def _servo(self) -> tuple[float, float, float]:
        return self.servo_real_pole, self.servo_frequency, self.servo_damping_ratio
