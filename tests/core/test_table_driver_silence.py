"""The table driver without news: commands that stop to come, and answers that are late or lost."""

import math

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import LOOKS_BEFORE_SILENCE, MOST_EXCUSES
from bmd_rths_core.safety import Action
from tests.core.driven_table import DT, PATIENT, REAL, Asynchronous, Host, Waiting, assert_at_rest, sine

# ---- commands


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.parametrize("acceleration", [0.5, 3.0, 12.0])
def test_silence_ends_the_test_while_the_limits_can_still_be_kept(kind, acceleration):
    world = kind()
    host = Host(world)
    host.follow([acceleration] * 4)
    host.wait(world.now + 5.0)
    assert host.state is DriveState.AT_REST
    assert (host.driver.outcome, host.driver.last_passed) == (Outcome.LIMIT, 3)
    assert "until rest" in host.driver.reason
    motions = world.motions()
    assert max(abs(motion.displacement) for motion in motions) <= PATIENT.safety.displacement_limit
    assert max(abs(motion.velocity) for motion in motions) <= PATIENT.safety.velocity_limit
    assert max(motion.velocity for motion in motions) > 0.5 * min(1.0, math.sqrt(0.23 * acceleration))
    assert_at_rest(world)


def test_silence_longer_than_is_allowed_ends_the_test():
    world = Asynchronous()
    host = Host(world, Config())
    host.follow([0.01] * 10)
    host.wait(world.now + 5.0)
    assert "safety.stale_shear" in host.driver.reason
    assert_at_rest(world)


@pytest.mark.parametrize("stall", [0.012, 0.05, 0.09])
def test_host_that_was_held_up_does_not_blame_what_lies_unread(stall):
    """It looks a few times before it judges, and so has read the command by then."""
    world = Asynchronous()
    host = Host(world)
    host.follow([1.0] * 40)
    world.now += stall
    for _ in range(LOOKS_BEFORE_SILENCE - 1):
        assert host.driver.poll(world.now) <= world.now
        world.now += 1e-5
    host.driver.command(40, 1.0, world.now)
    assert host.state is DriveState.FOLLOWING
    assert world.begun[-1][1:] == (40, 1.0)


@pytest.mark.parametrize("every", [1.2 * DT, 3.0 * DT])
def test_host_that_is_held_up_at_every_look_does_not_go_on_for_ever(every):
    """A host that is too slow to look twice within Δt has to see that no command comes, too."""
    world = Asynchronous()
    host = Host(world, Config())
    host.follow([0.2] * 10)
    for _ in range((MOST_EXCUSES + 1) * LOOKS_BEFORE_SILENCE):
        host.driver.poll(world.now)
        world.now += every
    assert host.state is DriveState.RETURNING
    assert host.driver.outcome is Outcome.LIMIT


def test_no_command_before_step_0_is_no_silence():
    world = Asynchronous()
    host = Host(world)
    host.wait(world.now + 10.0)
    assert host.state is DriveState.ARMED


# ---- answers


def test_lost_answers_have_no_measurement_and_the_test_goes_on():
    world = Asynchronous(answers=lambda step: None if step % 3 == 1 else 0.002)
    host = Host(world)
    host.follow(sine(60))
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert [m.step for m in host.measured] == [step for step in range(60) if step % 3 != 1]
    assert_at_rest(world)


def test_lost_answers_of_a_controller_that_waits():
    world = Waiting(answers=lambda step: None if step % 3 == 1 else 0.0)
    host = Host(world)
    host.follow(sine(60))
    assert [m.step for m in host.measured] == [step for step in range(60) if step % 3 != 1]


def test_late_answers_are_measurements_of_the_test_also_on_the_way_to_rest():
    world = Asynchronous(answers=lambda step: 2.5 * DT)
    host = Host(world)
    host.follow(sine(60))
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert [m.step for m in host.measured] == list(range(60))
    assert host.driver.latest.step > 60
    assert_at_rest(world)


def test_controller_that_falls_silent_ends_the_test():
    world = Asynchronous(answers=lambda step: 0.001 if step < 10 else None)
    host = Host(world, Config())
    host.follow([0.0] * 200)
    assert "safety.stale_controller" in host.driver.reason
    assert world.calls[-1] == "emergency_stop"
