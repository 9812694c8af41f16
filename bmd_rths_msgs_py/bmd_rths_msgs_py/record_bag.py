"""Write the record of a run in process as a bag."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import build_section
from bmd_rths_core.record import RunRecord
from bmd_rths_core.rest_record import RestRecord
from bmd_rths_core.run_config import RunConfig
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MeasurementCodec, PairCodec, ScalarCodec
from bmd_rths_msgs_py.topics import (
    DESIRED_ACCELERATION,
    MEASUREMENT,
    NAMESPACE,
    SCALAR_TOPICS,
    WAY_TO_REST_COMMAND,
    WAY_TO_REST_MEASUREMENT,
    Topic,
)


def write_record(record: RunRecord, directory: Path) -> Path:
    """Write a record as a bag with the topics of a real run; `read_bag` returns the same signals bit for bit.

    Test time takes the place of the wall clock: the log time of a message is its stamp.

    Parameters
    ----------
    record : RunRecord
        The run, with at least one floor.
    directory : Path
        The bag directory, which must be new or empty.

    Returns
    -------
    Path
        The directory.

    Raises
    ------
    InputError
        The directory cannot be written, or the configuration of the record contradicts its time step.
    """
    configured = record.configuration.get("run", {}).get("time_step")
    if configured != record.time_step:
        raise InputError(f"run.time_step: {configured!r} in the configuration of a record of {record.time_step!r} s")
    stamps = build_section(RunConfig, {"time_step": record.time_step}).stamps
    measurement_codec = MeasurementCodec(record.floor_accelerations.shape[1], stamps, MEASUREMENT.frame_id)
    namespace = record.namespace or NAMESPACE
    scalars = [(topic, topic.full_name_in(namespace), *_packed(record, topic)) for topic in SCALAR_TOPICS]
    writer = BagWriter(directory, metadata=start_metadata(record.configuration, record.motion, record.versions))
    for step in range(record.steps):
        stamp_ns = stamps.of(step)
        for topic, name, pack, values in scalars:
            writer.write(name, topic.type_name, pack(stamp_ns, values[step]), stamp_ns, stamp_ns)
        data = measurement_codec.pack(stamp_ns, _measured(record, step, step))
        writer.write(MEASUREMENT.full_name_in(namespace), MEASUREMENT.type_name, data, stamp_ns, stamp_ns)
    if record.way_to_rest is not None:
        _write_way_to_rest(record.way_to_rest, writer, measurement_codec, stamps, namespace)
    writer.close(end_metadata(record.outcome, record.reason, record.timing, record.told_controller))
    return directory


def _write_way_to_rest(
    rest: RestRecord, writer: BagWriter, measurement_codec: MeasurementCodec, stamps: StepStamps, namespace: str
) -> None:
    pack = ScalarCodec(WAY_TO_REST_COMMAND.frame_id).pack
    for row, command in enumerate(rest.command.tolist()):
        step = rest.first_step + row
        stamp_ns = stamps.of(step)
        measurement = _measured(rest, row, step)
        messages = []
        if math.isfinite(command):
            messages.append((WAY_TO_REST_COMMAND, pack(stamp_ns, command)))
        if np.isfinite([*measurement[1:6], *measurement.floor_accelerations]).any():
            messages.append((WAY_TO_REST_MEASUREMENT, measurement_codec.pack(stamp_ns, measurement)))
        for topic, data in messages:
            writer.write(topic.full_name_in(namespace), topic.type_name, data, stamp_ns, stamp_ns)


def _measured(signals: RunRecord | RestRecord, row: int, step: int) -> TableMeasurement:
    return TableMeasurement(step, *(getattr(signals, name)[row] for name in TableMeasurement._fields[1:]))


def _packed(record: RunRecord, topic: Topic) -> tuple[Callable[[int, Any], bytes], list[Any]]:
    """Return how the messages of a topic are packed, and the values of all steps."""
    values: list[Any] = getattr(record, topic.name).tolist()
    scheme = compensators().get(record.configuration.get("run", {}).get("scheme", ""))
    if topic is DESIRED_ACCELERATION and scheme is not None and scheme.control is not None:
        return PairCodec(topic.frame_id).pack, list(zip(values, record.command.tolist(), strict=True))
    return ScalarCodec(topic.frame_id).pack, values
