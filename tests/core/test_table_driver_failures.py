"""The table driver whose controller or host fails: the table is stopped at once, and the one to blame is named."""

import pytest

from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action
from tests.core.driven_table import DT, PATIENT, REAL, Asynchronous, BySteps, Host, Waiting


def failing(call, at):
    def fails(name, step):
        if name == call and step >= at:
            raise OSError("network is down")

    return fails


@pytest.mark.parametrize(
    ("kind", "call"), [(Waiting, "exchange"), (BySteps, "exchange"), (Asynchronous, "begin"), (Asynchronous, "poll")]
)
@pytest.mark.parametrize("at", [0, 20, 45])
def test_controller_that_fails_is_stopped_at_once_and_once(kind, call, at):
    """At step 0, in the test, and on the way to rest, which begins at step 40."""
    world = kind(fails=failing(call, at))
    host = Host(world)
    host.follow([1.0] * 40)
    if host.driver.moving:
        host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    host.wait(world.now + 1.0)
    assert host.state is DriveState.AT_REST
    assert (host.driver.outcome, world.calls.count("emergency_stop")) == (Outcome.FAILED, 1)
    assert host.driver.reason.startswith("table controller at step")
    assert host.driver.reason.endswith("network is down")
    assert max(world.steps, default=0) <= at


def test_controller_that_fails_before_step_0_is_told_without_a_step():
    world = Asynchronous(fails=failing("poll", -1))
    host = Host(world)
    host.driver.poll(world.now)
    assert host.driver.reason == "table controller: network is down"
    assert host.state is DriveState.AT_REST


def test_controller_that_cannot_be_connected_leaves_the_driver_released():
    world = Waiting(fails=failing("connect", -1))
    with pytest.raises(OSError, match="network is down"):
        Host(world)


@pytest.mark.parametrize("kind", REAL)
def test_failure_of_the_host_is_not_blamed_on_the_controller(kind):
    """A host that cannot write its progress, say: the error is its own."""

    def broken(measurement):
        raise BrokenPipeError("the host cannot write")

    world = kind()
    driver = TableDriver(world, make_supervisor(PATIENT), DT, False, broken)
    driver.arm()
    with pytest.raises(BrokenPipeError, match="the host cannot write"):
        _step_and_answer(driver, world)
    assert driver.outcome is None
    driver.release()
    assert world.calls[-2:] == ["stop", "close"]


def _step_and_answer(driver, world):
    driver.command(0, 1.0, world.now)
    world.now += 0.002
    driver.poll(world.now)
