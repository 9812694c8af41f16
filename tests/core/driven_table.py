"""A table driver in virtual time: its host, and tables that move as long as each command is really held."""

import math

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.states import DriveState
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action
from bmd_rths_core.safety.commanded_motion import REST
from bmd_rths_core.table.controller import NoAnswer, TableMeasurement

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
