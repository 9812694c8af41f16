"""Tell when the computer itself is slow: on a virtual machine the host takes speed away for tens of milliseconds.

A process of its own does the same small piece of work again and again and notes what it costs in processor time of its
thread. Other programs of this machine change how long that takes by the clock, and hardly what it costs; the host,
which a guest cannot see, changes the cost. So nothing that the product does to itself is excused by it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

#: Pause between two samples [s].
PERIOD = 0.004

#: Work that costs this many times the median is that of a slow host; it is so around the sample, too [s].
SLOW = 3.0
MARGIN = 0.02


class HostWitness:
    """A process that watches the host while the block runs."""

    def __enter__(self) -> HostWitness:
        self._process = subprocess.Popen([sys.executable, __file__], stdout=subprocess.PIPE, text=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        output = self._process.communicate()[0]
        rows = [line.split() for line in output.splitlines() if line.count(" ") == 1]
        self._times, costs = np.array(rows, dtype=float).reshape(-1, 2).T
        self._slow = costs > SLOW * np.median(costs)

    def slow_during(self, begin: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell in which intervals the host was slow, or was not watched.

        Parameters
        ----------
        begin, end : ndarray, shape (n,)
            Wall clock [s].
        """
        first = np.searchsorted(self._times, np.asarray(begin) - MARGIN)
        last = np.searchsorted(self._times, np.asarray(end) + MARGIN)
        slow_until = np.concatenate([[0], np.cumsum(self._slow)])
        return (slow_until[last] > slow_until[first]) | (last == first)

    @property
    def slow_percent(self) -> float:
        """Samples in which the host was slow [%]."""
        return 100.0 * float(np.mean(self._slow))


def _watch() -> None:
    while True:
        at, before = time.time(), time.thread_time()
        total = 0
        for value in range(400):
            total += value * value
        print(f"{at:.6f} {time.thread_time() - before:.3e}", flush=True)
        time.sleep(PERIOD)


if __name__ == "__main__":
    _watch()
