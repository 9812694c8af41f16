"""A run as the sections of its report see it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.numerical_motion import NumericalMotion, numerical_motion
from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.analysis.whole_samples import strong_motion
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord

T = TypeVar("T")

#: Fewer steps than this make no history.
_LEAST_STEPS = 3


#: Length of what is shown closely [s]: some ten periods of the buildings that stand on shake tables.
CLOSE = 3.0


class CloseUp(NamedTuple):
    """A window of time.

    Parameters
    ----------
    begin, end : float
        [s].
    name : str
        What it is.
    """

    begin: float
    end: float
    name: str

    @property
    def limits(self) -> tuple[float, float]:
        """Begin and end [s]."""
        return self.begin, self.end


@dataclass(frozen=True)
class ReportedRun:
    """One run, of any length, with any gaps; what it does not have is a reason why a section cannot be shown.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.
    timing : StepTiming or str
        Its timing, or why it has none.
    window : tuple of float, optional
        Begin and end of what is shown closely [s]; by default `CLOSE` s around the largest response.
    """

    analysis: RunAnalysis
    timing: StepTiming | str
    window: tuple[float, float] | None = None

    @property
    def record(self) -> RunRecord:
        """The record of the run."""
        return self.analysis.record

    @property
    def config(self) -> Config:
        """The configuration of the run."""
        return self.analysis.config

    @cached_property
    def motion(self) -> NumericalMotion:
        """The numerical substructure, computed again."""
        return numerical_motion(self.record, self.config)

    @cached_property
    def strong_motion(self) -> tuple[float, float]:
        """Begin and end of the strong motion [s]."""
        return strong_motion(self.record.ground_acceleration, self.record.time_step)

    @cached_property
    def closely(self) -> CloseUp:
        """What is shown so closely that curves which nearly agree are told apart in print."""
        if self.window is not None:
            return CloseUp(*self.window, "as chosen")
        response, step = np.abs(self.analysis.reference[:, -1]), self.record.time_step
        middle = float(np.argmax(response)) * step if len(response) else 0.0
        last = max(self.record.steps - 1, 0) * step
        begin = max(0.0, min(middle, last - 0.5 * CLOSE) - 0.5 * CLOSE)
        return CloseUp(begin, max(min(begin + CLOSE, last), begin + step), "around the largest response")

    @property
    def no_history(self) -> str:
        """Why there is no history; empty where there is one."""
        steps = self.record.steps
        return "" if steps >= _LEAST_STEPS else f"a history needs {_LEAST_STEPS} steps, the run has {steps}"

    @property
    def no_forces(self) -> str:
        """Why there are no forces; empty where there are."""
        return self.no_history or _missing(self.record.required_force, "forces")

    @property
    def no_table(self) -> str:
        """Why there is no acceleration of the table; empty where there is."""
        return self.no_history or _missing(self.record.table_acceleration, "acceleration of the table")

    @property
    def no_floors(self) -> str:
        """Why there are no accelerations of table and floors; empty where there are."""
        expected, found = len(self.config.specimen.masses), self.record.floor_accelerations.shape[1]
        if self.no_table or found != expected:
            return self.no_table or f"the record has {found} measured floors, the specimen {expected}"
        floors = enumerate(self.record.floor_accelerations.T, 1)
        return next((reason for i, floor in floors if (reason := _missing(floor, f"floor {i}"))), "")


def part(reason: str, compute: Callable[[], T]) -> T | str:
    """Return a part of a report, or why there is none.

    Parameters
    ----------
    reason : str
        Why it cannot be computed; empty where nothing is known against it.
    compute : callable
        Returns it, or raises `InputError`.
    """
    if reason:
        return reason
    try:
        return compute()
    except InputError as error:
        return str(error)


def _missing(signal: NDArray[np.float64], name: str) -> str:
    return "" if np.isfinite(signal).any() else f"nothing was recorded of the {name}"
