"""One node seen from ROS: parameters, lifecycle, status, messages of other nodes."""

import json
import math
import signal
import time
from itertools import product

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import JointTrajectory

from bmd_rths_core.compensators.phase_lead import CommandShaper
from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.topics import CORRECTED_FORCE, DIAGNOSTICS, ROLES, TOPICS
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.messages import message_class
from tests.nodes.conftest import Substructure, change_state, wait_until
from tests.nodes.emulation import LOCKSTEP, emulator


@pytest.fixture
def shaper(start):
    """Start a command shaper that waits for the operator."""
    return start("-m", "bmd_rths_nodes.nodes.command_shaper", "--ros-args", "-p", "autostart:=false")


def state(client):
    return client.call(GetState, "/rths/command_shaper/get_state", GetState.Request()).current_state.id


def set_parameter(client, name, value):
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return client.call(SetParameters, "/rths/command_shaper/set_parameters", request).results[0]


@pytest.mark.slow
def test_parameters_are_described_and_change_before_configuration_only(client, shaper):
    names = ["command_shaper.lead_time", "run.scheme", "run.seed", "autostart"]
    request = DescribeParameters.Request(names=names)
    lead, scheme, seed, autostart = client.call(
        DescribeParameters, "/rths/command_shaper/describe_parameters", request
    ).descriptors
    assert lead.type == ParameterType.PARAMETER_DOUBLE
    assert lead.floating_point_range[0].from_value == 0.0
    assert "delay constant alpha of Eq. 10" in lead.description
    assert "[s]" in lead.description
    assert scheme.type == ParameterType.PARAMETER_STRING
    assert scheme.additional_constraints.startswith("one of uc, fc, plc, plc_fc")
    assert seed.type == ParameterType.PARAMETER_INTEGER
    assert seed.integer_range[0].from_value == 0
    assert autostart.type == ParameterType.PARAMETER_BOOL

    listed = client.call(ListParameters, "/rths/command_shaper/list_parameters", ListParameters.Request()).result.names
    sections = {name.partition(".")[0] for name in listed if "." in name}
    assert {"run", "command_shaper"} <= sections
    assert "specimen" not in sections  # those of its role only

    assert set_parameter(client, "command_shaper.lead_time", 0.02).successful
    refused = set_parameter(client, "command_shaper.w1", 0.5)
    assert not refused.successful
    assert "W1 = 0.5" in refused.reason
    assert not set_parameter(client, "command_shaper.lead_time", -1.0).successful
    assert change_state(client, Transition.TRANSITION_CONFIGURE)
    refused = set_parameter(client, "command_shaper.lead_time", 0.015)
    assert not refused.successful
    assert "after the cleanup transition" in refused.reason
    assert change_state(client, Transition.TRANSITION_CLEANUP)
    assert set_parameter(client, "command_shaper.lead_time", 0.015).successful
    request = GetParameters.Request(names=["command_shaper.lead_time"])
    values = client.call(GetParameters, "/rths/command_shaper/get_parameters", request).values
    assert values[0].double_value == 0.015


@pytest.mark.slow
def test_lifecycle_can_be_driven_and_an_impossible_transition_does_no_harm(client, shaper):
    assert state(client) == State.PRIMARY_STATE_UNCONFIGURED
    assert not change_state(client, Transition.TRANSITION_ACTIVATE)
    assert state(client) == State.PRIMARY_STATE_UNCONFIGURED
    for transition, expected in (
        (Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE),
        (Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE),
        (Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_CLEANUP, State.PRIMARY_STATE_UNCONFIGURED),
        (Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE),
        (Transition.TRANSITION_ACTIVE_SHUTDOWN, State.PRIMARY_STATE_FINALIZED),
    ):
        assert change_state(client, transition)
        assert state(client) == expected
    shaper.interrupt()
    assert shaper.wait(20.0).status == 0


