"""Deadlines: misses, late arrivals and closure times, with times given by hand."""

import math

import pytest

from bmd_rths_core.loop.deadlines import DeadlineMonitor

DT = 0.005


def opened(monitor, step, late=0.0):
    monitor.opened(step, DT * step + late, DT * (step + 1))


def test_steps_that_close_in_time_give_their_closure_times():
    monitor = DeadlineMonitor(DT, longest_miss=0.0)
    for step, closure in enumerate((0.001, 0.003, 0.002)):
        opened(monitor, step)
        assert monitor.closed(step, DT * step + closure)
    timing = monitor.statistics()
    assert timing.missed_deadlines == 0
    assert timing.closure_ms["p50"] == pytest.approx(2.0, rel=0.005)
    assert math.isclose(timing.closure_ms["max"], 3.0)


def test_early_repeated_and_older_shears_close_nothing():
    monitor = DeadlineMonitor(DT, longest_miss=5 * DT)
    opened(monitor, 0)
    assert not monitor.closed(1, 0.001)
    assert monitor.closed(0, 0.002)
    assert not monitor.closed(0, 0.003)
    opened(monitor, 1)
    opened(monitor, 2)
    assert not monitor.closed(1, 0.011)
    assert monitor.statistics().missed_steps == (1,)


@pytest.mark.parametrize(
    ("began_late", "closes", "missed"), [(0.0, 4.9, 0), (0.0, 5.0, 1), (0.0, 5.1, 1), (4.0, 4.9, 0), (35, 35.2, 1)]
)
def test_deadline_is_by_the_clock_whoever_was_late(began_late, closes, missed):
    """A step that began 35 ms late has missed its deadline, however fast it closes then; one 4 ms late has not."""
    monitor = DeadlineMonitor(DT, longest_miss=1.0)
    monitor.opened(0, 1e-3 * began_late, DT)
    assert monitor.closed(0, 1e-3 * closes)
    timing = monitor.statistics()
    assert timing.missed_deadlines == missed
    assert math.isnan(timing.closure_ms["max"]) == bool(missed)


def test_misses_in_a_row_exhaust_the_monitor_and_a_closed_step_starts_the_count_again():
    monitor = DeadlineMonitor(DT, longest_miss=2 * DT)

    def exhausted(step):
        monitor.expired(DT * step)
        return monitor.exhausted(DT * step, DT * (step + 1))

    for step in range(3):
        assert not exhausted(step)
        opened(monitor, step)
    assert monitor.closed(2, 0.011)
    for step in range(3, 6):
        assert not exhausted(step)
        opened(monitor, step)
    assert exhausted(6)
    timing = monitor.statistics()
    assert timing.missed_steps == (0, 1, 3, 4, 5)
    assert timing.max_consecutive_misses == 3


def test_one_long_stall_exhausts_it_as_many_misses_do():
    monitor = DeadlineMonitor(DT, longest_miss=20 * DT)
    opened(monitor, 0)
    monitor.closed(0, 0.001)
    assert not monitor.exhausted(now=DT + 20 * DT, next_deadline=2 * DT)
    assert monitor.exhausted(now=DT + 22 * DT, next_deadline=2 * DT)


def test_nothing_is_missed_before_its_deadline():
    """The end of a test, and lockstep, where there is no deadline."""
    monitor = DeadlineMonitor(DT, longest_miss=0.0)
    monitor.opened(0, 0.0, math.inf)
    monitor.expired(1e9)
    assert monitor.statistics().missed_deadlines == 0


def test_nothing_closed_gives_nan():
    assert math.isnan(DeadlineMonitor(DT, longest_miss=0.0).statistics().closure_ms["p99"])
