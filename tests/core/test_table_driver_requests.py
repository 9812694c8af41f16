"""Requests to the table driver (stop, emergency stop, hold, release) in each of its states."""

import numpy as np
import pytest

from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action, State
from tests.core.driven_table import (
    ALL,
    DT,
    PATIENT,
    REAL,
    STATES,
    Asynchronous,
    Host,
    Waiting,
    assert_at_rest,
    reach,
    sine,
)


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("state", STATES)
def test_emergency_stop_in_every_state_reaches_the_controller_at_once(state, kind):
    world = kind()
    host = reach(state, world)
    begun = len(world.begun)
    host.driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "button", world.now)
    assert (host.state, world.calls[-1]) == (DriveState.AT_REST, "emergency_stop")
    assert (host.driver.outcome, host.driver.reason) == (Outcome.STOPPED, "button")
    host.driver.command(1000, 1.0, world.now)
    host.wait(world.now + 1.0)
    assert len(world.begun) == begun


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("ask", ["stop", "finish"])
def test_ramp_in_every_state_ends_at_rest_at_zero(state, kind, ask):
    world = kind()
    host = reach(state, world)
    if ask == "stop":
        host.driver.stop(Action.RAMP, Outcome.STOPPED, "operator", world.now)
        assert (host.driver.outcome, host.driver.reason) == (Outcome.STOPPED, "operator")
    else:
        host.driver.finish(Action.RAMP, world.now)
        assert (host.driver.outcome, host.driver.reason) == (None, "")
    host.to_rest()
    assert host.state is DriveState.AT_REST
    assert_at_rest(world)
    host.driver.command(1000, 1.0, world.now)
    assert host.state is DriveState.AT_REST


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.parametrize("stalls", [{}, {40: 0.2}])
def test_hold_keeps_the_table_off_zero_until_it_is_ramped(kind, stalls):
    world = kind()
    host = Host(world, stalls=stalls)
    host.follow([1.0] * 30)
    host.driver.finish(Action.HOLD, world.now)
    host.to_rest()
    assert host.state is DriveState.HELD
    host.wait(world.now + 3.0)
    assert_at_rest(world, at_zero=False)
    assert abs(world.motions()[-1].displacement) > 0.01
    assert np.diff(world.times).min() >= 0.5 * DT
    host.driver.finish(Action.HOLD, world.now)  # a second hold, or a late end of the test, changes nothing
    assert host.state is DriveState.HELD
    host.wait(world.now + 0.1)
    assert "stop" not in world.calls
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert host.state is DriveState.AT_REST
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
def test_stalls_while_the_table_is_held_do_not_move_it(kind):
    world = kind()
    host = reach(DriveState.HELD, world)
    there = world.motions()[-1].displacement
    for stall in (0.05, 0.5, 3.0):
        world.now += stall
        host.wait(world.now + 0.05)
        assert host.state is DriveState.HELD
    assert world.motions()[-1].displacement == pytest.approx(there, abs=2e-4)
    assert np.diff(world.times)[30:].min() >= 0.5 * DT


@pytest.mark.parametrize("kind", REAL)
def test_hold_that_jitter_has_left_moving_is_corrected_before_it_counts_as_held(kind):
    """Each command on the way is held a little longer than Δt, within what is not planned anew."""
    world = kind()
    host = Host(world)
    host.follow([4.0] * 20)
    host.driver.finish(Action.HOLD, world.now)
    while host.state is DriveState.RETURNING:
        world.now = max(world.now, host.driver.poll(world.now) + 0.0004 * (len(world.begun) % 3))
    assert host.state is DriveState.HELD
    assert host.driver.supervisor.at_rest
    assert_at_rest(world, at_zero=False)


@pytest.mark.parametrize("kind", REAL)
def test_limit_that_asks_for_a_ramp_brings_a_held_table_back(kind):
    world = kind()
    host = reach(DriveState.HELD, world)
    host.driver.supervisor.request(Action.RAMP)  # as a sensor that is lost does
    host.wait(world.now + 2.5 * DT)
    assert host.state is DriveState.RETURNING
    host.to_rest()
    assert host.state is DriveState.AT_REST
    assert_at_rest(world)


def test_severer_request_takes_over_on_the_way():
    world = Waiting()
    host = Host(world)
    host.follow([1.0] * 30)
    host.driver.finish(Action.HOLD, world.now)
    host.wait(world.now + 0.02)
    host.driver.finish(Action.RAMP, world.now)
    host.driver.finish(Action.HOLD, world.now)  # milder: changes nothing
    host.to_rest()
    assert host.state is DriveState.AT_REST
    assert_at_rest(world)


def test_first_outcome_stays_and_the_last_reason_is_told():
    world = Waiting()
    host = Host(world)
    host.follow([1.0] * 10 + [25.0])
    host.driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "button", world.now)
    assert (host.driver.outcome, host.driver.reason) == (Outcome.LIMIT, "button")


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("action", [Action.RAMP, Action.EMERGENCY_STOP])
def test_second_test_begins_from_nothing(kind, action):
    world = kind()
    host = Host(world)
    host.follow([1.0] * 30)
    host.driver.stop(action, Outcome.STOPPED, "operator", world.now)
    host.to_rest()
    world.now += 100.0
    host.driver.arm()
    assert (host.state, host.driver.outcome, host.driver.reason) == (DriveState.ARMED, None, "")
    assert (host.driver.last_passed, host.driver.latest) == (-1, None)
    assert host.driver.supervisor.state is State.NORMAL
    host.follow(sine(30))
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert host.driver.outcome is None
    assert_at_rest(world)


@pytest.mark.parametrize("state", STATES)
def test_release_stops_and_closes_in_every_state(state):
    world = Asynchronous()
    host = reach(state, world)
    host.driver.release()
    assert world.calls[-2:] == ["stop", "close"]
    assert host.state is DriveState.RELEASED
    begun = len(world.begun)
    host.wait(world.now + 1.0)
    assert len(world.begun) == begun


def test_stop_that_is_asked_for_by_the_reader_of_a_measurement():
    """The host may end the test from within the callback."""
    world = Waiting()
    driver = None

    def on_measurement(measurement):
        if measurement.step == 5:
            driver.stop(Action.RAMP, Outcome.STOPPED, "seen enough", world.now)

    driver = TableDriver(world, make_supervisor(PATIENT), DT, False, on_measurement)
    driver.arm()
    for step in range(10):
        driver.command(step, 1.0, world.now)
        world.now += DT
        driver.poll(world.now)
    while driver.moving:
        world.now = max(world.now, driver.poll(world.now))
    assert driver.last_passed == 5
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)
    assert_at_rest(world)
