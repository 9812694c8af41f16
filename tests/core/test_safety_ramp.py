"""Ramps to rest: nothing is left, and nothing is passed on the way, from any motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.safety.commanded_motion import Motion, stopping_range
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.ramp import longest_ramp, ramp_commands, stop_commands

CONFIG = SafetyConfig()
STEPS = st.sampled_from([0.0005, 0.001, 0.005, 0.01])


def within(limit):
    return st.floats(-limit, limit)


MOTIONS = st.builds(
    Motion, within(CONFIG.displacement_limit), within(CONFIG.velocity_limit), within(CONFIG.acceleration_limit)
)


def followed(motion, commands, dt):
    """Return displacement and velocity at the end of each held command, by cumulative sums."""
    velocity = motion.velocity + dt * np.cumsum(commands)
    before = np.concatenate(([motion.velocity], velocity[:-1]))
    displacement = motion.displacement + np.cumsum(dt * before + 0.5 * dt**2 * commands)
    return displacement, velocity


@given(MOTIONS, STEPS)
def test_ramp_leaves_neither_velocity_nor_displacement(motion, dt):
    commands = ramp_commands(motion, CONFIG, dt)
    displacement, velocity = followed(motion, commands, dt)
    assert abs(velocity[-1]) < 1e-12
    assert abs(displacement[-1]) < 1e-11


@given(MOTIONS, STEPS)
def test_stop_leaves_no_velocity(motion, dt):
    assert abs(followed(motion, stop_commands(motion, CONFIG, dt), dt)[1][-1]) < 1e-12


@given(MOTIONS, STEPS)
def test_acceleration_and_jerk_are_limited(motion, dt):
    commands = ramp_commands(motion, CONFIG, dt)
    assert np.abs(commands).max() <= max(abs(motion.acceleration), CONFIG.ramp_acceleration) * (1.0 + 1e-9)
    jerk = np.diff(np.concatenate(([motion.acceleration], commands, [0.0]))) / dt
    assert np.abs(jerk).max() <= CONFIG.ramp_jerk * (1.0 + 1e-9)
    unwound = np.flatnonzero(commands == 0.0)[0]
    assert np.abs(commands[unwound:]).max() <= CONFIG.ramp_acceleration * (1.0 + 1e-9)


@given(MOTIONS, STEPS)
def test_stopping_range_holds_the_way_to_rest_and_is_not_much_larger(motion, dt):
    way = stopping_range(motion, CONFIG, dt)
    stop = stop_commands(motion, CONFIG, dt)
    ends, velocities = followed(motion, stop, dt)
    displacement, velocity = np.append(ends, motion.displacement), np.append(velocities, motion.velocity)
    assert way.lowest <= displacement.min() + 1e-12
    assert way.highest >= displacement.max() - 1e-12
    assert way.velocity == pytest.approx(np.abs(velocity).max(), abs=1e-12)
    rest = ends[-1]
    assert min(abs(way.lowest - rest), abs(way.highest - rest)) < 1e-12 or motion.velocity * motion.acceleration < 0.0
    # The return begins at rest and is monotone: the whole ramp stays between this range and zero.
    ramp, _ = followed(motion, ramp_commands(motion, CONFIG, dt), dt)
    assert ramp.min() >= min(way.lowest, 0.0) - 1e-11
    assert ramp.max() <= max(way.highest, 0.0) + 1e-11


@given(MOTIONS, STEPS)
def test_ramp_keeps_the_stated_time(motion, dt):
    way = stopping_range(motion, CONFIG, dt)
    within_limits = max(-way.lowest, way.highest) <= CONFIG.displacement_limit
    if within_limits and way.velocity <= CONFIG.velocity_limit:
        assert dt * len(ramp_commands(motion, CONFIG, dt)) <= longest_ramp(CONFIG, dt) + 1e-12


def test_braking_distance_is_that_of_a_raised_cosine():
    """V T / 2 with the peak deceleration 2 v / T: twice the v² / 2a of a constant deceleration."""
    way = stopping_range(Motion(0.0, 0.5, 0.0), CONFIG, 0.001)
    assert way.highest == pytest.approx(0.5**2 / CONFIG.ramp_acceleration, rel=0.02)
    assert longest_ramp(CONFIG, 0.005) == pytest.approx(0.04 + 0.4 + 2.3, abs=0.02)


def test_table_at_rest_stays_where_it_is():
    assert not ramp_commands(Motion(0.0, 0.0, 0.0), CONFIG, 0.005).any()
    assert not stop_commands(Motion(0.1, 0.0, 0.0), CONFIG, 0.005).any()
