"""The conductor in virtual time: when steps begin, what is a missed deadline, and how a test ends."""

import numpy as np
import pytest

from bmd_rths_core.loop.conductor import (
    LOOK_PERIOD,
    START_DELAY,
    Begun,
    Conductor,
)
from bmd_rths_core.loop.peers import PEER_LOST_AFTER, Peer
from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_core.safety import Action, Trip
from bmd_rths_core.table.controller import TableMeasurement

DT = 0.005
#: Seconds since a computer was started.
BOOT = 1e5
READY, WAITING, RUNNING, TRIPPED = NodeState.READY, NodeState.WAITING, NodeState.RUNNING, NodeState.TRIPPED


class Substructure:
    """Answers with what it was given, and writes it down."""

    displacements = np.zeros(1)
    takes_feedback = True

    def __init__(self):
        self.fed_back, self.resets, self.learnt = [], 0, []

    def reset(self):
        self.fed_back, self.resets = [], self.resets + 1

    def step(self, ground_acceleration, feedback_force):
        self.fed_back.append(feedback_force)
        desired = 2.0 * ground_acceleration
        return Begun(0, ground_acceleration, desired, 3.0 * ground_acceleration, command=desired)

    def learn(self, measurement):
        self.learnt.append(measurement)


class Indicator:
    """Trips at given steps with given actions."""

    def __init__(self, **actions):
        self.actions = {int(step.removeprefix("at_")): action for step, action in actions.items()}

    def reset(self):
        pass

    def step(self, step, force, displacements):
        action = self.actions.get(step)
        return action and Trip("safety.stability_limit", "1", "stability indicator", 0.8, 0.7, step, action)


class Bench:
    """A conductor in virtual time; the shear of each step comes back after a time, or not."""

    def __init__(
        self, steps=20, lockstep=False, longest_miss=10 * DT, peers=(), recorder="", indicator=None, closure=0.001
    ):
        self.now = BOOT
        self.begun, self.times, self.closures = [], [], []
        self.closure = closure if callable(closure) else lambda step: closure
        self.numerical = Substructure()
        ground = [0.1 * (k + 1) for k in range(steps)]
        self.conductor = Conductor(
            ground, self.numerical, indicator, DT, lockstep, longest_miss, self.on_step, peers, recorder
        )

    def on_step(self, begun):
        self.begun.append(begun)
        self.times.append(self.now)
        closure = self.closure(begun.step)
        if closure is not None:
            self.closures.append((self.now + closure, begun.step))

    def tell(self, role, state, **values):
        self.conductor.hear(Peer(role, state, **values), self.now)

    def run(self, until=float("inf"), steps=None, ready=True):
        """Let time pass, until as many steps have begun or the test has ended."""
        for _ in range(100_000):
            due = self.conductor.poll(self.now, ready)
            if self.conductor.state is NodeState.ENDED or (steps is not None and self.conductor.step >= steps):
                return
            coming = min([due, until, *[time for time, _ in self.closures]])
            if self.now >= until or coming == float("inf"):
                return
            self.now = max(self.now, coming)
            for closure in [closure for closure in self.closures if closure[0] <= self.now]:
                self.closures.remove(closure)
                self.conductor.shear(closure[1], 10.0 * closure[1], self.now)
        raise AssertionError("the conductor asks for the same time for ever")

    @property
    def timing(self):
        return self.conductor.deadlines.statistics()

    @property
    def ended(self):
        return self.conductor.outcome, self.conductor.reason


def measured(step):
    return TableMeasurement(step, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(1))


# ---- the start gate


def test_test_begins_a_moment_after_all_peers_are_ready():
    bench = Bench(peers=("b", "a"))
    bench.run(until=BOOT + 1.0)
    assert (bench.conductor.waiting_for, bench.begun) == (["a", "b"], [])
    bench.tell("a", READY)
    bench.run(until=BOOT + 2.0)
    assert (bench.conductor.waiting_for, bench.begun) == (["b"], [])
    bench.tell("b", READY)
    bench.run(steps=1)
    assert bench.times == [pytest.approx(BOOT + 2.0 + START_DELAY)]
    assert (bench.conductor.state, bench.conductor.waiting_for) == (RUNNING, [])


