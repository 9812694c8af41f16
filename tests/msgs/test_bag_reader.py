"""`read_bag` gives back what was recorded, whoever has written the bag."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from bmd_rths_core.config import config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_reader import MAX_STEPS, read_bag
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT
from tests.conftest import examples
from tests.msgs.bags import FINISHED, STAMPS, STEP_NS, Make, Same, bag_of, command, custom_data, measurement


@pytest.mark.slow
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    max_examples=examples(30),
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # every example writes a bag: shrinking takes minutes
)
@given(data=st.data(), steps=st.integers(1, 12), floors=st.integers(1, 4))
def test_round_trip(make_record: Make, same: Same, tmp_path: Path, data: Any, steps: int, floors: int) -> None:
    record = make_record(steps, floors)
    signals = {name: data.draw(arrays(np.float64, values.shape), name) for name, values in record.signals().items()}
    record = replace(record, **signals)
    shutil.rmtree(tmp_path / "run", ignore_errors=True)
    found = read_bag(write_record(record, tmp_path / "run"))
    assert same(found, record)
    for name, values in record.signals().items():
        negative_zeros = np.signbit(values) & (values == 0)
        assert np.array_equal(np.signbit(getattr(found, name)) & (values == 0), negative_zeros)


def test_a_bag_names_its_source(bag: Path, record: RunRecord, same: Same) -> None:
    assert read_bag(bag).source == str(bag)
    assert same(read_bag(bag), record)
    assert same(read_bag(str(bag / "run_0.mcap")), record)


def test_a_record_that_contradicts_its_configuration_is_not_written(record: RunRecord, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.time_step"):
        write_record(replace(record, time_step=0.01), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_missing_messages_are_nan_and_the_last_duplicate_wins(tmp_path: Path) -> None:
    measured = MEASUREMENT, MeasurementCodec(2, STAMPS).pack(STEP_NS, measurement(2))
    messages = [command(3, 30.0), command(1, 10.0), command(3, 31.0), measured]
    found = read_bag(bag_of(tmp_path / "run", messages))
    assert found.steps == 4
    assert np.array_equal(found.command, [np.nan, 10.0, np.nan, 31.0], equal_nan=True)
    assert np.isnan(found.interface_force).all()
    assert np.array_equal(found.base_shear, [np.nan, 5.0, np.nan, np.nan], equal_nan=True)
    assert found.floor_accelerations.shape == (4, 2)
    assert (found.outcome, found.reason, found.timing) == ("finished", "", None)


def test_malformed_messages_are_left_out_and_counted(tmp_path: Path) -> None:
    right, wrong = MeasurementCodec(3, STAMPS), MeasurementCodec(2, STAMPS)
    messages = [
        (COMMAND, b"\x00\x01"),
        command(0, 1.0),
        (COMMAND, ScalarCodec().pack(STEP_NS + 1, 2.0)),
        (COMMAND, ScalarCodec().pack(MAX_STEPS * STEP_NS, 3.0)),  # a stray node with another clock
        (MEASUREMENT, right.pack(0, measurement(3))[:-9]),
        (MEASUREMENT, right.pack(0, measurement(3))),
        (MEASUREMENT, wrong.pack(STEP_NS, measurement(2))),
    ]
    found = read_bag(bag_of(tmp_path / "run", messages))
    assert found.steps == 1
    assert found.command.tolist() == [1.0]
    assert found.floor_accelerations.shape == (1, 3)
    assert found.outcome == "finished"
    assert found.reason.startswith("5 malformed messages were left out, the first of /rths/command: 2 bytes")


def test_without_a_measurement_there_are_no_floors(tmp_path: Path) -> None:
    cut = MeasurementCodec(3, STAMPS).pack(0, measurement(3))[:-9]
    found = read_bag(bag_of(tmp_path / "run", [command(0, 1.0), (MEASUREMENT, cut)]))
    assert found.floor_accelerations.shape == (1, 0)
    assert found.reason.startswith("1 malformed")


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_rewritten_copy_reads_equal(bag: Path, tmp_path: Path, same: Same, compression: CompressionType) -> None:
    """Another tool compresses the chunks and puts the metadata in front."""
    records = list(StreamReader(str(bag / "run_0.mcap")).records)
    with (tmp_path / "copy.mcap").open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start("ros2")
        unique = {(type(r).__name__, getattr(r, "id", r)): r for r in records if hasattr(r, "id")}
        for (kind, _), r in unique.items():
            if kind == "Schema":
                assert writer.register_schema(r.name, r.encoding, r.data) == r.id
        for (kind, _), r in unique.items():
            if kind == "Channel":
                assert writer.register_channel(r.topic, r.message_encoding, r.schema_id, r.metadata) == r.id
        for r in records:
            if type(r).__name__ == "Metadata":
                writer.add_metadata(r.name, r.metadata)
        for r in records:
            if type(r).__name__ == "Message":
                writer.add_message(r.channel_id, r.log_time, r.data, r.publish_time)
        writer.finish()
    assert same(read_bag(tmp_path / "copy.mcap"), read_bag(bag))


def test_a_copy_of_rosbags_reads_equal(bag: Path, tmp_path: Path, same: Same, typestore: Any) -> None:
    """rosbags, like `ros2 bag convert`, drops the records of the MCAP; the custom data of metadata.yaml stay."""
    copy = RosbagsWriter(tmp_path / "copy", version=9, storage_plugin=StoragePlugin.MCAP)
    copy.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with Reader(bag) as reader, copy:
        for key, value in custom_data(bag).items():
            copy.set_custom_data(key, value)
        connections = {c.id: copy.add_connection(c.topic, c.msgtype, typestore=typestore) for c in reader.connections}
        for connection, time, data in reader.messages():
            copy.write(connections[connection.id], time, data)
    assert same(read_bag(tmp_path / "copy"), read_bag(bag))


@pytest.mark.parametrize("outcome", ["stopped", "limit", "failed"])
def test_how_a_run_ended_is_read(tmp_path: Path, outcome: str) -> None:
    found = read_bag(bag_of(tmp_path / "run", [command(0, 1.0)], end_metadata(outcome, "by hand", None)))
    assert (found.outcome, found.reason, found.timing) == (outcome, "by hand", None)


def test_the_story_is_json_that_anyone_can_read(bag: Path, record: RunRecord) -> None:
    custom = custom_data(bag)
    assert json.loads(custom["configuration"]) == record.configuration
    assert json.loads(custom["motion"]) == record.motion
    assert json.loads(custom["timing"])["missed_steps"] == [5, 17]


def test_configuration_of_an_older_version_is_converted_and_the_record_tells(make_record: Make, tmp_path: Path) -> None:
    """As a bag of the version before has it, where limits counted steps."""
    old = {
        "run": {"time_step": 0.005, "max_consecutive_misses": 20, "seed": 7},
        "command_shaper": {"w1": 2.0, "alpha": 5.422},
        "safety": {"stale_shear_limit": 30, "stale_controller_limit": 10, "stuck_limit": 100},
    }
    recorded = replace(make_record(3), configuration=old, outcome="finished", reason="")
    found = read_bag(write_record(recorded, tmp_path / "old"))
    config = config_from_mapping(found.configuration)
    assert (config.run.longest_miss_time, config.run.seed, config.command_shaper.lead_time) == (0.1, 7, 0.02711)
    safety = config.safety
    assert (safety.stale_shear_time, safety.stale_controller_time, safety.stuck_time) == (0.15, 0.05, 0.5)
    assert found.reason.startswith("the configuration is of an older version: run.max_consecutive_misses is now ")
    assert "safety.stale_shear_limit is now safety.stale_shear_time; 30 steps of 0.005 s are 0.15 s" in found.reason
    again = read_bag(write_record(found, tmp_path / "again"))  # written anew it is one of this version
    assert again.configuration == found.configuration
    assert again.reason == found.reason


def test_configuration_with_old_and_new_name_is_refused(tmp_path: Path) -> None:
    both = {"run": {"time_step": 0.005}, "safety": {"stuck_limit": 100, "stuck_time": 0.5}}
    BagWriter(tmp_path / "both", metadata=start_metadata(both, {}, {})).close(FINISHED)
    with pytest.raises(InputError, match=r"both: safety\.stuck_limit: stands beside safety\.stuck_time"):
        read_bag(tmp_path / "both")
