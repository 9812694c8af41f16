"""The bands of the verdict: what the quality of a run has to keep to be called good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import check_parameters, parameter


@dataclass(frozen=True)
class VerdictConfig:
    """The bands of tracking error, delay and capture; a run is green only where all of them hold."""

    SECTION: ClassVar[str] = "verdict"

    largest_tracking_error: float = parameter(
        20.0,
        description="Largest root-mean-square error of the acceleration of the table against the desired one",
        unit="%",
        source="assumed",
        lower=0.0,
        upper=1e4,
    )
    largest_delay: float = parameter(
        2.5e-3,
        description="Largest delay or lead of the table, at the frequency where the desired acceleration is",
        unit="s",
        source="half a step of the 200 Hz of Chen et al. 2020; a delay τ takes ω τ / 2 of the damping ratio "
        "(Horiuchi et al. 1999): 4.7 % at 37 rad/s",
        lower=0.0,
        upper=1.0,
    )
    smallest_capture: float = parameter(
        0.9,
        description="Smallest share of a change of the specimen that the result follows, at interface and top; a test "
        "that follows less is a simulation",
        unit="1",
        source="assumed: a tenth of what is tested may be missed",
        lower=0.0,
        upper=1.0,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
