"""The next test with the same processes: by one service, and by hand, node by node."""

from types import SimpleNamespace

import pytest
from lifecycle_msgs.msg import Transition
from std_srvs.srv import Trigger

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.nodes.numerical_substructure import NumericalSubstructureNode
from bmd_rths_nodes.roles import LOOP
from bmd_rths_nodes.ros.status import NodeStatus
from tests.nodes.conftest import change_state, wait_until

LOOP_ROLES = [role.name for role in LOOP]


@pytest.mark.slow
def test_next_test_by_service_and_by_hand_equals_the_first(client, start, tmp_path):
    config = Config().changed(
        run__lockstep=True, ground_motion__duration=0.5, recorder__directory=str(tmp_path / "bags")
    )
    (tmp_path / "parameters.yaml").write_text(dump_config(config))
    for module in ("composed_loop", "recorder"):
        start("-m", f"bmd_rths_nodes.nodes.{module}", "--ros-args", "--params-file", tmp_path / "parameters.yaml")

    def ask(service, role="numerical_substructure"):
        response = client.call(Trigger, f"/rths/{role}/{service}", Trigger.Request())
        return response.success, response.message

    def wait_for_bag(number):
        def closed():
            return [f.parent for f in (tmp_path / "bags").glob("*/metadata.yaml") if "outcome" in f.read_text()]

        wait_until(lambda: len(closed()) == number)

    wait_for_bag(1)
    wait_until(lambda: ask("next_test")[0])  # the recorder tells within a second that its bag is closed
    wait_for_bag(2)

    # By hand, in the order of the page: the clock of the test first, the recorder first again.
    for role in ("numerical_substructure", "recorder", *LOOP_ROLES[1:]):
        assert change_state(client, Transition.TRANSITION_DEACTIVATE, role)
    assert ask("next_test") == (False, "the numerical substructure is inactive; activate it")
    for role in ("recorder", *LOOP_ROLES[1:], "numerical_substructure"):
        assert change_state(client, Transition.TRANSITION_ACTIVATE, role)
    wait_for_bag(3)

    # What the operator has stopped takes a person to start it again.
    wait_until(lambda: ask("next_test")[1] != "the bag of the last test is not closed yet")
    wait_for_bag(4)
    assert ask("stop", "table_driver")[0]
    refused = "table_driver has tripped (stopped by the operator); reset arms it again"
    wait_until(lambda: ask("next_test") == (False, refused))
    assert ask("reset", "table_driver")[0]
    wait_until(lambda: ask("next_test")[0])
    wait_for_bag(5)

    expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    for bag in (tmp_path / "bags").iterdir():
        record = read_bag(bag)
        assert record.outcome == "finished"
        assert record.same_signals(expected)


@pytest.mark.parametrize(
    ("state", "driver", "recorder", "problem"),
    [
        (NodeState.ENDED, "ready", "ended", ""),
        (NodeState.RUNNING, "ready", "ready", "a test is running; stop of the table driver ends it"),
        (NodeState.READY, "ready", "ready", "a test is about to begin already"),
        (NodeState.WAITING, "ready", "ready", "a test is about to begin already"),
        (NodeState.ENDED, "ended", "ready", "the table is still on its way to rest"),
        (NodeState.ENDED, "ready", "ready", "the bag of the last test is not closed yet"),
        (NodeState.ENDED, "tripped", "ended", "table_driver has tripped (why); reset arms it again"),
        (NodeState.ENDED, "ready", "tripped", "recorder has tripped (why); deactivate and activate it"),
    ],
)
def test_what_keeps_the_next_test_from_being_offered(state, driver, recorder, problem):
    told = {
        role: NodeStatus(f"/rths/{role}", NodeState(of), message="why")
        for role, of in (("table_driver", driver), ("recorder", recorder))
    }
    config = SimpleNamespace(run=SimpleNamespace(record=True))
    node = SimpleNamespace(state=state, _told=told, _table_moves=driver == "ended", config=config)
    assert NumericalSubstructureNode._why_no_next_test(node) == problem
