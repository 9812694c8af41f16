"""Declare the limits: each has a value and an action."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import LIMITS_BY_UNIT, RAMP_ACCELERATION, RAMP_JERK, Bounds
from bmd_rths_core.safety.trips import ACTION_NAMES, Action


def _limit(default: float, description: str, unit: str, source: str, bounds: Bounds | None = None) -> Any:
    return parameter(default, description=description, unit=unit, source=source, **(bounds or LIMITS_BY_UNIT[unit]))


def _action(default: Action, limit: str, source: str = "") -> Any:
    description = f"What happens when {limit} is passed"
    return parameter(default.name.lower(), description=description, source=source, choices=ACTION_NAMES)


@dataclass(frozen=True)
class SafetyConfig:
    """Limits in the path of the command, how the table is brought to rest, and the stability indicator."""

    SECTION: ClassVar[str] = "safety"

    displacement_limit: float = _limit(
        0.23,
        "Largest displacement of the table: measured, or where it could be brought to rest after the command",
        "m",
        "assumed: stroke of +-250 mm in Chen et al. 2020, less 20 mm for the lag of the table",
    )
    displacement_action: str = parameter(
        "ramp",
        description="What happens when displacement_limit is passed; hold and ramp become an emergency stop where the "
        "table itself has passed it and does not follow the commands: it stands farther out than they have led it "
        "within the last following_time, by more than following_tolerance",
        choices=ACTION_NAMES,
    )
    following_time: float = parameter(
        0.05,
        description="Longest lag of a table that follows its commands",
        unit="s",
        source="assumed: twice the delay of the table in Chen et al. 2020",
        lower=0.0,
        upper=1.0,
    )
    following_tolerance: float = parameter(
        0.005,
        description="How much farther out than its commands a table that follows them may stand",
        unit="m",
        source="assumed: 1 % of the stroke of Chen et al. 2020",
        lower=0.0,
        upper=10.0,
    )
    velocity_limit: float = _limit(
        1.0,
        "Largest velocity of the table after the command and until it could be brought to rest",
        "m/s",
        "assumed: four times that of the stable runs at 1 m/s2",
    )
    velocity_action: str = _action(Action.RAMP, "velocity_limit")
    acceleration_limit: float = _limit(
        20.0,
        "Largest acceleration command",
        "m/s2",
        "assumed: about ten times the command of a stable run at 1 m/s2",
    )
    acceleration_action: str = _action(Action.RAMP, "acceleration_limit")
    force_limit: float = _limit(
        500e3, "Largest measured force of the actuator", "N", "Chen et al. 2020: capacity of +-500 kN"
    )
    force_action: str = _action(Action.RAMP, "force_limit")
    increment_limit: float = _limit(
        15.0,
        "Largest change of the acceleration command from one step to the next",
        "m/s2",
        "assumed: seven times that of the stable runs at 1 m/s2",
    )
    increment_action: str = _action(Action.RAMP, "increment_limit")
    tracking_limit: float = _limit(
        5.0,
        "Largest tracking error: root mean square over tracking_time of applied command less measured acceleration",
        "m/s2",
        "assumed: nearly three times that of the stable runs at 1 m/s2",
    )
    tracking_action: str = _action(Action.RAMP, "tracking_limit")
    tracking_time: float = _limit(0.5, "Time constant of the mean square of the tracking error", "s", "assumed")
    stale_shear_time: float = parameter(
        0.1,
        description="Longest time without a command, in whole steps; the last one is held meanwhile",
        unit="s",
        source="assumed: as run.longest_miss_time",
        lower=0.0,
        upper=600.0,
    )
    stale_shear_action: str = _action(Action.RAMP, "stale_shear_time")
    stale_controller_time: float = parameter(
        0.05,
        description="Longest time without a new measurement from the table controller, in whole steps",
        unit="s",
        source="assumed: 10 steps at 200 Hz",
        lower=0.0,
        upper=600.0,
    )
    stale_controller_action: str = _action(
        Action.EMERGENCY_STOP, "stale_controller_time", "a ramp cannot be trusted to a controller that is silent"
    )
    stuck_time: float = parameter(
        0.5,
        description="Longest time in which a sensor that has worked keeps its value while the table is moved, in whole "
        "steps; at least one",
        unit="s",
        source="assumed: 100 steps at 200 Hz",
        lower=0.0,
        lower_open=True,
        upper=600.0,
    )
    stuck_action: str = _action(Action.RAMP, "stuck_time")
    non_finite_action: str = parameter(
        "ramp",
        description="What happens when a command is not finite, or a sensor that was; it is never passed on",
        choices=ACTION_NAMES[Action.HOLD :],
    )
    stability_limit: float = _limit(
        0.7,
        "Largest stability indicator: logarithm of the factor by which the interface has raised the energy",
        "1",
        "assumed: ln 2, the energy doubled; docs/decisions/0009 has the measurements",
    )
    stability_action: str = _action(Action.RAMP, "stability_limit")
    stability_time: float = _limit(
        0.1, "Time constant of the mean power and energy of the stability indicator", "s", "docs/decisions/0009"
    )
    stability_floor: float = _limit(
        60.0,
        "Jerk of the numerical substructure, root mean square over its floors by their masses, at which growth counts "
        "half; above it more, below it less, by the ratio of the squares, but never nothing",
        "m/s3",
        "docs/decisions/0009: above sensor noise",
    )
    ramp_acceleration: float = _limit(
        5.0,
        "Largest acceleration while the table is braked and brought back; no more than acceleration_limit",
        "m/s2",
        "assumed",
        RAMP_ACCELERATION,
    )
    ramp_jerk: float = _limit(
        500.0,
        "Largest jerk while the table is braked and brought back",
        "m/s3",
        "assumed: that of the commands in stable runs at 1 m/s2",
        RAMP_JERK,
    )
    ramp_velocity: float = _limit(
        0.2, "Largest velocity while the table is brought back, not above velocity_limit", "m/s", "assumed"
    )
    high_pass_frequency: float = _limit(
        0.314,
        "Corner frequency of the high-pass that keeps displacement commands from drifting",
        "rad/s",
        "assumed: 0.05 Hz",
    )

    def __post_init__(self) -> None:
        """Check the values, and that the way to rest keeps the velocity limit."""
        check_parameters(self)
        if self.ramp_velocity > self.velocity_limit and self.action("velocity") is not Action.IGNORE:
            raise InputError(
                f"safety.ramp_velocity: {self.ramp_velocity:g} m/s on the way to rest passes safety.velocity_limit; "
                f"<= {self.velocity_limit:g} m/s is required"
            )

    @property
    def braking_acceleration(self) -> float:
        """Largest acceleration on the way to rest [m/s²]: that of the ramp, where the limit allows it."""
        if self.action("acceleration") is Action.IGNORE:
            return self.ramp_acceleration
        return min(self.ramp_acceleration, self.acceleration_limit)

    def action(self, limit: str) -> Action:
        """Return the action of a limit.

        Parameters
        ----------
        limit : str
            Name without ending, for example ``"displacement"``.
        """
        return Action[getattr(self, f"{limit}_action").upper()]
