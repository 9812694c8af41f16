"""Where a table stands when its commands say that it is at rest: what microseconds of every hold have added up to.

Commands that are held a few microseconds longer or shorter than was noted move a table by millimetres in minutes. Only
its displacement sensor knows.
"""

from __future__ import annotations

import math

import numpy as np

from bmd_rths_core.safety.commanded_motion import Motion, whole_steps

#: How long a table is watched with zero acceleration [s]; the first part of it passes until it has come up.
WATCH_TIME = 0.45
LAG_TIME = 0.15

#: A host that was held up has seen too little: it watches on until it has seen half of what it asked for, and so many
#: times as long at most, for a controller may have fallen silent.
LONGEST_WATCH = 4

#: What is nearer and slower than this is left alone: the noise of a displacement sensor [m, m/s].
NEAR = 2e-4
SLOW = 3e-4


class Settling:
    """Watch the displacement of a table that should be at rest, relative to where it stood before the test.

    Parameters
    ----------
    time_step : float
        Δt [s].
    """

    def __init__(self, time_step: float) -> None:
        self._time_step = time_step
        self._steps = whole_steps(WATCH_TIME, time_step)
        self._lag = whole_steps(LAG_TIME, time_step)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._zero = math.nan
        self._first_step = -1
        self._last_step = -1
        self._seen: list[tuple[int, float]] = []

    def observe(self, step: int, displacement: float) -> None:
        """Take a measured displacement.

        Parameters
        ----------
        step : int
            Step index.
        displacement : float
            [m]; NaN where there is no sensor.
        """
        if math.isnan(self._zero):
            self._zero = displacement
        if self._first_step >= 0 and step >= self._first_step + self._lag and math.isfinite(displacement):
            self._seen.append((step, displacement - self._zero))

    def watches(self, step: int) -> bool:
        """Begin to watch, or go on, and tell whether the watch lasts.

        Parameters
        ----------
        step : int
            Step index of the next command.
        """
        if self._first_step < 0:
            self._first_step = step
        self._last_step = step
        enough = math.isnan(self._zero) or len(self._seen) >= (self._steps - self._lag) // 2
        return step < self._first_step + (1 if enough else LONGEST_WATCH) * self._steps

    def found(self) -> Motion | None:
        """Return the motion that was seen at the end of the watch, and end it; None when the table is at rest at zero.

        Returns
        -------
        Motion or None
            By a straight line through the displacements.
        """
        seen, last = self._seen, self._last_step
        self._first_step, self._seen = -1, []
        if len(seen) < 8:
            return None
        steps, displacements = np.array(seen).T
        times = (steps - last) * self._time_step
        velocity, displacement = np.polyfit(times, displacements, 1).tolist()
        if abs(displacement) < NEAR and abs(velocity) < SLOW:
            return None
        return Motion(displacement, velocity if abs(velocity) >= SLOW else 0.0, 0.0)
