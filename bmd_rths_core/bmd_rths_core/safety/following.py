"""Whether the table follows its commands: where they have led it, allowing for a lag."""

from __future__ import annotations

from collections import deque

from bmd_rths_core.safety.commanded_motion import Motion
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.time_steps import most_steps


class FollowingCheck:
    """Tell a table that merely lags behind its commands from one that goes elsewhere.

    Parameters
    ----------
    config : SafetyConfig
        With `following_time` and `following_tolerance`.
    time_step : float
        Δt [s].

    Notes
    -----
    A table that lags by any time up to T, even one that changes, stands where the commands have led within the last T.
    It follows unless it stands farther out than all of that by more than the tolerance. A table that stands farther in
    follows: it is late. The slow offset of the measured displacement is left out on purpose: a table that drifts away
    must not explain itself.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        self._tolerance = config.following_tolerance
        self._time_step = time_step
        self._steps = most_steps(config.following_time, time_step)
        self.reset()

    def reset(self) -> None:
        """Begin at rest at zero displacement."""
        self._past = deque([0.0] * self._steps, maxlen=self._steps)

    def note(self, motion: Motion, held: int = 1) -> None:
        """Take note of where the commands have led the table, before they lead it on.

        Parameters
        ----------
        motion : Motion
            Where they have led it.
        held : int
            Steps that come next; of more than one, the command of the motion is held in all but the last.
        """
        for k in range(max(0, held - self._steps), held):
            self._past.append(motion.after(motion.acceleration, k * self._time_step).displacement)

    def explains(self, commanded: float, measured: float) -> bool:
        """Tell whether the commands and a lag explain a displacement.

        Parameters
        ----------
        commanded : float
            Where the commands have led the table by now [m].
        measured : float
            [m].
        """
        side = 1.0 if measured >= 0.0 else -1.0
        farthest = max(side * displacement for displacement in (*self._past, commanded))
        return side * measured <= farthest + self._tolerance
