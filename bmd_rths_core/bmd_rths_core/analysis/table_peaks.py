"""Largest motion of the table in a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]


class TablePeaks(NamedTuple):
    """Largest absolute values of what the sensors of the table measured; NaN where nothing was measured.

    Parameters
    ----------
    displacement : float
        [m].
    velocity : float
        Central difference of the displacement over two steps [m/s].
    acceleration : float
        [m/s²].
    force : float
        Of the actuator [N].
    """

    displacement: float
    velocity: float
    acceleration: float
    force: float


def table_peaks(record: RunRecord) -> TablePeaks:
    """Return the peaks of a run from its first step to its last.

    Parameters
    ----------
    record : RunRecord
        The run.
    """
    return _peaks(record.table_displacement, record.table_acceleration, record.actuator_force, record.time_step)


def table_peaks_to_rest(record: RunRecord) -> TablePeaks:
    """Return the peaks of a run and of the way to rest behind it, where that was recorded.

    Parameters
    ----------
    record : RunRecord
        The run.
    """
    displacement, acceleration = record.continued("table_displacement"), record.continued("table_acceleration")
    return _peaks(displacement, acceleration, record.continued("actuator_force"), record.time_step)


def _peaks(displacement: FloatArray, acceleration: FloatArray, force: FloatArray, time_step: float) -> TablePeaks:
    velocity = (displacement[2:] - displacement[:-2]) / (2.0 * time_step)
    return TablePeaks(peak(displacement), peak(velocity), peak(acceleration), peak(force))


def peak(values: FloatArray) -> float:
    """Return the largest absolute value, leaving out NaN; NaN when nothing is left.

    Parameters
    ----------
    values : ndarray
        Of any shape.
    """
    known = np.abs(values[np.isfinite(values)])
    return float(np.max(known)) if known.size else float("nan")
