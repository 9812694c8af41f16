"""Every spectral line of a record, with the noise it carries: what a model is fitted to.

A Welch estimate smooths a sharp resonance over the width of its segments. The ratio of the Fourier transforms of a
whole record from rest to rest does not, and the many noisy lines are averaged by the model that is fitted to all of
them. How noisy a line is follows from the coherence of the Welch estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.frequency_response import (
    ComplexArray,
    FloatArray,
    FrequencyResponse,
    estimate_frequency_response,
)

#: Coherence below which lines are not used.
LEAST_COHERENCE = 0.8

#: Share of a band that has to be coherent for a fit.
_LEAST_SHARE = 0.6

#: Number of neighbouring lines the noise is taken from; their mean square is known to a seventh.
_NOISE_LINES = 50

#: Least number and largest length [s] of the segments a record is divided into for the averaged estimate.
_SEGMENTS = 8
_LONGEST_SEGMENT = 20.48

#: Number of frequencies of the averaged estimate that a band has to contain.
_LEAST_FREQUENCIES = 24

#: The ends of a record are tapered over this time [s]; a driven record is at rest there.
TAPER = 1.0


@dataclass(frozen=True)
class SpectralLines:
    """Responses over excitation at the lines of a discrete Fourier transform.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω > 0 [rad/s], ascending.
    response : ndarray of complex, shape (n, m)
        Ratio of the transforms of m responses and of the excitation.
    weight : ndarray, shape (n, m)
        One over the standard deviation of the ratio; 0 where the coherence is too low.
    """

    frequencies: FloatArray
    response: ComplexArray
    weight: FloatArray

    def averaged(self, count: int) -> SpectralLines:
        """Return weighted means of neighbouring lines.

        Parameters
        ----------
        count : int
            Number of lines that are averaged; those that are left over at the end are left out.

        Returns
        -------
        SpectralLines
        """
        groups = len(self.frequencies) // count

        def grouped(values: NDArray[Any]) -> NDArray[Any]:
            return values[: groups * count].reshape(groups, count, *values.shape[1:])

        precision = grouped(self.weight**2)
        total = precision.sum(axis=1)
        weighted = (precision * grouped(self.response)).sum(axis=1)
        response = np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0.0)
        return SpectralLines(grouped(self.frequencies).mean(axis=1), response, np.sqrt(total))

    def reweighted(self, model: ComplexArray) -> SpectralLines:
        """Return the lines with weights from what a first model leaves over.

        The coherence drops at a sharp resonance because segments are short, not because of noise there. Weights from
        it alone would count least where a resonance is seen best.

        Parameters
        ----------
        model : ndarray of complex, shape (n, m)
            Response of a model that fits.

        Returns
        -------
        SpectralLines
            Lines without weight stay so.
        """
        squares = np.abs(self.weight * (self.response - model)) ** 2
        from scipy.ndimage import uniform_filter1d  # as in `frequency_response`

        used = uniform_filter1d((self.weight > 0.0).astype(float), _NOISE_LINES, axis=0)
        mean = uniform_filter1d(squares, _NOISE_LINES, axis=0) / np.maximum(used, 1.0 / _NOISE_LINES)
        size = np.sqrt(np.maximum(mean, 1e-6 * squares.mean()))
        return SpectralLines(self.frequencies, self.response, self.weight / size)


def averaged_response(
    excitation: FloatArray, response: FloatArray, time_step: float, band: tuple[float, float]
) -> FrequencyResponse:
    """Return the Welch estimate of a record within a band, with segments as long as the record bears.

    Parameters
    ----------
    excitation : ndarray, shape (N,)
        Excitation.
    response : ndarray, shape (N, m)
        Responses.
    time_step : float
        Δt [s].
    band : (float, float)
        Ends of the band [rad/s].

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        The record is too short for the band.
    """
    duration = len(excitation) * time_step
    estimate = estimate_frequency_response(excitation, response, time_step, min(_LONGEST_SEGMENT, duration / _SEGMENTS))
    inside = estimate.between(*band)
    if len(inside.frequencies) < _LEAST_FREQUENCIES:
        raise InputError(
            f"a record of {duration:g} s resolves {len(inside.frequencies)} frequencies of the band "
            f"{band[0] / (2 * np.pi):g} to {band[1] / (2 * np.pi):g} Hz; {_LEAST_FREQUENCIES} and more are required"
        )
    return inside


def spectral_lines(
    excitation: ArrayLike, response: ArrayLike, time_step: float, averaged: FrequencyResponse
) -> SpectralLines:
    """Return the lines of a record within the band of an averaged estimate.

    Parameters
    ----------
    excitation : array_like, shape (N,)
        Excitation.
    response : array_like, shape (N, m)
        Responses.
    time_step : float
        Δt [s].
    averaged : FrequencyResponse
        Welch estimate of the same m responses, limited to the band of interest. Its coherence tells the noise: a share
        1 − γ² of the response is not explained, that is (1 − γ²)/γ² of the explained part.

    Returns
    -------
    SpectralLines

    Raises
    ------
    InputError
        Too small a part of the band is coherent.
    """
    coherent = np.mean(averaged.coherence >= LEAST_COHERENCE)
    if coherent < _LEAST_SHARE:
        raise InputError(
            f"only {100.0 * coherent:.0f} % of the band has a coherence of {LEAST_COHERENCE:g} or more, at least "
            f"{100.0 * _LEAST_SHARE:.0f} % is required; a larger amplitude, a longer record or a narrower band may help"
        )
    frequencies, transforms = tapered_transform(np.column_stack((excitation, response)), time_step, averaged)
    of_excitation = transforms[:, :1]
    ratio = transforms[:, 1:] / of_excitation
    power = np.abs(of_excitation) ** 2
    width = round((averaged.frequencies[1] - averaged.frequencies[0]) / (frequencies[1] - frequencies[0]))
    coherence = np.maximum(_interpolate(frequencies, averaged.frequencies, averaged.coherence), 1e-6)
    explained = _interpolate(frequencies, averaged.frequencies, np.abs(averaged.response))
    # Where the excitation has less power than its neighbourhood, the same noise is a larger part of the ratio.
    from scipy.ndimage import uniform_filter1d  # as in `frequency_response`

    noise = np.sqrt((1.0 - coherence) / coherence * uniform_filter1d(power, width, axis=0) / power)
    floor = 1e-6 * np.max(explained, axis=0)  # a record without noise has lines of equal weight
    weight = np.where(coherence >= LEAST_COHERENCE, 1.0 / np.maximum(explained * noise, floor), 0.0)
    return SpectralLines(frequencies, ratio, weight)


def tapered_transform(
    signals: FloatArray, time_step: float, averaged: FrequencyResponse
) -> tuple[FloatArray, ComplexArray]:
    """Return the Fourier transform of whole records within the band of an averaged estimate.

    Parameters
    ----------
    signals : ndarray, shape (N, m)
        Records.
    time_step : float
        Δt [s].
    averaged : FrequencyResponse
        Its first and last frequency are the band.

    Returns
    -------
    frequencies : ndarray, shape (n,)
        ω [rad/s].
    transforms : ndarray of complex, shape (n, m)
    """
    length = len(signals)
    from scipy.signal.windows import tukey  # as in `frequency_response`

    window = tukey(length, min(1.0, 2.0 * TAPER / (length * time_step)))
    frequencies = 2.0 * np.pi * np.fft.rfftfreq(length, time_step)
    inside = (frequencies >= averaged.frequencies[0]) & (frequencies <= averaged.frequencies[-1])
    return frequencies[inside], np.fft.rfft(window[:, None] * signals, axis=0)[inside]


def incoherent_bands(averaged: FrequencyResponse) -> list[tuple[float, float]]:
    """Return the bands in which the coherence of any response is too low to be used.

    Parameters
    ----------
    averaged : FrequencyResponse
        Welch estimate.

    Returns
    -------
    list of (float, float)
        First and last frequency of each band [rad/s].
    """
    coherence = averaged.coherence.reshape(len(averaged.frequencies), -1)
    low = np.flatnonzero((coherence < LEAST_COHERENCE).any(axis=1))
    groups = np.split(low, np.flatnonzero(np.diff(low) > 1) + 1) if len(low) else []
    return [(float(averaged.frequencies[group[0]]), float(averaged.frequencies[group[-1]])) for group in groups]


def coherence_summary(averaged: FrequencyResponse) -> dict[str, Any]:
    """Return smallest and median coherence and the bands that were not used, as plain values.

    Parameters
    ----------
    averaged : FrequencyResponse
        Welch estimate.

    Returns
    -------
    dict
        ``smallest``, ``median`` and ``incoherent_bands_hz``, a list of pairs.
    """
    bands = [[lowest / (2.0 * np.pi), highest / (2.0 * np.pi)] for lowest, highest in incoherent_bands(averaged)]
    return {
        "smallest": float(averaged.coherence.min()),
        "median": float(np.median(averaged.coherence)),
        "incoherent_bands_hz": bands,
    }


def _interpolate(at: FloatArray, frequencies: FloatArray, values: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(at, frequencies, column) for column in values.T])
