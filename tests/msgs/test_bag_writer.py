"""Bags are what other rosbag2 tools expect, from before the first message on."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_writer import NO_START, BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT, SCALAR_TOPICS

STORY = {"configuration": '{"run": {"time_step": 0.005}}', "motion": "{}", "versions": "{}"}


def information(directory: Path) -> Any:
    return yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def write_command(writer: BagWriter, step: int, log_time_ns: int) -> None:
    data = ScalarCodec().pack(step * 5_000_000, float(step))
    writer.write(COMMAND.full_name, COMMAND.type_name, data, log_time_ns, log_time_ns - 7)


def messages_on_disk(directory: Path) -> int:
    """Count what a reader finds that comes by now, without closing anything."""
    count = 0
    with (directory / f"{directory.name}_0.mcap").open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                count += type(record).__name__ == "Message"
        except (McapError, EOFError):
            return count
    raise AssertionError("the file is closed")


def test_rosbags_reads_every_message(bag: Path, record: RunRecord) -> None:
    with AnyReader([bag]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == {
            topic.full_name: record.steps for topic in (*SCALAR_TOPICS, MEASUREMENT)
        }
        found: dict[str, list[Any]] = {}
        for connection, log_time, data in reader.messages():
            found.setdefault(connection.topic, []).append((log_time, reader.deserialize(data, connection.msgtype)))
    for topic in SCALAR_TOPICS:
        for step, (log_time, message) in enumerate(found[topic.full_name]):
            vectors = message.accel.linear if topic.type_name.endswith("AccelStamped") else message.wrench.force
            assert vectors.x == getattr(record, topic.name)[step]
            assert (vectors.y, vectors.z) == (0.0, 0.0)
            assert message.header.frame_id == topic.frame_id
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == log_time == step * 5_000_000
    for step, (_, message) in enumerate(found[MEASUREMENT.full_name]):
        assert message.joint_names == ["table", "floor_1", "floor_2", "floor_3", "applied_command"]
        (point,) = message.points
        assert point.positions[0] == record.table_displacement[step]
        assert point.accelerations.tolist() == [
            record.table_acceleration[step],
            *record.floor_accelerations[step],
            record.applied_command[step],
        ]
        assert point.effort[:2].tolist() == [record.actuator_force[step], record.base_shear[step]]


def test_rosbags_reads_the_metadata(bag: Path, record: RunRecord) -> None:
    with Reader(bag) as reader:
        assert reader.message_count == record.steps * 7
        assert reader.start_time == 0
        assert reader.duration == (record.steps - 1) * 5_000_000 + 1
        assert reader.ros_distro == "jazzy"
    assert information(bag)["custom_data"]["outcome"] == "finished"
    assert information(bag)["custom_data"]["reason"] == record.reason


def test_message_definitions_and_hashes_are_those_of_ros(bag: Path, typestore: Any) -> None:
    with (bag / "run_0.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert len(summary.schemas) == 3
    for channel in summary.channels.values():
        type_name = summary.schemas[channel.schema_id].name
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == typestore.hash_rihs01(type_name)
        (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert qos["reliability"] == "reliable"


def test_metadata_yaml_has_what_rosbag2_of_jazzy_requires(bag: Path) -> None:
    """The keys that rosbag2_storage/yaml.hpp of Jazzy reads without asking whether they are there."""
    found = information(bag)
    assert set(found) == {
        *("version", "storage_identifier", "duration", "starting_time", "message_count", "topics_with_message_count"),
        *("compression_format", "compression_mode", "relative_file_paths", "files", "custom_data", "ros_distro"),
    }
    assert found["version"] == 9
    assert all(isinstance(value, str) for value in found["custom_data"].values())
    (file,) = found["files"]
    assert file["path"] == found["relative_file_paths"][0] == "run_0.mcap"
    assert "&" not in (bag / "metadata.yaml").read_text().split("custom_data")[0]  # no YAML anchors


def test_the_mcap_alone_has_the_metadata_too(bag: Path) -> None:
    with (bag / "run_0.mcap").open("rb") as stream:
        records = {m.name: m.metadata for m in make_reader(stream).iter_metadata()}
    assert set(records) == {"bmd_rths", "bmd_rths_end", "rosbag2"}
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"]) == information(bag)


def test_both_files_exist_before_the_first_message(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run", metadata=STORY)
    assert sorted(file.name for file in (tmp_path / "run").iterdir()) == ["metadata.yaml", "run_0.mcap"]
    found = information(tmp_path / "run")
    assert found["message_count"] == 0
    assert found["starting_time"]["nanoseconds_since_epoch"] == NO_START
    assert found["custom_data"] == STORY
    assert found["relative_file_paths"] == ["run_0.mcap"]


def test_a_bag_without_messages_is_a_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run", metadata=STORY).close({"outcome": "stopped"})
    with Reader(tmp_path / "run") as reader:
        assert reader.message_count == 0


def test_times_are_the_ones_given(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", metadata=STORY)
    for step, log_time in enumerate((5_000, 2_000, 9_000)):
        write_command(writer, step, log_time)
    writer.close({})
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        times = [(m.log_time, m.publish_time) for _, _, m in make_reader(stream).iter_messages()]
    assert times == [(2_000, 1_993), (5_000, 4_993), (9_000, 8_993)]
    found = information(tmp_path / "run")
    assert found["starting_time"]["nanoseconds_since_epoch"] == 2_000
    assert found["duration"]["nanoseconds"] == 7_000


def test_messages_are_flushed_by_log_time(tmp_path: Path) -> None:
    start = 1_700_000_000 * 10**9
    writer = BagWriter(tmp_path / "run", metadata=STORY, flush_period=0.1)
    write_command(writer, 0, start)
    assert messages_on_disk(tmp_path / "run") == 1
    write_command(writer, 1, start + 99_999_999)
    assert messages_on_disk(tmp_path / "run") == 1
    write_command(writer, 2, start + 100_000_000)
    assert messages_on_disk(tmp_path / "run") == 3
    write_command(writer, 3, start + 1)  # the wall clock was set back
    assert messages_on_disk(tmp_path / "run") == 4


def test_flush_does_not_wait_for_a_message(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", metadata=STORY)
    write_command(writer, 0, 10_000)
    assert messages_on_disk(tmp_path / "run") == 0
    writer.flush()
    assert messages_on_disk(tmp_path / "run") == 1


def test_a_directory_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty") as caught:
        BagWriter(tmp_path, metadata=STORY)
    assert str(caught.value).startswith(f"{tmp_path}: ")
    assert "\n" not in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_an_empty_directory_is_taken(tmp_path: Path) -> None:
    BagWriter(tmp_path, metadata=STORY).close({})
    with Reader(tmp_path) as reader:
        assert reader.message_count == 0


@pytest.mark.parametrize("place", ["file", "file/run", "n" * 300])
def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path, place: str) -> None:
    """A file stands in the way, or the name is too long: this fails for root, too."""
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="cannot be written") as caught:
        BagWriter(tmp_path / place, metadata=STORY)
    assert "\n" not in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_the_index_that_is_kept_packed_is_the_one_of_the_library(tmp_path: Path, monkeypatch: Any) -> None:
    def bag(name: str) -> bytes:
        writer = BagWriter(tmp_path / name / "same", metadata=STORY, chunk_size=200)
        for step in range(50):
            write_command(writer, step, 10**9 + step * 5_000_000)
        writer.close({"outcome": "finished"})
        return (tmp_path / name / "same" / "same_0.mcap").read_bytes()

    packed = bag("packed")
    monkeypatch.setattr("bmd_rths_msgs_py.bag_writer._PackedChunkIndices", list)
    assert bag("plain") == packed
    with (tmp_path / "packed" / "same" / "same_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 10


def test_memory_of_a_recording_grows_by_no_more_than_its_index(tmp_path: Path) -> None:
    """A minute of a test has some 1200 chunks, for each of which the library would keep 1 kB."""
    writer = BagWriter(tmp_path / "bag", metadata=STORY, chunk_size=0)  # a chunk a message
    write_command(writer, 0, 10**9)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for step in range(1, 1201):
            write_command(writer, step, 10**9 + step)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    writer.close({})
    assert grown < 200_000
