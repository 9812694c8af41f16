"""What the supervisor foresees: a command is refused when the table could no longer be braked within its limits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bmd_rths_core.safety import Action, SafetyConfig, SafetySupervisor, State
from bmd_rths_core.safety.ramp import longest_ramp
from tests.conftest import WITHOUT_LIMITS
from tests.core.test_safety_supervisor import (
    DT,
    STOPPING,
    measurement,
    supervisor,
    way_to_rest,
)


def test_displacement_limit_acts_before_the_braking_distance_is_used_up():
    """At constant acceleration the trip comes where the stop just fits; the braking then stays within the limit."""
    observed = supervisor(displacement_action="hold")
    displacement = velocity = 0.0
    step = 0
    while observed.check(step, 1.0):
        displacement, velocity = displacement + DT * velocity + 0.5 * DT**2, velocity + DT
        observed.observe(measurement(step, 1.0, math.nan, 1.0))
        step += 1
    (trip,) = observed.trips
    assert (trip.limit, trip.step) == ("safety.displacement_limit", step)
    farthest = displacement
    for command in way_to_rest(observed):
        displacement += DT * velocity + 0.5 * DT**2 * command.acceleration
        velocity += DT * command.acceleration
        farthest = max(farthest, displacement)
    limit = SafetyConfig().displacement_limit
    assert velocity == pytest.approx(0.0, abs=1e-12)
    assert limit - 0.01 < farthest <= limit
    assert trip.value == pytest.approx(limit, abs=0.01)


def test_velocity_limit_acts_on_the_predicted_velocity():
    observed = supervisor(velocity_limit=0.1025, ramp_velocity=0.1, stale_controller_action="ignore")
    steps = next(step for step in range(100) if not observed.check(step, 1.0))
    (trip,) = observed.trips
    assert trip.limit == "safety.velocity_limit"
    assert steps == 20  # 0.1 m/s after 20 commands; from 1 m/s² the acceleration falls to zero in one step
    assert trip.value == pytest.approx(21 * DT)


def test_lasting_difference_to_the_measured_displacement_is_taken_into_account():
    """A table that stands 0.2 m off centre has only 0.03 m left on that side."""
    observed, fresh = supervisor(stale_controller_action="ignore"), supervisor(stale_controller_action="ignore")
    for step in range(3000):
        assert observed.check(step, 0.0)
        observed.observe(measurement(step, displacement=0.2))
    on_this_side = next(k for k in range(200) if not observed.check(3000 + k, 1.0))
    centred = next(k for k in range(200) if not fresh.check(k, 1.0))
    assert on_this_side < 0.5 * centred


def test_motion_follows_what_the_controller_really_applied():
    observed = supervisor()
    for step in range(100):
        assert observed.check(step, 0.4)
        observed.observe(measurement(step, applied=0.0, acceleration=0.0))
    observed.request(Action.RAMP)
    assert all(command.acceleration == 0.0 for command in way_to_rest(observed))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=400), st.sampled_from(STOPPING[:2]))
def test_no_sequence_of_commands_brings_the_table_out_of_its_limits(commands, action):
    """What was passed on and what follows to rest stays within displacement, velocity and acceleration limit."""
    config = SafetyConfig(displacement_limit=0.05, velocity_limit=0.4, increment_action="ignore")
    observed = SafetySupervisor(config, DT)
    passed = []
    for step, command in enumerate(commands):
        if not observed.check(step, command):
            break
        passed.append(command)
        observed.observe(measurement(step, command, math.nan, command))
    observed.request(action)
    way = [command.acceleration for command in way_to_rest(observed)]
    accelerations = np.array(passed + way)
    assert len(way) * DT <= longest_ramp(config, DT)
    velocity = DT * np.cumsum(accelerations)
    displacement = np.cumsum(DT * np.concatenate(([0.0], velocity[:-1])) + 0.5 * DT**2 * accelerations)
    assert np.abs(displacement).max() <= 0.05 + 1e-12
    assert np.abs(velocity).max() <= 0.4 + 1e-12
    assert np.abs(accelerations).max() <= 20.0
    assert abs(velocity[-1]) < 1e-12
    if observed.state is State.STOPPED:  # ramped, not held
        assert abs(displacement[-1]) < 1e-12


@pytest.mark.parametrize("applied", [1e4, -1e300])
def test_absurd_applied_command_stops_the_table_without_a_ramp(applied):
    """No ramp leads back from where such a command would have brought the table."""
    observed = supervisor()
    assert observed.check(0, 0.0)
    observed.observe(measurement(0, applied))
    assert not observed.check(1, 0.0)
    assert observed.advance() is None
    assert observed.state is State.STOPPED


def test_nothing_fails_without_limits_however_large_the_command():
    observed = supervisor(**{name.removeprefix("safety__"): value for name, value in WITHOUT_LIMITS.items()})
    for step in range(200):
        assert observed.check(step, (-10.0) ** min(step, 300))
        observed.observe(measurement(step, (-10.0) ** min(step, 300)))
    observed.request(Action.RAMP)
    assert observed.advance() is None
