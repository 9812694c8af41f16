"""Deadlines of a run: which steps closed in time, and how long each took. Times are given, no clock is read."""

from __future__ import annotations

import math

from bmd_rths_core.loop.closure_times import ClosureTimes
from bmd_rths_core.record import TimingStatistics


class DeadlineMonitor:
    """Count missed deadlines and collect closure times.

    A step is opened when its desired acceleration is published, and closed when its corrected shear has arrived. It
    misses its deadline when the next step is due by the clock before or just then, whoever was late.

    Parameters
    ----------
    time_step : float
        Δt [s].
    longest_miss : float
        Time without a shear that was back in time that is tolerated [s].

    Attributes
    ----------
    late_ticks : int
        Steps that began so long after they were due that the schedule moved.
    """

    def __init__(self, time_step: float, longest_miss: float) -> None:
        self._closures = ClosureTimes(time_step)
        self._tolerated = longest_miss
        self._step = -1
        self._opened_at = 0.0
        self._deadline = math.inf
        self._open = False
        self._consecutive = 0
        self._longest = 0
        self._missing_since = math.inf
        self._missed: list[int] = []
        self.late_ticks = 0

    @property
    def missed_deadlines(self) -> int:
        """Number of steps that missed their deadline so far."""
        return len(self._missed)

    def exhausted(self, now: float, next_deadline: float) -> bool:
        """Tell whether no shear has been back in time for longer than is tolerated.

        Parameters
        ----------
        now : float
            Time [s].
        next_deadline : float
            Deadline of the step that is about to begin: it may have passed already.
        """
        return now - min(self._missing_since, next_deadline) > self._tolerated * (1.0 - 1e-9)

    def opened(self, step: int, time: float, deadline: float) -> None:
        """Note that a step begins; the step before can close no more.

        Parameters
        ----------
        step : int
            Step index, one more than at the last call.
        time : float
            Time of a monotonic clock [s].
        deadline : float
            When the next step is due [s]; infinite in lockstep.
        """
        self.expired(time)
        self._step = step
        self._opened_at = time
        self._deadline = deadline
        self._open = True

    def closed(self, step: int, time: float) -> bool:
        """Note that the corrected shear of a step has arrived.

        Parameters
        ----------
        step : int
            Step index the shear belongs to.
        time : float
            Time of the same clock [s].

        Returns
        -------
        bool
            True when it closes the step that is open, in time or not; False for an early, older or repeated one.
        """
        if not self._open or step != self._step:
            return False
        if time >= self._deadline:
            self._miss()
        else:
            self._closures.add(time - self._opened_at)
            self._consecutive = 0
            self._missing_since = math.inf
        self._open = False
        return True

    def expired(self, time: float) -> None:
        """Note the time: the open step misses its deadline when that has passed.

        Parameters
        ----------
        time : float
            Time of the same clock [s].
        """
        if self._open and time >= self._deadline:
            self._open = False
            self._miss()

    def _miss(self) -> None:
        self._missed.append(self._step)
        self._missing_since = min(self._missing_since, self._deadline)
        self._consecutive += 1
        self._longest = max(self._longest, self._consecutive)

    def statistics(self) -> TimingStatistics:
        """Return the statistics so far; closure times are NaN when no step has closed in time."""
        p50, p99 = (self._closures.percentile(percent) for percent in (50.0, 99.0))
        return TimingStatistics(
            missed_deadlines=len(self._missed),
            max_consecutive_misses=self._longest,
            missed_steps=tuple(self._missed),
            late_ticks=self.late_ticks,
            closure_ms={"p50": 1e3 * p50, "p99": 1e3 * p99, "max": 1e3 * self._closures.longest},
            closure_counts=self._closures.counts,
        )
