"""How long the steps took to close, counted: memory and cost stay the same however long a test is."""

from __future__ import annotations

import math

#: Parts of a time step that closure times are counted in.
PARTS = 40

#: Ratio of neighbouring classes for percentiles: these are within half of 1 %.
_RATIO = math.log(1.01)

#: Lower edge of the first class [s], and number of classes: up to 30 s.
_LEAST, _CLASSES = 1e-6, 1731


class ClosureTimes:
    """Count closure times.

    Parameters
    ----------
    time_step : float
        Δt [s].

    Attributes
    ----------
    longest : float
        The longest one [s]; NaN before the first.
    """

    def __init__(self, time_step: float) -> None:
        self._time_step = time_step
        self._classes = [0] * _CLASSES
        self._parts = [0] * PARTS
        self._total = 0
        self.longest = math.nan

    def add(self, closure: float) -> None:
        """Count one.

        Parameters
        ----------
        closure : float
            Closure time [s].
        """
        index = int(math.log(max(closure, _LEAST) / _LEAST) / _RATIO)
        self._classes[min(index, _CLASSES - 1)] += 1
        self._total += 1
        self.longest = closure if self._total == 1 else max(self.longest, closure)
        part = int(PARTS * closure / self._time_step)
        if 0 <= part < PARTS:
            self._parts[part] += 1

    def percentile(self, percent: float) -> float:
        """Return the closure time that so many percent do not exceed, within 0.5 % [s]; NaN before the first.

        Parameters
        ----------
        percent : float
            0 to 100.
        """
        rank, seen = math.ceil(0.01 * percent * self._total), 0
        for index, count in enumerate(self._classes):
            seen += count
            if seen >= rank > 0:
                return min(_LEAST * math.exp((index + 0.5) * _RATIO), self.longest)
        return math.nan

    @property
    def counts(self) -> tuple[int, ...]:
        """How many fell into each of the `PARTS` equal parts of a time step; longer ones, of lockstep, are left out."""
        return tuple(self._parts)
