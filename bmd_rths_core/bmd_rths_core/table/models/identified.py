"""The models that `bmd-rths identify` writes for compensators and judges: table, specimen, noise of the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import (
    COEFFICIENT,
    DAMPING,
    DISPLACEMENT_VARIANCE,
    FORCE_VARIANCE,
    MASS,
    POLE,
    POLE_DAMPING,
    POSITIVE_FACTOR,
    STIFFNESS,
    VARIANCE,
)
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.dynamics import series
from bmd_rths_core.table.models.plant import HydraulicServo, Plant, driven_plant, hydraulic_plant, interacting_plant


@dataclass(frozen=True)
class IdentifiedModelConfig:
    """What was identified of a table with the specimen on it. A simulated table does not change with it."""

    SECTION: ClassVar[str] = "identified_model"

    table: str = parameter(
        "none",
        description="Structure of the identified table: none yet, a third-order servo that the specimen pulls at, the "
        "same with oil column and servovalve, or the sections given",
        choices=("none", "interacting_servo", "hydraulic_servo", "sections"),
    )
    gain: float = parameter(
        1.0, description="Gain of the servo at zero frequency", unit="1", source="bmd-rths identify", **POSITIVE_FACTOR
    )
    servo_real_pole: float = parameter(
        50.0, description="Real pole of the servo", unit="rad/s", source="bmd-rths identify", **POLE
    )
    servo_frequency: float = parameter(
        150.0,
        description="Natural frequency of the oscillatory pair of the servo",
        unit="rad/s",
        source="bmd-rths identify",
        **POLE,
    )
    servo_damping_ratio: float = parameter(
        0.1,
        description="Damping ratio of the oscillatory pair of the servo",
        unit="1",
        source="bmd-rths identify",
        **POLE_DAMPING,
    )
    platen_mass: float = parameter(
        5000.0,
        description="Mass of platen and piston that the specimen pulls at",
        unit="kg",
        source="bmd-rths identify",
        **MASS,
    )
    proportional_gain: float = parameter(
        40.0,
        description="Hydraulic servo: valve velocity per displacement error",
        unit="1/s",
        source="bmd-rths identify",
        **POLE,
    )
    oil_frequency: float = parameter(
        160.0,
        description="Hydraulic servo: natural frequency of platen and oil column",
        unit="rad/s",
        source="bmd-rths identify",
        **POLE,
    )
    leakage_rate: float = parameter(
        5.0,
        description="Hydraulic servo: share of the load pressure that leaks in a second",
        unit="1/s",
        source="bmd-rths identify",
        lower=0.0,
        upper=1e4,
    )
    valve_frequency: float = parameter(
        400.0,
        description="Hydraulic servo: natural frequency of the servovalve",
        unit="rad/s",
        source="bmd-rths identify",
        **POLE,
    )
    valve_damping_ratio: float = parameter(
        0.7,
        description="Hydraulic servo: damping ratio of the servovalve",
        unit="1",
        source="bmd-rths identify",
        **POLE_DAMPING,
    )
    pressure_feedback: float = parameter(
        0.0,
        description="Hydraulic servo: valve velocity per acceleration the load pressure gives the platen",
        unit="s",
        source="bmd-rths identify",
        lower=0.0,
        upper=10.0,
    )
    sections: tuple[float, ...] = parameter(
        (),
        description="Analog sections in series, rows of b2 b1 b0 a2 a1 a0, used when table is sections",
        unit="coefficients of s2, s and 1",
        source="bmd-rths identify",
        **COEFFICIENT,
    )
    command_delay: float = parameter(
        0.0, description="Pure delay of the command", unit="s", source="bmd-rths identify", lower=0.0, upper=1.0
    )
    stiffnesses: tuple[float, ...] = parameter(
        (),
        description="Identified story stiffnesses of the specimen; none take those of the section specimen",
        unit="N/m",
        source="bmd-rths identify",
        **STIFFNESS,
    )
    damping_coefficients: tuple[float, ...] = parameter(
        (),
        description="Identified damping coefficients of the specimen, with the stiffnesses",
        unit="N s/m",
        source="bmd-rths identify",
        **DAMPING,
    )
    table_deviations: tuple[float, ...] = parameter(
        (),
        description="Standard deviations of gain, servo_real_pole, servo_frequency, servo_damping_ratio, platen_mass "
        "and command_delay, for studies of robustness; of a hydraulic servo those of gain, proportional_gain, "
        "oil_frequency, leakage_rate, platen_mass, valve_frequency, valve_damping_ratio, pressure_feedback and "
        "command_delay; none where they are not known",
        unit="of each",
        source="bmd-rths identify",
        lower=0.0,
        upper=1e8,
    )
    stiffness_deviations: tuple[float, ...] = parameter(
        (),
        description="Standard deviations of the stiffnesses",
        unit="N/m",
        source="bmd-rths identify",
        lower=0.0,
        upper=1e12,
    )
    damping_deviations: tuple[float, ...] = parameter(
        (),
        description="Standard deviations of the damping coefficients",
        unit="N s/m",
        source="bmd-rths identify",
        lower=0.0,
        upper=1e12,
    )
    acceleration_noise: float = parameter(
        0.0524,
        description="Noise of the accelerometers, root mean square",
        unit="m/s2",
        source="Chen et al. 2020",
        **VARIANCE,
    )
    displacement_noise: float = parameter(
        5e-5,
        description="Noise of the displacement of the table, root mean square",
        unit="m",
        source="assumed",
        **DISPLACEMENT_VARIANCE,
    )
    shear_noise: float = parameter(
        20.0, description="Noise of the load cells, root mean square", unit="N", source="assumed", **FORCE_VARIANCE
    )

    def __post_init__(self) -> None:
        """Check the values and the table model."""
        check_parameters(self)
        if self.table == "sections" and not self.sections:
            raise InputError("identified_model.sections: empty; table 'sections' requires at least one row of six")
        if len(self.stiffnesses) != len(self.damping_coefficients):
            raise InputError(
                "identified_model: stiffnesses and damping_coefficients need one entry a story each; "
                f"they have {len(self.stiffnesses)} and {len(self.damping_coefficients)} entries"
            )
        stories = len(self.stiffnesses)
        of_table = 9 if self.table == "hydraulic_servo" else 6
        for name, expected in (("table", of_table), ("stiffness", stories), ("damping", stories)):
            entries = len(getattr(self, f"{name}_deviations"))
            if entries not in (0, expected):
                raise InputError(
                    f"identified_model.{name}_deviations: {entries} entries; {expected} or none are required"
                )
        series(self.sections)

    def specimen(self, nominal: LinearBuilding) -> LinearBuilding:
        """Return the identified specimen with the given floor masses, or the nominal one where none was identified.

        Parameters
        ----------
        nominal : LinearBuilding
            Its floor masses, and the specimen where none was identified.

        Raises
        ------
        InputError
            The identified specimen has another number of stories.
        """
        if not self.stiffnesses:
            return nominal
        if len(self.stiffnesses) != nominal.stories:
            raise InputError(
                f"identified_model.stiffnesses: {len(self.stiffnesses)} entries; the specimen has {nominal.stories}"
            )
        return ShearBuilding(nominal.masses, self.stiffnesses, self.damping_coefficients)

    def plant(self, specimen: LinearBuilding) -> Plant | None:
        """Return table and specimen as one system without the pure delay, or None where no table was identified.

        Parameters
        ----------
        specimen : LinearBuilding
            The specimen on the table.
        """
        if self.table == "none":
            return None
        if self.table == "sections":
            return driven_plant(series(self.sections), specimen)
        if self.table == "hydraulic_servo":
            plant = hydraulic_plant(HydraulicServo(*(getattr(self, n) for n in HydraulicServo._fields)), specimen)
        else:
            servo = self.servo_real_pole, self.servo_frequency, self.servo_damping_ratio
            plant = interacting_plant(*servo, self.platen_mass, specimen)
        return plant._replace(b=self.gain * plant.b)
