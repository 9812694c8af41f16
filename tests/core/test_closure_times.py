"""Counted closure times: percentiles by classes against those of numpy, and counts by parts of a step."""

import math

import numpy as np
import pytest

from bmd_rths_core.loop.closure_times import PARTS, ClosureTimes

DT = 0.005


def counted(closures, time_step=DT):
    times = ClosureTimes(time_step)
    for closure in closures:
        times.add(closure)
    return times


@pytest.mark.parametrize("scale", [2e-6, 3e-4, 2e-3, 0.5])
def test_percentiles_are_those_of_all_times_within_half_a_percent(scale):
    closures = np.random.default_rng(0).gamma(4.0, scale, 5000)
    times = counted(closures.tolist())
    for percent in (1.0, 50.0, 99.0, 100.0):
        exact = np.percentile(closures, percent, method="inverted_cdf")
        assert times.percentile(percent) == pytest.approx(exact, rel=0.0051)
    assert times.longest == closures.max()


def test_no_percentile_is_longer_than_the_longest():
    times = counted([0.00123])
    assert times.percentile(50.0) <= times.percentile(99.0) <= times.longest == 0.00123


def test_before_the_first_nothing_is_known():
    times = counted([])
    assert math.isnan(times.percentile(50.0))
    assert math.isnan(times.longest)
    assert sum(times.counts) == 0


def test_counts_are_those_of_a_histogram_of_a_step():
    closures = np.random.default_rng(1).uniform(0.0, 1.2 * DT, 2000)
    expected, _ = np.histogram(closures, bins=PARTS, range=(0.0, DT))
    assert counted(closures.tolist()).counts == tuple(expected)


@pytest.mark.parametrize("closure", [0.0, 1e-9, 40.0, 1e4])
def test_times_beyond_the_classes_are_counted_all_the_same(closure):
    times = counted([closure] * 3)
    assert times.longest == closure
    assert times.percentile(50.0) <= closure


def test_what_is_kept_does_not_grow_with_the_test():
    times = counted([1e-3])
    before = [len(value) for value in vars(times).values() if isinstance(value, list)]
    for _ in range(5000):
        times.add(1e-3)
    assert [len(value) for value in vars(times).values() if isinstance(value, list)] == before
