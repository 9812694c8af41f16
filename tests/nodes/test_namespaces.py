"""Two rigs on one ROS domain, each in a namespace of its own."""

import json

import pytest
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.doctor import measured
from bmd_rths_nodes.ros.parameter_files import refuse_unreached
from bmd_rths_nodes.run.domain_lock import domain_lock
from tests.nodes.conftest import CONFIG

#: What the two rigs differ in, so that a message of the other one would show.
RIGS = {"/rig1": ("plc_fc", 1), "/lab/rig2": ("uc", 2)}


def statuses(bag):
    with AnyReader([bag]) as reader:
        told = [c for c in reader.connections if c.topic == "/diagnostics"]
        return {
            status.name
            for connection, _, raw in reader.messages(told)
            for status in reader.deserialize(raw, connection.msgtype).status
        }


@pytest.mark.slow
def test_two_runs_at_once_on_one_domain_equal_the_loop_in_process_bit_for_bit(bmd_rths, run_main, tmp_path):
    changes = {"ground_motion__duration": 2.0, "run__preflight": "skip"}
    given = [word for name, value in changes.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]
    children = {
        namespace: bmd_rths(
            *("run", CONFIG, "--namespace", namespace, "--scheme", scheme, "--set", f"run.seed={seed}", *given),
            *("--lockstep", "--composed", "--output", tmp_path / str(seed), "--json"),
        )
        for namespace, (scheme, seed) in RIGS.items()
    }
    for namespace, (scheme, seed) in RIGS.items():
        result = children[namespace].wait()
        assert result.status == 0, result.errors
        told = json.loads(result.output)
        (bag,) = (tmp_path / str(seed)).iterdir()
        record = read_bag(bag)
        config = load_config(CONFIG).changed(run__scheme=scheme, run__seed=seed, **changes)
        expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
        assert record.same_signals(expected)
        assert record.way_to_rest.same_signals(expected.way_to_rest)
        assert told["namespace"] == record.namespace == namespace
        assert {name.rpartition("/")[0] for name in statuses(bag)} == {namespace}
    (bag,) = (tmp_path / "1").iterdir()
    status, output, _ = run_main("replay", bag, "--json")
    assert (status, json.loads(output)["reproduced"]) == (0, True)
    status, output, _ = run_main("analyze", bag)
    assert status == 0
    assert "/rig1" in next(line for line in output.splitlines() if "namespace" in line)


def test_lock_is_one_of_domain_and_namespace():
    refused = pytest.raises(InputError, match=r"another run is active on this ROS domain .* a --namespace of its own")
    with domain_lock("/rig1"), domain_lock("/lab/rig1"), domain_lock("/lab_rig1"), refused, domain_lock("/rig1"):
        pass


def test_parameter_file_of_another_rig_reaches_nobody(tmp_path):
    file = tmp_path / "parameters.yaml"
    arguments = ["--ros-args", "--params-file", str(file)]
    file.write_text("/rig2/recorder:\n  ros__parameters: {}\n")
    with pytest.raises(InputError, match=r"/rig2/recorder is no node of a test; allowed here: .*, /rig1/recorder"):
        refuse_unreached(arguments, ["/rig1/recorder"])
    file.write_text("/rig1/recorder:\n  ros__parameters: {}\n/rig2/recorder:\n  ros__parameters: {}\n")
    refuse_unreached(arguments, ["/rig1/recorder"])


def test_wrong_namespace_is_bad_usage(run_main):
    status, _, errors = run_main("run", CONFIG, "--namespace", "rig 1")
    assert (status, errors.count("\n")) == (2, 1)
    assert errors.startswith("error: namespace 'rig 1' is not allowed")


def test_doctor_sees_a_test_in_any_namespace():
    finding = measured.others_finding(["/camera", "/rig1/recorder"])
    assert finding.level == measured.WARNING
    assert "a test is on this domain, in /rig1" in finding.advice
