"""Delay and amplitude of the table by the frequency evaluation index (FEI).

Guo et al. (2014), with the exponent 2; used to compare compensators by Xu, Guo and Chen (2016), Earthquake Engineering
and Engineering Vibration 15, 129-143.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Length and distance of the windows over time [s].
WINDOW, HOP = 2.0, 0.5
#: A window with less than this share of the largest root mean square says nothing.
QUIET = 0.1


class FrequencyEvaluation(NamedTuple):
    """How the achieved signal relates to the desired one where the desired one is.

    Parameters
    ----------
    amplitude : float
        Achieved over desired; 1 is right.
    delay_ms : float
        Delay of the achieved signal [ms], unique within half a period of the frequency.
    frequency_hz : float
        Equivalent frequency of the desired signal [Hz].
    """

    amplitude: float
    delay_ms: float
    frequency_hz: float


def frequency_evaluation(desired: FloatArray, achieved: FloatArray, time_step: float) -> FrequencyEvaluation:
    """Return delay and amplitude of a signal.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        Sampled at the same times; NaN counts as zero.
    time_step : float
        Δt [s].

    Returns
    -------
    FrequencyEvaluation
        NaN when the desired signal is zero.

    Notes
    -----
    FEI = Σ (Xm/Xc) |Xc|² / Σ |Xc|², f_eq = Σ |Xc|² f / Σ |Xc|², both without the mean; the amplitude is |FEI| and the
    delay −arg(FEI) / (2π f_eq).
    """
    if len(desired) < 3:
        return FrequencyEvaluation(float("nan"), float("nan"), float("nan"))
    commanded, moved = (np.fft.rfft(np.nan_to_num(signal))[1:] for signal in (desired, achieved))
    power = np.abs(commanded) ** 2
    total = float(power.sum())
    if total == 0.0 or not np.isfinite(total):
        return FrequencyEvaluation(float("nan"), float("nan"), float("nan"))
    index = complex((moved * np.conj(commanded)).sum() / total)
    frequency = float(power @ np.fft.rfftfreq(len(desired), time_step)[1:]) / total
    delay = -np.angle(index) / (2.0 * np.pi * frequency)
    return FrequencyEvaluation(abs(index), 1e3 * float(delay), frequency)


def frequency_evaluation_over_time(
    desired: FloatArray, achieved: FloatArray, time_step: float
) -> tuple[FloatArray, list[FrequencyEvaluation]]:
    """Return delay and amplitude in windows of `WINDOW` s (Hann), every `HOP` s; quiet ones are left out.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        Sampled at the same times; NaN counts as zero.
    time_step : float
        Δt [s].

    Returns
    -------
    time : ndarray, shape (w,)
        Middle of each window after the first sample [s].
    evaluations : list of FrequencyEvaluation
    """
    length, hop = round(WINDOW / time_step), max(1, round(HOP / time_step))
    taper, desired, achieved = np.hanning(length), np.nan_to_num(desired), np.nan_to_num(achieved)
    begins = range(0, len(desired) - length + 1, hop)
    loudness = [float(np.mean(desired[begin : begin + length] ** 2)) for begin in begins]
    loud = [begin for begin, power in zip(begins, loudness, strict=True) if power > QUIET**2 * max(loudness)]
    evaluations = [
        frequency_evaluation(
            taper * desired[begin : begin + length], taper * achieved[begin : begin + length], time_step
        )
        for begin in loud
    ]
    return (np.array(loud, dtype=float) + 0.5 * length) * time_step, evaluations
