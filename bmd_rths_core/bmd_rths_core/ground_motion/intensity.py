"""How strong a ground motion is, how long, and at which frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY, GroundMotion

#: Length of the segments that are averaged in the spectrum of `dominant_frequency` [s].
SEGMENT = 10.0

# Zeros after each segment: the spectrum is read at a step of 1 / (8 * 10 s).
_ZERO_PADDING = 8


@dataclass(frozen=True)
class Intensity:
    """Measures of one ground motion.

    Parameters
    ----------
    peak_acceleration : float
        PGA, largest absolute acceleration [m/s²].
    peak_velocity : float
        PGV, see `peak_velocity` [m/s].
    arias_intensity : float
        See `arias_intensity` [m/s].
    significant_duration : float
        D5-95, see `significant_duration` [s].
    dominant_frequency : float
        See `dominant_frequency` [Hz].
    """

    peak_acceleration: float
    peak_velocity: float
    arias_intensity: float
    significant_duration: float
    dominant_frequency: float


def intensity(motion: GroundMotion) -> Intensity:
    """Return all measures of a ground motion.

    Parameters
    ----------
    motion : GroundMotion
        The record.

    Returns
    -------
    Intensity
        Of the record as it is.
    """
    return Intensity(
        motion.peak,
        peak_velocity(motion),
        arias_intensity(motion),
        significant_duration(motion),
        dominant_frequency(motion),
    )


def peak_velocity(motion: GroundMotion) -> float:
    """Return the peak ground velocity [m/s]: the acceleration integrated from rest by the trapezoidal rule.

    Nothing is corrected: a record with an offset drifts, and its value is too large.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    return float(np.max(np.abs(_integral(motion.acceleration, motion.time_step))))


def arias_intensity(motion: GroundMotion) -> float:
    """Return the Arias intensity π / (2 g) ∫ a² dt [m/s], by the trapezoidal rule.

    Arias 1970, A measure of earthquake intensity, in Seismic Design for Nuclear Power Plants, MIT Press.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    return math.pi / (2.0 * STANDARD_GRAVITY) * float(_integral(motion.acceleration**2, motion.time_step)[-1])


def significant_duration(motion: GroundMotion) -> float:
    """Return D5-95: the time from 5 % to 95 % of the Arias intensity [s], 0 for a record that is zero throughout.

    Trifunac and Brady 1975, Bull. Seismol. Soc. Am. 65(3), 581-626. Between two points the intensity grows linearly.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    husid = _integral(_of_peak_one(motion) ** 2, motion.time_step)
    begin, end = np.interp([0.05 * husid[-1], 0.95 * husid[-1]], husid, np.arange(motion.steps) * motion.time_step)
    return float(end - begin)


def dominant_frequency(motion: GroundMotion) -> float:
    """Return the frequency of the peak of the power spectral density of the acceleration [Hz].

    Welch's method: segments of 10 s, or the whole of a shorter record, each without its mean and in a Hann window, one
    half overlapping the next. A segment resolves 0.1 Hz; the peak is read at a step of 1/80 Hz.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    length = max(2, min(motion.steps, round(min(SEGMENT / motion.time_step, motion.steps))))
    segments = sliding_window_view(_of_peak_one(motion), length)[:: length - length // 2]
    window = np.hanning(length + 1)[:-1]  # periodic, as for a spectrum
    spectra = np.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window, n=_ZERO_PADDING * length)
    density = np.sum(np.abs(spectra) ** 2, axis=0)
    density[1:-1] *= 2.0  # one side of the spectrum stands for both, but for its two ends
    return int(np.argmax(density)) / (_ZERO_PADDING * length * motion.time_step)


def _of_peak_one(motion: GroundMotion) -> NDArray[np.float64]:
    """Return the acceleration as a part of its peak, so that no square of it overflows."""
    return motion.acceleration / motion.peak if motion.peak > 0.0 else motion.acceleration


def _integral(values: NDArray[np.float64], time_step: float) -> NDArray[np.float64]:
    """Return the integral from the first point to each, by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(values[1:] + values[:-1])]) * (time_step / 2.0)
