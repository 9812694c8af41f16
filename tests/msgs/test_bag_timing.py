"""When the messages of the steps of a bag were sent, and what a step waits for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.record import TimingStatistics
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.bag_timing import CHAIN, read_timing_of_steps
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec
from bmd_rths_msgs_py.node_status import HARDWARE_ID
from bmd_rths_msgs_py.topics import CORRECTED_FORCE, DESIRED_ACCELERATION, DIAGNOSTICS, MEASUREMENT, ROLES

STEP_NS = 5_000_000
START_NS = 1_700_000_000_000_000_000

#: How much later the recorder hears a message than it was sent.
HELD_UP_NS = 3_000_000


def bag_of(directory: Path, closures_ns: dict[int, int], lockstep: bool = False, rclpy: bool = True) -> Path:
    """Write the bag of six steps, some of which close."""
    configuration = {"run": {"time_step": 0.005, "lockstep": lockstep}}
    writer = BagWriter(directory, metadata=start_metadata(configuration, {}, {"rclpy": "7.1.6"} if rclpy else {}))
    pack = ScalarCodec().pack
    for step in range(6):
        begun = START_NS + step * STEP_NS
        messages = [(DESIRED_ACCELERATION, begun)]
        if step in closures_ns:
            messages.append((CORRECTED_FORCE, begun + closures_ns[step]))
        for topic, heard in messages:
            writer.write(topic.full_name, topic.type_name, pack(step * STEP_NS, 0.0), heard + HELD_UP_NS, heard)
    writer.close(end_metadata("finished", "", TimingStatistics(1, 1, (3,), 0, {"p50": 1.0, "p99": 2.0, "max": 2.0})))
    return directory


def test_steps_and_periods_are_those_of_the_times_at_which_messages_were_sent(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "run", {0: 1_000_000, 1: 2_000_000, 2: 1_500_000, 4: 7_000_000, 5: 1_000_000})
    timing = read_timing_of_steps(read_bag(bag))
    assert isinstance(timing, StepTiming)
    assert timing.steps.tolist() == [0, 1, 2, 4, 5]
    assert timing.chain_ms == pytest.approx([1.0, 2.0, 1.5, 7.0, 1.0])
    assert timing.period_ms == pytest.approx([5.0, 5.0, 5.0])  # not across the step that is missing
    assert timing.missed_steps == (3,)


def test_a_test_that_followed_no_clock_has_no_timing(tmp_path: Path) -> None:
    closures = dict.fromkeys(range(6), 1_000_000)
    lockstep = read_timing_of_steps(read_bag(bag_of(tmp_path / "lockstep", closures, lockstep=True)))
    simulated = read_timing_of_steps(read_bag(bag_of(tmp_path / "simulated", closures, rclpy=False)))
    nothing = read_timing_of_steps(read_bag(bag_of(tmp_path / "nothing", {})))
    assert isinstance(lockstep, str)
    assert "lockstep" in lockstep
    assert isinstance(simulated, str)
    assert "in process" in simulated
    assert isinstance(nothing, str)
    assert "no step" in nothing


def test_a_recording_without_an_end_has_its_times_all_the_same(tmp_path: Path) -> None:
    record = read_bag(bag_of(tmp_path / "run", {0: 1_000_000}))
    timing = read_timing_of_steps(replace(record, timing=None))
    assert isinstance(timing, StepTiming)
    assert timing.missed_steps == ()


def chain_of(directory: Path, processes: dict[str, str]) -> Path:
    """Write the bag of ten steps with every message of the chain, and what the nodes told of their processes."""
    writer = BagWriter(directory, metadata=start_metadata({"run": {"time_step": 0.005}}, {}, {"rclpy": "7.1.6"}))
    typestore = get_typestore(Stores.ROS2_JAZZY)
    types = typestore.types
    status, pair = types["diagnostic_msgs/msg/DiagnosticStatus"], types["diagnostic_msgs/msg/KeyValue"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 0), "")
    told = [
        status(0, f"/rths/{role}", "", HARDWARE_ID, [pair("state", "ready"), pair("instance", process)])
        for role, process in processes.items()
    ]
    array = types[DIAGNOSTICS.type_name](header, told)
    data = bytes(typestore.serialize_cdr(array, DIAGNOSTICS.type_name))
    writer.write(DIAGNOSTICS.full_name, DIAGNOSTICS.type_name, data, START_NS, START_NS)
    pack, measured = ScalarCodec().pack, MeasurementCodec(1, StepStamps(0.005)).pack
    for step in range(10):
        stamp, sent = step * STEP_NS, START_NS + step * STEP_NS
        for number, topic in enumerate(CHAIN):
            sent += 100_000 * number
            data = (
                measured(stamp, TableMeasurement(step, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(1)))
                if topic is MEASUREMENT
                else pack(stamp, 0.0)
            )
            writer.write(topic.full_name, topic.type_name, data, sent + HELD_UP_NS, sent)
    writer.close(end_metadata("finished", "", None))
    return directory


def test_hops_are_the_times_from_message_to_message(tmp_path: Path) -> None:
    timing = read_timing_of_steps(read_bag(chain_of(tmp_path / "run", {role: f"process of {role}" for role in ROLES})))
    assert isinstance(timing, StepTiming)
    expected = {"command": 0.1, "measurement": 0.2, "interface_force": 0.3, "corrected_force": 0.4}
    assert list(timing.hops_ms) == list(expected)
    for name, hop in expected.items():
        assert timing.hops_ms[name] == pytest.approx([hop] * 10)
    assert sum(hops.mean() for hops in timing.hops_ms.values()) == pytest.approx(timing.chain_ms.mean())


def test_nodes_that_share_a_process_have_no_hops(tmp_path: Path) -> None:
    timing = read_timing_of_steps(read_bag(chain_of(tmp_path / "run", dict.fromkeys(ROLES, "process 1"))))
    assert isinstance(timing, StepTiming)
    assert timing.hops_ms == {}