def test_peer_that_is_lost_again_before_the_start_stops_it():
    bench = Bench(peers=("a",))
    bench.tell("a", READY)
    bench.run(until=BOOT + 0.5 * START_DELAY)
    bench.tell("a", WAITING)
    bench.run(until=BOOT + 10.0)
    assert bench.begun == []
    bench.tell("a", READY)
    bench.run(steps=1)
    assert bench.times == [pytest.approx(BOOT + 10.0 + START_DELAY)]


def test_host_that_is_not_ready_does_not_start():
    bench = Bench()
    bench.run(until=BOOT + 1.0, ready=False)
    assert bench.begun == []
    bench.run(steps=1)
    assert bench.times == [pytest.approx(BOOT + 1.0 + START_DELAY)]


# ---- ticks


def test_steps_begin_by_the_clock_each_with_the_shear_of_the_one_before():
    bench = Bench(steps=20)
    bench.run()
    assert np.diff(bench.times) == pytest.approx(DT, abs=1e-9)
    assert [begun.step for begun in bench.begun] == list(range(20))
    assert bench.begun[3] == (3, pytest.approx(0.4), pytest.approx(0.8), pytest.approx(1.2), pytest.approx(0.8))
    assert bench.numerical.fed_back == [0.0, *(10.0 * step for step in range(19))]
    assert bench.ended == (Outcome.FINISHED, "end of the ground motion")
    assert bench.now - bench.times[0] == pytest.approx(20 * DT)
    assert (bench.timing.missed_deadlines, bench.timing.late_ticks) == (0, 0)


def test_command_that_is_held_up_after_its_tick_moves_the_schedule():
    """The host was held up between the tick and its command: the next one is not sent right behind it."""
    bench = Bench(steps=30)
    bench.run(steps=10)
    tick = bench.times[-1]
    bench.conductor.passed_on(tick + 0.1 * DT)
    bench.conductor.passed_on(tick - DT)
    assert bench.conductor.poll(bench.now) == pytest.approx(tick + DT)
    for _ in range(2):
        bench.conductor.passed_on(tick + 0.95 * DT)
        assert bench.conductor.poll(bench.now) == pytest.approx(tick + 1.95 * DT)
    bench.run()
    assert bench.times[10] == pytest.approx(tick + 1.95 * DT)
    assert np.diff(bench.times[10:]) == pytest.approx(DT, abs=1e-9)
    assert (bench.timing.late_ticks, bench.ended[0]) == (1, Outcome.FINISHED)


def test_stall_is_one_missed_deadline_and_one_late_tick_and_no_burst():
    """Held up for 40 ms after a step has closed: the next begins late, and its shear is not back when due."""
    bench = Bench(steps=30)
    bench.run(steps=10)
    bench.run(until=bench.now + 0.002)
    bench.now += 0.040
    bench.run()
    assert bench.ended[0] is Outcome.FINISHED
    assert (bench.timing.missed_steps, bench.timing.late_ticks) == ((10,), 1)
    between = np.diff(bench.times)
    assert between[9] == pytest.approx(0.042)
    assert np.delete(between, 9) == pytest.approx(DT, abs=1e-9)


def test_every_stall_counts():
    bench = Bench(steps=200)
    for step in range(20, 200, 20):
        bench.run(steps=step)
        bench.run(until=bench.now + 0.002)
        bench.now += 0.040
    bench.run()
    assert bench.timing.missed_steps == tuple(range(20, 200, 20))
    assert bench.timing.late_ticks == 9


def test_tick_that_is_a_little_late_keeps_the_schedule():
    bench = Bench(steps=10)
    bench.run(steps=3)
    bench.run(until=bench.now + 0.002)
    bench.now += DT
    bench.run()
    assert bench.timing.late_ticks == 0
    assert bench.times[9] - bench.times[0] == pytest.approx(9 * DT)


# ---- deadlines


