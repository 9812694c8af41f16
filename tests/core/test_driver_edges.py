"""What a driver does when two things happen in one slot, or one at a bad moment: with the real link."""

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import LOOKS_BEFORE_SILENCE, MOST_EXCUSES, NOT_CONFIRMED, TableDriver
from bmd_rths_core.safety import Action
from bmd_rths_core.table.emulated.faults import Faults, parse_fault
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_core.table.wire import ControllerState
from tests.faults.rig import SESSION, Rig, Trial, VirtualNetwork

DT = 0.005
CONFIG = Config().changed(virtual_controller__model="servo")


class Bench:
    """A table driver with the UDP controller of the product, in virtual time."""

    def __init__(self, **changes):
        self.config = CONFIG.changed(**changes)
        self.faults = Faults([])
        self.network = VirtualNetwork(self.config, self.faults)
        self.measured, self.way = [], []
        self.driver = TableDriver(
            make_udp_table(self.config, self.network, SESSION),
            make_supervisor(self.config),
            DT,
            False,
            self.measured.append,
            self.way.append,
        )
        self.driver.arm()
        self.step = 0

    @property
    def controller(self):
        return self.network.controller

    @property
    def now(self):
        return self.network.now()

    def fault(self, text):
        self.faults.set(parse_fault(text, "servo"))

    def poll_until(self, until):
        while self.now < until:
            due = self.driver.poll(self.now)
            self.network.pass_time(self.network.time + max(1000, round(1e9 * (min(due, until) - self.now))))

    def follow(self, commands):
        for acceleration in commands:
            end = self.now + DT
            self.driver.command(self.step, float(acceleration), self.now)
            self.step += 1
            self.poll_until(end)

    def to_rest(self, seconds=20.0):
        end = self.now + seconds
        while self.driver.state is DriveState.RETURNING and self.now < end:
            self.poll_until(self.now + DT)
        assert self.driver.state is not DriveState.RETURNING


def told(bench):
    return bench.driver.outcome, bench.driver.reason


# ---- a limit in the last slot, and on the way to rest


def test_limit_of_the_last_slot_is_latched_although_the_test_has_ended_by_itself():
    bench = Bench(safety__force_limit=1.0)
    bench.follow([0.5])
    assert bench.measured
    assert bench.driver.state is DriveState.FOLLOWING  # it takes effect with the next command, which does not come
    bench.driver.finish(Action.RAMP, bench.now)
    bench.to_rest()
    outcome, reason = told(bench)
    assert outcome is Outcome.LIMIT
    assert reason.startswith("safety.force_limit [N] passed at step 0")


@pytest.mark.parametrize("action", ["ramp", "emergency_stop"])
@pytest.mark.parametrize("end", [Action.RAMP, Action.HOLD])
def test_limit_that_is_passed_on_the_way_to_rest_is_told_and_latched(action, end):
    bench = Bench(safety__non_finite_action=action)
    bench.follow([1.0] * 20)
    bench.driver.finish(end, bench.now)
    bench.poll_until(bench.now + 0.05)
    bench.fault("nan=force")
    bench.poll_until(bench.now + 3.0 * DT)  # after a hold the table stands by then
    bench.to_rest()
    outcome, reason = told(bench)
    assert outcome is Outcome.LIMIT
    assert reason.startswith("safety.non_finite_action: actuator force at step")
    assert bench.driver.state is DriveState.AT_REST
    assert (bench.controller.state is ControllerState.INTERLOCK) is (action == "emergency_stop")


def test_emergency_stop_by_a_limit_is_told_also_where_the_operator_has_stopped_the_test():
    bench = Bench(safety__non_finite_action="emergency_stop")
    bench.follow([1.0] * 20)
    bench.driver.stop(Action.RAMP, Outcome.STOPPED, "stopped by the operator", bench.now)
    bench.fault("nan=force")
    bench.to_rest()
    outcome, reason = told(bench)
    assert outcome is Outcome.STOPPED
    assert reason.startswith("stopped by the operator; safety.non_finite_action: actuator force at step")


def test_motion_that_is_not_plausible_is_told_and_latched():
    bench = Bench(safety__stale_shear_action="ignore")
    bench.follow([2.0] * 10)
    bench.driver.finish(Action.RAMP, bench.now + 900.0)
    outcome, reason = told(bench)
    assert (outcome, bench.driver.state) == (Outcome.FAILED, DriveState.AT_REST)
    assert "900" in reason


