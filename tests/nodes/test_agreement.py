"""What the nodes of a test agree on before step 0, and whom they do not believe."""

import json
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from rclpy.qos import QoSProfile

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.agreement import FORGOTTEN_AFTER, LARGEST_AGE, Agreement, Heard
from bmd_rths_nodes.ros.parameter_files import parameter_files, refuse_unreached
from bmd_rths_nodes.ros.status import NodeStatus
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, change_state, recorded, wait_until

LEADER, SHAPER, DRIVER = "numerical_substructure", "command_shaper", "table_driver"


class Node:
    """A node that takes part, as far as it agrees with others."""

    def __init__(self, role, instance="", **shared):
        self.role, self.state, self.free = role, NodeState.WAITING, True
        self.agreement = Agreement(role, instance or f"process of {role}")
        self.agreement.begin(shared)

    def told(self, age=0.0):
        values = {**self.agreement.values(), **self.agreement.identity()}
        return NodeStatus(f"/rths/{self.role}", self.state, values=values, stamp=time.time() - age)

    def hear(self, other, now=0.0, age=0.0):
        return self.agreement.hear(other.told(age), now, self.free)


def test_waiting_node_takes_over_the_id_of_the_numerical_substructure_and_is_believed_from_then_on():
    leader, shaper = Node(LEADER), Node(SHAPER)
    assert shaper.agreement.run == ""
    assert leader.hear(shaper) is Heard.IGNORED
    assert shaper.hear(leader) is Heard.ADOPTED
    assert shaper.agreement.run == leader.agreement.run != ""
    assert leader.hear(shaper) is Heard.BELIEVED
    assert shaper.hear(leader) is Heard.BELIEVED


def test_each_test_has_an_id_of_its_own_and_the_end_of_the_one_before_is_not_believed():
    leader, recorder = Node(LEADER), Node("recorder")
    leader.state = NodeState.ENDED
    assert recorder.hear(leader) is Heard.IGNORED
    before = leader.agreement.run
    leader.agreement.begin({})
    leader.state = NodeState.WAITING
    assert recorder.hear(leader) is Heard.ADOPTED
    assert recorder.agreement.run == leader.agreement.run != before


def test_node_that_comes_when_a_test_is_under_way_is_none_of_it():
    leader, shaper = Node(LEADER), Node(SHAPER)
    leader.state = NodeState.RUNNING
    assert shaper.hear(leader) is Heard.LATE
    assert shaper.agreement.run == ""


def test_node_in_a_test_keeps_its_id():
    leader, driver, other = Node(LEADER), Node(DRIVER), Node(LEADER, "another process")
    driver.hear(leader)
    driver.free = False
    assert driver.hear(other, now=100.0) is Heard.IGNORED
    assert driver.agreement.run == leader.agreement.run


def test_second_numerical_substructure_is_told_and_not_followed_before_the_first_is_gone():
    leader, shaper, other = Node(LEADER), Node(SHAPER), Node(LEADER, "another process")
    shaper.hear(leader)
    assert shaper.hear(other) is Heard.IGNORED
    assert shaper.agreement.obstacle(0.0) == f"a second {LEADER} is there (another process)"
    assert shaper.hear(other, now=FORGOTTEN_AFTER) is Heard.ADOPTED
    assert shaper.agreement.obstacle(FORGOTTEN_AFTER) == ""


def test_second_node_of_a_role_is_not_believed_and_told_as_long_as_it_is_there():
    leader, shaper, other = Node(LEADER), Node(SHAPER), Node(SHAPER, "another process")
    for node in (shaper, other):
        node.hear(leader)
    assert leader.hear(shaper) is Heard.BELIEVED
    assert leader.hear(other) is Heard.IGNORED
    assert leader.agreement.obstacle(0.0) == f"a second {SHAPER} is there (another process)"
    assert leader.agreement.obstacle(FORGOTTEN_AFTER) == ""
    assert shaper.hear(other) is Heard.RIVAL
    other.state = NodeState.TRIPPED
    assert shaper.hear(other) is Heard.IGNORED
    assert shaper.agreement.obstacle(0.0) == ""


