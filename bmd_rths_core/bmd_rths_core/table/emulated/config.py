"""Parameters of the virtual table controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import ACCELERATION, DISPLACEMENT, FORCE, SPEED


@dataclass(frozen=True)
class VirtualControllerConfig:
    """The virtual table controller of `bmd-rths emulate`: its table, its answers, its own limits."""

    SECTION: ClassVar[str] = "virtual_controller"

    model: str = parameter(
        "servo_hydraulic",
        description="Table: servo_hydraulic, or servo, which is the one of simulated_table",
        choices=("servo", "servo_hydraulic"),
    )
    answer_after: float = parameter(
        0.003,
        description="Real time: from a command to its answer, with the sensors as they are then",
        unit="s",
        source="leaves 2 ms of a step of 5 ms for the computer; the same share of a shorter one",
        lower=0.0,
        upper=0.1,
    )
    watchdog: float = parameter(
        0.05,
        description="Real time: silence of the host after which the table returns to rest",
        unit="s",
        source="assumed: ten steps",
        lower=0.005,
        upper=10.0,
    )
    return_frequency: float = parameter(
        6.0,
        description="Return to rest: that of a critically damped oscillator of this frequency; it takes 10 over it",
        unit="rad/s",
        source="assumed",
        lower=1.0,
        upper=50.0,
    )
    displacement_limit: float = parameter(
        0.25, description="Interlock: table displacement", unit="m", source="Chen et al. 2020: stroke", **DISPLACEMENT
    )
    velocity_limit: float = parameter(
        1.0, description="Interlock: commanded velocity", unit="m/s", source="assumed", **SPEED
    )
    acceleration_limit: float = parameter(
        30.0, description="Interlock: table acceleration", unit="m/s2", source="assumed", **ACCELERATION
    )
    force_limit: float = parameter(
        5e5, description="Interlock: actuator force", unit="N", source="Chen et al. 2020: force capacity", **FORCE
    )
    tracking_limit: float = parameter(
        0.05,
        description="Interlock: displacement of the table minus the commanded one",
        unit="m",
        source="assumed",
        lower=1e-06,
        upper=100.0,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
