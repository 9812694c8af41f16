"""The table driver in virtual time: whatever a host and a controller do, the table ends at rest, and within its limits.

The table of these tests is the double integral of the commands over the time each was really held.
"""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.excited_table import DrivingStopped, drive
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import LOOKS_BEFORE_SILENCE, MOST_EXCUSES, NOT_CONFIRMED, TableDriver
from bmd_rths_core.safety import Action, State
from bmd_rths_core.safety.commanded_motion import REST, stopping_range
from bmd_rths_core.table.controller import NoAnswer, TableMeasurement
from bmd_rths_core.table.models.simulated import SimulatedTable

DT = 0.005
#: Seconds since a computer was started.
BOOT = 1e5

#: Nothing but where the table can go, and how fast, ends these tests.
PATIENT = Config().changed(
    **{
        f"safety__{limit}_action": "ignore"
        for limit in ("stale_shear", "stale_controller", "tracking", "stuck", "increment")
    }
)


class World:
    """Time, and a controller in it that writes down what it is told and when.

    Parameters
    ----------
    answers : callable, optional
        Time until the answer to a step [s]; None is no answer.
    fails : callable, optional
        Gets the name of a call and the step, and may raise.
    """

    def __init__(self, answers=lambda step: 0.001, fails=lambda call, step: None):
        self.now = BOOT
        self.calls = []
        self.begun = []  # (time, step, acceleration)
        self.stopped_at = None
        self.answers, self.fails = answers, fails

    def call(self, name, step=-1):
        self.calls.append(name)
        self.fails(name, step)

    def connect(self):
        self.begun, self.stopped_at = [], None
        self.call("connect")

    def hold(self, command):
        self.begun.append((self.now, *command))

    def stop(self):
        self.stopped_at = self.now if self.stopped_at is None else self.stopped_at
        self.calls.append("stop")

    def emergency_stop(self):
        self.stopped_at = self.now if self.stopped_at is None else self.stopped_at
        self.calls.append("emergency_stop")

    def close(self):
        self.calls.append("close")

    def statistics(self):
        return {}

    @property
    def times(self):
        return np.array([time for time, _, _ in self.begun])

    @property
    def steps(self):
        return [step for _, step, _ in self.begun]

    def motions(self):
        """Return the motion of the table when each command began, and when the table was stopped."""
        motion, motions = REST, [REST]
        ends = [*self.times[1:], self.now if self.stopped_at is None else self.stopped_at]
        for (time, _, acceleration), end in zip(self.begun, ends, strict=False):
            motion = motion.after(acceleration, end - time)
            motions.append(motion)
        return motions

    def measured(self, step, acceleration):
        return TableMeasurement(step, acceleration, math.nan, math.nan, math.nan, math.nan, np.array([math.nan]))


class Waiting(World):
    """A real table whose controller answers at once, or not at all."""

    def exchange(self, command):
        self.call("exchange", command.step)
        self.hold(command)
        if self.answers(command.step) is None:
            raise NoAnswer
        return self.measured(*command)


class BySteps(Waiting):
    """A model: it moves with the commands, not with the clock."""

    by_steps = True

    def motions(self):
        motion, motions, accelerations = REST, [REST], {step: a for _, step, a in self.begun}
        held = 0.0
        for step in range(max(accelerations, default=-1) + 1):
            held = accelerations.get(step, held)
            motion = motion.after(held, DT)
            motions.append(motion)
        return motions


class Asynchronous(World):
    """A real table whose answers come later, and whose commands leave a little later than they were decided on."""

    lag = 0.0

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.pending = []

    @property
    def awaiting(self):
        return bool(self.pending)

    def exchange(self, command):
        raise AssertionError("not in real time")

    def begin(self, command):
        self.call("begin", command.step)
        self.now += self.lag
        self.hold(command)
        delay = self.answers(command.step)
        if delay is not None:
            self.pending.append((self.now + delay, self.measured(*command)))
        return self.now

    def poll(self):
        self.fails("poll", self.begun[-1][1] if self.begun else -1)
        if self.pending and self.pending[0][0] <= self.now:
            return self.pending.pop(0)[1]
        return None


REAL = [Waiting, Asynchronous]
ALL = [*REAL, BySteps]


