"""How well the table follows the desired acceleration: error, delay, amplitude, indicator, spectrum and peak."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.frequency_evaluation import frequency_evaluation
from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold
from bmd_rths_core.integration.linear_simulation import SimulationFromRest

FloatArray = NDArray[np.float64]

#: Frequencies of the response spectrum [Hz], sixths of an octave, and its damping ratio: ICC-ES AC156 (2010), 6.5.
SPECTRUM_HZ = 1.3 * 2.0 ** (np.arange(29) / 6.0)
SPECTRUM_DAMPING = 0.05
#: Tolerance of the achieved spectrum over the desired one: ICC-ES AC156 (2010), 6.5.
SPECTRUM_TOLERANCE = (0.9, 1.3)


@dataclass(frozen=True)
class TrackingQuality:
    """The table against the desired acceleration, both at the end of a step.

    Parameters
    ----------
    error_percent : float
        √(Σ (y − x)² / Σ x²) · 100 [%] without the noise of the accelerometer on the table.
    amplitude, delay_ms, frequency_hz : float
        See `frequency_evaluation`.
    indicator : float
        Last value of the tracking indicator over that of a table that lags by a quarter of a period: the sine of the
        phase, > 0 where the table lags.
    spectrum_out_percent : float
        Share of the frequencies of the response spectrum at which that of the table is out of tolerance [%].
    peak_ratio : float
        Largest absolute acceleration of the table over the desired one.
    """

    error_percent: float
    amplitude: float
    delay_ms: float
    frequency_hz: float
    indicator: float
    spectrum_out_percent: float
    peak_ratio: float


def tracking_indicator(desired: FloatArray, achieved: FloatArray) -> FloatArray:
    """Return the tracking indicator of Mercan over the steps.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        x and y at the same times, without gaps.

    Returns
    -------
    ndarray, shape (N,)
        ½ (∫ x dy − ∫ y dx), the area between x and y: it grows where y lags, falls where it leads and stays where only
        the amplitude is wrong. A sine of amplitude 1 that is late by φ adds π sin φ a period.

    Notes
    -----
    Mercan and Ricles (2007), Stability and accuracy analysis of outer loop dynamics in real-time pseudodynamic testing
    of SDOF systems, Earthquake Engineering and Structural Dynamics 36, 1523-1543. By the rule of trapezoids.
    """
    if not len(desired):
        return np.zeros(0)
    area = desired[:-1] * achieved[1:] - desired[1:] * achieved[:-1]
    return np.concatenate(([0.0], np.cumsum(0.5 * area)))


def response_spectrum(
    acceleration: FloatArray, time_step: float, frequencies: FloatArray, damping: float
) -> FloatArray:
    """Return the absolute acceleration spectrum of a motion.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        Of the base, linear between the samples [m/s²].
    time_step : float
        Δt [s].
    frequencies : ndarray, shape (f,)
        Natural frequencies of the oscillators [Hz].
    damping : float
        Damping ratio of the oscillators.

    Returns
    -------
    ndarray, shape (f,)
        Largest absolute acceleration of every oscillator at the samples, exact [m/s²].
    """
    oscillators = _oscillators(time_step, tuple(frequencies.tolist()), damping)
    return np.array([np.max(np.abs(each.outputs(acceleration)), initial=0.0) for each in oscillators])


@functools.lru_cache(maxsize=4)  # desired and achieved, and each run of a laboratory, have the same
def _oscillators(time_step: float, frequencies: tuple[float, ...], damping: float) -> list[SimulationFromRest]:
    """Return oscillators from the acceleration of their base to their own, absolute one."""
    oscillators = []
    for omega in 2.0 * np.pi * np.array(frequencies):
        a = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])
        phi, before, now = first_order_hold(a, np.array([[0.0], [-1.0]]), time_step)
        # The state less what the ground acceleration of its own step has added: one input a step.
        oscillators.append(SimulationFromRest(DiscreteStateSpace(phi, phi @ now + before, a[1:], a[1:] @ now)))
    return oscillators


def tracking_quality(desired: FloatArray, achieved: FloatArray, time_step: float, noise: float) -> TrackingQuality:
    """Judge how the table followed.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        At the same times [m/s²]; samples where one of them is NaN count as zero in both.
    time_step : float
        Δt [s].
    noise : float
        Root mean square of the noise in the achieved signal, which is taken from the error [m/s²].

    Returns
    -------
    TrackingQuality
        NaN where nothing can be compared.
    """
    valid = np.isfinite(desired) & np.isfinite(achieved)
    x, y = np.where(valid, desired, 0.0), np.where(valid, achieved, 0.0)
    power = float(np.sum(x**2))
    if power == 0.0 or not np.isfinite(power) or not np.isfinite(y).all():
        return TrackingQuality(*[float("nan")] * 7)
    error = rmse_percent(x, y)
    floor = 1e2 * noise * float(np.sqrt(valid.sum() / power))
    evaluation = frequency_evaluation(x, y, time_step)
    wanted, got = (response_spectrum(signal, time_step, SPECTRUM_HZ, SPECTRUM_DAMPING) for signal in (x, y))
    lowest, highest = SPECTRUM_TOLERANCE
    outside = (got < lowest * wanted) | (got > highest * wanted)
    # A sine of amplitude A has ∫ x dy − ∫ y dx = A² ω t sin φ, and Σ x² = N A²/2.
    turned = power * time_step * 2.0 * np.pi * evaluation.frequency_hz
    return TrackingQuality(
        error_percent=float(np.sqrt(max(0.0, error**2 - floor**2))),
        **evaluation._asdict(),
        indicator=float(tracking_indicator(x, y)[-1]) / turned,
        spectrum_out_percent=100.0 * float(outside.mean()),
        peak_ratio=float(np.max(np.abs(y)) / np.max(np.abs(x))),
    )