@pytest.fixture
def with_hangup():
    """Have children that die of SIGHUP, also where the tests run under nohup, which they would inherit."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP])
def test_bare_node_starts_itself_tells_its_status_and_ends_in_order(client, start, with_hangup, ending):
    told = {}

    def on_diagnostics(message):
        for entry in message.status:
            told[entry.name] = {pair.key: pair.value for pair in entry.values}

    client.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QoSProfile(depth=10))
    node = start("-m", "bmd_rths_nodes.nodes.command_shaper")
    wait_until(lambda: client.spin_some() or told)
    wait_until(lambda: client.spin_some() or told["/rths/command_shaper"]["state"] == "waiting")
    assert told["/rths/command_shaper"]["malformed"] == "0"
    assert state(client) == State.PRIMARY_STATE_ACTIVE
    node.process.send_signal(ending)
    result = node.wait(20.0)
    assert result.status == 0
    assert "Traceback" not in result.errors


def test_ordinary_ros_node_can_take_part(client, start):
    """A stage of a laboratory, written with ordinary messages, talks to the raw ones of this project."""
    start(
        "-m", "bmd_rths_nodes.nodes.command_shaper", "--ros-args", "-p", "run.record:=false", "-p", "run.lockstep:=true"
    )
    commands = []
    client.create_subscription(AccelStamped, "/rths/command", commands.append, QoSProfile(depth=10))
    publisher = client.create_publisher(AccelStamped, "/rths/desired_acceleration", QoSProfile(depth=10))

    def send(step, value):
        message = AccelStamped()
        message.header.frame_id = "another frame"
        message.header.stamp.nanosec = 5_000_000 * step
        message.accel.linear.x = value
        publisher.publish(message)
        client.spin_some()

    # The two sides meet when a command comes back; what was sent before is of no interest: step 0 begins anew.
    wait_until(lambda: send(0, 9.0) or send(1, 9.0) or commands)
    for _ in range(20):
        client.spin_some()
    commands.clear()
    expected = CommandShaper(Config().command_shaper, Config().run.time_step, active=True)
    for step, value in enumerate((0.0, 1.0, -2.5, math.pi)):
        send(step, value)
        wait_until(lambda n=step: client.spin_some() or len(commands) > n)
        send(step, value)  # a repeated message is dropped, not computed twice
        assert commands[step].accel.linear.x == expected.step(value)
        assert commands[step].header.stamp.nanosec == 5_000_000 * step


#: Runs nodes one after the other, and tells the exit status of each; a line of errors ends with one of its own.
ONE_AFTER_THE_OTHER = """
import json, sys
from importlib import import_module

for module, parameters in json.loads(sys.argv[1]):
    sys.argv = ["node", "--ros-args", *(word for parameter in parameters for word in ("-p", parameter))]
    print(import_module(f"bmd_rths_nodes.nodes.{module}").main(), flush=True)
    print("----", file=sys.stderr, flush=True)
