"""Acceleration of every floor in a run and in the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.benchmark_criteria import peak_error_percent
from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.numerical_motion import NumericalMotion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FloorResponse:
    """One floor.

    Parameters
    ----------
    name : str
        Which floor, and whether it was computed or measured.
    time : ndarray, shape (N,)
        [s].
    run, reference : ndarray, shape (N,)
        Absolute acceleration [m/s²].
    rmse_percent, peak_error_percent : float
        Eq. 12, and the largest error over the largest reference [%].
    """

    name: str
    time: FloatArray
    run: FloatArray
    reference: FloatArray
    rmse_percent: float
    peak_error_percent: float

    @property
    def peaks(self) -> tuple[float, float]:
        """Largest absolute acceleration of run and reference [m/s²]."""
        return peak(self.run), peak(self.reference)


@dataclass(frozen=True)
class FloorResponses:
    """All floors of the building.

    Parameters
    ----------
    floors : tuple of FloorResponse
        From the ground up.
    strong_motion : tuple of float
        Begin and end of the strong motion [s].
    """

    floors: tuple[FloorResponse, ...]
    strong_motion: tuple[float, float]


def floor_responses(
    record: RunRecord, reference: FloatArray, motion: NumericalMotion, strong_motion: tuple[float, float]
) -> FloorResponses:
    """Return the responses of all floors.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building [m/s²].
    motion : NumericalMotion
        The numerical substructure.
    strong_motion : tuple of float
        Begin and end [s].

    Returns
    -------
    FloorResponses
        Without errors for a run that a limit ended. The interface is the recorded desired acceleration; sensors stand
        at the end of the step they were read at.
    """
    lower = motion.accelerations.shape[1]
    floors = [
        _floor(f"numerical floor {i + 1} (computed)", record.time, motion.accelerations[:, i], reference[:, i])
        for i in range(lower - 1)
    ]
    interface = record.desired_acceleration, reference[:, lower - 1]
    floors.append(_floor("interface (computed)", record.time, *interface))
    floors += [
        _floor(f"specimen floor {i + 1} (measured)", record.sensor_time[:-1], measured, reference[1:, lower + i])
        for i, measured in enumerate(record.floor_accelerations[:-1].T)
    ]
    if not record.stable:
        floors = [replace(floor, rmse_percent=np.nan, peak_error_percent=np.nan) for floor in floors]
    return FloorResponses(tuple(floors), strong_motion)


def _floor(name: str, time: FloatArray, run: FloatArray, reference: FloatArray) -> FloorResponse:
    errors = rmse_percent(reference, run), peak_error_percent(reference, run)
    return FloorResponse(name, time, run, reference, *errors)