class Host:
    """Gives commands every Δt, as the conductor does, and polls when it is told to; it may be held up.

    Parameters
    ----------
    stalls : mapping of int to float
        For how long it is held up [s] after which poll.
    """

    def __init__(self, world, config=PATIENT, stalls=None, lockstep=False):
        self.world, self.stalls, self.polls = world, dict(stalls or {}), 0
        self.measured = []
        self.driver = TableDriver(world, make_supervisor(config), DT, lockstep, self.measured.append)
        self.driver.arm()

    @property
    def state(self):
        return self.driver.state

    def poll(self):
        world = self.world
        due = self.driver.poll(world.now)
        self.polls += 1
        if self.polls in self.stalls:
            world.now += self.stalls.pop(self.polls)
        return due

    def wait(self, until):
        """Let time pass; the driver does what is due."""
        same = 0
        while self.world.now < until:
            before, due = self.world.now, self.poll()
            self.world.now = max(self.world.now, min(due, until))
            same = same + 1 if self.world.now == before else 0
            assert same < 100, "the driver asks for the same time for ever"

    def follow(self, commands, first=0):
        """Give commands until the driver takes no more; a late one moves the schedule."""
        due = self.world.now
        for step, command in enumerate(commands, first):
            self.driver.command(step, float(command), self.world.now)
            late = self.world.now - due > DT
            due = (self.world.now if late else due) + DT
            self.wait(due)
            if self.state is not DriveState.FOLLOWING:
                return

    def to_rest(self, seconds=300.0):
        end = self.world.now + seconds
        while self.driver.moving and self.state is not DriveState.HELD and self.world.now < end:
            self.wait(min(max(self.poll(), self.world.now + 1e-9), end))
        assert self.state in (DriveState.AT_REST, DriveState.HELD)


def sine(steps=100, amplitude=2.0, period=40):
    return amplitude * np.sin(2.0 * np.pi * np.arange(steps) / period)


def assert_at_rest(world, at_zero=True):
    motion = world.motions()[-1]
    assert abs(motion.velocity) <= 1e-4
    if at_zero:
        assert abs(motion.displacement) <= 1e-4


# ---- the ordinary test


@pytest.mark.parametrize("kind", ALL)
def test_commands_reach_the_table_and_it_ends_at_rest(kind):
    world = kind()
    host = Host(world)
    commands = sine()
    host.follow(commands)
    assert [a for _, _, a in world.begun] == commands.tolist()
    assert host.driver.last_passed == 99
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert (host.state, host.driver.outcome, host.driver.reason) == (DriveState.AT_REST, None, "")
    assert [m.step for m in host.measured] == list(range(100))
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)
    assert world.calls[-1] == "stop"
    assert_at_rest(world)


def test_command_that_leaves_late_is_followed_by_the_next_a_step_later():
    """A host that stands still between its look at the clock and its packet sends no two of them at once."""

    class LeavingLate(Asynchronous):
        def begin(self, command):
            self.lag = 0.0047 if command.step == 102 else 0.0
            return super().begin(command)

    world = LeavingLate()
    host = Host(world)
    host.follow(sine())
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert np.diff(world.times)[101:104] == pytest.approx([DT + 0.0047, DT, DT], abs=1e-9)
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
def test_refused_command_is_replaced_in_its_own_slot(kind):
    """Braking begins when the refused command would have, and not one step later."""
    world = kind()
    host = Host(world)
    host.follow([1.0] * 10 + [25.0, 1.0])
    host.to_rest()
    assert host.driver.outcome is Outcome.LIMIT
    assert "acceleration_limit" in host.driver.reason
    assert world.steps[:13] == list(range(13))
    assert world.begun[10][2] < 1.0
    assert np.diff(world.times)[:12] == pytest.approx(DT, abs=1e-9)
    assert host.driver.last_passed == 9
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.parametrize("early", [0.1, 0.5, 0.9])
def test_way_to_rest_begins_when_the_last_command_was_held_for_a_step(kind, early):
    world = kind()
    host = Host(world)
    host.follow([1.0] * 10)
    host.driver.command(10, 1.0, world.now)
    host.wait(world.now + early * DT)
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)
    assert_at_rest(world)


# ---- confirmation of the stop


def unconfirmed_stop(call, step):
    raise OSError("no route to the table")


