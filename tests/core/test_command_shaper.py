"""Phase-lead compensator against scipy, python-control and the numbers of PAPER_NOTES (Eq. 10)."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import freqz, lfilter

from bmd_rths_core.compensators.phase_lead import CommandShaper, CommandShaperConfig, stable_weights, transfer_function
from bmd_rths_core.errors import InputError

DT = 0.005
PAPER = CommandShaperConfig(2.0, 2.0, 0.025)


def response_at(config, frequency_hz):
    numerator, denominator = transfer_function(config, DT)
    return freqz(numerator, denominator, worN=[2 * np.pi * frequency_hz * DT])[1][0]


def test_paper_weights_give_the_stated_gain_and_phase():
    numerator, denominator = transfer_function(PAPER, DT)
    assert numerator == (27.0, -23.0, 1.0)
    assert denominator == (2.0, 2.0, 1.0)
    assert sum(numerator) / sum(denominator) == 1.0
    assert np.abs(np.roots(denominator)) == pytest.approx([0.7071, 0.7071], abs=5e-5)
    assert abs(response_at(PAPER, 15.0)) == pytest.approx(2.5, abs=0.05)
    assert np.degrees(np.angle(response_at(PAPER, 15.0))) == pytest.approx(75.0, abs=0.5)
    assert abs(response_at(PAPER, 100.0)) == pytest.approx(51.0, rel=1e-12)


def rounded(value: float) -> float:
    """Return a number that is 0 or none of the smallest, which are refused."""
    return round(value, 10)


@given(st.floats(0.0, 10.0).map(rounded))
def test_lead_at_low_frequency_is_alpha_steps(alpha):
    config = CommandShaperConfig(2.0, 2.0, alpha * DT)
    frequency = 1e-3
    lead = np.angle(response_at(config, frequency)) / (2 * np.pi * frequency)
    assert lead == pytest.approx(alpha * DT, abs=1e-6)


def test_steps_are_those_of_scipy_lfilter_and_python_control():
    signal = np.random.default_rng(0).normal(size=500)
    shaper = CommandShaper(PAPER, DT, active=True)
    ours = np.array([shaper.step(a) for a in signal])
    numerator, denominator = transfer_function(PAPER, DT)
    assert ours == pytest.approx(lfilter(numerator, denominator, signal), rel=1e-12, abs=1e-12)
    theirs = control.forced_response(control.tf(numerator, denominator, DT), U=signal)
    assert ours == pytest.approx(theirs.outputs, rel=1e-10, abs=1e-10)


def test_inactive_shaper_passes_the_desired_acceleration_bit_for_bit():
    shaper = CommandShaper(PAPER, DT, active=False)
    assert [shaper.step(a) for a in (0.1, -3.7, 1e-300)] == [0.1, -3.7, 1e-300]


def test_reset_forgets_the_past():
    shaper = CommandShaper(PAPER, DT, active=True)
    first = [shaper.step(a) for a in (1.0, 2.0, 3.0)]
    shaper.reset()
    assert [shaper.step(a) for a in (1.0, 2.0, 3.0)] == first


@given(st.floats(-6.0, 6.0).map(rounded), st.floats(-8.0, 8.0).map(rounded))
def test_stable_region_is_where_the_poles_are_inside_the_unit_circle(w1, w2):
    if abs(w1) < 1e-3:
        return
    modulus = np.abs(np.roots([w1, w2, 1.0])).max()
    if abs(modulus - 1.0) > 1e-6:
        assert stable_weights(w1, w2) == (modulus < 1.0)


@pytest.mark.parametrize(("w1", "w2"), [(1.0, 0.0), (-1.0, 0.0), (2.0, 3.0), (2.0, -3.0), (-3.0, 2.0), (0.0, 0.0)])
def test_boundary_of_the_stable_region_is_refused(w1, w2):
    with pytest.raises(InputError) as error:
        CommandShaperConfig(w1, w2, 0.025)
    assert f"W1 = {w1:g}, W2 = {w2:g}" in str(error.value)
    assert "|W1| > 1 and |W2| < |W1 + 1| are required" in str(error.value)
    assert "\n" not in str(error.value)
