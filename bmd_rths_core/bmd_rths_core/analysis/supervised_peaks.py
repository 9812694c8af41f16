"""Largest values of what the supervisor watches and no sensor measures."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.integration.linear_simulation import running_mean
from bmd_rths_core.record import RunRecord
from bmd_rths_core.safety import SafetyConfig


def largest_increment(record: RunRecord) -> float:
    """Return the largest change of the command from one step to the next, the first one from rest [m/s²].

    Parameters
    ----------
    record : RunRecord
        The run.

    Returns
    -------
    float
        Against what the table controller applied at the step before, or the command where that is not known; NaN when
        nothing was recorded.
    """
    applied = np.where(np.isfinite(record.applied_command), record.applied_command, record.command)
    return peak(record.command - np.append(0.0, applied)[: record.steps])


def largest_tracking_error(record: RunRecord, config: SafetyConfig) -> float:
    """Return the largest tracking error as the supervisor takes it [m/s²].

    Parameters
    ----------
    record : RunRecord
        The run.
    config : SafetyConfig
        With the time constant of the mean square.

    Returns
    -------
    float
        Root of the running mean square of applied command less measured acceleration, steps without either left out;
        NaN when nothing was recorded.
    """
    error = record.applied_command - record.table_acceleration
    known = error[np.isfinite(error)]
    if not known.size:
        return float("nan")
    mean_square = running_mean(record.time_step, config.tracking_time, 1).advance(known[:, None] ** 2)
    return float(np.sqrt(np.max(mean_square)))