def test_shear_that_is_late_is_a_missed_deadline_and_still_fed_back():
    """It comes when the next step has begun, and is newer than the one that step was begun with."""
    bench = Bench(steps=8, closure=lambda step: {3: 1.5 * DT, 4: None}.get(step, 0.001))
    bench.run()
    assert bench.timing.missed_steps == (3, 4)
    assert bench.numerical.fed_back == [0.0, 0.0, 10.0, 20.0, 20.0, 30.0, 50.0, 60.0]


def test_shear_of_the_past_does_not_replace_a_newer_one():
    bench = Bench(steps=8)
    bench.run(steps=4)
    bench.run(until=bench.now + 0.002)
    bench.conductor.shear(1, -1.0, bench.now)
    bench.run()
    assert bench.numerical.fed_back[4] == 30.0


def test_lost_shear_leaves_the_last_one():
    bench = Bench(steps=8, closure=lambda step: None if step in (3, 4) else 0.001)
    bench.run()
    assert bench.timing.missed_steps == (3, 4)
    assert bench.numerical.fed_back[3:7] == [20.0, 20.0, 20.0, 50.0]
    assert bench.ended[0] is Outcome.FINISHED


def test_too_long_without_a_shear_ends_the_test():
    bench = Bench(steps=100, longest_miss=10 * DT, closure=lambda step: 0.001 if step < 20 else None)
    bench.run()
    outcome, reason = bench.ended
    assert outcome is Outcome.FAILED
    assert "missed for more than 0.05 s" in reason
    assert reason.endswith(f"the last at step {bench.conductor.step - 1}")
    assert 10 <= bench.timing.missed_deadlines <= 11
    assert bench.now - bench.times[20] == pytest.approx(11 * DT, abs=DT)


def test_misses_that_are_not_in_a_row_do_not_end_it():
    bench = Bench(steps=200, longest_miss=10 * DT, closure=lambda step: 0.001 if step % 8 == 7 else None)
    bench.run()
    assert bench.ended[0] is Outcome.FINISHED


def test_one_long_stall_ends_it_as_many_misses_do():
    bench = Bench(steps=100, longest_miss=10 * DT)
    bench.run(steps=5)
    bench.run(until=bench.now + 0.002)
    bench.now += 0.2
    bench.run()
    assert bench.ended[0] is Outcome.FAILED
    assert len(bench.begun) == 5


@pytest.mark.parametrize(("after", "missed"), [(0.3 * DT, ()), (2.0 * DT, (5,))])
def test_nothing_is_missed_at_the_end_that_was_not_due(after, missed):
    bench = Bench(closure=lambda step: 0.001 if step < 5 else None)
    bench.run(steps=6)
    bench.now += after
    bench.conductor.end(Outcome.STOPPED, "operator", bench.now)
    assert bench.timing.missed_steps == missed


def test_last_step_misses_its_deadline_when_its_shear_is_not_back_at_the_end():
    bench = Bench(steps=6, closure=lambda step: 0.001 if step < 5 else None)
    bench.run()
    assert bench.ended[0] is Outcome.FINISHED
    assert bench.timing.missed_steps == (5,)


# ---- peers


@pytest.mark.parametrize("lockstep", [False, True])
def test_peer_that_is_silent_during_a_test_ends_it(lockstep):
    bench = Bench(steps=10_000, lockstep=lockstep, peers=("a", "b"))
    bench.tell("a", READY)
    bench.tell("b", READY)
    while bench.conductor.state is not NodeState.ENDED:
        bench.run(until=bench.now + LOOK_PERIOD)
        bench.tell("a", RUNNING)
    assert bench.ended == (Outcome.FAILED, f"nothing was heard of b for {PEER_LOST_AFTER:g} s")
    assert PEER_LOST_AFTER < bench.now - BOOT <= PEER_LOST_AFTER + 2.1 * LOOK_PERIOD


@pytest.mark.parametrize(
    ("told", "outcome"),
    [(Outcome.LIMIT, Outcome.LIMIT), (Outcome.STOPPED, Outcome.STOPPED), (None, Outcome.FAILED)],
)
def test_peer_that_trips_during_a_test_ends_it_its_way(told, outcome):
    bench = Bench(peers=("a",))
    bench.tell("a", READY)
    bench.run(steps=5)
    bench.tell("a", TRIPPED, reason="too fast", outcome=told)
    assert bench.ended == (outcome, "a: too fast")
    bench.run(until=bench.now + 1.0)
    assert len(bench.begun) == 5


