"""Criteria of the vRTHS benchmark against closed forms."""

import numpy as np
import pytest

from bmd_rths_core.analysis.benchmark_criteria import benchmark_criteria, peak_error_percent
from bmd_rths_core.analysis.table_peaks import table_peaks
from bmd_rths_core.config import Config
from bmd_rths_core.record import RunRecord, empty_signals

DT = 0.005
STEPS = 4000
ANGLE = 2.0 * np.pi * np.arange(STEPS) / 100  # 2 Hz


def record_of(floors=2, **signals):
    """Return a record with some signals; the others are missing."""
    empty = empty_signals(STEPS, floors)
    return RunRecord(DT, **(empty | signals), configuration=Config().as_mapping(), motion={"name": "sine"})


def tracked(desired, achieved):
    """Return the criteria of a table that achieves a signal at the ends of the steps."""
    record = record_of(desired_acceleration=desired, table_acceleration=np.append(achieved[1:], np.nan))
    return benchmark_criteria(record, np.ones((STEPS, 3)), lower=1)


@pytest.mark.parametrize("delay", [-0.01, 0.0, 0.005, 0.025])
def test_tracking_criteria_of_a_pure_delay_have_closed_forms(delay):
    """A sine delayed by a phase φ differs by 2 sin(φ/2) in root mean square, and at its peak."""
    phase = 2.0 * np.pi * 2.0 * delay
    window = np.sin(np.pi * np.arange(STEPS) / STEPS) ** 2  # so that one period is not as good as the next
    assert tracked(window * np.sin(ANGLE), window * np.sin(ANGLE - phase)).tracking_delay_ms == pytest.approx(
        1e3 * delay, abs=0.05
    )
    criteria = tracked(np.sin(ANGLE), np.sin(ANGLE - phase))
    expected = 200.0 * abs(np.sin(phase / 2.0))
    assert criteria.tracking_error_percent == pytest.approx(expected, rel=1e-3, abs=1e-9)
    assert criteria.peak_tracking_error_percent == pytest.approx(expected, rel=2e-3, abs=1e-9)


def test_a_gain_is_its_own_error_and_nothing_is_late():
    desired = np.random.default_rng(0).normal(size=STEPS)
    criteria = tracked(desired, 1.1 * desired)
    assert criteria.tracking_delay_ms == pytest.approx(0.0, abs=0.2)
    assert criteria.tracking_error_percent == pytest.approx(10.0)
    assert criteria.peak_tracking_error_percent == pytest.approx(10.0)


def test_responses_are_compared_floor_by_floor_at_the_time_of_their_sensors():
    reference = np.column_stack([amplitude * np.sin(ANGLE) for amplitude in (1.0, 2.0, 4.0)])
    read = np.vstack((reference[1:, 1:], np.full((1, 2), np.nan)))
    record = record_of(desired_acceleration=0.9 * reference[:, 0], floor_accelerations=read * [1.0, 1.25])
    criteria = benchmark_criteria(record, reference, lower=1)
    assert criteria.response_error_percent == pytest.approx((10.0, 0.0, 25.0))
    assert criteria.peak_response_error_percent == pytest.approx((10.0, 0.0, 25.0))
    symbols = criteria.by_symbol()
    assert list(symbols) == [f"J{i}" for i in range(1, 10)]
    assert (symbols["J4"], symbols["J6"], symbols["J9"]) == pytest.approx((10.0, 25.0, 25.0))


def test_peak_error_leaves_out_what_is_missing_and_needs_a_reference():
    reference = np.array([1.0, np.nan, -4.0, 2.0])
    assert peak_error_percent(reference, np.array([1.0, 9.0, -3.0, np.nan])) == pytest.approx(25.0)
    assert np.isnan(peak_error_percent(np.zeros(4), np.ones(4)))
    assert np.isnan(peak_error_percent(np.full(4, np.nan), np.ones(4)))


def test_peaks_of_the_table_are_those_of_its_sensors():
    amplitude, omega = 0.05, 2.0 * np.pi * 2.0
    record = record_of(
        table_displacement=amplitude * np.sin(ANGLE), table_acceleration=np.append(np.ones(10), [np.nan])
    )
    peaks = table_peaks(record)
    assert peaks.displacement == pytest.approx(amplitude)
    assert peaks.velocity == pytest.approx(amplitude * omega * np.sinc(omega * DT / np.pi))
    assert peaks.acceleration == 1.0
    assert np.isnan(peaks.force)
