"""Deadlines: misses, late arrivals and closure times, with times given by hand."""

import math

from bmd_rths_core.loop.deadlines import DeadlineMonitor


def test_steps_that_close_in_time_give_their_closure_times():
    monitor = DeadlineMonitor(steps=3, max_consecutive_misses=0)
    for step, closure in enumerate((0.001, 0.003, 0.002)):
        monitor.opened(step, 0.005 * step)
        assert monitor.closed(step, 0.005 * step + closure)
    timing = monitor.statistics()
    assert timing.missed_deadlines == 0
    assert math.isclose(timing.closure_ms["p50"], 2.0)
    assert math.isclose(timing.closure_ms["max"], 3.0)


def test_late_early_and_repeated_shears_close_nothing():
    monitor = DeadlineMonitor(steps=4, max_consecutive_misses=5)
    monitor.opened(0, 0.0)
    assert not monitor.closed(1, 0.001)
    assert monitor.closed(0, 0.002)
    assert not monitor.closed(0, 0.003)
    monitor.opened(1, 0.005)
    monitor.opened(2, 0.010)
    assert not monitor.closed(1, 0.011)
    assert monitor.statistics().missed_steps == (1,)


def test_misses_in_a_row_exhaust_the_monitor_and_a_closed_step_starts_the_count_again():
    monitor = DeadlineMonitor(steps=10, max_consecutive_misses=2)
    for step in range(3):
        monitor.opened(step, 0.005 * step)
    assert not monitor.exhausted
    assert monitor.closed(2, 0.011)
    for step in range(3, 7):
        monitor.opened(step, 0.005 * step)
        assert monitor.exhausted == (step == 6)
    monitor.closed(6, 0.031)
    timing = monitor.statistics()
    assert timing.missed_steps == (0, 1, 3, 4, 5)
    assert timing.max_consecutive_misses == 3


def test_nothing_closed_gives_nan():
    assert math.isnan(DeadlineMonitor(steps=1, max_consecutive_misses=0).statistics().closure_ms["p99"])