@pytest.mark.parametrize(
    ("role", "told", "ends"),
    [("a", Outcome.FAILED, True), ("a", Outcome.STOPPED, False), ("stranger", Outcome.FAILED, False)],
)
def test_peer_that_trips_before_a_test_ends_it_only_when_it_has_failed(role, told, ends):
    bench = Bench(peers=("a", "b"))
    bench.tell("a", READY)
    bench.tell(role, TRIPPED, reason="no", outcome=told)
    assert (bench.conductor.state is NodeState.ENDED) == ends


def test_peer_that_was_reset_after_an_operators_stop_takes_part():
    bench = Bench(peers=("a",))
    bench.tell("a", TRIPPED, reason="stop", outcome=Outcome.STOPPED)
    bench.run(until=BOOT + 1.0)
    bench.tell("a", READY)
    bench.run(steps=1)
    assert len(bench.begun) == 1


# ---- stability indicator


@pytest.mark.parametrize("action", [Action.HOLD, Action.RAMP, Action.EMERGENCY_STOP])
@pytest.mark.parametrize("lockstep", [False, True])
def test_stability_indicator_ends_the_test_before_the_step_it_trips_at(action, lockstep):
    bench = Bench(indicator=Indicator(at_7=action), lockstep=lockstep)
    bench.run()
    assert bench.ended[0] is Outcome.LIMIT
    assert "safety.stability_limit" in bench.ended[1]
    assert (bench.conductor.action, bench.conductor.step) == (action, 7)
    assert [begun.step for begun in bench.begun] == list(range(7))


def test_stability_indicator_that_only_indicates_is_noted():
    bench = Bench(indicator=Indicator(at_3=Action.INDICATE, at_9=Action.HOLD))
    bench.run()
    assert [trip.step for trip in bench.conductor.trips] == [3, 9]
    assert bench.conductor.action is Action.HOLD
    other = Bench(indicator=Indicator(at_3=Action.INDICATE))
    other.run()
    assert (other.ended[0], other.conductor.action) == (Outcome.FINISHED, Action.RAMP)


# ---- the end, and again


@pytest.mark.parametrize("lockstep", [False, True])
def test_end_is_final(lockstep):
    bench = Bench(lockstep=lockstep, peers=("a",))
    bench.tell("a", READY)
    bench.run(steps=5)
    conductor = bench.conductor
    conductor.end(Outcome.STOPPED, "operator", bench.now)
    conductor.end(Outcome.FAILED, "something else", bench.now)
    bench.tell("a", TRIPPED, reason="too late", outcome=Outcome.LIMIT)
    conductor.shear(4, 1.0, bench.now)
    assert conductor.poll(bench.now + 100.0) == float("inf")
    assert bench.ended == (Outcome.STOPPED, "operator")
    assert (conductor.step, conductor.state) == (5, NodeState.ENDED)


@pytest.mark.parametrize("lockstep", [False, True])
def test_second_test_is_like_the_first(lockstep):
    bench = Bench(steps=10, lockstep=lockstep, peers=("a",), indicator=Indicator(at_8=Action.HOLD))
    bench.tell("a", READY)
    bench.run()
    first = (bench.begun[:], bench.numerical.fed_back[:], bench.ended)
    bench.begun.clear()
    bench.times.clear()
    bench.closures.clear()
    bench.now += 60.0
    bench.conductor.reset()
    conductor = bench.conductor
    assert (conductor.state, conductor.outcome, conductor.reason) == (WAITING, None, "")
    assert (conductor.step, conductor.trips, conductor.action) == (0, [], Action.RAMP)
    assert (conductor.deadlines.statistics().missed_deadlines, conductor.waiting_for) == (0, ["a"])
    bench.run(until=bench.now + 1.0)
    assert bench.begun == []
    bench.tell("a", READY)
    bench.run()
    assert (bench.begun, bench.numerical.fed_back, bench.ended) == first
    assert bench.numerical.resets == 2
