"""Servo-hydraulic shake table under displacement control with the specimen on it: a non-linear model.

An acceleration command is integrated twice, with a washout against drift, to the reference displacement. A
proportional-integral displacement loop with differential-pressure feedback drives a servovalve, the valve feeds an oil
column, and the oil moves platen and specimen, whose base shear acts back on the platen. Non-linear are the flow through
the valve, its opening, the relief valves, Coulomb friction and the end stops (Merritt, Hydraulic Control Systems,
1967; Conte and Trombetti, Earthq. Eng. Struct. Dyn. 29, 2000). docs/reference/virtual_table.md compares it with Eq. 9.

All states are motions: the valve opening as the velocity q it gives without load [m/s], the load pressure as the
acceleration z it gives the platen [m/s²].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import first_order_hold, zero_order_hold
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import DAMPING, FORCE, FORCE_NOISE, MASS, SPEED
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.models.model_table import ModelTable
from bmd_rths_core.table.models.sensors import Sensors

FloatArray = NDArray[np.float64]

#: Longest step of the integration [s].
LONGEST_SUBSTEP = 0.5e-3

#: Velocity above which Coulomb friction has its full value [m/s].
FRICTION_VELOCITY = 2e-3

#: Stiffness of the end stops over the platen mass [1/s²], and damping over it [1/s].
STOP_STIFFNESS, STOP_DAMPING = 2e5, 200.0

#: Time in which the relief valves take away a pressure above that of the supply [s].
RELIEF_TIME = 1e-3

#: Damping ratio of the washout.
WASHOUT_DAMPING = 0.7

#: Real part of a pole [1/s] up to which rounding may lead it; the washout and the integral gain may be off.
_NEUTRAL = 1e-6

#: Number of non-linear effects: flow, valve opening, force.
EFFECTS = 3

#: Positions of the states; the specimen follows, relative to the table.
REFERENCE, REFERENCE_RATE, ERROR, POSITION, VELOCITY, PRESSURE, SPOOL, SPOOL_RATE, SPECIMEN = range(9)


@dataclass(frozen=True)
class ServoHydraulicConfig:
    """The virtual servo-hydraulic shake table; its accelerometers are those of simulated_table."""

    SECTION: ClassVar[str] = "servo_hydraulic"

    force_capacity: float = parameter(
        5e5, description="Force of the actuator at supply pressure", unit="N", source="Chen et al. 2020", **FORCE
    )
    stroke: float = parameter(
        0.25,
        description="Displacement at which the end stops begin",
        unit="m",
        source="Chen et al. 2020",
        lower=0.001,
        upper=100.0,
    )
    supply_pressure: float = parameter(
        20.7e6, description="Supply pressure", unit="Pa", source="assumed: 3000 psi", lower=100000.0, upper=1000000000.0
    )
    rated_velocity: float = parameter(
        1.0,
        description="Velocity at full valve opening without load: rated flow over piston area",
        unit="m/s",
        source="assumed",
        **SPEED,
    )
    bulk_modulus: float = parameter(
        7e8,
        description="Effective bulk modulus of the oil",
        unit="Pa",
        source="assumed; usual with hoses and air",
        lower=10000000.0,
        upper=100000000000.0,
    )
    oil_volume: float = parameter(
        0.0133,
        description="Oil under pressure in both chambers and lines",
        unit="m3",
        source="assumed: piston area times both strokes, and 10 %",
        lower=1e-07,
        upper=10.0,
    )
    leakage: float = parameter(
        1e-11, description="Leakage across the piston", unit="m3/(s Pa)", source="assumed", lower=0.0, upper=1e-06
    )
    platen_mass: float = parameter(5000.0, description="Mass of platen and piston", unit="kg", source="assumed", **MASS)
    viscous_damping: float = parameter(
        10e3, description="Viscous damping of bearings and seals", unit="N s/m", source="assumed", **DAMPING
    )
    coulomb_friction: float = parameter(
        400.0, description="Coulomb friction of bearings and seals", unit="N", source="assumed", **FORCE_NOISE
    )
    valve_frequency: float = parameter(
        400.0,
        description="Natural frequency of the servovalve",
        unit="rad/s",
        source="assumed",
        lower=1.0,
        upper=100000.0,
    )
    valve_damping_ratio: float = parameter(
        0.7, description="Damping ratio of the servovalve", unit="1", source="assumed", lower=0.01, upper=10.0
    )
    proportional_gain: float = parameter(
        36.0,
        description="Valve velocity per displacement error",
        unit="1/s",
        source="tuned: 26 ms of delay, gain 0.62 at 15 Hz",
        lower=0.001,
        upper=100000.0,
    )
    integral_gain: float = parameter(
        0.2,
        description="Valve velocity per integral of the displacement error",
        unit="1/s2",
        source="assumed",
        lower=0.0,
        upper=100000.0,
    )
    velocity_feedforward: float = parameter(
        0.0,
        description="Share of the reference velocity fed forward to the valve",
        unit="1",
        source="tuned: 26 ms of delay, gain 0.62 at 15 Hz",
        lower=0.0,
        upper=1.0,
    )
    pressure_feedback: float = parameter(
        2e-3,
        description="Valve velocity per acceleration the differential pressure gives the platen",
        unit="s",
        source="tuned: 26 ms of delay, gain 0.62 at 15 Hz",
        lower=0.0,
        upper=10.0,
    )
    washout_frequency: float = parameter(
        0.0628,
        description="Natural frequency of the washout against drift of the reference",
        unit="rad/s",
        source="assumed: 0.01 Hz",
        lower=0.0,
        upper=10000.0,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)

    @property
    def piston_area(self) -> float:
        """Area of the piston [m²]."""
        return self.force_capacity / self.supply_pressure

    @property
    def oil_frequency_squared(self) -> float:
        """Stiffness of the oil column over the platen mass, 4 β A² / (V M) [1/s²]."""
        return 4.0 * self.bulk_modulus * self.piston_area**2 / (self.oil_volume * self.platen_mass)


class ServoHydraulicTable(ModelTable):
    """A table controller whose table is the servo-hydraulic model.

    The linear part is advanced by its exact discretisation; what is not linear is an input of it that is taken as
    linear over each substep of at most `LONGEST_SUBSTEP`, by one prediction and one correction (second order).

    Parameters
    ----------
    config : ServoHydraulicConfig
        Hydraulics and controller.
    sensors : Sensors
        Noise and quantisation.
    specimen : LinearBuilding
        What stands on the table, n floors.
    time_step : float
        Δt [s].
    """

    def __init__(
        self, config: ServoHydraulicConfig, sensors: Sensors, specimen: LinearBuilding, time_step: float
    ) -> None:
        self._config = config
        self._masses = np.asarray(specimen.masses)
        self._force_capacity = config.force_capacity / config.platen_mass
        self._friction = config.coulomb_friction / config.platen_mass
        self._relief = 1.0 / (config.oil_frequency_squared * RELIEF_TIME)
        self._a, self._b, by_effects, self._observed, self._output = _linear_part(config, specimen)
        self._substeps = math.ceil(time_step / LONGEST_SUBSTEP - 1e-9)
        substep = time_step / self._substeps
        phi, by_command = zero_order_hold(self._a, self._b, substep)
        _, first, last = first_order_hold(self._a, by_effects, substep)
        # The prediction holds the effects of the beginning; only what the effects depend on has to be predicted.
        self._predict = self._observed @ np.hstack((phi, by_command, first + last))
        corrected = np.hstack((phi, by_command, first, last))
        self._correct = np.vstack((corrected, self._observed @ corrected))
        super().__init__(sensors)

    @property
    def reference(self) -> tuple[float, float]:
        """Reference displacement [m] and velocity [m/s]."""
        return float(self._state[REFERENCE]), float(self._state[REFERENCE_RATE])

    def degrade(self, valve: float, supply: float) -> None:
        """Change what the hydraulics can do.

        Parameters
        ----------
        valve : float
            Opening the valve still reaches, as a share of the full one.
        supply : float
            Supply pressure that is left, as a share.
        """
        self._largest_opening = valve * self._config.rated_velocity
        self._supply = supply

    def frequency_response(self, omega: FloatArray) -> NDArray[np.complex128]:
        """Return table acceleration over acceleration command, linearised about a small steady motion.

        Friction has its sign and not its size there, so only viscous damping counts; valve and oil are those at
        mid-opening without load.

        Parameters
        ----------
        omega : ndarray
            Frequencies [rad/s].

        Returns
        -------
        ndarray of complex
            G(jω).
        """
        identity = np.eye(len(self._a))
        return np.array([self._output[0] @ np.linalg.solve(1j * w * identity - self._a, self._b[:, 0]) for w in omega])

    def _rest(self) -> None:
        size = len(self._a)
        # States, command, effects at the beginning and at the end of a substep: one vector, one product a substep.
        self._work = np.zeros(size + 1 + 2 * EFFECTS)
        self._state = self._work[:size]
        self.degrade(1.0, 1.0)

    def _advance(self, command: TableCommand) -> TableMeasurement:
        self._hold(command.acceleration)
        accelerations = self._output @ self._state
        accelerations[0] += self._effects(*(self._observed @ self._state).tolist())[2]
        displacement, velocity = float(self._state[POSITION]), float(self._state[VELOCITY])
        force = self._config.platen_mass * float(self._state[PRESSURE])
        self.motion = TrueMotion(displacement, velocity, float(accelerations[0]), force)
        return self._sensors.read(
            step=command.step,
            applied_command=command.acceleration,
            displacement=displacement,
            accelerations=accelerations,
            actuator_force=force,
            base_shear=-float(self._masses @ accelerations[1:]),
        )

    def _hold(self, acceleration: float) -> None:
        work, size, effects = self._work, len(self._a), self._effects
        at_begin, at_end = slice(size + 1, size + 1 + EFFECTS), slice(size + 1 + EFFECTS, None)
        known = work[: size + 1 + EFFECTS]
        work[size] = acceleration
        observed = (self._observed @ self._state).tolist()
        for _ in range(self._substeps):
            work[at_begin] = effects(*observed)
            work[at_end] = effects(*(self._predict @ known).tolist())
            corrected = self._correct @ work
            work[:size] = corrected[:size]
            observed = corrected[size:].tolist()

    def _effects(
        self, position: float, velocity: float, pressure: float, spool: float, wanted: float
    ) -> tuple[float, float, float]:
        """Return the non-linear effects: flow [m/s], valve command [m/s], force on the platen [m/s²]."""
        share = pressure / self._force_capacity
        drop = self._supply - math.copysign(share, spool * pressure)
        flow = spool * (math.sqrt(drop if drop > 0.0 else 0.0) - 1.0)
        if abs(share) > 1.0:
            flow -= self._relief * (pressure - math.copysign(self._force_capacity, pressure))
        limit = self._largest_opening
        opening = (limit if wanted > limit else -limit if wanted < -limit else wanted) - wanted
        force = -self._friction * math.tanh(velocity / FRICTION_VELOCITY)
        beyond = abs(position) - self._config.stroke
        if beyond > 0.0:
            force -= math.copysign(STOP_STIFFNESS * beyond, position) + STOP_DAMPING * velocity
        return flow, opening, force


def refuse_unstable(config: ServoHydraulicConfig, specimen: LinearBuilding) -> None:
    """Refuse a table that is not stable with its specimen on it, before anything is moved.

    Parameters
    ----------
    config : ServoHydraulicConfig
        Hydraulics and controller.
    specimen : LinearBuilding
        What stands on the table.

    Raises
    ------
    InputError
        A pole of the linear part is in the right half-plane.
    """
    pole = max(np.linalg.eigvals(_linear_part(config, specimen)[0]), key=lambda value: value.real)
    if pole.real > _NEUTRAL:
        oil = math.sqrt(config.oil_frequency_squared) / (2.0 * math.pi)
        raise InputError(
            f"servo_hydraulic: the emulated table is not stable, with a pole at {pole.real:.3g} 1/s and "
            f"{abs(pole.imag) / (2.0 * math.pi):.3g} Hz; an oil column faster than its {oil:.3g} Hz (oil_volume "
            f"{config.oil_volume:g} m3; rig.stroke and rig.force derive one), a proportional_gain smaller than "
            f"{config.proportional_gain:g} 1/s or a pressure_feedback other than {config.pressure_feedback:g} s "
            "is required"
        )


def _linear_part(
    config: ServoHydraulicConfig, specimen: LinearBuilding
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the linear part: A, B of the command, B of the effects, and two output matrices.

    The first output matrix gives what the effects depend on: position, velocity, pressure, valve opening and the
    opening that the controller wants; the second the accelerations of table and floors.
    """
    floors_a, floors_b, floors_c = specimen.relative_motion()
    size = SPECIMEN + len(floors_a)
    floors = slice(SPECIMEN, size)
    unit = np.eye(size)
    oil, valve, washout = config.oil_frequency_squared, config.valve_frequency, config.washout_frequency

    table = unit[PRESSURE] - config.viscous_damping / config.platen_mass * unit[VELOCITY]
    table[floors] = -np.asarray(specimen.masses) @ floors_c / config.platen_mass
    wanted = (
        config.proportional_gain * (unit[REFERENCE] - unit[POSITION])
        + config.integral_gain * unit[ERROR]
        + config.velocity_feedforward * unit[REFERENCE_RATE]
        - config.pressure_feedback * unit[PRESSURE]
    )
    a = np.zeros((size, size))
    a[REFERENCE] = unit[REFERENCE_RATE]
    a[REFERENCE_RATE] = -(washout**2) * unit[REFERENCE] - 2.0 * WASHOUT_DAMPING * washout * unit[REFERENCE_RATE]
    a[ERROR] = unit[REFERENCE] - unit[POSITION]
    a[POSITION] = unit[VELOCITY]
    a[VELOCITY] = table
    # The leakage takes 4 beta C / V of the pressure in a second.
    leak = 4.0 * config.bulk_modulus * config.leakage / config.oil_volume
    a[PRESSURE] = oil * (unit[SPOOL] - unit[VELOCITY]) - leak * unit[PRESSURE]
    a[SPOOL] = unit[SPOOL_RATE]
    a[SPOOL_RATE] = valve**2 * (wanted - unit[SPOOL]) - 2.0 * config.valve_damping_ratio * valve * unit[SPOOL_RATE]
    a[floors] = floors_b @ table[None, :]
    a[floors, floors] += floors_a

    by_command = unit[:, [REFERENCE_RATE]]
    by_effects = np.zeros((size, EFFECTS))
    by_effects[PRESSURE, 0] = oil
    by_effects[SPOOL_RATE, 1] = valve**2
    by_effects[VELOCITY, 2] = 1.0
    by_effects[floors, 2] = floors_b[:, 0]

    observed = np.vstack((unit[POSITION], unit[VELOCITY], unit[PRESSURE], unit[SPOOL], wanted))
    output = np.zeros((1 + specimen.stories, size))
    output[0] = table
    output[1:, floors] = floors_c
    return a, by_command, by_effects, observed, output
