"""The table driver of a host that is held up: the table ends at rest, within its limits."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bmd_rths_core.loop.states import DriveState
from bmd_rths_core.safety import Action
from bmd_rths_core.safety.commanded_motion import stopping_range
from tests.core.driven_table import DT, PATIENT, REAL, Asynchronous, BySteps, Host, Waiting, assert_at_rest, sine


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.parametrize("stall", [0.02, 0.1, 0.4])
def test_refused_command_after_a_stall_is_braked_from_where_the_table_is(kind, stall):
    """The hold is counted once: the first way to rest leads there, no correction is needed."""
    world = kind()
    host = Host(world)
    host.follow([1.0] * 10)
    world.now += stall
    host.driver.command(10, 25.0, world.now)
    host.to_rest()
    assert host.driver.supervisor._way._corrections == 0
    assert world.times[10] - world.times[9] == pytest.approx(DT + stall)
    assert_at_rest(world)


@pytest.mark.parametrize("late", [0.0, 0.0004])
def test_model_knows_whole_steps_only(late):
    """Commands that come a little late and then a little early are a whole step each for such a table."""
    world = BySteps()
    host = Host(world)
    host.follow(sine(30))
    host.driver.finish(Action.RAMP, world.now)
    count = 0
    while host.driver.moving:
        due = host.driver.poll(world.now)
        count += 1
        world.now = max(world.now, due + late * (count % 2))
    assert host.driver.supervisor._motion.displacement == pytest.approx(world.motions()[-1].displacement, abs=1e-12)
    assert host.driver.supervisor._way._corrections == 0
    assert_at_rest(world)


@pytest.mark.parametrize("stall", [0.02, 0.1, 0.4])
def test_model_in_real_time_comes_to_rest_after_a_stall(stall):
    world = BySteps()
    host = Host(world)
    host.follow([1.0] * 30)
    host.driver.finish(Action.RAMP, world.now)
    host.wait(world.now + 0.05)
    world.now += stall
    host.to_rest()
    assert_at_rest(world)


STALLS = st.dictionaries(st.integers(1, 1500), st.floats(0.0, 0.5), max_size=4)


def judge(world, first_of_way):
    """Hold the motion of a table against the limits, and against what a stall alone has made unavoidable."""
    safety = PATIENT.safety
    farthest, fastest = safety.displacement_limit, safety.velocity_limit
    motions = world.motions()
    for (time, _, _), (next_time, _, _), motion in zip(world.begun, world.begun[1:], motions[1:], strict=False):
        if next_time - time > 1.4 * DT:
            way = stopping_range(motion, safety, DT)
            farthest, fastest = max(farthest, -way.lowest, way.highest), max(fastest, way.velocity)
    assert max(abs(motion.displacement) for motion in motions) <= farthest + 0.006
    assert max(abs(motion.velocity) for motion in motions) <= fastest + 0.02
    between = np.diff(world.times)
    assert between[first_of_way:].min(initial=DT) >= 0.5 * DT - 1e-9  # no bursts
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
@settings(max_examples=15, deadline=None)
@given(stalls=STALLS, amplitude=st.floats(0.1, 6.0), period=st.integers(10, 80), lag=st.floats(0.0, 0.0005))
def test_table_ends_at_rest_however_its_host_is_held_up(kind, stalls, amplitude, period, lag):
    world = kind()
    if kind is Asynchronous:
        world.lag = lag
    host = Host(world, stalls=stalls)
    host.follow(sine(120, amplitude, period))
    last = len(world.begun) if host.state is DriveState.FOLLOWING else host.driver.last_passed + 1
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    judge(world, last)


@pytest.mark.parametrize("kind", REAL)
def test_motion_that_is_not_plausible_is_an_emergency_stop(kind):
    """A host that was held up for a quarter of an hour knows nothing of its table any more."""
    world = kind()
    host = Host(world)
    host.follow([2.0] * 10)
    world.now += 900.0
    host.driver.finish(Action.RAMP, world.now)
    assert (host.state, world.calls[-1]) == (DriveState.AT_REST, "emergency_stop")


#: Delays that one correction after the other repeats.
SAME_AGAIN = (6 * [0.0]) + [1.95e-3, 1.95e-3, 2.8e-3, 3e-3, 2.7e-3, 0.0, 2.6e-3, 1.6e-3, 1.3e-3, 1.2e-3, 1.6e-3]


@settings(max_examples=8, deadline=None)
@example(jitter=[*SAME_AGAIN, 3e-4, 5e-4, 4e-4])
@given(jitter=st.lists(st.floats(0.0, 0.003), min_size=20, max_size=20))
def test_corrections_end_whatever_the_jitter(jitter):
    """Commands of the way to rest that never come on time leave little, and after a few corrections it is enough."""
    world = Waiting()
    host = Host(world)
    host.follow([4.0] * 20)
    host.driver.finish(Action.RAMP, world.now)
    polls = 0
    while host.driver.moving:
        due = host.driver.poll(world.now)
        polls += 1
        assert polls < 20000
        world.now = max(world.now, due + jitter[polls % 20])
    motion = world.motions()[-1]
    assert abs(motion.velocity) <= 1e-3
    assert abs(motion.displacement) <= 1e-3
