"""A host that is late at every command leads its table to rest all the same, or leaves it to the controller."""

import numpy as np
import pytest

from bmd_rths_core.loop.early_end import GIVEN_UP
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.safety import Action
from tests.core.driven_table import DT, Asynchronous, BySteps, Host, Waiting


def late_way_to_rest(world, late, commands=30, acceleration=4.0, ask=None):
    """Stop a table that is fast, and be late [s] at every command; return the host, and how long it took."""
    host = Host(world)
    host.follow([acceleration] * commands)
    begin = world.now
    if ask is not None:
        ask(host)
    elif host.driver.state is DriveState.FOLLOWING:
        host.driver.finish(Action.RAMP, world.now)
    while host.state is DriveState.RETURNING and world.now < begin + 60.0:
        world.now = max(world.now, host.driver.poll(world.now) + late())
    return host, (world.stopped_at or world.now) - begin


def always(late):
    return lambda: late


def at_random(most):
    random = np.random.default_rng(0)
    return lambda: random.uniform(0.0, most)


@pytest.mark.parametrize("kind", [Waiting, Asynchronous])
@pytest.mark.parametrize("late", [always(DT), always(2.0 * DT), at_random(2.0 * DT), at_random(3.0 * DT)])
def test_table_comes_to_rest(kind, late):
    world = kind()
    host, took = late_way_to_rest(world, late)
    assert (host.state, host.driver.outcome) == (DriveState.AT_REST, None)
    assert took < 20.0  # a run waits for longer
    motion = world.motions()[-1]
    assert abs(motion.velocity) < 2e-3
    assert abs(motion.displacement) < 2e-3
    assert max(abs(motion.displacement) for motion in world.motions()) < 0.32


@pytest.mark.parametrize("kind", [Waiting, BySteps])
def test_table_is_left_to_its_controller_by_a_host_that_cannot_lead_it(kind):
    world = kind()
    host, took = late_way_to_rest(world, always(20.0 * DT))
    assert (host.state, world.calls[-1]) == (DriveState.AT_REST, "stop")
    assert (host.driver.outcome, host.driver.reason) == (Outcome.FAILED, GIVEN_UP)
    assert took < 12.0


def test_giving_up_keeps_the_reason_of_the_test():
    world = Waiting()

    def stop(host):
        host.driver.stop(Action.RAMP, Outcome.STOPPED, "stopped by the operator", world.now)

    host, _ = late_way_to_rest(world, always(20.0 * DT), ask=stop)
    assert (host.driver.outcome, host.driver.reason) == (Outcome.STOPPED, f"stopped by the operator; {GIVEN_UP}")


def test_hold_is_given_up_too():
    world = Waiting()
    host, _ = late_way_to_rest(
        world, always(20.0 * DT), acceleration=1.0, ask=lambda host: host.driver.finish(Action.HOLD, world.now)
    )
    assert host.state in (DriveState.HELD, DriveState.AT_REST)


def test_host_that_is_in_time_holds_every_command_for_a_step():
    world = Waiting()
    host, _ = late_way_to_rest(world, always(0.0))
    assert host.driver.supervisor.hold == DT
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)


def test_next_test_begins_with_holds_of_a_step():
    world = Waiting()
    host, _ = late_way_to_rest(world, always(2.0 * DT))
    assert host.driver.supervisor.hold > DT
    host.driver.arm()
    assert host.driver.supervisor.hold == DT


def test_one_stall_on_the_way_keeps_the_time_step():
    world, stalls = Waiting(), iter([0.1])
    host, _ = late_way_to_rest(world, lambda: next(stalls, 0.0))
    assert host.driver.supervisor.hold == DT
    assert np.diff(world.times)[40:] == pytest.approx(DT, abs=1e-9)
