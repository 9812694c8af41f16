"""Frequency response and coherence against known systems, closed forms and python-control."""

import control
import numpy as np
import pytest
from scipy.signal import coherence, freqz, lfilter

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.frequency_response import (
    FrequencyResponse,
    estimate_frequency_response,
    hold,
    without_hold,
)

DT = 0.005


def noise(seed, steps, outputs=None):
    return np.random.default_rng(seed).normal(size=steps if outputs is None else (steps, outputs))


def test_known_filter_is_found():
    b, a = [0.3, 0.1], [1.0, -1.2, 0.6]
    x = noise(0, 200_000)
    estimate = estimate_frequency_response(x, lfilter(b, a, x), DT, 5.12)
    _, expected = freqz(b, a, worN=estimate.frequencies * DT)
    # No noise: what is left is the smoothing within the width of a segment, 0.2 Hz.
    assert estimate.response == pytest.approx(expected, rel=5e-3)
    assert estimate.coherence.min() >= 0.999
    assert estimate.frequencies[0] == pytest.approx(2 * np.pi / 5.12)
    assert estimate.frequencies[-1] < np.pi / DT


def test_coherence_is_that_of_scipy_for_each_response():
    x = noise(1, 20_000)
    y = np.column_stack((x, x + noise(2, 20_000), noise(3, 20_000)))
    estimate = estimate_frequency_response(x, y, DT, 2.56)
    for j in range(3):
        _, expected = coherence(x, y[:, j], fs=1 / DT, nperseg=512, noverlap=384)
        assert estimate.coherence[:, j] == pytest.approx(expected[1:-1], abs=1e-12)


def test_noise_of_the_response_lowers_the_coherence_as_the_closed_form_says():
    x = noise(4, 400_000)
    y = 2.0 * x + 3.0 * noise(5, 400_000)
    estimate = estimate_frequency_response(x, y, DT, 2.56)
    assert estimate.coherence.mean() == pytest.approx(4.0 / 13.0, abs=0.005)
    assert estimate.response.mean() == pytest.approx(2.0, abs=0.02)


def test_hold_and_reading_at_its_end_are_those_of_a_sampled_system():
    """python-control samples the continuous system with a zero-order hold; row k is read at (k + 1) Δt."""
    continuous = control.tf([2.0e5], [1.0, 85.0, 3.7e4, 1.7e6])
    sampled = control.sample_system(continuous, DT, method="zoh")
    omega = 2 * np.pi * np.linspace(0.5, 20.0, 100)
    rows = control.frequency_response(sampled, omega).complex * np.exp(1j * omega * DT)
    found = without_hold(FrequencyResponse(omega, rows, np.ones(100)), DT)
    expected = control.frequency_response(continuous, omega).complex
    # Only the images are left, of a system that has fallen to some thousandths where they come from.
    assert found.response == pytest.approx(expected, rel=2e-3)


def test_hold_is_half_a_step_early_and_vanishes_at_zero_frequency():
    assert hold(np.array([0.0]), DT) == pytest.approx([1.0])
    omega = np.array([2 * np.pi * 10.0])
    s = 1j * omega
    assert hold(omega, DT) == pytest.approx(np.exp(s * DT) * (1 - np.exp(-s * DT)) / (s * DT))


def test_band_has_its_ends():
    response = FrequencyResponse(np.arange(1.0, 6.0), np.arange(5) * 1j, np.ones(5))
    assert response.between(2.0, 4.0).frequencies.tolist() == [2.0, 3.0, 4.0]
    assert response.between(2.0, 4.0).response.tolist() == [1j, 2j, 3j]


@pytest.mark.parametrize(
    ("excitation", "response", "expected"),
    [
        (np.ones(5000), np.ones(4000), "do not belong together"),
        (np.ones((5000, 2)), np.ones(5000), "do not belong together"),
        (noise(0, 5000), np.where(np.arange(5000) == 7, np.nan, 1.0), "missing"),
        (noise(0, 1000), noise(1, 1000), "too short"),
        (np.zeros(5000), noise(1, 5000), "excitation is zero"),
    ],
)
def test_wrong_signals_are_refused_in_one_line(excitation, response, expected):
    with pytest.raises(InputError, match=expected) as error:
        estimate_frequency_response(excitation, response, DT, 5.12)
    assert "\n" not in str(error.value)
