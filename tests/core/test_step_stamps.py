"""Stamps of steps: exact where Δt is a whole number of nanoseconds, and one for each step where it is not."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.time_steps import StepStamps


@given(st.integers(100_000, 100_000_000), st.integers(0, 10**7))
def test_whole_nanoseconds_are_multiples(nanoseconds, step):
    stamps = StepStamps(nanoseconds * 1e-9)
    assert stamps.of(step) == step * nanoseconds
    assert stamps.step(step * nanoseconds) == stamps.step_under_way(step * nanoseconds) == step
    assert stamps.step(step * nanoseconds + 1) is None
    assert stamps.step_under_way((step + 1) * nanoseconds - 1) == step


@pytest.mark.parametrize("rate", [1024, 2048, 4096, 300, 600, 7])
@given(step=st.integers(0, 10**7))
def test_rates_of_laboratories_stay_at_their_time(rate, step):
    stamps, exact = StepStamps(1.0 / rate), Fraction(step * 10**9, rate)
    stamp = stamps.of(step)
    assert abs(stamp - exact) <= Fraction(1, 2)
    # Another program rounds down, or up.
    assert {stamps.step(int(exact)), stamps.step(-int(-exact)), stamps.step(stamp)} == {step}
    assert stamps.step_under_way(int(exact)) == stamps.step_under_way(stamp) == step
    assert stamps.step(stamp + 2) is None
