"""`read_bag` gives back what was recorded, and the part of it that is left of a damaged bag."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from bmd_rths_core.config import config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_core.rest_record import rest_record
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_reader import MAX_STEPS, bag_is_whole, read_bag
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT, WAY_TO_REST_MEASUREMENT

Same = Callable[[RunRecord, RunRecord], bool]
Make = Callable[..., RunRecord]
STEP_NS = 5_000_000
STAMPS = StepStamps(0.005)
CONFIGURATION = {"run": {"time_step": 0.005}}
FINISHED = end_metadata("finished", "", None)


def bag_of(directory: Path, messages: list[tuple[Any, bytes]], end: dict[str, str] = FINISHED) -> Path:
    """Write a bag of messages as they are."""
    writer = BagWriter(directory, metadata=start_metadata(CONFIGURATION, {}, {}))
    for topic, data in messages:
        writer.write(topic.full_name, topic.type_name, data, 0, 0)
    writer.close(end)
    return directory


def command(step: int, value: float) -> tuple[Any, bytes]:
    return COMMAND, ScalarCodec().pack(step * STEP_NS, value)


def custom_data(bag: Path) -> dict[str, str]:
    """Return the custom data of ``metadata.yaml``."""
    return yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["custom_data"]


def measurement(floors: int) -> TableMeasurement:
    return TableMeasurement(0, 1.0, 2.0, 3.0, 4.0, 5.0, np.zeros(floors))


def assert_prefix(found: RunRecord, whole: RunRecord) -> None:
    """Every signal is the beginning of the recorded one: some of its first values, then NaN."""
    assert found.steps <= whole.steps
    for name, values in found.signals().items():
        recorded = getattr(whole, name)
        if values.ndim == 2 and values.shape[1] == 0:  # no measurement is left
            continue
        missing = np.isnan(values).any(axis=tuple(range(1, values.ndim)))
        count = int(np.sum(~missing))
        assert missing[count:].all()
        assert np.array_equal(values[:count], recorded[:count])


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    max_examples=30,
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


def with_way_to_rest(record: RunRecord, first_step: int) -> RunRecord:
    """Return a record whose way to rest has a step without a command, one without an answer, and one without both."""
    n = record.floor_accelerations.shape[1]
    measured = {
        step: TableMeasurement(step, 1.0, 2.0, 3.0 * step, np.nan, 5.0, np.arange(n) + 6.0)
        for step in (first_step, first_step + 1, first_step + 4)
    }
    commands = {first_step: 0.5, first_step + 2: -0.25, first_step + 4: -0.0}
    return replace(record, way_to_rest=rest_record(commands, measured, n))


@pytest.mark.parametrize("first_step", [199, 200, 230])
def test_way_to_rest_comes_back_bit_for_bit(record: RunRecord, same: Same, tmp_path: Path, first_step: int) -> None:
    record = with_way_to_rest(record, first_step)
    found = read_bag(write_record(record, tmp_path / "run"))
    assert same(replace(found, way_to_rest=None), replace(record, way_to_rest=None))
    assert found.way_to_rest is not None
    assert found.way_to_rest.same_signals(record.way_to_rest)
    assert np.signbit(found.way_to_rest.command[-1])


def test_bag_of_a_way_to_rest_alone_is_one_of_no_step(record: RunRecord, tmp_path: Path) -> None:
    nothing = {name: values[:0] for name, values in record.signals().items()}
    whole = with_way_to_rest(record, 0)
    found = read_bag(write_record(replace(whole, **nothing), tmp_path / "run"))
    assert (found.steps, found.outcome) == (0, "finished")
    assert found.way_to_rest is not None
    assert found.way_to_rest.same_signals(whole.way_to_rest)


def test_older_bag_has_no_way_to_rest(bag: Path) -> None:
    found = read_bag(bag)
    assert (found.outcome, found.way_to_rest) == ("finished", None)
    assert np.array_equal(found.continued("command"), found.command)


def test_lost_message_of_the_way_to_rest_makes_a_bag_incomplete(record: RunRecord, tmp_path: Path) -> None:
    whole = write_record(with_way_to_rest(record, 200), tmp_path / "run")
    metadata = (whole / "metadata.yaml").read_text()
    cut = write_record(replace(record, way_to_rest=None), tmp_path / "cut")
    (cut / "metadata.yaml").write_text(metadata.replace("run_0.mcap", "cut_0.mcap"))
    found = read_bag(cut)
    assert found.outcome == "cut"
    assert "the recording is incomplete: 6 of 1406 messages of signals" in found.reason


def test_way_to_rest_of_another_number_of_floors_is_malformed(tmp_path: Path) -> None:
    measured = [(MEASUREMENT, MeasurementCodec(2, STAMPS).pack(0, measurement(2)))]
    strange = [(WAY_TO_REST_MEASUREMENT, MeasurementCodec(3, STAMPS).pack(STEP_NS, measurement(3)))]
    found = read_bag(bag_of(tmp_path / "run", measured + strange))
    assert found.way_to_rest is None
    assert found.reason.startswith("1 malformed messages were left out, the first of /rths/way_to_rest_measurement")


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


def split(bag: Path, folder: Path, files: int, **options: Any) -> Path:
    """Write the messages of a bag into several files of another, as a recorder that splits does."""
    reader = make_reader((bag / "run_0.mcap").open("rb"))
    messages = list(reader.iter_messages(log_time_order=False))
    stories = list(reader.iter_metadata())
    rename = options.get("rename", lambda topic: topic)
    folder.mkdir()
    for number in range(files):
        with (folder / f"run_{number}.mcap").open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="ros2")
            for story in stories if number == 0 else ():
                writer.add_metadata(story.name, options.get("change", dict)(story.metadata))
            ids: dict[str, int] = {}
            for schema, channel, message in messages[
                len(messages) * number // files : len(messages) * (number + 1) // files
            ]:
                if channel.topic not in ids:
                    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                    ids[channel.topic] = writer.register_channel(rename(channel.topic), "cdr", schema_id)
                writer.add_message(ids[channel.topic], message.log_time, message.data, message.publish_time)
            writer.finish()
    shutil.copy(bag / "metadata.yaml", folder)
    return folder


def test_a_split_bag_is_read_whole(make_record: Make, same: Same, tmp_path: Path) -> None:
    bag = write_record(make_record(30), tmp_path / "run")
    assert same(read_bag(split(bag, tmp_path / "split", 12)), read_bag(bag))  # run_10 comes after run_2


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_split_bag_without_one_of_its_files_is_told_as_incomplete(bag: Path, tmp_path: Path, lost: int) -> None:
    folder = split(bag, tmp_path / "split", 3)
    (folder / f"run_{lost}.mcap").unlink()
    found = read_bag(folder)
    assert found.outcome == "cut"
    missing = 1400 * (lost + 1) // 3 - 1400 * lost // 3
    assert f"the recording is incomplete: {missing} of 1400 messages of signals" in found.reason
    assert ("and so is the file 'run_0.mcap'" in found.reason) == (lost == 0)


def test_an_excerpt_with_all_its_metadata_is_told_as_incomplete(bag: Path, tmp_path: Path) -> None:
    folder = split(bag, tmp_path / "split", 2)
    (folder / "run_1.mcap").unlink()
    (folder / "metadata.yaml").unlink()
    found = read_bag(folder)
    assert found.outcome == "cut"
    assert "700 of 1400 messages of signals, as its metadata count them, are missing" in found.reason


def test_two_runs_in_one_folder_are_refused(bag: Path, make_record: Make, tmp_path: Path) -> None:
    for name, record in (("other", replace(make_record(50), motion={"name": "b"})), ("same", make_record(200, seed=1))):
        folder = write_record(record, tmp_path / name)
        shutil.copy(bag / "run_0.mcap", folder / "zz_1.mcap")
        with pytest.raises(InputError, match="two runs in one folder"):
            read_bag(folder)


def test_a_bag_without_its_motion_is_refused(bag: Path, tmp_path: Path) -> None:
    def without(story: dict[str, str]) -> dict[str, str]:
        return {key: value for key, value in story.items() if key != "motion"}

    with pytest.raises(InputError, match="has no entry 'motion'"):
        read_bag(split(bag, tmp_path / "split", 1, change=without))


@pytest.mark.parametrize("namespace", ["/lab/rths", "/lab", "/a/b/c"])
def test_signals_under_another_namespace_are_read(bag: Path, same: Same, tmp_path: Path, namespace: str) -> None:
    folder = split(bag, tmp_path / "split", 1, rename=lambda topic: topic.replace("/rths", namespace))
    assert read_bag(folder).same_signals(read_bag(bag))
    assert read_bag(folder).outcome == "finished"


def test_topics_without_a_signal_are_listed(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no signal of a test in it; topics found: '/rths/command_x'"):
        read_bag(split(bag, tmp_path / "split", 1, rename=lambda topic: topic + "_x"))


def test_signals_in_two_namespaces_are_refused(bag: Path, tmp_path: Path) -> None:
    def rename(topic: str) -> str:
        return topic.replace("/rths", "/one" if topic.endswith("command") else "/two")

    with pytest.raises(InputError, match="signals in 2 namespaces, '/one', '/two'"):
        read_bag(split(bag, tmp_path / "split", 1, rename=rename))


def test_a_bag_of_which_nothing_can_be_read_is_refused(tmp_path: Path) -> None:
    messages = [(COMMAND, b"\x28\xb5\x2f\xfd compressed one by one")] * 40
    with pytest.raises(InputError, match="none of its 40 messages can be read, the first of /rths/command"):
        read_bag(bag_of(tmp_path / "run", messages))


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/urandom"])
def test_a_file_without_an_end_is_refused(path: str) -> None:
    with pytest.raises(InputError, match="is no regular file"):
        read_bag(path)


def test_a_huge_file_is_not_read_into_memory(tmp_path: Path) -> None:
    path = tmp_path / "huge.mcap"
    with path.open("wb") as stream:
        stream.truncate(10**13)  # sparse: more than any memory
    with pytest.raises(InputError, match="not a bag of bmd_rths"):
        read_bag(path)


def test_truncated_anywhere_a_bag_gives_its_beginning(bag: Path, record: RunRecord, tmp_path: Path) -> None:
    data = (bag / "run_0.mcap").read_bytes()
    rng = random.Random(2)
    story_end = data.index(b'{"bmd_rths": "0.1.0"}') + len(b'{"bmd_rths": "0.1.0"}')  # the last words of the record
    at_random = (rng.randrange(len(data)) for _ in range(200))
    offsets = sorted({0, 1, 8, story_end - 1, story_end, len(data) - 1, *at_random})
    cut = tmp_path / "cut.mcap"
    steps = cuts = 0
    for offset in offsets:
        cut.write_bytes(data[:offset])
        if offset < story_end:
            with pytest.raises(InputError, match="cut before its first record"):
                read_bag(cut)
            continue
        found = read_bag(cut)
        assert_prefix(found, record)
        assert found.steps >= steps, "a longer file cannot say less"
        steps = found.steps
        assert found.outcome in ("cut", "finished")
        if found.outcome == "cut":
            cuts += 1
            assert found.reason.endswith(f"the recording is cut or damaged after {steps} steps ({steps * 0.005:.3f} s)")
    assert cuts > 100
    assert steps == record.steps


def test_a_truncated_file_in_a_bag_has_its_story_in_metadata_yaml(bag: Path, record: RunRecord) -> None:
    (bag / "run_0.mcap").write_bytes(b"")
    found = read_bag(bag)
    assert found.steps == 0
    assert found.outcome == "cut"
    assert found.configuration == record.configuration


def test_a_damaged_byte_ends_the_reading_but_not_the_reader(bag: Path, record: RunRecord) -> None:
    data = bytearray((bag / "run_0.mcap").read_bytes())
    at = data.index(ScalarCodec("world").pack(100 * STEP_NS, record.command[100])) + 40
    data[at] ^= 1
    (bag / "run_0.mcap").write_bytes(data)
    found = read_bag(bag)
    assert_prefix(found, record)
    assert 80 <= found.steps <= 101  # the chunk with the damage may begin in the middle of step 100
    assert found.outcome == "cut"


def test_no_damage_makes_the_reader_fail(bag: Path, record: RunRecord, tmp_path: Path) -> None:
    data = (bag / "run_0.mcap").read_bytes()
    rng = random.Random(3)
    damaged = tmp_path / "damaged.mcap"
    refused = read = 0
    for _ in range(300):
        copy = bytearray(data)
        at = rng.randrange(1000 if rng.random() < 0.5 else len(data))
        copy[at : at + 4] = rng.randbytes(4)
        damaged.write_bytes(copy)
        try:
            found = read_bag(damaged)
        except InputError:
            refused += 1
        else:
            assert found.steps <= record.steps
            read += 1
    assert refused > 10
    assert read > 10


WRITE_UNTIL_KILLED = """
import itertools, sys
from pathlib import Path
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.bag_description import start_metadata
from bmd_rths_msgs_py.topics import SCALAR_TOPICS

