"""Whether signals that are filtered have had no gap of late."""

from __future__ import annotations

import math

#: After a lost measurement nothing is told until the filters have forgotten it [s].
_FORGET = 1.0


class Continuity:
    """Count down after a gap.

    Parameters
    ----------
    time_step : float
        Δt [s].
    """

    def __init__(self, time_step: float) -> None:
        self._waits = math.ceil(_FORGET / time_step)
        self.reset()

    def reset(self) -> None:
        """Return to before step 0."""
        self._last, self._pause = -1, 0

    def unbroken(self, step: int, complete: bool) -> bool:
        """Tell whether the filters have forgotten the last gap.

        Parameters
        ----------
        step : int
            Of this measurement.
        complete : bool
            It has every value.
        """
        if step - self._last > 1 or not complete:
            self._pause = self._waits
        self._last = step
        if self._pause:
            self._pause -= 1
            return False
        return True
