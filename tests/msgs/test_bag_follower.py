"""A bag that is followed while it is written is, in the end, what `read_bag` reads."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bmd_rths_core.config import load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MalformedMessage, ScalarCodec
from bmd_rths_msgs_py.node_status import read_statuses
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_msgs_py.topics import COMMAND, CORRECTED_FORCE, DESIRED_ACCELERATION, DIAGNOSTICS

CONFIG = load_config(Path(__file__).parents[2] / "config" / "simplified_bmd.yaml").as_mapping()
ON_ROS = {"rclpy": "7.1.6"}


@pytest.fixture
def record(make_record: Callable[..., RunRecord]) -> RunRecord:
    """Return a run with a whole configuration."""
    return replace(make_record(900), configuration=CONFIG)


def same(follower: BagFollower, path: Path) -> bool:
    """Tell whether what was followed is what is read."""
    assert follower.run is not None
    found, read = follower.run.signals.signals(), read_bag(path).signals()
    return all(np.array_equal(found[name], read[name], equal_nan=True) for name in read)


def follow(path: Path) -> BagFollower:
    follower = BagFollower(path)
    while follower.look():
        pass
    return follower


def test_finished_bag_is_read_as_ever(record: RunRecord, tmp_path: Path) -> None:
    path = write_record(record, tmp_path / "bag")
    follower = follow(path)
    assert same(follower, path)
    run = follower.run
    assert run is not None
    assert (follower.ended, follower.damaged) == (True, False)
    assert (run.outcome, run.reason, run.timing) == (record.outcome, record.reason, record.timing)
    assert run.shown_steps == record.steps
    assert run.motion["name"] == "el_centro_1940_ns"
    assert run.tracking.windows[-1].end == pytest.approx(4.5, abs=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_it_does_not_matter_where_a_look_cuts_the_file(record: RunRecord, tmp_path: Path, seed: int) -> None:
    """Half a record, half of its head, a half chunk: the rest is there at the next look."""
    path = write_record(record, tmp_path / "bag")
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    growing = tmp_path / "growing.mcap"
    growing.touch()
    follower = BagFollower(growing)
    cuts = sorted(random.Random(seed).sample(range(len(data)), 60))
    shown = 0
    for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
        with growing.open("ab") as stream:
            stream.write(data[begin:end])
        follower.look()
        if follower.run is not None:
            assert follower.run.shown_steps >= shown
            shown = follower.run.shown_steps
    assert follower.ended
    assert same(follower, path)


def test_writer_and_follower_at_the_same_time(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", metadata=start_metadata(CONFIG, {"name": "a", "source": "b"}, ON_ROS))
    follower = BagFollower(tmp_path / "bag")
    follower.look()
    run = follower.run
    assert run is not None
    pack = ScalarCodec().pack
    for step in range(50):
        stamp = 5_000_000 * step
        for topic, late in ((DESIRED_ACCELERATION, 0), (CORRECTED_FORCE, 300_000)):
            writer.write(topic.full_name, topic.type_name, pack(stamp, step), 10**18 + stamp + late, stamp)
        writer.flush()
        follower.look()
        assert run.signals.steps == step + 1
        assert run.shown_steps == 0  # the other topics have not come
        assert run.signals.columns["corrected_force"][step] == step
    assert run.last_signal == pytest.approx(1e9 + 49 * 0.005 + 0.0003)
    writer.close(end_metadata("stopped", "by hand", None))
    follower.look()
    assert (follower.ended, run.outcome, run.reason, run.shown_steps) == (True, "stopped", "by hand", 50)


def test_story_that_another_tool_left_in_the_metadata_only(record: RunRecord, tmp_path: Path) -> None:
    path = write_record(record, tmp_path / "bag")
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(
        data.replace(b"bmd_rths_end", b"gone_for_bag").replace(b"\x08\x00\x00\x00bmd_rths", b"\x08\x00\x00\x00otherbag")
    )
    follower = follow(path)
    assert same(follower, path)
    assert follower.run is not None
    assert follower.run.outcome == "finished"
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    metadata["rosbag2_bagfile_information"]["custom_data"] = {}
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    assert follow(path).run is None


def test_malformed_messages_are_counted_and_left_out(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", metadata=start_metadata(CONFIG, {"name": "a"}, ON_ROS))
    writer.write(COMMAND.full_name, COMMAND.type_name, b"short", 1, 1)
    writer.write(COMMAND.full_name, COMMAND.type_name, ScalarCodec().pack(1, 1.0), 1, 1)  # no step has this stamp
    writer.write(DIAGNOSTICS.full_name, DIAGNOSTICS.type_name, b"\x00\x01\x00\x00" + bytes(9), 1, 1)
    writer.write(COMMAND.full_name, COMMAND.type_name, ScalarCodec().pack(0, 1.0), 1, 1)
    writer.close(end_metadata("finished", "", None))
    run = follow(tmp_path / "bag").run
    assert run is not None
    assert (run.malformed, run.shown_steps) == (3, 1)


def test_what_is_no_bag_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such bag"):
        BagFollower(tmp_path / "nothing.mcap")
    with pytest.raises(InputError, match=r"no \.mcap file in it"):
        BagFollower(tmp_path)
    writer = BagWriter(tmp_path / "bag", metadata={"configuration": "{", "motion": "{}", "versions": "{}"})
    with pytest.raises(InputError, match="configuration: not JSON"):
        follow(tmp_path / "bag")
    writer.close(end_metadata("finished", "", None))


# ---- statuses


def diagnostics(typestore: Any, little_endian: bool = True, hardware: str = "bmd_rths") -> bytes:
    """Return a message as rosbags makes it."""
    types = typestore.types
    status, pair = types["diagnostic_msgs/msg/DiagnosticStatus"], types["diagnostic_msgs/msg/KeyValue"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 250_000_000), "frame ü")
    told = [
        status(1, "/rths/recorder", "is ready", hardware, [pair("state", "ready"), pair("messages", "12")]),
        status(0, "/other/camera", "", "camera", []),
        status(2, "/rths/table_driver", "tripped: ü", "bmd_rths", [pair("trips", "a | b"), pair("state", "tripped")]),
    ]
    message = types["diagnostic_msgs/msg/DiagnosticArray"](header, told)
    return bytes(typestore.serialize_cdr(message, "diagnostic_msgs/msg/DiagnosticArray", little_endian=little_endian))


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("more", [b"", b"\x00" * 7])
def test_statuses_are_those_that_rosbags_wrote(typestore: Any, little_endian: bool, more: bytes) -> None:
    recorder, driver = read_statuses(diagnostics(typestore, little_endian) + more)
    assert (recorder.role, recorder.state, recorder.level, recorder.message) == (
        "recorder",
        NodeState.READY,
        b"\x01",
        "is ready",
    )
    assert (recorder.values, recorder.stamp) == ({"messages": "12"}, 7.25)
    assert (driver.node, driver.state, driver.message) == ("/rths/table_driver", NodeState.TRIPPED, "tripped: ü")
    assert driver.values == {"trips": "a | b"}


def test_cut_statuses_are_malformed_wherever_they_are_cut(typestore: Any) -> None:
    data = diagnostics(typestore)
    for size in range(len(data) - 3):  # the last three bytes may be padding
        with pytest.raises(MalformedMessage):
            read_statuses(data[:size])
