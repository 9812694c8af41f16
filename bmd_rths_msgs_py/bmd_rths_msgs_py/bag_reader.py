"""Read a bag, whole or cut, into a `RunRecord`."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np
import yaml
from mcap.records import Channel, DataEnd, Message, Metadata

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import build_section
from bmd_rths_core.record import OUTCOMES, FloatArray, RunRecord
from bmd_rths_core.renamed_parameters import convert_renamed
from bmd_rths_core.rest_record import rest_record
from bmd_rths_core.run_config import RunConfig
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_completeness import (
    MAX_METADATA,
    READ_TOPICS,
    SIGNAL_TOPICS,
    namespace_of,
    promised_counts,
    promised_files,
    shortfall,
)
from bmd_rths_msgs_py.bag_description import END_RECORD, START_RECORD, motion_of, read_object, read_timing
from bmd_rths_msgs_py.cdr import MalformedMessage, MeasurementCodec, ScalarCodec, count_floors
from bmd_rths_msgs_py.mcap_records import open_regular, records_until_damage
from bmd_rths_msgs_py.topics import MEASUREMENT, SCALAR_TOPICS, WAY_TO_REST_COMMAND, WAY_TO_REST_MEASUREMENT, Topic

#: Stamps beyond this step (seven hours at 200 Hz) are those of another clock, not of a test.
MAX_STEPS = 5_000_000

#: Most bytes of messages of signals that are read; a test of seven hours at 200 Hz has fewer.
MAX_CONTENT = 6_000_000_000

#: What the writer of an MCAP file puts at its very end.
_MAGIC = b"\x89MCAP0\r\n"

_SIGNAL_NAMES = tuple(f"/{topic.name}" for topic in READ_TOPICS)

#: End of encapsulation and stamp of a message.
_STAMP_END = 12


def read_bag(path: Path | str) -> RunRecord:
    """Read the record of a run.

    A bag that was cut, because its writer was killed or because the file was damaged, is read up to its first
    incomplete record; the outcome is then ``"cut"``. Values whose message is missing are NaN, of two messages of one
    step the last one counts, and malformed messages are left out; ``reason`` says how many. A bag without any
    measurement has no floors.

    Parameters
    ----------
    path : Path or str
        Bag directory or MCAP file.

    Returns
    -------
    RunRecord
        The run.

    Raises
    ------
    InputError
        It cannot be read or is not a bag of this project.
    """
    path = Path(path)
    files = bag_files(path)
    try:
        contents = _Contents(files)
        if START_RECORD not in contents.metadata:
            contents.take_custom_data(path / "metadata.yaml")
        contents.take_promises(path / "metadata.yaml")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    try:
        return contents.record(str(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order in which they were written.

    Parameters
    ----------
    path : Path
        Bag directory or MCAP file.

    Raises
    ------
    InputError
        A directory has none.
    """
    if not path.is_dir():
        return [path]
    files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not files:
        raise InputError(f"{path}: no .mcap file in it; a bag directory or an MCAP file is required")
    return files


def bag_is_whole(path: Path) -> bool:
    """Tell whether the writer of a bag came to its end and nothing of it was cut off since, without reading it all.

    Parameters
    ----------
    path : Path
        Bag directory or MCAP file; it need not exist.
    """
    try:
        return all(_ends_with_magic(file) for file in bag_files(path))
    except (OSError, InputError):
        return False


