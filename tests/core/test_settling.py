"""What a table does at the end of its way is seen by its displacement sensor, however many of its answers come."""

import math

import numpy as np
import pytest

from bmd_rths_core.safety.settling import LAG_TIME, LONGEST_WATCH, WATCH_TIME, Settling

DT = 0.005
STEPS, LAG = round(WATCH_TIME / DT), round(LAG_TIME / DT)


def watched(displacement, answered=lambda step: True):
    """Return the steps that were watched, and the motion that was found."""
    settling, step = Settling(DT), 0
    settling.observe(-1, 0.0)
    while settling.watches(step):
        if answered(step):
            settling.observe(step, displacement(step))
        step += 1
    return step, settling.found()


def test_a_drift_is_found_with_its_velocity():
    noise = np.random.default_rng(0).normal(0.0, 5e-5, STEPS)
    steps, found = watched(lambda step: 2e-3 * DT * step + noise[step])
    assert steps == STEPS
    assert found.velocity == pytest.approx(2e-3, rel=0.1)
    assert found.displacement == pytest.approx(2e-3 * DT * steps, rel=0.1)


def test_a_table_at_rest_is_left_alone():
    assert watched(lambda step: 1e-4) == (STEPS, None)


def test_a_host_that_saw_too_little_watches_on():
    """All answers but those of the last 25 ms are lost: five of them told nothing of a table that moves at 1.5 mm/s."""
    steps, found = watched(lambda step: 1.5e-3 * DT * step, lambda step: step >= STEPS - 5)
    assert steps == STEPS - 5 + (STEPS - LAG) // 2
    assert found.velocity == pytest.approx(1.5e-3)


@pytest.mark.parametrize("answered", [lambda step: False, lambda step: step % 40 == 0])
def test_a_silent_controller_is_not_watched_for_ever(answered):
    steps, _ = watched(lambda step: 0.0, answered)
    assert steps == LONGEST_WATCH * STEPS


def test_a_table_without_the_sensor_is_watched_no_longer():
    settling, step = Settling(DT), 0
    while settling.watches(step):
        settling.observe(step, math.nan)
        step += 1
    assert (step, settling.found()) == (STEPS, None)
