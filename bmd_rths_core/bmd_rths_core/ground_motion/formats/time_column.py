"""The time step of a column of times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.ground_motion.formats.record_file import RecordFile

#: Largest deviation of one interval of the time column from the time step, as a part of the time step.
TIME_TOLERANCE = 1e-6


def step_of_times(file: RecordFile, line_numbers: Sequence[int], time: NDArray[np.float64]) -> float:
    """Return the time step of times that run from 0 in equal steps.

    Parameters
    ----------
    file : RecordFile
        The file.
    line_numbers : sequence of int
        The line of each time.
    time : ndarray, shape (N,)
        Times [s], N >= 2.

    Raises
    ------
    InputError
        They do not; the line at fault is named.
    """
    intervals = np.diff(time)
    # The median is the step of the file even when a row is missing, so that the line at fault is the one named.
    step = float(np.median(intervals))
    if abs(time[0]) > TIME_TOLERANCE * abs(step):
        raise file.error(line_numbers[0], f"the first time is {time[0]:g} s; 0 is required")
    bad = np.flatnonzero((intervals <= 0) | (np.abs(intervals - step) > TIME_TOLERANCE * step))
    if bad.size:
        row = bad[0] + 1
        problem = f"time {time[row]:.9g} s is {intervals[row - 1]:.9g} s after the row before"
        raise file.error(line_numbers[row], f"{problem}; equal steps > 0 are required (median {step:.9g} s)")
    return float(time[-1] / (time.size - 1))