@pytest.mark.parametrize("confirmed", [True, False])
@pytest.mark.parametrize("steps", [0, 10])
@pytest.mark.parametrize("action", [Action.RAMP, Action.EMERGENCY_STOP])
def test_stop_that_is_not_confirmed_is_a_failure_whatever_ended_the_test(action, steps, confirmed):
    world = Waiting()
    world.stop_confirmed = confirmed
    host = Host(world)
    host.follow([1.0] * steps)
    host.driver.finish(action, world.now)
    host.to_rest()
    driver = host.driver
    assert driver.state is DriveState.AT_REST
    told = (driver.outcome, driver.reason, driver.stop_problem)
    assert told == ((None, "", "") if confirmed else (Outcome.FAILED, NOT_CONFIRMED, NOT_CONFIRMED))


def test_first_reason_stays_beside_a_stop_that_is_not_confirmed():
    world = Waiting()
    world.stop_confirmed = False
    host = Host(world)
    host.follow([1.0] * 10 + [25.0])
    host.to_rest()
    assert host.driver.outcome is Outcome.LIMIT
    assert "acceleration_limit" in host.driver.reason
    assert host.driver.stop_problem == NOT_CONFIRMED


def test_stop_that_raises_is_not_confirmed_and_the_table_is_released(monkeypatch):
    world = Waiting()
    host = Host(world)
    monkeypatch.setattr(world, "stop", lambda: world.fails("stop", -1))
    world.fails = unconfirmed_stop
    host.driver.release()
    assert host.driver.stop_problem == f"{NOT_CONFIRMED}: no route to the table"
    assert (host.driver.outcome, host.driver.state, world.calls[-1]) == (Outcome.FAILED, DriveState.RELEASED, "close")


def test_next_test_begins_without_the_problem_of_the_last():
    world = Waiting()
    world.stop_confirmed = False
    host = Host(world)
    host.driver.halt()
    assert host.driver.stop_problem
    host.driver.arm()
    assert (host.driver.outcome, host.driver.stop_problem) == (None, "")


class SilentAfterTheStop(SimulatedTable):
    """It does all it is told, and does not say that it stands."""

    stop_confirmed = False


def test_test_in_process_has_not_finished_before_its_table_is_known_to_be_at_rest():
    config = Config().changed(ground_motion__duration=0.2)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    parts = (config.simulated_table, config.specimen.building(), config.run.time_step, config.run.seed)
    whole = RthsLoop(config, motion, SimulatedTable(*parts)).run()
    record = RthsLoop(config, motion, SilentAfterTheStop(*parts)).run()
    assert (whole.outcome, whole.reason) == ("finished", "end of the ground motion")
    assert (record.outcome, record.reason) == ("failed", f"end of the ground motion; {NOT_CONFIRMED}")
    assert record.same_signals(whole)
    with pytest.raises(DrivingStopped, match=f"{NOT_CONFIRMED}$"):
        drive(SilentAfterTheStop(*parts), make_supervisor(config), sine(), DT)


# ---- stalls


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


# ---- silence


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


# ---- failures


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


# ---- requests in every state


def reach(state, world, config=PATIENT):
    """Return a host whose driver is in a state."""
    host = Host(world, config)
    if state is DriveState.ARMED:
        return host
    host.follow([1.0] * 30)
    if state is DriveState.FOLLOWING:
        return host
    if state is DriveState.HELD:
        host.driver.finish(Action.HOLD, world.now)
        host.to_rest()
    else:
        host.driver.finish(Action.RAMP, world.now)
        host.wait(world.now + 0.1)
        if state is DriveState.AT_REST:
            host.to_rest()
    assert host.state is state
    return host


STATES = [DriveState.ARMED, DriveState.FOLLOWING, DriveState.RETURNING, DriveState.HELD, DriveState.AT_REST]


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


# ---- motions no table has


@pytest.mark.parametrize("kind", REAL)
def test_motion_that_is_not_plausible_is_an_emergency_stop(kind):
    """A host that was held up for a quarter of an hour knows nothing of its table any more."""
    world = kind()
    host = Host(world)
    host.follow([2.0] * 10)
    world.now += 900.0
    host.driver.finish(Action.RAMP, world.now)
    assert (host.state, world.calls[-1]) == (DriveState.AT_REST, "emergency_stop")


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
