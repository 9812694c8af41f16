"""Frequency response with coherence, estimated from records of finite length with noise in them.

The estimator is H₁ = S_xy / S_xx with Welch's averaged spectra (Bendat and Piersol, "Random Data", 4th ed., Chapter 6):
noise of the response does not bias it, and the coherence γ² says which share of the response is explained.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bmd_rths_core.errors import InputError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Overlap of the segments; with the Hann window more would not lower the variance.
_OVERLAP = 0.75

#: Fewer segments than this, and the coherence of mere noise is no longer small.
_LEAST_SEGMENTS = 4


@dataclass(frozen=True)
class FrequencyResponse:
    """A frequency response at single frequencies.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω > 0 [rad/s], ascending.
    response : ndarray of complex, shape (n,) or (n, m)
        Response over excitation, of one or of m responses.
    coherence : ndarray, shape (n,) or (n, m)
        γ² between 0 and 1, of each response.
    """

    frequencies: FloatArray
    response: ComplexArray
    coherence: FloatArray

    def between(self, lowest: float, highest: float) -> FrequencyResponse:
        """Return the part in a band.

        Parameters
        ----------
        lowest, highest : float
            Ends of the band [rad/s], which belong to it.

        Returns
        -------
        FrequencyResponse
        """
        inside = (self.frequencies >= lowest) & (self.frequencies <= highest)
        return FrequencyResponse(self.frequencies[inside], self.response[inside], self.coherence[inside])


def estimate_frequency_response(
    excitation: ArrayLike, response: ArrayLike, time_step: float, segment_duration: float = 20.48
) -> FrequencyResponse:
    """Estimate the frequency response between two measured signals.

    Parameters
    ----------
    excitation : array_like, shape (N,)
        Excitation.
    response : array_like, shape (N,) or (N, m)
        One or m responses.
    time_step : float
        Δt [s].
    segment_duration : float
        Length of a segment [s]. Its inverse is the resolution; a resonance has to be several times as wide.

    Returns
    -------
    FrequencyResponse
        From one over the segment duration to the Nyquist frequency, excluding both.

    Raises
    ------
    InputError
        The signals do not belong together, have a gap, are too short, or the excitation is zero.
    """
    x, y = np.asarray(excitation, dtype=float), np.asarray(response, dtype=float)
    if x.size == 0 or y.size == 0:
        raise InputError("frequency response: no values of excitation or response; a record of both is required")
    if x.ndim != 1 or y.shape[:1] != x.shape:
        raise InputError(f"frequency response: signals of shape {x.shape} and {y.shape} do not belong together")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InputError("frequency response: a value is missing or not finite; records without gaps are required")
    length = round(segment_duration / time_step)
    needed = round(length * (1.0 + (_LEAST_SEGMENTS - 1) * (1.0 - _OVERLAP)))
    if length < 2 or len(x) < needed:
        raise InputError(
            f"frequency response: a record of {len(x) * time_step:g} s is too short for segments of "
            f"{segment_duration:g} s; {needed * time_step:g} s and more are required"
        )
    settings = {"fs": 1.0 / time_step, "window": "hann", "nperseg": length, "noverlap": round(_OVERLAP * length)}
    from scipy.signal import csd, welch  # takes more than a second; a fit of what was measured does without

    frequency, of_excitation = welch(x, **settings)
    if not of_excitation.any():
        raise InputError("frequency response: the excitation is zero")
    _, of_response = welch(y.T, **settings)
    _, crossed = csd(x, y.T, **settings)
    # Without zero frequency, where the mean was taken away, and the Nyquist frequency.
    inner = slice(1, (length - 1) // 2 + 1)
    of_excitation, of_response, crossed = of_excitation[inner], of_response[..., inner], crossed[..., inner]
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.nan_to_num(np.abs(crossed) ** 2 / (of_excitation * of_response))
        ratio = np.nan_to_num(crossed / of_excitation)
    return FrequencyResponse(2.0 * np.pi * frequency[inner], ratio.T, np.minimum(coherence.T, 1.0))


def without_hold(response: FrequencyResponse, time_step: float) -> FrequencyResponse:
    """Return the response of a continuous system whose commands are held and whose sensors are read after the hold.

    Command k acts from k·Δt to (k+1)·Δt and row k of the sensors is read at (k+1)·Δt, so that the rows respond to the
    commands with e^{sΔt} G(s) (1 − e^{−sΔt}) / (s Δt) and the images of it around multiples of the sampling frequency
    ω_s. The hold and the advance by one step are divided out. The images are left; the largest has about ω/ω_s of
    the size of G at ω_s − ω, which is little for a table that does not follow so fast.

    Parameters
    ----------
    response : FrequencyResponse
        From commands to rows of sensors.
    time_step : float
        Δt [s].

    Returns
    -------
    FrequencyResponse
        G(jω), with the same coherence.
    """
    factor = hold(response.frequencies, time_step)
    factor = factor if response.response.ndim == 1 else factor[:, None]
    return FrequencyResponse(response.frequencies, response.response / factor, response.coherence)


def hold(frequencies: FloatArray, time_step: float) -> ComplexArray:
    """Return what the zero-order hold and the reading at its end add, e^{sΔt} (1 − e^{−sΔt}) / (s Δt).

    Parameters
    ----------
    frequencies : ndarray
        ω [rad/s].
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray of complex
        An advance by half a step, times sinc.
    """
    half = 0.5 * frequencies * time_step
    return np.asarray(np.exp(1j * half) * np.sinc(half / np.pi))
