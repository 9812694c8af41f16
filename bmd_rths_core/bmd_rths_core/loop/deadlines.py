"""Deadlines of a run: which steps closed in time, and how long each took. Times are given, no clock is read."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.record import TimingStatistics


class DeadlineMonitor:
    """Count missed deadlines and collect closure times.

    A step is opened when its desired acceleration is published and closed when its corrected shear has arrived. It
    misses its deadline when the next step has to begin before that.

    Parameters
    ----------
    steps : int
        Number of steps of the run.
    max_consecutive_misses : int
        Misses in a row that are tolerated.
    """

    def __init__(self, steps: int, max_consecutive_misses: int) -> None:
        self._closure = np.full(steps, np.nan)
        self._tolerated = max_consecutive_misses
        self._step = -1
        self._opened_at = 0.0
        self._open = False
        self._consecutive = 0
        self._longest = 0
        self._missed: list[int] = []
        self.late_ticks = 0

    @property
    def missed_deadlines(self) -> int:
        """Number of steps that missed their deadline so far."""
        return len(self._missed)

    @property
    def exhausted(self) -> bool:
        """True when more steps in a row missed than are tolerated."""
        return self._consecutive > self._tolerated

    def opened(self, step: int, time: float) -> None:
        """Note that a step begins, so that the step before must have closed by now.

        Parameters
        ----------
        step : int
            Step index, one more than at the last call.
        time : float
            Time of a monotonic clock [s].
        """
        self.expired()
        self._step = step
        self._opened_at = time
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
            True when it closes the step that is open; False for a late, early or repeated one.
        """
        if not self._open or step != self._step:
            return False
        self._open = False
        self._consecutive = 0
        self._closure[step] = time - self._opened_at
        return True

    def expired(self) -> None:
        """Note that the deadline of the open step, if there is one, has passed."""
        if self._open:
            self._open = False
            self._missed.append(self._step)
            self._consecutive += 1
            self._longest = max(self._longest, self._consecutive)

    def statistics(self) -> TimingStatistics:
        """Return the statistics so far.

        Returns
        -------
        TimingStatistics
            Closure times are NaN when no step has closed.
        """
        closed = 1e3 * self._closure[np.isfinite(self._closure)]
        p50, p99, longest = np.percentile(closed, [50, 99, 100]).tolist() if len(closed) else [float("nan")] * 3
        return TimingStatistics(
            missed_deadlines=len(self._missed),
            max_consecutive_misses=self._longest,
            missed_steps=tuple(self._missed),
            late_ticks=self.late_ticks,
            closure_ms={"p50": p50, "p99": p99, "max": longest},
        )
