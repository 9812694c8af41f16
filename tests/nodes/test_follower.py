"""How long a run is waited for: on a clock of its own, with nodes that are heard early, late or never."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from bmd_rths_core.loop.states import NodeState
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.run import follower as follower_module
from bmd_rths_nodes.run.follower import (
    CLOSING_TIMEOUT,
    FAREWELL_TIME,
    HEARING_TIMEOUT,
    LONGEST_HEARING_TIMEOUT,
    NEWS_TIMEOUT,
    RunFailed,
    RunFollower,
)

#: Longest way of the table to rest [s].
TO_REST = 2.5

LOST = "shear_estimator ended with status -9: it wrote nothing"


class Run:
    """Monitor, supervisor and operator of a run, and the clock; what happens is said by time [s]."""

    def __init__(self, **events):
        self.now, self.status, self.interrupted, self._lost = 0.0, {}, False, None
        self.discovered, self.first_runs, self.updates = [], True, 0
        self.operator = SimpleNamespace(asked=False, leaving=False, update=self.operate)
        self._events = {float(name.removeprefix("at_")): event for name, event in events.items()}

    def update(self, seconds):
        """Let time pass."""
        self.now += seconds
        for when in [when for when in self._events if when <= self.now]:
            self._events.pop(when)(self)

    def operate(self):
        self.updates += 1

    def nodes_there(self):
        return self.discovered

    def lost(self):
        return self._lost

    def lose(self, name):
        process = SimpleNamespace(returncode=-9)
        self._lost = SimpleNamespace(name=name, process=process, last_words=lambda: "it wrote nothing")

    def interrupt_first(self):
        self.interrupted = True

    def tell(self, role, state, message="", **values):
        values = {"step": "5", "missed_deadlines": "0"} | values
        self.status[role] = NodeStatus(f"/rths/{role}", state, message=message, values=values)


def loses(name):
    return lambda run: run.lose(name)


def tells(role, state, message="", **values):
    return lambda run: run.tell(role, state, message, **values)


@pytest.fixture
def follow(monkeypatch):
    """Follow a run to its end; return the bag or the error, what the follower says of it, and when it was."""

    def follow_run(run):
        monkeypatch.setattr(follower_module, "time", SimpleNamespace(perf_counter=lambda: run.now))
        follower = RunFollower(run, run, run.operator, TO_REST)
        try:
            while (bag := follower.look()) is None:
                pass
        except RunFailed as error:
            return str(error), follower.problem, run.now
        return bag, follower.problem, run.now

    return follow_run


ENDS = tells("recorder", NodeState.ENDED, bag="the_bag")
RUNS = tells("numerical_substructure", NodeState.RUNNING)


def test_run_is_followed_to_its_bag_however_long_it_takes(follow):
    assert follow(Run(at_1=RUNS, at_900=ENDS))[:2] == (Path("the_bag"), "")


def test_node_that_is_lost_before_anything_was_heard_may_have_been_one_of_a_running_test(follow):
    """The numerical substructure is heard 3 s after the loss; the bag is waited for."""
    outcome, problem, when = follow(Run(at_2=loses("shear_estimator"), at_5=RUNS, at_9=ENDS))
    assert (outcome, problem) == (Path("the_bag"), LOST)
    assert when == pytest.approx(9.0, abs=0.1)


def test_node_that_is_lost_of_a_run_that_is_never_heard_ends_it_soon(follow):
    outcome, _, when = follow(Run(at_2=loses("shear_estimator")))
    assert outcome == LOST
    assert when == pytest.approx(2.0 + HEARING_TIMEOUT, abs=0.2)


def test_node_that_is_lost_before_the_test_ends_the_run_with_the_next_news(follow):
    waits = tells("numerical_substructure", NodeState.WAITING)
    outcome, _, when = follow(Run(at_1=waits, at_2=loses("shear_estimator")))
    assert outcome == LOST
    assert when == pytest.approx(2.0 + NEWS_TIMEOUT, abs=0.2)


def test_node_that_is_lost_right_after_the_test_has_begun_leaves_its_bag(follow):
    """It waited when it was last heard; its test had begun, which it tells a second later."""
    waits = tells("numerical_substructure", NodeState.WAITING)
    run = Run(at_1=waits, at_2=loses("shear_estimator"), at_3=RUNS, at_9=ENDS)
    assert follow(run)[:2] == (Path("the_bag"), LOST)


IDLE = "table controller: udp://127.0.0.1:5000 is idle: it was stopped or restarted"
WAITS = tells("numerical_substructure", NodeState.WAITING)


def test_node_that_trips_before_it_takes_part_in_a_test_ends_the_run_with_its_own_reason(follow):
    trips = tells("table_driver", NodeState.TRIPPED, IDLE, outcome="failed")
    outcome, _, when = follow(Run(at_1=WAITS, at_2=trips))
    assert outcome == f"table_driver: {IDLE}"
    assert when == pytest.approx(2.0 + FAREWELL_TIME, abs=0.2)


def test_bag_of_a_test_that_a_trip_before_step_0_has_ended_is_waited_for(follow):
    trips = tells("table_driver", NodeState.TRIPPED, IDLE, outcome="failed")
    ended = tells("numerical_substructure", NodeState.ENDED)
    outcome, problem, _ = follow(Run(at_1=WAITS, at_2=trips, at_4=ended, at_9=ENDS))
    assert (outcome, problem) == (Path("the_bag"), f"table_driver: {IDLE}")


def test_stop_of_the_operator_before_step_0_can_be_reset(follow):
    stopped = tells("table_driver", NodeState.TRIPPED, "stopped by the operator", outcome="stopped")
    assert follow(Run(at_1=WAITS, at_2=stopped, at_30=RUNS, at_40=ENDS))[:2] == (Path("the_bag"), "")


def test_bag_of_a_lost_run_is_waited_for_once(follow):
    outcome, _, when = follow(Run(at_1=RUNS, at_2=loses("shear_estimator")))
    assert outcome == LOST
    assert when == pytest.approx(2.0 + TO_REST + CLOSING_TIMEOUT, abs=0.2)


def test_without_its_recorder_the_test_is_ended_and_the_table_has_time_to_come_to_rest(follow):
    run = Run(at_1=RUNS, at_2=loses("recorder"))
    outcome, _, when = follow(run)
    assert outcome == "recorder ended with status -9: it wrote nothing"
    assert run.interrupted
    assert when == pytest.approx(2.0 + TO_REST + FAREWELL_TIME, abs=0.2)


STANDS = tells("table_driver", NodeState.WAITING, table="at rest")
MOVES = tells("table_driver", NodeState.RUNNING, table="moving")
ENDED = tells("numerical_substructure", NodeState.ENDED)


@pytest.mark.parametrize(
    "end", [loses("recorder"), tells("recorder", NodeState.TRIPPED, "cannot be written")], ids=["killed", "disk full"]
)
def test_where_nothing_is_recorded_any_more_a_table_at_rest_is_the_end(follow, end):
    outcome, _, when = follow(Run(at_0=MOVES, at_1=RUNS, at_2=end, at_3=ENDED, at_4=STANDS))
    assert outcome.startswith("recorder")
    assert when == pytest.approx(4.0, abs=0.1)
    _, _, when = follow(Run(at_0=STANDS, at_1=RUNS, at_2=end))  # before it moved; the test has not ended
    assert when > 2.0 + TO_REST


def test_bag_of_a_table_at_rest_is_not_waited_for_as_if_it_moved(follow):
    _, _, when = follow(Run(at_1=RUNS, at_2=ENDED, at_3=STANDS))
    assert when == pytest.approx(3.0 + CLOSING_TIMEOUT, abs=0.1)


LEAVES = tells("recorder", NodeState.INACTIVE, bag="the_bag")


def test_deactivated_recorder_lets_the_numerical_substructure_say_why_the_test_ends(follow):
    problem = "recorder: it was deactivated before the test had ended"
    outcome, told, when = follow(Run(at_1=RUNS, at_2=LEAVES, at_3=ENDED))
    assert (outcome, told) == (Path("the_bag"), problem)
    assert when == pytest.approx(3.0, abs=0.1)
    outcome, told, when = follow(Run(at_1=RUNS, at_2=LEAVES))
    assert (outcome, told) == (Path("the_bag"), problem)
    assert when == pytest.approx(2.0 + FAREWELL_TIME, abs=0.2)


def test_ctrl_c_before_anything_was_heard_waits_for_a_test_that_may_be_under_way(follow):
    def asks(run):
        run.operator.asked = True

    outcome, _, when = follow(Run(at_2=asks, at_5=RUNS, at_9=ENDS))
    assert outcome == Path("the_bag")
    assert when == pytest.approx(9.0, abs=0.1)
    run = Run(at_2=asks)
    outcome, _, when = follow(run)
    assert outcome == "stopped before the test had begun"
    assert when == pytest.approx(2.0 + HEARING_TIMEOUT, abs=0.2)
    assert run.updates > 1  # the table is asked to stop all the same


def test_ctrl_c_while_the_nodes_wait_for_each_other_ends_the_run_at_once(follow):
    def asks(run):
        run.operator.asked = True

    run = Run(at_1=tells("numerical_substructure", NodeState.WAITING), at_2=asks)
    outcome, _, when = follow(run)
    assert (outcome, run.updates) == ("stopped before the test had begun", 0)
    assert when == pytest.approx(2.0, abs=0.2)


def test_numerical_substructure_that_is_discovered_is_waited_for_longer(follow):
    run = Run(at_2=loses("shear_estimator"), at_12=RUNS, at_20=ENDS)
    run.discovered = ["numerical_substructure"]
    assert follow(run)[:2] == (Path("the_bag"), LOST)
    run = Run(at_2=loses("shear_estimator"))
    run.discovered = ["numerical_substructure"]
    outcome, _, when = follow(run)
    assert outcome == LOST
    assert when == pytest.approx(2.0 + LONGEST_HEARING_TIMEOUT, abs=0.2)
    run = Run(at_2=loses("numerical_substructure"))
    run.discovered, run.first_runs = ["numerical_substructure"], False  # it is dead, and DDS does not know it yet
    assert follow(run)[2] == pytest.approx(2.0 + HEARING_TIMEOUT, abs=0.2)


def test_what_a_stopped_run_waits_for_is_said():
    run = Run()
    follower = RunFollower(run, run, run.operator, TO_REST)
    assert follower.progress == ("starting", 0)
    run.tell("numerical_substructure", NodeState.RUNNING)
    assert follower.progress == ("running, 0 deadlines missed", 5)
    run.operator.asked = True
    run.tell("table_driver", NodeState.TRIPPED, table="moving")
    assert follower.progress == ("stopping, the table moves", 5)
    run.tell("table_driver", NodeState.TRIPPED, table="at rest")
    assert follower.progress == ("stopping", 5)
    run.tell("numerical_substructure", NodeState.ENDED)
    assert follower.progress == ("stopping, the bag is being closed", 5)
