"""How the table follows over a moving window, while a run is under way or at any time of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.frequency_evaluation import QUIET, WINDOW, frequency_evaluation
from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.tracking_quality import tracking_indicator

FloatArray = NDArray[np.float64]

#: Distance of the windows [s].
MOVING_HOP = 0.1


class TrackingWindow(NamedTuple):
    """The table against the desired acceleration in one window of `WINDOW` s.

    Parameters
    ----------
    end : float
        Test time at its end [s].
    error_percent : float
        √(Σ (y − x)² / Σ x²) · 100 [%], sensor noise included.
    amplitude, delay_ms, frequency_hz : float
        See `frequency_evaluation`; the window is tapered (Hann).
    indicator : float
        Tracking indicator of the tapered window over that of a lag of a quarter of a period: the sine of the phase,
        > 0 where the table lags.
    """

    end: float
    error_percent: float
    amplitude: float
    delay_ms: float
    frequency_hz: float
    indicator: float


class MovingTracking:
    """Judge every window once, as soon as it is complete.

    Parameters
    ----------
    time_step : float
        Δt [s].

    Attributes
    ----------
    windows : list of TrackingWindow
        In the order of time. One with less than a tenth of the largest root mean square so far is left out: it would
        tell the noise.
    """

    def __init__(self, time_step: float) -> None:
        self._time_step = time_step
        self._length = max(3, round(WINDOW / time_step))
        self._hop = max(1, round(MOVING_HOP / time_step))
        self._taper = np.hanning(self._length)
        self._next_end = self._length
        self._loudest = 0.0
        self.windows: list[TrackingWindow] = []

    def advance(self, desired: FloatArray, achieved: FloatArray) -> None:
        """Judge the windows that are complete by now.

        Parameters
        ----------
        desired, achieved : ndarray, shape (N,)
            Both signals from the first step on, row k as in a `RunRecord` [m/s²]. The table is measured at the end of
            a step, so that it is compared with the desired acceleration of the next one. Where one of them is NaN both
            count as zero.
        """
        while self._next_end < len(desired):
            begin, end = self._next_end - self._length, self._next_end
            self._judge(desired[begin + 1 : end + 1], achieved[begin:end], end * self._time_step)
            self._next_end += self._hop

    def _judge(self, desired: FloatArray, achieved: FloatArray, time: float) -> None:
        valid = np.isfinite(desired) & np.isfinite(achieved)
        x, y = np.where(valid, desired, 0.0), np.where(valid, achieved, 0.0)
        power = float(np.mean(x**2))
        self._loudest = max(self._loudest, power)
        if power == 0.0 or power < QUIET**2 * self._loudest:
            return
        tapered = self._taper * x, self._taper * y
        evaluation = frequency_evaluation(*tapered, self._time_step)
        turned = float(np.sum(tapered[0] ** 2)) * self._time_step * 2.0 * np.pi * evaluation.frequency_hz
        indicator = float(tracking_indicator(*tapered)[-1]) / turned
        self.windows.append(TrackingWindow(time, rmse_percent(x, y), *evaluation, indicator))
