"""When the steps of a bag began and closed, by the clock of the recorder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.record import TimingStatistics
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.bag_timing import read_timing_of_steps
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.topics import CORRECTED_FORCE, DESIRED_ACCELERATION

STEP_NS = 5_000_000
START_NS = 1_700_000_000_000_000_000


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
            writer.write(topic.full_name, topic.type_name, pack(step * STEP_NS, 0.0), heard, heard)
    writer.close(end_metadata("finished", "", TimingStatistics(1, 1, (3,), 0, {"p50": 1.0, "p99": 2.0, "max": 2.0})))
    return directory


def test_closures_and_periods_are_those_of_the_log_times(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "run", {0: 1_000_000, 1: 2_000_000, 2: 1_500_000, 4: 7_000_000, 5: 1_000_000})
    timing = read_timing_of_steps(read_bag(bag))
    assert isinstance(timing, StepTiming)
    assert timing.steps.tolist() == [0, 1, 2, 4, 5]
    assert timing.closure_ms == pytest.approx([1.0, 2.0, 1.5, 7.0, 1.0])
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


def test_a_recording_without_an_end_has_its_log_times_all_the_same(tmp_path: Path) -> None:
    record = read_bag(bag_of(tmp_path / "run", {0: 1_000_000}))
    timing = read_timing_of_steps(replace(record, timing=None))
    assert isinstance(timing, StepTiming)
    assert timing.missed_steps == ()