metadata = start_metadata({"run": {"time_step": 0.005}}, {}, {})
writer = BagWriter(Path(sys.argv[1]), metadata=metadata)
codec = ScalarCodec("world")
for step in itertools.count():
    for topic in SCALAR_TOPICS:
        log_time_ns = 1_700_000_000_000_000_000 + step * 5_000_000
        writer.write(topic.full_name, topic.type_name, codec.pack(step * 5_000_000, float(step)), log_time_ns, 0)
    print(step, flush=True)
"""


def test_after_sigkill_at_most_the_flush_period_is_lost(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_UNTIL_KILLED, str(bag)], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        for _ in range(1993):
            line = process.stdout.readline()
        process.kill()
        written = [int(line), *(int(rest) for rest in process.stdout.read().split("\n")[:-1])][-1]
    assert written >= 1992
    found = read_bag(bag)
    assert found.outcome == "cut"
    assert "cut or damaged" in found.reason
    assert written - (found.steps - 1) <= 20  # 0.1 s
    assert found.command[: found.steps - 1].tolist() == list(range(found.steps - 1))


def test_a_whole_bag_without_an_end_is_cut(tmp_path: Path) -> None:
    with (tmp_path / "recovered.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.add_metadata("bmd_rths", start_metadata(CONFIGURATION, {}, {}))
        writer.finish()
    found = read_bag(tmp_path / "recovered.mcap")
    assert (found.outcome, found.reason) == ("cut", "the recording has no end; it holds 0 steps (0.000 s)")


@pytest.mark.parametrize("outcome", ["stopped", "limit", "failed"])
def test_how_a_run_ended_is_read(tmp_path: Path, outcome: str) -> None:
    found = read_bag(bag_of(tmp_path / "run", [command(0, 1.0)], end_metadata(outcome, "by hand", None)))
    assert (found.outcome, found.reason, found.timing) == (outcome, "by hand", None)


@pytest.mark.parametrize(
    ("end", "problem"),
    [
        ({"outcome": "well"}, "outcome 'well' is unknown"),
        ({"outcome": "finished", "timing": "{"}, "timing: not JSON"),
        ({"outcome": "finished", "timing": "{}"}, "timing: KeyError"),
        ({"outcome": "finished", "timing": "[]"}, "timing: .* is not a JSON object"),
    ],
)
def test_an_unreadable_end_is_refused(tmp_path: Path, end: dict[str, str], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        read_bag(bag_of(tmp_path / "run", [], end))


@pytest.mark.parametrize(
    ("configuration", "problem"),
    [
        ("", "configuration: not JSON"),
        ("[1]", "not a JSON object"),
        ("{}", "run.time_step is missing"),
        ('{"run": 3}', "run.time_step is missing"),
        ('{"run": {"time_step": "fast"}}', "run.time_step: 'fast' is not a number"),
        ('{"run": {"time_step": -1.0}}', "run.time_step: -1"),
    ],
)
def test_an_unreadable_story_is_refused(tmp_path: Path, configuration: str, problem: str) -> None:
    BagWriter(tmp_path / "run", metadata={"configuration": configuration}).close(FINISHED)
    with pytest.raises(InputError, match=problem) as caught:
        read_bag(tmp_path / "run")
    assert str(caught.value).startswith(f"{tmp_path / 'run'}: ")


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("not a bag\n" * 100)
    (tmp_path / "empty").mkdir()
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "metadata.yaml").write_text("a: [")
    with (tmp_path / "foreign" / "foreign_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.finish()
    problems = {
        "missing": "No such file",
        "missing/file.mcap": "No such file",
        "text.mcap": "not a bag of bmd_rths",
        "empty": "no .mcap file",
        "foreign": "not a bag of bmd_rths",
    }
    for name, problem in problems.items():
        with pytest.raises(InputError, match=problem) as caught:
            read_bag(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("yaml_text", ["a: [", "a: 1", "[]", "rosbag2_bagfile_information: {custom_data: null}"])
def test_a_foreign_metadata_yaml_does_no_harm(tmp_path: Path, yaml_text: str) -> None:
    (tmp_path / "metadata.yaml").write_text(yaml_text)
    (tmp_path / "bag_0.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="not a bag of bmd_rths"):
        read_bag(tmp_path)


def test_the_story_is_json_that_anyone_can_read(bag: Path, record: RunRecord) -> None:
    custom = custom_data(bag)
    assert json.loads(custom["configuration"]) == record.configuration
    assert json.loads(custom["motion"]) == record.motion
    assert json.loads(custom["timing"])["missed_steps"] == [5, 17]


def test_bag_is_whole_until_its_end_is_cut(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", [command(step, 0.5) for step in range(10)])
    assert bag_is_whole(bag)
    (file,) = bag.glob("*.mcap")
    os.truncate(file, file.stat().st_size - 1)
    assert not bag_is_whole(bag)
    os.truncate(file, 3)
    assert not bag_is_whole(bag)
    file.unlink()
    assert not bag_is_whole(bag)
    assert not bag_is_whole(tmp_path / "none")


def test_bag_without_an_end_is_not_whole(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag", metadata=start_metadata(CONFIGURATION, {}, {})).flush()
    assert not bag_is_whole(tmp_path / "bag")


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