"""

WRONG_PARAMETERS = [
    (
        "command_shaper",
        ["command_shaper.alpha:=5.0", "run.time_step:=0.002"],
        "command_shaper.alpha is now command_shaper.lead_time, in seconds; 5 steps of 0.002 s are 0.01 s",
    ),
    ("command_shaper", ["command_shaper.alfa:=5.0"], "command_shaper.alfa: unknown parameter"),
    ("command_shaper", ["command_shaper.w1:=0.5"], "W1 = 0.5"),
    ("command_shaper", ["specimen.masses:=[-1.0]"], "specimen.masses: [-1] is not allowed; >= 0.1 kg and"),
    ("table_driver", ["nonsense:=1"], "nonsense: unknown section"),
    ("numerical_substructure", ["ground_motion.record:=no.at2"], "no.at2: cannot be read: No such file"),
    ("recorder", ["recorder.directory:=/proc/no"], "/proc/no"),
]


@pytest.mark.slow
def test_wrong_parameters_end_a_node_with_status_2_and_one_line(start):
    nodes = [(module, parameters) for module, parameters, _ in WRONG_PARAMETERS]
    result = start("-c", ONE_AFTER_THE_OTHER, json.dumps(nodes)).wait()
    assert result.status == 0, result.errors
    assert result.output.split() == ["2"] * len(WRONG_PARAMETERS)
    told = result.errors.split("----\n")[:-1]
    for (_, _, message), errors in zip(WRONG_PARAMETERS, told, strict=True):
        (line,) = (line for line in errors.splitlines() if line.startswith("error: "))
        assert message in line
    assert "Traceback" not in result.errors


@pytest.mark.slow
def test_recorder_in_lockstep_waits_for_the_last_messages(client, start, tmp_path):
    """Of a test that has ended one topic lacks its last step; the bag is closed when it has come."""
    bags, told = tmp_path / "bags", []
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(dump_config(Config().changed(run__lockstep=True, recorder__directory=str(bags))))
    start("-m", "bmd_rths_nodes.nodes.recorder", "--ros-args", "--params-file", parameters)
    topics = [topic for topic in TOPICS.values() if topic is not DIAGNOSTICS]
    publishers = {t: client.create_publisher(message_class(t), t.full_name, QoSProfile(depth=10)) for t in topics}
    diagnostics = client.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))

    def on_diagnostics(message):
        told.extend(entry for entry in message.status if entry.name == "/rths/recorder")

    client.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QoSProfile(depth=10))

    def send(topic, step):
        message = message_class(topic)()
        message.header.stamp.nanosec = 5_000_000 * step
        publishers[topic].publish(message)

    def value(key):
        return {pair.key: pair.value for pair in told[-1].values}.get(key) if told else None

    ended = {"outcome": "finished", "step": "2", "missed_deadlines": "0", "max_consecutive_misses": "0"}
    ended |= {"missed_steps": "[]", "late_ticks": "0"} | {f"closure_ms_{name}": "0.0" for name in ("p50", "p99", "max")}
    wait_until(lambda: client.spin_some() or all(p.get_subscription_count() for p in publishers.values()))
    for topic in topics:
        send(topic, 0)
        if topic is not CORRECTED_FORCE:
            send(topic, 1)
    node = status.NodeStatus("/rths/numerical_substructure", NodeState.ENDED, values=ended)
    diagnostics.publish(status.to_message(node, 0, 0))
    begin = time.monotonic()
    wait_until(lambda: client.spin_some() or time.monotonic() > begin + 2.0)
    assert value("state") != "ended"
    send(CORRECTED_FORCE, 1)
    wait_until(lambda: client.spin_some() or value("state") == "ended")
    assert value("recorded_steps") == "2"
    (bag,) = bags.iterdir()
    assert read_bag(bag).outcome == "finished"


@pytest.mark.slow
def test_table_is_stopped_when_the_test_ends_and_late_commands_do_not_move_it_again(client, start):
    told, measured = {}, []

    def on_diagnostics(message):
        for entry in message.status:
            told[entry.name] = {pair.key: pair.value for pair in entry.values}

    client.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QoSProfile(depth=10))
    client.create_subscription(JointTrajectory, "/rths/measurement", measured.append, QoSProfile(depth=10))
    commands = client.create_publisher(AccelStamped, "/rths/command", QoSProfile(depth=10))
    substructure = Substructure(client)
    start(
        "-m", "bmd_rths_nodes.nodes.table_driver", "--ros-args", "-p", "run.record:=false", "-p", "run.lockstep:=true"
    )

    def send(step):
        message = AccelStamped()
        message.header.stamp.nanosec = 5_000_000 * step
        commands.publish(message)
        client.spin_some()

    def table():
        client.spin_some()
        return told.get("/rths/table_driver", {}).get("table")

    def run():
        return told.get("/rths/table_driver", {}).get("run")

    def begin():
        """Send two steps, and wait before sending them again: a step 0 that is still on its way begins a new test."""
        send(0)
        send(1)
        end = time.monotonic() + 2.0
        while not measured and time.monotonic() < end:
            client.spin_some()
        return measured

    substructure.offer(run)
    wait_until(begin)
    wait_until(lambda: table() == "moving")
    substructure.tell(NodeState.ENDED)
    wait_until(lambda: table() == "at rest")
    measured.clear()
    for step in (*range(2, 30), 0, 1):
        send(step)
    assert measured == []
    assert table() == "at rest"
    substructure.offer(run)
    wait_until(lambda: send(0) or measured)  # a new test begins at step 0
    wait_until(lambda: table() == "moving")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "roles", "another"),
    [("composed_loop", ROLES[:-1], "recorder"), ("recorder", ROLES[-1:], "table_driver")],
    ids=["loop", "recorder"],
)
def test_node_that_waits_for_the_operator_survives_the_status_of_others(
    client, start, tmp_path, module, roles, another
):
    """Every state between unconfigured and active is told, often, without harm while other nodes tell theirs."""
    talkative = (
        "import sys; from bmd_rths_nodes.ros import stage_node; stage_node.STATUS_PERIOD = 0.05; "
        f"from bmd_rths_nodes.nodes.{module} import main; sys.exit(main())"
    )
    child = start(
        *("-c", talkative, "--ros-args"),
        *("-p", "autostart:=false", "-p", f"recorder.directory:={tmp_path}"),
    )
    diagnostics = client.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
    told = []
    client.create_subscription(DiagnosticArray, "/diagnostics", told.append, QoSProfile(depth=10))
    steps = (
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
    )
    for role, transition in product(roles, steps):
        assert change_state(client, transition, role)
        told.clear()
        # Its own status, between those of another node.
        wait_until(
            lambda role=role: (
                diagnostics.publish(status.to_message(status.NodeStatus(f"/rths/{another}", NodeState.READY), 0, 0))
                or client.spin_some()
                or any(s.name == f"/rths/{role}" for message in told for s in message.status)
            )
        )
    child.interrupt()
    result = child.wait(20.0)
    assert result.status == 0
    assert "Traceback" not in result.errors


@pytest.mark.slow
def test_every_node_of_a_process_is_made_safe_before_one_waits_for_its_last_words(start):
    """The table must not wait for the middleware."""
    script = """