def test_recorded_status_is_neither_a_rival_nor_a_test_to_take_part_in():
    leader, shaper, other = Node(LEADER), Node(SHAPER), Node(SHAPER, "another process")
    assert shaper.hear(other, age=LARGEST_AGE + 1.0) is Heard.IGNORED
    assert shaper.hear(leader, age=LARGEST_AGE + 1.0) is Heard.IGNORED
    assert shaper.agreement.run == ""
    assert "is 11 s old by the clock of this computer" in shaper.agreement.obstacle(0.0)


def test_parameter_that_differs_is_told_with_both_values_whoever_notices():
    leader = Node(LEADER, safety={"velocity_limit": 1.0}, run={"seed": 0})
    recorder = Node("recorder", safety={"velocity_limit": 1.0}, run={"seed": 0}, command_shaper={"w1": 0.9})
    driver = Node(DRIVER, safety={"velocity_limit": 0.5}, run={"seed": 0})
    shaper = Node(SHAPER, run={"seed": 0}, command_shaper={"w1": 0.9})
    nodes = (leader, recorder, driver, shaper)

    def all_tell_all():
        for node in nodes:
            for other in nodes:
                if other is not node:
                    node.hear(other)

    for _ in range(3):
        all_tell_all()
    for node in nodes:
        told = node.agreement.obstacle(0.0)
        assert "safety.velocity_limit is " in told
        assert f"0.5 in {DRIVER}" in told
        assert "1.0 in" in told
        assert "run.seed" not in told
        assert "command_shaper" not in told.replace("1.0 in", "")
    assert not any(key.startswith("parameters.") for key in shaper.agreement.values())
    recorder.agreement.begin({"safety": {"velocity_limit": 0.5}, "command_shaper": {"w1": 0.8}})
    leader.agreement.begin({"safety": {"velocity_limit": 0.5}})
    for _ in range(3):
        all_tell_all()
    assert leader.agreement.obstacle(0.0) == f"command_shaper.w1 is 0.9 in {SHAPER} and 0.8 in recorder"


@pytest.mark.parametrize("told", ["", "[]", "nonsense", '{"safety": 3}', "[" * 100_000])
def test_odd_configuration_of_a_foreign_node_does_no_harm(told):
    leader = Node(LEADER, safety={"velocity_limit": 1.0})
    values = {"run": leader.agreement.run, "configuration": told, "parameters.safety": told}
    foreign = NodeStatus(f"/rths/{SHAPER}", NodeState.READY, values=values)
    assert leader.agreement.hear(foreign, 0.0, True) is Heard.BELIEVED
    assert leader.agreement.obstacle(0.0) == ""


# ---- parameter files


@pytest.mark.parametrize("key", ["/**", "/rths/command_shaper", "rths/command_shaper", "/rths/*", "/*/command_shaper"])
def test_parameter_file_that_reaches_the_node_is_taken(tmp_path, key):
    file = tmp_path / "parameters.yaml"
    file.write_text(f"{key}:\n  ros__parameters:\n    command_shaper:\n      w1: 0.9\n")
    refuse_unreached(["node", "--ros-args", "--params-file", str(file)], ["/rths/command_shaper"])


