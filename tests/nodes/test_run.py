"""`bmd-rths run`: the ROS graph equals the loop in process, and survives what happens to it."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger

from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import dump_config, load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, RECORDER, ROLES
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, EIGHT_STORY, change_state, processes_of_domain, recorded, wait_until


def loop_of(config):
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def in_process(path=CONFIG, **changes):
    return loop_of(load_config(path).changed(**changes))


def finished(ended):
    """Return what a run that has ended well tells: a child, or what the command line in this process has returned."""
    status, output, errors = ended if isinstance(ended, tuple) else vars(ended.wait()).values()
    assert status == 0, errors
    return json.loads(output)


class Laboratory:
    """Six processes that a person has started by hand, in lockstep, and their bags."""

    def __init__(self, client, start, folder, config):
        self._client, self._bags = client, folder / "bags"
        self._read = {}
        parameters = folder / "parameters.yaml"
        parameters.write_text(dump_config(config.changed(recorder__directory=str(self._bags))))
        for role in ROLES:
            start("-m", f"bmd_rths_nodes.nodes.{role}", "--ros-args", "--params-file", parameters)

    def record(self, number):
        """Wait until so many bags are closed; return the record of the newest one."""
        wait_until(lambda: len(self._closed()) == number)
        (new,) = set(self._closed()) - set(self._read)
        self._read[new] = read_bag(new)
        return self._read[new]

    def _closed(self):
        return [file.parent for file in self._bags.glob("*/metadata.yaml") if "outcome" in file.read_text()]

    def under_way(self):
        """Wait until some steps of a test are in its bag."""
        before = set(self._closed())
        (new,) = wait_until(lambda: set(self._bags.iterdir()) - before)
        wait_until(lambda: recorded(self._bags, 50_000, new.name))

    def ask(self, service):
        return self._client.call(Trigger, f"/rths/table_driver/{service}", Trigger.Request()).success

    def again(self):
        """Begin another test, as README says: recorder and numerical substructure are activated again."""
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            for role in (RECORDER, NUMERICAL_SUBSTRUCTURE):
                assert change_state(self._client, transition, role)

    def with_scheme(self, scheme):
        """Begin a test with another scheme."""
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
            for role in ROLES:
                assert change_state(self._client, transition, role)
        request = SetParameters.Request(parameters=[Parameter("run.scheme", value=scheme).to_parameter_msg()])
        for role in ROLES:
            assert self._client.call(SetParameters, f"/rths/{role}/set_parameters", request).results[0].successful
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            for role in ROLES:
                assert change_state(self._client, transition, role)


@pytest.mark.slow
def test_five_processes_equal_the_loop_in_process_bit_for_bit_test_after_test_with_every_scheme(
    client, start, tmp_path
):
    """The same processes run a test, one that the operator stops, the first one again, and those of other schemes."""
    config = load_config(CONFIG).changed(run__lockstep=True, ground_motion__duration=2.0)
    laboratory = Laboratory(client, start, tmp_path, config)
    first = laboratory.record(1)
    expected = loop_of(config)
    assert (first.outcome, first.steps) == ("finished", 401)
    assert first.same_signals(expected)
    assert first.way_to_rest.same_signals(expected.way_to_rest)

    laboratory.again()
    laboratory.under_way()
    assert laboratory.ask("stop")
    stopped = laboratory.record(2)
    assert (stopped.outcome, stopped.reason) == ("stopped", "table_driver: stopped by the operator")
    whole = stopped.steps - 2  # the last step had not closed
    assert whole > 20
    for name, values in stopped.signals().items():
        assert np.array_equal(values[:whole], expected.signals()[name][:whole]), name

    wait_until(lambda: laboratory.ask("reset"))
    laboratory.again()
    assert laboratory.record(3).same_signals(expected)

    others = [scheme for scheme in SCHEME_NAMES if scheme != config.run.scheme]
    assert len(others) == 3
    for number, scheme in enumerate(others, start=4):
        laboratory.with_scheme(scheme)
        record = laboratory.record(number)
        assert (record.outcome, record.configuration["run"]["scheme"]) == ("finished", scheme)
        assert record.same_signals(loop_of(config.changed(run__scheme=scheme)))


@pytest.mark.slow
def test_real_time_run_equals_the_loop_in_process_up_to_the_first_missed_deadline(run_main, tmp_path):
    """On a busy machine deadlines may be missed: what came before is equal all the same, and the misses are told."""
    duration = 3.0
    arguments = (*PATIENT, "--set", f"ground_motion.duration={duration}", "--output", tmp_path, "--json")
    result = finished(run_main("run", CONFIG, *arguments))
    assert set(result) >= {"scheme", "motion", "steps", "stable", "rmse_percent", "tracking_delay_ms", "bag"}
    assert set(result["closure_ms"]) == {"p50", "p99", "max"}
    assert set(result["rmse_percent"]) == {"substructure", "control_layer", "superstructure"}
    record = read_bag(result["bag"])
    expected = in_process(ground_motion__duration=duration, run__longest_miss_time=20)
    assert record.steps == expected.steps == 601
    assert len(record.timing.missed_steps) == result["missed_deadlines"]
    first_miss = min(record.timing.missed_steps, default=record.steps)
    for name, signal_ in record.signals().items():
        assert np.array_equal(signal_[:first_miss], expected.signals()[name][:first_miss]), name


@pytest.mark.slow
def test_lockstep_waits_for_a_recorder_that_gets_no_turn(bmd_rths, tmp_path, client, domain):
    """The numerical substructure stands still until the recorder goes on, and the bag has every value."""
    steps = []

    def on_diagnostics(message):
        for entry in message.status:
            values = {pair.key: pair.value for pair in entry.values}
            if entry.name == "/rths/numerical_substructure" and int(values.get("step", 0)) > 0:
                steps.append(int(values["step"]))

    client.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QoSProfile(depth=100))
    duration = settings(ground_motion__duration=18.0)
    child = bmd_rths("run", CONFIG, "--lockstep", "--composed", *duration, "--output", tmp_path, "--json")
    wait_until(lambda: begun(tmp_path))
    (recorder,) = (pid for pid, command in processes_of_domain(domain).items() if "recorder" in command)
    os.kill(recorder, signal.SIGSTOP)
    wait_until(lambda: client.spin_some() or (len(steps) > 2 and steps[-2] == steps[-1]))
    os.kill(recorder, signal.SIGCONT)
    assert 100 < steps[-1] < 3599
    assert read_bag(finished(child)["bag"]).same_signals(in_process(ground_motion__duration=18.0))


@pytest.mark.slow
def test_composed_lockstep_equals_the_loop_in_process(composed_run):
    record, expected = read_bag(composed_run.told["bag"]), in_process(ground_motion__duration=3.0)
    assert record.same_signals(expected)
    assert record.way_to_rest.same_signals(expected.way_to_rest)
    told = composed_run.told
    assert told["steps"] == record.steps == 601
    assert told["missing_values"] == told["missed_deadlines"] == 0
    assert told["stable"] is True


@pytest.mark.slow
@pytest.mark.parametrize("substructure", ["linear", "yielding"])
def test_8_story_system_with_a_share_of_the_shear_equals_the_loop_in_process(run_main, tmp_path, substructure):
    changes = {"ground_motion.duration": 5.0, "force_correction.feedback_scale": 0.05, "run.preflight": "skip"}
    if substructure == "yielding":
        changes |= {
            "nonlinear.story_model": "bilinear",
            "nonlinear.integration": "kr_alpha",
            "nonlinear.yield_drifts": [0.0005, 0.0005, 0.0005],
        }
    settings = [argument for key, value in changes.items() for argument in ("--set", f"{key}={json.dumps(value)}")]
    options = ("--lockstep", "--composed", *settings, "--output", tmp_path, "--json")
    result = finished(run_main("run", EIGHT_STORY, *options))
    record = read_bag(result["bag"])
    assert record.floor_accelerations.shape == (1001, 5)
    expected = in_process(EIGHT_STORY, **{key.replace(".", "__"): value for key, value in changes.items()})
    assert record.same_signals(expected)


@pytest.mark.slow
def test_passed_limit_ends_the_run_at_the_same_step_as_in_process(run_main, tmp_path):
    arguments = (
        "--lockstep",
        "--set",
        "safety.acceleration_limit=1.0",
        "--set",
        "safety.ramp_acceleration=1.0",
        "--output",
        tmp_path,
        "--json",
    )
    status, output, _ = run_main("run", CONFIG, "--override-preflight", *arguments)
    assert status == 1
    told = json.loads(output)
    assert told["outcome"] == "limit"
    assert told["stable"] is False
    assert told["rmse_percent"] == {"substructure": None, "control_layer": None, "superstructure": None}
    expected = in_process(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0)
    record = read_bag(told["bag"])
    assert record.same_signals(expected)
    assert record.way_to_rest.same_signals(expected.way_to_rest)
    assert record.way_to_rest.first_step == record.steps - 1
    assert record.reason == f"table_driver: {expected.reason}"


@pytest.mark.slow
def test_diverging_run_is_stopped_at_the_same_step_as_in_process(run_main, tmp_path):
    """The uncompensated loop with a numerical mass far below the allowable one."""
    light = {
        "numerical_substructure__masses": [1500.0],
        "numerical_substructure__stiffnesses": [1500.0 * 94.09**2],
        "numerical_substructure__damping_coefficients": [2 * 0.0167 * 94.09 * 1500.0],
    }
    arguments = ("--scheme", "uc", "--lockstep", "--composed", *settings(**light), "--output", tmp_path, "--json")
    status, output, _ = run_main("run", CONFIG, "--override-preflight", *arguments)
    assert status == 1
    told = json.loads(output)
    expected = in_process(run__scheme="uc", **light)
    record = read_bag(told["bag"])
    assert (record.outcome, record.reason) == ("limit", expected.reason)
    assert "safety.stability_limit" in record.reason
    assert record.same_signals(expected)


@pytest.mark.slow
def test_analyze_computes_the_same_from_the_bag_alone_and_the_bag_tells_the_whole_story(run_main, composed_run):
    result = dict(composed_run.told)
    assert result.pop("preflight")["cleared"] is True
    status, again, errors = run_main("analyze", result["bag"], "--json")
    assert status == 0, errors
    assert json.loads(again) == result
    record = read_bag(result["bag"])
    assert record.configuration["ground_motion"]["duration"] == 3.0
    assert record.motion["name"] == "el_centro_1940_ns"
    assert len(record.motion["sha256"]) == 64
    assert set(record.versions) >= {"bmd_rths", "numpy", "scipy", "filterpy", "python", "rclpy", "rmw", "ros_distro"}
    with AnyReader([Path(result["bag"])]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        diagnostics = [c for c in reader.connections if c.topic == "/diagnostics"]
        told = {
            status.name
            for connection, _, raw in reader.messages(diagnostics)
            for status in reader.deserialize(raw, connection.msgtype).status
        }
    assert {f"/rths/{role}" for role in ROLES} <= told
    rest = {counts.pop(f"/rths/way_to_rest_{what}") for what in ("command", "measurement")}
    assert rest == {record.way_to_rest.steps}
    assert all(count == 601 for topic, count in counts.items() if topic != "/diagnostics")


def settings(**changes):
    return [word for name, value in changes.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]


#: Real time on a busy machine: its stalls, and the jumps of the command they cause, must not end the test before the
#: fault that is tested does.
PATIENT = settings(run__longest_miss_time=20, run__preflight="skip", safety__stale_shear_time=20, **WITHOUT_LIMITS)


def begun(tmp_path):
    """Return the MCAP file of the run once a second of it has been recorded."""
    return recorded(tmp_path, 200_000)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["at the door", "on the domain"])
def test_ctrl_c_before_the_start_leaves_no_process(bmd_rths, tmp_path, client, domain, where):
    child = bmd_rths("run", CONFIG, "--composed", *PATIENT, "--output", tmp_path)
    wait_until(lambda: processes_of_domain(domain))
    if where == "on the domain":
        wait_until(lambda: set(client.get_node_names()) & set(ROLES))
    child.interrupt()
    result = child.wait(30.0)
    assert result.status == 1
    assert "Traceback" not in result.errors
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_killed_recorder_loses_at_most_a_second_and_its_bag_says_that_it_was_cut(bmd_rths, run_main, tmp_path, domain):
    """In lockstep no deadline can be missed, so all that was recorded must be that of the loop in process.

    What is there is enough for a replay.
    """
    endless = settings(ground_motion__free_vibration=600.0, run__preflight="skip")
    child = bmd_rths("run", CONFIG, "--lockstep", "--composed", *endless, "--output", tmp_path)
    bag = wait_until(lambda: begun(tmp_path))
    (recorder,) = (pid for pid, command in processes_of_domain(domain).items() if "nodes.recorder" in command)
    killed_at = time.time_ns()
    os.kill(recorder, signal.SIGKILL)
    result = child.wait(60.0)
    assert result.status == 1
    assert "recorder ended with status -9" in result.errors
    assert processes_of_domain(domain) == {}
    assert last_log_time(bag) > killed_at - 1_000_000_000
    record = read_bag(bag.parent)
    assert record.outcome == "cut"
    assert record.steps > 100
    expected = in_process()
    # The last steps may be there in part, because the cut falls between two messages of one step.
    whole = min(record.steps, expected.steps) - 2
    for name, signal_ in record.signals().items():
        assert np.array_equal(signal_[:whole], expected.signals()[name][:whole]), name
    status, output, errors = run_main("replay", bag.parent, "--json")
    assert (status, json.loads(output)["reproduced"]) == (0, True)
    assert json.loads(output)["signals"]["interface_force"]["compared"] > 100
    assert errors.startswith("warning: ")


def last_log_time(bag):
    """Return the log time of the last whole message of a cut MCAP file."""
    last = 0
    with open(bag, "rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Message):
                    last = max(last, record.log_time)
        except (McapError, EOFError):
            pass
    return last


@pytest.mark.slow
def test_killed_node_ends_the_run_with_its_name_and_a_readable_bag(bmd_rths, tmp_path, domain):
    a_second = settings(run__longest_miss_time=1)
    child = bmd_rths("run", CONFIG, *PATIENT, *a_second, "--output", tmp_path, "--json")
    wait_until(lambda: begun(tmp_path))
    (shaper,) = (pid for pid, command in processes_of_domain(domain).items() if "command_shaper" in command)
    os.kill(shaper, signal.SIGKILL)
    result = child.wait(60.0)
    assert result.status == 1
    assert "command_shaper ended with status -9" in result.errors
    assert result.output, result.errors
    record = read_bag(json.loads(result.output)["bag"])
    assert record.outcome == "failed"
    assert "deadlines in a row were missed" in record.reason
    assert 1 < record.timing.max_consecutive_misses <= 201  # less where ticks were late, which moves the schedule
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_table_is_brought_to_rest_when_no_command_comes_any_more(bmd_rths, tmp_path, domain):
    limits = settings(run__longest_miss_time=10, safety__stale_shear_time=0.1)
    child = bmd_rths("run", CONFIG, *PATIENT, *limits, "--output", tmp_path, "--json")
    wait_until(lambda: begun(tmp_path))
    (shaper,) = (pid for pid, command in processes_of_domain(domain).items() if "command_shaper" in command)
    os.kill(shaper, signal.SIGKILL)
    result = child.wait(60.0)
    assert result.status == 1
    record = read_bag(json.loads(result.output)["bag"])
    assert record.outcome == "limit"
    assert "table_driver: safety.stale_shear_time [s] passed at step" in record.reason
    assert processes_of_domain(domain) == {}
