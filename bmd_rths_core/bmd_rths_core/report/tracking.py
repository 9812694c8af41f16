"""How the table followed: in time, in frequency, and how its delay changed over the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import tracking_delay
from bmd_rths_core.identification.frequency_response import FrequencyResponse, estimate_frequency_response
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.whole_samples import filled

FloatArray = NDArray[np.float64]

#: Length and distance of the windows in which the delay is estimated, and the longest one that is looked for [s].
WINDOW, HOP, LONGEST = 2.0, 0.5, 0.1

#: A window with less than this share of the largest root mean square says nothing about the delay.
QUIET = 0.1

#: Lengths of a spectral segment [s]; the longest the record allows is taken.
_SEGMENTS = (20.48, 10.24, 5.12, 2.56)

#: Highest frequency that is shown [rad/s].
_HIGHEST = 2.0 * np.pi * 25.0


@dataclass(frozen=True)
class TrackingHistory:
    """Desired and achieved acceleration of the table at the same times.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    desired, achieved : ndarray, shape (N,)
        Of the interface, and measured on the table [m/s²].
    strong_motion : tuple of float
        Begin and end [s].
    delay_time, delay_ms : ndarray, shape (w,)
        Middle of a window [s] and the delay in it [ms]; quiet windows are left out.
    overall_delay_ms : float
        Delay over the whole run [ms].
    """

    time: FloatArray
    desired: FloatArray
    achieved: FloatArray
    strong_motion: tuple[float, float]
    delay_time: FloatArray
    delay_ms: FloatArray
    overall_delay_ms: float


def tracking_history(record: RunRecord, strong_motion: tuple[float, float]) -> TrackingHistory:
    """Return how the table followed in time.

    Parameters
    ----------
    record : RunRecord
        The run.
    strong_motion : tuple of float
        Begin and end [s].
    """
    desired, achieved = record.desired_acceleration[1:], record.table_acceleration[:-1]
    times, delays = delay_over_time(filled(desired), filled(achieved), record.time_step)
    overall = 1e3 * tracking_delay(desired, achieved, record.time_step)
    return TrackingHistory(record.time[1:], desired, achieved, strong_motion, times, delays, overall)


def delay_over_time(desired: FloatArray, achieved: FloatArray, time_step: float) -> tuple[FloatArray, FloatArray]:
    """Return the delay of the table in windows of `WINDOW` s, every `HOP` s.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        At the same times, without gaps [m/s²].
    time_step : float
        Δt [s].

    Returns
    -------
    time, delay_ms : ndarray, shape (w,)
        Middle of each window [s] and the delay in it [ms]: that of the largest correlation coefficient between the
        window and what was achieved up to `LONGEST` s before and after it. Windows with less than `QUIET` of the
        largest root mean square are left out; a record shorter than a window has none.
    """
    length, hop, lags = round(WINDOW / time_step), round(HOP / time_step), round(LONGEST / time_step)
    surrounded = np.pad(achieved, lags)
    windows = [(begin, desired[begin : begin + length]) for begin in range(0, len(desired) - length + 1, hop)]
    loudest = max((float(np.mean(window**2)) for _, window in windows), default=0.0)
    times, delays = [], []
    for begin, window in windows:
        if float(np.mean(window**2)) > QUIET**2 * loudest:
            late = _samples_late(window, surrounded[begin : begin + length + 2 * lags])
            times.append((begin + 1 + 0.5 * length) * time_step)  # the first sample is that of step 1
            delays.append(1e3 * time_step * late)
    return np.array(times), np.array(delays)


def _samples_late(window: FloatArray, achieved: FloatArray) -> float:
    """Return by how many samples a window appears later in what lies around it as much before as behind."""
    shifted = sliding_window_view(achieved, len(window))
    sizes = np.sqrt(np.sum(shifted**2, axis=1))
    likeness = np.divide(shifted @ window, sizes, out=np.zeros(len(sizes)), where=sizes > 0.0)
    peak = int(np.argmax(likeness[1:-1])) + 1
    before, top, after = likeness[peak - 1 : peak + 2]
    curvature = before - 2.0 * top + after
    fraction = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(peak - len(shifted) // 2 + fraction)


@dataclass(frozen=True)
class TableFrequencies:
    """Frequency response from the desired to the achieved acceleration, and how far it can be trusted.

    Parameters
    ----------
    response : FrequencyResponse
        Estimated with Hann windows and averaged spectra.
    """

    response: FrequencyResponse


def table_frequencies(record: RunRecord) -> TableFrequencies:
    """Return how the table followed in frequency.

    Parameters
    ----------
    record : RunRecord
        The run; gaps are bridged by straight lines.

    Raises
    ------
    InputError
        The record is too short, or the table was not moved.
    """
    return TableFrequencies(_estimated(record.desired_acceleration[1:], record.table_acceleration[:-1], record))


@dataclass(frozen=True)
class FloorTransfer:
    """Frequency responses from the ground to the floors, in the run and in the reference.

    Parameters
    ----------
    names : tuple of str
        The n floors.
    run, reference : FrequencyResponse
        Of n responses each, both estimated from the record in the same way.
    """

    names: tuple[str, ...]
    run: FrequencyResponse
    reference: FrequencyResponse


def floor_transfer(record: RunRecord, reference: FloatArray, lower: int) -> FloorTransfer:
    """Return the frequency responses of the interface and the measured floors.

    Parameters
    ----------
    record : RunRecord
        The run; gaps are bridged by straight lines.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building [m/s²].
    lower : int
        Stories of the numerical substructure.

    Raises
    ------
    InputError
        The record is too short, or the ground was at rest.
    """
    measured = record.floor_accelerations
    run = np.column_stack((record.desired_acceleration[1:], measured[:-1]))
    names = ("interface", *(f"specimen floor {i + 1}" for i in range(measured.shape[1])))
    ground = record.ground_acceleration[1:]
    shown = reference[1:, lower - 1 : lower + measured.shape[1]]
    return FloorTransfer(names, _estimated(ground, run, record), _estimated(ground, shown, record))


def _estimated(excitation: FloatArray, response: FloatArray, record: RunRecord) -> FrequencyResponse:
    x = filled(excitation)
    y = np.apply_along_axis(filled, 0, response) if len(response) else response
    available = 0.5 * len(x) * record.time_step  # four segments with their overlap need 1.75 of one
    segment = next((length for length in _SEGMENTS if length <= available), _SEGMENTS[-1])
    return estimate_frequency_response(x, y, record.time_step, segment).between(0.0, _HIGHEST)