def _ends_with_magic(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(-len(_MAGIC), os.SEEK_END)
        return file.read() == _MAGIC


class _Contents:
    """What the files of a bag hold, not yet put in order: another tool may have moved the metadata to the end."""

    def __init__(self, files: list[Path]) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.messages: dict[str, list[bytes]] = defaultdict(list)
        self.malformed: list[str] = []
        self.converted: list[str] = []
        self.whole = True
        self.promised: dict[str, int] = {}
        self.missing_files: list[str] = []
        self._topics: set[str] = set()
        self._bytes = 0
        self._firsts: list[tuple[Path, dict[str, bytes]]] = []
        for file in files:
            self._firsts.append((file, {}))
            with open_regular(file) as stream:
                self.whole &= self._read(file, stream)
        self.namespace = namespace_of(self._topics)

    def _read(self, file: Path, stream: IO[bytes]) -> bool:
        """Take one file; tell whether it is whole."""
        topics: dict[int, str] = {}
        for record in records_until_damage(stream):
            if isinstance(record, Message):
                self._take(topics.get(record.channel_id, ""), record.data)
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Metadata):
                self._take_metadata(file, record)
            elif isinstance(record, DataEnd):
                return True  # behind it is an index, which is not needed
        return False

    def _take(self, topic: str, data: bytes) -> None:
        if not topic:
            return
        self._topics.add(topic)
        if not topic.endswith(_SIGNAL_NAMES):
            return  # of cameras and the like: nobody asks for them here
        self._bytes += len(data)
        if self._bytes > MAX_CONTENT:
            raise InputError(f"more than {MAX_CONTENT // 10**9} GB of messages; no test is")
        # Of two runs in one folder the first step of a topic is there in two files.
        firsts = self._firsts[-1][1]
        if topic not in firsts:
            firsts[topic] = data[:_STAMP_END]
            for other, seen in self._firsts[:-1]:
                if seen.get(topic) == firsts[topic]:
                    name = self._firsts[-1][0].name
                    raise InputError(
                        f"two runs in one folder: {other.name!r} and {name!r} both begin at one step of {topic}"
                    )
        self.messages[topic].append(data)

    def _take_metadata(self, file: Path, record: Metadata) -> None:
        known = self.metadata.get(record.name)
        if record.name == START_RECORD and known not in (None, record.metadata):
            raise InputError(f"two runs in one folder: {file.name!r} is of another one than the files before it")
        self.metadata[record.name] = record.metadata
        if record.name == "rosbag2":
            self._promise(record.metadata.get("serialized_metadata", ""))

    def _promise(self, text: str) -> None:
        for topic, count in promised_counts(text).items():
            self.promised[topic] = max(count, self.promised.get(topic, 0))

    def take_promises(self, file: Path) -> None:
        """Take what ``metadata.yaml`` says is in the bag."""
        text = _read_metadata(file)
        self._promise(text)
        self.missing_files = [name for name in promised_files(text) if not (file.parent / Path(name).name).exists()]

    def take_custom_data(self, file: Path) -> None:
        """Take the story of the run from ``metadata.yaml``: tools that rewrite a bag drop the records of the MCAP."""
        if story := custom_data(file):
            self.metadata[START_RECORD] = story
            if "outcome" in story:
                self.metadata[END_RECORD] = story

    def record(self, source: str) -> RunRecord:
        if START_RECORD not in self.metadata:
            raise InputError(f"not a bag of bmd_rths, or cut before its first record; no record {START_RECORD!r} in it")
        story = self.metadata[START_RECORD]
        configuration = read_object(story, "configuration")
        run = configuration.get("run")
        if not isinstance(run, dict) or "time_step" not in run:
            raise InputError("configuration: run.time_step is missing")
        configuration, self.converted = convert_renamed(configuration, RunConfig.time_step)
        timing = build_section(RunConfig, {"time_step": run["time_step"]})
        stamps: StepStamps = timing.stamps
        scalars = {topic.name: self._scalars(topic, stamps) for topic in SCALAR_TOPICS}
        measurements, floors = self._measurements(MEASUREMENT, stamps)
        steps = 1 + max(chain(measurements, *scalars.values()), default=-1)
        signals = {name: _column(found, steps) for name, found in scalars.items()}
        for name in TableMeasurement._fields[1:-1]:
            signals[name] = _column({step: getattr(found, name) for step, found in measurements.items()}, steps)
        floor_accelerations = np.full((steps, floors), np.nan)
        for step, found in measurements.items():
            floor_accelerations[step] = found.floor_accelerations
        heard = sum(len(self.messages[self._name(topic)]) for topic in SIGNAL_TOPICS)
        if heard and len(self.malformed) == heard:
            raise InputError(f"none of its {heard} messages can be read, the first of {self.malformed[0]}")
        rest_measurements, rest_floors = self._measurements(WAY_TO_REST_MEASUREMENT, stamps, floors)
        rest_commands = self._scalars(WAY_TO_REST_COMMAND, stamps)
        end = self.metadata.get(END_RECORD, {})
        outcome, reason = self._ending(end, f"{steps} steps ({steps * timing.time_step:.3f} s)")
        return RunRecord(
            time_step=float(run["time_step"]),
            **signals,
            floor_accelerations=floor_accelerations,
            configuration=configuration,
            motion=motion_of(story),
            versions=read_object(story, "versions"),
            outcome=outcome,
            reason=reason,
            timing=read_timing(end),
            told_controller=end.get("controller"),
            source=source,
            way_to_rest=rest_record(rest_commands, rest_measurements, floors or rest_floors),
            namespace=self.namespace,
        )

    def _name(self, topic: Topic) -> str:
        """Return the name a topic was recorded under."""
        return f"{self.namespace}/{topic.name}"

    def _scalars(self, topic: Topic, stamps: StepStamps) -> dict[int, float]:
        unpack = ScalarCodec().unpack
        found = {}
        for data in self.messages[self._name(topic)]:
            try:
                stamp_ns, value = unpack(data)
                found[step_of_stamp(stamp_ns, stamps)] = value
            except MalformedMessage as problem:
                self.malformed.append(f"{self._name(topic)}: {problem}")
        return found

    def _measurements(
        self, topic: Topic, stamps: StepStamps, known_floors: int = 0
    ) -> tuple[dict[int, TableMeasurement], int]:
        """Return measurements by step and the number of floors, as known or as the first well-formed one has it."""
        found: dict[int, TableMeasurement] = {}
        floors = 0
        for data in self.messages[self._name(topic)]:
            try:
                if not found:
                    floors = known_floors or count_floors(data)
                    unpack = MeasurementCodec(floors, stamps).unpack
                stamp_ns, measurement = unpack(data)
                found[step_of_stamp(stamp_ns, stamps)] = measurement
            except MalformedMessage as problem:
                self.malformed.append(f"{self._name(topic)}: {problem}")
        return found, floors if found else 0

    def _ending(self, end: Mapping[str, str], extent: str) -> tuple[str, str]:
        """Return outcome and reason."""
        reasons = [str(end["reason"])] if end.get("reason") else []
        outcome = end.get("outcome", "cut")
        if outcome not in OUTCOMES:
            raise InputError(f"outcome {outcome!r} is unknown; one of {', '.join(OUTCOMES)} is required")
        missing = shortfall(self.promised, {name: len(found) for name, found in self.messages.items()})
        if missing and self.missing_files:
            missing += f", and so is the file {self.missing_files[0]!r}"
        if missing:
            outcome = "cut"
            reasons.append(f"the recording is incomplete: {missing}; it holds {extent}")
        if not self.whole:
            outcome = "cut"
            reasons.append(f"the recording is cut or damaged after {extent}")
        elif not end:
            reasons.append(f"the recording has no end; it holds {extent}")
        if self.malformed:
            reasons.append(f"{len(self.malformed)} malformed messages were left out, the first of {self.malformed[0]}")
        if self.converted:
            reasons.append("the configuration is of an older version: " + ", ".join(self.converted))
        return outcome, "; ".join(reasons)


def _read_metadata(file: Path) -> str:
    """Return the text of ``metadata.yaml``, "" without a readable one."""
    try:
        with open_regular(file) as stream:
            return stream.read(MAX_METADATA).decode("utf-8")
    except (OSError, UnicodeDecodeError, InputError):
        return ""


def custom_data(file: Path) -> dict[str, str]:
    """Return the story of a run from a ``metadata.yaml``; empty when it has none."""
    try:
        story = yaml.safe_load(_read_metadata(file))["rosbag2_bagfile_information"]["custom_data"]
    except (yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return {}
    return story if isinstance(story, dict) and "configuration" in story else {}


def step_of_stamp(stamp_ns: int, stamps: StepStamps) -> int:
    """Return the step of a stamp; one that is of no step, or of another clock, is malformed."""
    step = stamps.step(stamp_ns)
    if step is None or step >= MAX_STEPS:
        raise MalformedMessage(f"stamp {stamp_ns} ns is not that of a step")
    return step


def _column(found: Mapping[int, float], steps: int) -> FloatArray:
    column = np.full(steps, np.nan)
    column[list(found)] = list(found.values())
    return column