import sys
from bmd_rths_nodes.nodes.composed_loop import LOOP_NODES
from bmd_rths_nodes.ros import spin, stage_node

spin._spin = lambda *arguments: None
for name in ("stop_stage", "say_farewell"):
    for node_type in LOOP_NODES:
        def tell(node, name=name, done=getattr(node_type, name)):
            print(name, node.ROLE)
            done(node)
        setattr(node_type, name, tell)
sys.exit(spin.run_nodes(LOOP_NODES, ["--ros-args", "-p", "run.record:=false"]))
"""
    result = start("-c", script).wait()
    assert result.status == 0, result.errors
    loop = [role for role in ROLES if role != "recorder"]
    told = [line.split() for line in result.output.splitlines()]
    assert [name for name, _ in told] == ["stop_stage"] * 5 + ["say_farewell"] * 5
    assert [role for _, role in told] == [*loop, *loop]


@pytest.mark.slow
@pytest.mark.parametrize("lockstep", [False, True])
def test_node_settles_before_a_real_table_in_real_time_so_that_nobody_is_discovered_in_a_test(
    client, start, tmp_path, lockstep
):
    told = []

    def on_diagnostics(message):
        for entry in message.status:
            if entry.name == "/rths/numerical_substructure":
                told.append(next(pair.value for pair in entry.values if pair.key == "state"))

    client.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QoSProfile(depth=100))
    parameters = tmp_path / "parameters.yaml"
    config = LOCKSTEP.changed(run__lockstep=lockstep, run__record=False, run__settling_time=60.0)
    with emulator(config.changed(ground_motion__duration=2.0)) as (_, config):
        parameters.write_text(dump_config(config))
        loop = start("-m", "bmd_rths_nodes.nodes.composed_loop", "--ros-args", "--params-file", parameters)
        if lockstep:
            wait_until(lambda: client.spin_some() or "ended" in told)
        else:
            wait_until(lambda: client.spin_some() or len(told) > 30)
            assert set(told) == {"waiting"}
        loop.interrupt()
        assert loop.wait(20.0).status == 0
