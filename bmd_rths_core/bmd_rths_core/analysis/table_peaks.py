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
    """Return the peaks of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    """
    displacement = record.table_displacement
    velocity = (displacement[2:] - displacement[:-2]) / (2.0 * record.time_step)
    return TablePeaks(peak(displacement), peak(velocity), peak(record.table_acceleration), peak(record.actuator_force))


def peak(values: FloatArray) -> float:
    """Return the largest absolute value, leaving out NaN; NaN when nothing is left.

    Parameters
    ----------
    values : ndarray
        Of any shape.
    """
    known = np.abs(values[np.isfinite(values)])
    return float(np.max(known)) if known.size else float("nan")
