"""What nodes that a person started say on their consoles: for whom they wait, that they are ready, how it ended."""

from types import SimpleNamespace

import pytest

from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_nodes.ros.end_of_test import LINGER, EndOfTest
from bmd_rths_nodes.ros.stage_node import StageNode
from tests.nodes.conftest import CONFIG

SHORT = ("-p", "run.lockstep:=true", "-p", "ground_motion.duration:=0.5")


@pytest.mark.slow
def test_nodes_say_for_whom_they_wait_that_they_are_ready_and_how_the_test_has_ended(start):
    def node(name, *more):
        return start("-m", f"bmd_rths_nodes.nodes.{name}", "--ros-args", "--params-file", CONFIG, *SHORT, *more)

    loop = node("composed_loop")
    loop.wait_for_words("[rths.numerical_substructure]: waiting for recorder")
    loop.wait_for_words("[rths.table_driver]: waiting for recorder")
    recorder = node("recorder")
    recorder.wait_for_words("[rths.recorder]: ready; the test begins when every node is")
    recorder.wait_for_words("[rths.recorder]: the test has ended, finished: end of the ground motion")
    recorder.wait_for_words("finished: end of the ground motion")
    loop.wait_for_words("[rths.numerical_substructure]: finished: end of the ground motion")
    assert all(child.process.poll() is None for child in (loop, recorder))  # without exit_when_done they stay
    for child in (loop, recorder):
        child.interrupt()
        told = child.wait(30.0).errors
        assert child.process.returncode == 0, told
        said = [line for line in told.splitlines() if ": waiting for " in line or ": ready; " in line]
        assert len(said) == len({line.partition("[rths.")[2] for line in said}), told  # each once
    assert "the test has ended" not in loop.errors.read_text()  # the numerical substructure says more


def test_a_node_is_not_ready_once_more_when_its_test_has_ended():
    said = []
    node = SimpleNamespace(state=NodeState.READY, ready_words="ready", _said="", _say_due=0.0, log_later=said.append)
    node.end_of_test = EndOfTest(recorded=False)
    StageNode._say_what_is_waited_for(node, 0.0)
    assert said == ["ready"]
    node._said = "the test has ended, finished"
    node.end_of_test.hear(told("numerical_substructure", NodeState.ENDED, outcome="finished"))
    StageNode._say_what_is_waited_for(node, 1.0)
    assert said == ["ready"]
    node.end_of_test = EndOfTest(recorded=False)  # of the next test, which was offered
    StageNode._say_what_is_waited_for(node, 2.0)
    assert said == ["ready", "ready"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "status", "words"),
    [((), 0, "finished: end of the ground motion"), (("-p", "safety.acceleration_limit:=0.01"), 1, "limit: ")],
    ids=["finished", "limit"],
)
def test_nodes_that_shall_exit_when_done_say_by_their_status_how_the_test_has_ended(start, more, status, words):
    options = ("--ros-args", "--params-file", CONFIG, *SHORT, *more, "-p", "exit_when_done:=true")
    nodes = [start("-m", f"bmd_rths_nodes.nodes.{name}", *options) for name in ("composed_loop", "recorder")]
    ended = [node.wait(60.0) for node in nodes]
    assert [told.status for told in ended] == [status, status], ended
    assert words in ended[0].errors
    assert words in ended[1].errors


def told(role, state, **values):
    return NodeStatus(f"/rths/{role}", state, values=values)


def test_a_test_is_over_when_the_table_is_at_rest_and_the_bag_closed():
    end = EndOfTest(recorded=True)
    assert not end.over(0.0)
    end.hear(told("table_driver", NodeState.READY, table="moving"))
    end.hear(told("numerical_substructure", NodeState.ENDED))  # what is urgent, without the outcome
    assert end.outcome == ""
    end.hear(told("numerical_substructure", NodeState.ENDED, outcome="limit"))
    end.hear(told("recorder", NodeState.ENDED))
    assert not end.over(10.0)
    end.hear(told("table_driver", NodeState.TRIPPED))  # does not say what the table does
    assert not end.over(11.0)
    end.hear(told("table_driver", NodeState.TRIPPED, table="at rest"))
    assert not end.over(12.0)
    assert not end.over(12.0 + 0.9 * LINGER)
    assert end.over(12.0 + LINGER)
    assert (end.outcome, end.exit_status) == ("limit", 1)


def test_without_a_recorder_nothing_is_recorded_to_wait_for():
    end = EndOfTest(recorded=False)
    end.hear(told("numerical_substructure", NodeState.ENDED, outcome="finished"))
    end.over(0.0)
    assert end.over(LINGER)
    assert end.exit_status == 0