def test_nested_namespace_and_a_second_file_for_another_node_are_taken(tmp_path):
    nested, other = tmp_path / "nested.yaml", tmp_path / "other.yaml"
    nested.write_text("rths:\n  command_shaper:\n    ros__parameters: {command_shaper: {w1: 0.9}}\n")
    other.write_text("/rths/table_driver:\n  ros__parameters: {table: {controller: udp}}\n")
    arguments = ["--ros-args", "--params-file", str(nested), "--params-file", str(other)]
    assert parameter_files(["--params-file", "no", *arguments]) == [str(nested), str(other)]
    refuse_unreached(arguments, ["/rths/command_shaper"])
    with pytest.raises(InputError, match="none of it is for /rths/recorder, which would run on defaults"):
        refuse_unreached(arguments, ["/rths/recorder"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--params-file", "FILE"], "/rths/comand_shaper is no node of a test; allowed here: /**, /rths/numerical"),
        (["-r", "__ns:=/"], "__ns: / is not supported; a namespace of its own is required for each rig, as in /rig1"),
        (["-r", "__node:=shaper"], "__node: shaper is not supported, command_shaper is required"),
        (["-p", "use_sim_time:=true"], "use_sim_time: true is not supported, a table moves by the clock"),
        (["-p", "qos_overrides./rths/command.publisher.depth:=1"], "qos_overrides./rths/command.publisher.depth: not"),
    ],
)
def test_what_would_be_ignored_is_refused_in_one_line(start, tmp_path, arguments, message):
    file = tmp_path / "parameters.yaml"
    file.write_text(dump_config(Config()).replace("/**", "/rths/comand_shaper"))
    given = [str(file) if word == "FILE" else word for word in arguments]
    result = start("-m", "bmd_rths_nodes.nodes.command_shaper", "--ros-args", *given).wait()
    assert result.status == 2
    lines = [line for line in result.errors.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert message in lines[0]
    assert "Traceback" not in result.errors


# ---- on the graph


class Diagnostics:
    """What is told on /diagnostics, and a way to tell something there."""

    def __init__(self, client):
        self.told = {}
        self._client = client
        client.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=100))
        self._publisher = client.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=100))

    def _on_diagnostics(self, message):
        for entry in message.status:
            self.told.setdefault(entry.name.removeprefix("/rths/"), []).append(
                {pair.key: pair.value for pair in entry.values} | {"message": entry.message}
            )

    def tell(self, role, state, message="", stamp=None, **values):
        entry = NodeStatus(f"/rths/{role}", state, message=message, values=values)
        self._publisher.publish(status.to_message(entry, int(time.time() if stamp is None else stamp), 0))

    def latest(self, role):
        return self.told.get(role, [{}])[-1]

    def wait_for(self, condition, timeout=60.0):
        return wait_until(lambda: self._client.spin_some() or condition(), timeout)


def closed_bags(folder):
    return sorted(file.parent for file in folder.glob("*/metadata.yaml") if "outcome" in file.read_text())


@pytest.mark.slow
def test_test_waits_for_the_same_parameters_and_a_new_bag_does_not_take_the_end_of_the_test_before(
    client, start, tmp_path
):
    """Two tests with the same processes; for the second one the recorder is activated first, as README says."""
    bags = tmp_path / "bags"
    config = Config().changed(run__lockstep=True, ground_motion__duration=1.0, recorder__directory=str(bags))
    for name, changed in (("loop", config), ("recorder", config.changed(safety__velocity_limit=0.9))):
        (tmp_path / f"{name}.yaml").write_text(dump_config(changed))
    diagnostics = Diagnostics(client)
    start("-m", "bmd_rths_nodes.nodes.composed_loop", "--ros-args", "--params-file", tmp_path / "loop.yaml")
    start("-m", "bmd_rths_nodes.nodes.recorder", "--ros-args", "--params-file", tmp_path / "recorder.yaml")
    different = "safety.velocity_limit is 1.0 in numerical_substructure, table_driver and 0.9 in recorder"
    diagnostics.wait_for(lambda: diagnostics.latest(LEADER).get("message") == different)
    assert diagnostics.latest(LEADER)["step"] == "0"
    assert closed_bags(bags) == []

    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        assert change_state(client, transition, "recorder")
    set_velocity_limit(client, 1.0)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert change_state(client, transition, "recorder")
    finished = lambda: [bag for bag in closed_bags(bags) if read_bag(bag).outcome == "finished"]  # noqa: E731
    diagnostics.wait_for(lambda: len(finished()) == 1)
    first = diagnostics.latest(LEADER)["run"]

    for role in ("recorder", LEADER):
        assert change_state(client, Transition.TRANSITION_DEACTIVATE, role)
    # The numerical substructure was deactivated; what another one repeats of the test before is no end of the new one.
    assert change_state(client, Transition.TRANSITION_ACTIVATE, "recorder")
    for _ in range(20):
        diagnostics.tell(LEADER, NodeState.ENDED, "end", run=first, outcome="finished", step="201")
        client.spin_some()
    assert change_state(client, Transition.TRANSITION_ACTIVATE, LEADER)
    diagnostics.wait_for(lambda: len(finished()) == 2)
    told = lambda: {diagnostics.latest(role)["run"] for role in (LEADER, DRIVER, SHAPER, "recorder")}  # noqa: E731
    diagnostics.wait_for(lambda: len(told()) == 1 and told().isdisjoint({"", first}))
    expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    for bag in finished():
        assert read_bag(bag).same_signals(expected)


def set_velocity_limit(client, value):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    request = SetParameters.Request(parameters=[Parameter("safety.velocity_limit", value=value).to_parameter_msg()])
    assert client.call(SetParameters, "/rths/recorder/set_parameters", request).results[0].successful


ENDLESS = {
    "ground_motion.free_vibration": 600.0,
    "run.preflight": "skip",
    "run.longest_miss_time": 20,
    "safety.stale_shear_time": 20,
    **{name.replace("__", "."): value for name, value in WITHOUT_LIMITS.items()},
}
SETTINGS = [word for name, value in ENDLESS.items() for word in ("--set", f"{name}={value}")]


@pytest.mark.slow
def test_foreign_statuses_neither_end_a_test_nor_reach_its_result(bmd_rths, client, tmp_path):
    diagnostics = Diagnostics(client)
    run = bmd_rths("run", CONFIG, "--composed", *SETTINGS, "--output", tmp_path / "bags", "--json")
    diagnostics.wait_for(lambda: recorded(tmp_path / "bags", 200_000))
    (bag,) = (tmp_path / "bags").iterdir()
    diagnostics.wait_for(lambda: LEADER in diagnostics.told and diagnostics.latest(LEADER).get("step"))
    run_id, step = diagnostics.latest(LEADER)["run"], int(diagnostics.latest(LEADER)["step"])
    for _ in range(50):
        diagnostics.tell(DRIVER, NodeState.TRIPPED, "foreign", outcome="exploded", run="another", table="moving")
        diagnostics.tell(LEADER, NodeState.ENDED, "foreign")
        diagnostics.tell(LEADER, NodeState.ENDED, "foreign", outcome="finished", run=run_id, instance="another")
        diagnostics.tell("recorder", NodeState.ENDED, "foreign", bag="/another/bag", run=run_id, instance="another")
        client.spin_some()
    diagnostics.wait_for(lambda: int(diagnostics.latest(LEADER).get("step", 0)) > step + 300)
    run.interrupt()
    result = run.wait(60.0)
    told = json.loads(result.output)
    assert (told["bag"], told["outcome"]) == (str(bag), "stopped")
    assert told["reason"] == "table_driver: stopped by the operator"


@pytest.mark.slow
@pytest.mark.parametrize("transition", [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN])
def test_recorder_that_is_deactivated_ends_the_test_at_once(bmd_rths, client, tmp_path, transition):
    diagnostics = Diagnostics(client)
    run = bmd_rths("run", CONFIG, "--composed", *SETTINGS, "--output", tmp_path, "--json")
    bag = wait_until(lambda: recorded(tmp_path, 200_000)).parent
    begin = time.monotonic()
    assert change_state(client, transition, "recorder")
    result = run.wait(60.0)
    assert time.monotonic() - begin < 20.0  # of a busy machine; what is said below comes of no time-out
    assert result.status == 1
    told = json.loads(result.output)
    assert (told["bag"], told["outcome"]) == (str(bag), "failed")
    assert told["reason"] == "the recorder was deactivated before the test ended"
    ended = lambda: [entry["message"] for entry in diagnostics.told.get(LEADER, ()) if entry["state"] == "ended"]  # noqa: E731
    diagnostics.wait_for(ended, 10.0)
    assert ended()[0].startswith("recorder takes no part any more: it is ")
