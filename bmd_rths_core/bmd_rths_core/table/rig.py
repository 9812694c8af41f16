"""What a shake table can do, told once: limits, interlocks and the emulated actuator follow from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import ACCELERATION, ADDED_MASS, DISPLACEMENT, FORCE, SPEED
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicConfig

#: Share of the capacity at which the supervisor acts, before the interlock of the controller does at the whole of it.
_SUPERVISED = {"displacement": 0.92, "velocity": 0.9, "acceleration": 0.9, "force": 0.9}

#: Ratios of the table of Chen et al. 2020 as this project assumes it, kept for another size of table.
_FOLLOWING_TOLERANCE, _TRACKING = 0.02, 0.2  # m over m of stroke
_INCREMENT = 0.75  # change of the command over its limit
_PLATEN = 0.01  # kg over N of force
_VISCOUS, _COULOMB = 2.0, 8e-4  # N s/m over kg of platen, N over N of force
_LEAKAGE = 1e-11 / 0.0133  # m³/(s Pa) over m³ of oil
_DEAD_VOLUME = 1.1  # oil under pressure over piston area times both strokes

#: Largest speed and acceleration on the way to rest, and tracking error, of a table that can do more.
_RAMP_VELOCITY, _RAMP_ACCELERATION, _TRACKING_ERROR = 0.2, 5.0, 5.0

_CAPACITY = {"displacement": "stroke", "velocity": "velocity", "acceleration": "acceleration", "force": "force"}
_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2", "force": "N"}


@dataclass(frozen=True)
class RigConfig:
    """Capacity of the shake table; what is not told here keeps the defaults of its section."""

    SECTION: ClassVar[str] = "rig"

    stroke: float = parameter(
        0.0,
        description="Largest displacement of the table to either side; 0 does not tell it",
        unit="m",
        source="data sheet",
        lower=0.0,
        upper=DISPLACEMENT["upper"],
    )
    velocity: float = parameter(
        0.0,
        description="Largest velocity of the table; 0 does not tell it",
        unit="m/s",
        source="data sheet",
        lower=0.0,
        upper=SPEED["upper"],
    )
    acceleration: float = parameter(
        0.0,
        description="Largest acceleration of the table with the specimen on it; 0 does not tell it",
        unit="m/s2",
        source="data sheet",
        lower=0.0,
        upper=ACCELERATION["upper"],
    )
    force: float = parameter(
        0.0,
        description="Largest force of the actuator; 0 does not tell it",
        unit="N",
        source="data sheet",
        lower=0.0,
        upper=FORCE["upper"],
    )
    platen_mass: float = parameter(
        0.0,
        description="Mass of platen and piston; 0 takes 10 kg for each kN of force",
        unit="kg",
        source="data sheet",
        **ADDED_MASS,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)

    @property
    def told(self) -> bool:
        """True when anything is told."""
        return any((self.stroke, self.velocity, self.acceleration, self.force, self.platen_mass))

    def derived(self, supply_pressure: float = ServoHydraulicConfig.supply_pressure) -> dict[str, dict[str, float]]:
        """Return the parameters that follow from the capacity, where nothing else is said of them.

        Parameters
        ----------
        supply_pressure : float
            Of the emulated actuator [Pa].

        Returns
        -------
        dict of str to dict
            Section to parameter to value. What is not told has no entry.
        """
        safety: dict[str, float] = {}
        controller: dict[str, float] = {}
        hydraulic: dict[str, float] = {}
        simulated: dict[str, float] = {}
        for quantity, name in _CAPACITY.items():
            if capacity := getattr(self, name):
                safety[f"{quantity}_limit"] = _SUPERVISED[quantity] * capacity
                controller[f"{quantity}_limit"] = capacity
        if self.stroke:
            safety["following_tolerance"] = _FOLLOWING_TOLERANCE * self.stroke
            controller["tracking_limit"] = _TRACKING * self.stroke
            hydraulic["stroke"] = self.stroke
        if self.velocity:
            safety["ramp_velocity"] = min(_RAMP_VELOCITY, safety["velocity_limit"])
            hydraulic["rated_velocity"] = self.velocity
        if self.acceleration:
            limit = safety["acceleration_limit"]
            safety |= {
                "increment_limit": _INCREMENT * limit,
                "ramp_acceleration": min(_RAMP_ACCELERATION, limit),
                "tracking_limit": min(_TRACKING_ERROR, limit),
            }
        if self.force:
            hydraulic |= {"force_capacity": self.force, "coulomb_friction": _COULOMB * self.force}
        if platen := self.platen_mass or _PLATEN * self.force:
            hydraulic |= {"platen_mass": platen, "viscous_damping": _VISCOUS * platen}
            simulated["platen_mass"] = platen
        if self.force or self.stroke:
            area = (self.force or ServoHydraulicConfig.force_capacity) / supply_pressure
            volume = _DEAD_VOLUME * area * 2.0 * (self.stroke or ServoHydraulicConfig.stroke)
            hydraulic |= {"oil_volume": volume, "leakage": _LEAKAGE * volume}
        if hydraulic:
            # The valve and the pressure feedback are as fast, against the oil column, as those of the defaults.
            share = _oil_frequency(ServoHydraulicConfig()) / _oil_frequency(ServoHydraulicConfig(**hydraulic))
            if share < 1.0:
                hydraulic["valve_frequency"] = ServoHydraulicConfig.valve_frequency / share
            hydraulic["pressure_feedback"] = share * ServoHydraulicConfig.pressure_feedback
        sections = {
            "safety": safety,
            "virtual_controller": controller,
            "servo_hydraulic": hydraulic,
            "simulated_table": simulated,
        }
        return {name: {key: float(f"{v:.9g}") for key, v in values.items()} for name, values in sections.items()}

    def refuse_beyond(self, sections: Mapping[str, Any]) -> None:
        """Refuse a limit above the capacity.

        Parameters
        ----------
        sections : Mapping of str to Any
            Configuration sections with ``displacement_limit`` and so on.

        Raises
        ------
        InputError
            A limit is above what the table can do.
        """
        for section, config in sections.items():
            for quantity, name in _CAPACITY.items():
                capacity, limit = getattr(self, name), getattr(config, f"{quantity}_limit")
                if capacity and limit > capacity:
                    unit = _UNITS[quantity]
                    hint = f" (given in thousandths, it is {1e-3 * limit:g} {unit})" if limit < 1e3 * capacity else ""
                    raise InputError(
                        f"{section}.{quantity}_limit: {limit:g} {unit} is above the capacity of the table; "
                        f"<= {capacity:g} {unit}, rig.{name}, is required{hint}"
                    )


def _oil_frequency(config: ServoHydraulicConfig) -> float:
    return math.sqrt(config.oil_frequency_squared)