def test_loop_in_process_tells_what_has_ended_its_way_to_rest():
    config = CONFIG.changed(ground_motion__duration=0.2, safety__non_finite_action="emergency_stop")
    rig = Rig(Trial("no force on the way to rest", config, 0, ("nan=force@45",)))
    assert rig.loop.conductor.steps == 41
    outcome, reason = rig.run()
    assert outcome == "finished"
    assert reason.startswith("end of the ground motion; on the way to rest: safety.non_finite_action: actuator force")


# ---- step 0 of another test, and a controller that does not want to be armed again


@pytest.mark.parametrize("state", [DriveState.FOLLOWING, DriveState.RETURNING, DriveState.HELD])
def test_table_that_moves_is_not_armed_anew(state):
    bench = Bench()
    bench.follow([1.0] * 20)
    if state is not DriveState.FOLLOWING:
        bench.driver.finish(Action.HOLD if state is DriveState.HELD else Action.RAMP, bench.now)
    if state is DriveState.HELD:
        bench.to_rest()
    motion = bench.driver.supervisor.motion
    with pytest.raises(RuntimeError, match="the table moves"):
        bench.driver.arm()
    assert (bench.driver.state, bench.driver.supervisor.motion) == (state, motion)
    assert bench.controller.state is ControllerState.RUNNING


def test_controller_that_cannot_be_armed_again_leaves_what_is_known_of_its_table():
    bench = Bench(table__give_up_after=0.05)
    bench.follow([1.0] * 5)
    bench.fault("dead")
    bench.driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "button", bench.now)
    assert bench.driver.stop_problem == NOT_CONFIRMED
    with pytest.raises(RuntimeError, match="no answer"):
        bench.driver.arm()
    assert (*told(bench), bench.driver.stop_problem) == (Outcome.STOPPED, "button", NOT_CONFIRMED)
    bench.driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "button again", bench.now)
    assert bench.driver.stop_problem == NOT_CONFIRMED
    bench.faults.clear("dead")
    bench.driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "and again", bench.now)
    assert bench.driver.stop_problem == ""


# ---- steps that jump ahead


@pytest.mark.parametrize("first", [0, 20])
@pytest.mark.parametrize("step", [700, 2**31, 2**32, 10**12])
def test_command_of_a_step_that_no_clock_has_reached_is_refused(first, step):
    """Of another test, say: it would move the table from rest into the middle of it."""
    bench = Bench()
    bench.follow([0.1] * first)
    bench.driver.command(step, 1.0, bench.now)
    outcome, reason = told(bench)
    assert (outcome, bench.driver.last_passed) == (Outcome.LIMIT, first - 1)
    assert "safety.stale_shear_time" in reason
    bench.to_rest()
    assert bench.driver.state is DriveState.AT_REST
    assert (bench.controller.state, bench.driver.stop_problem) == (ControllerState.IDLE, "")


def test_step_that_the_wire_format_cannot_tell_stops_the_table():
    bench = Bench(safety__stale_shear_action="ignore")
    bench.follow([0.1] * 5)
    bench.driver.command(2**32, 0.1, bench.now)
    outcome, reason = told(bench)
    assert outcome is Outcome.FAILED
    assert f"step {2**32} refused" in reason
    assert bench.controller.state is ControllerState.INTERLOCK


# ---- a host that is slow at every look


def test_host_that_is_slow_at_every_look_does_not_wait_for_twenty_of_them():
    bench = Bench(virtual_controller__watchdog=10.0)
    bench.follow([5.0] * 10)
    last = bench.now
    while bench.driver.state is DriveState.FOLLOWING:
        bench.driver.poll(bench.now)
        bench.network.stall(0.03)
    assert bench.now - last < (MOST_EXCUSES + 2) * 0.03 + 0.1
    assert LOOKS_BEFORE_SILENCE * 0.03 > 0.5


# ---- a controller that is gone while its table is held


@pytest.mark.parametrize("fault", ["dead", "loss=100"])
def test_controller_that_falls_silent_while_its_table_is_held_is_noticed(fault):
    bench = Bench(table__give_up_after=0.05, virtual_controller__watchdog=10.0)
    bench.follow([1.0] * 20)
    bench.driver.finish(Action.HOLD, bench.now)
    bench.poll_until(bench.now + 1.0)
    assert (bench.driver.state, told(bench)) == (DriveState.HELD, (None, ""))
    bench.fault(fault)
    bench.poll_until(bench.now + 0.2)
    outcome, reason = told(bench)
    assert (outcome, bench.driver.stop_problem) == (Outcome.LIMIT, NOT_CONFIRMED)
    assert reason.startswith("safety.stale_controller_time [s] passed at step")
