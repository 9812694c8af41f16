"""Bags of messages as a test needs them, and what their readers are held to."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer

from bmd_rths_core.record import RunRecord
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.topics import COMMAND

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
