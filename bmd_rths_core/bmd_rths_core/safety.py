"""Safety: the limits a command must keep before it reaches the table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import check_parameters, parameter


@dataclass(frozen=True)
class SafetyConfig:
    """Limits in the path of the command."""

    SECTION: ClassVar[str] = "safety"

    acceleration_limit: float = parameter(
        20.0,
        description="Largest acceleration command; a larger one ends the test",
        unit="m/s2",
        source="assumed: about ten times the command of a stable run at 1 m/s2",
        lower=0.0,
        lower_open=True,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


class LimitExceeded(Exception):
    """A command passed a limit: the test must end.

    Parameters
    ----------
    limit : str
        Name of the limit.
    value : float
        The value that passed it.
    allowed : float
        The limit.
    step : int
        Step index.
    """

    def __init__(self, limit: str, value: float, allowed: float, step: int) -> None:
        super().__init__(f"{limit} passed at step {step}: {value:.6g}, allowed is ±{allowed:.6g}")
        self.step = step


class CommandLimit:
    """Refuse a command that is not finite or too large. Nothing is ever clipped.

    Parameters
    ----------
    config : SafetyConfig
        Limits.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._limit = config.acceleration_limit

    def step(self, step: int, command: float) -> None:
        """Check the command of a step.

        Parameters
        ----------
        step : int
            Step index.
        command : float
            Acceleration command [m/s²].

        Raises
        ------
        LimitExceeded
            The command must not reach the table.
        """
        if not math.isfinite(command) or abs(command) > self._limit:
            raise LimitExceeded("safety.acceleration_limit [m/s2]", command, self._limit, step)
