"""The clock of this computer, for hosts that run a table in real time."""

from __future__ import annotations

import time

#: A sleep ends up to this late [s]; the rest is waited for by looking at the clock.
_WAKE_UP_MARGIN = 0.0003


class MonotonicClock:
    """``time.perf_counter``, and sleeps that end on time: a `bmd_rths_core.loop.hosting.Clock`."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.perf_counter()

    def wait(self, until: float) -> None:
        """Let time pass until then."""
        sleep = until - time.perf_counter() - _WAKE_UP_MARGIN
        if sleep > 0.0:
            time.sleep(sleep)
        while time.perf_counter() < until:
            pass
