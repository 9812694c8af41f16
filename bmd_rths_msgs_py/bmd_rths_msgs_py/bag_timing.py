"""When the messages of a bag were heard: the log times, which `read_bag` has no use for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.records import Channel, Message

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.record import RunRecord
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_reader import bag_files
from bmd_rths_msgs_py.cdr import MalformedMessage, read_stamp
from bmd_rths_msgs_py.mcap_records import open_regular, records_until_damage
from bmd_rths_msgs_py.topics import CORRECTED_FORCE, DESIRED_ACCELERATION


def read_timing_of_steps(record: RunRecord) -> StepTiming | str:
    """Return when the steps of a bag began and closed on the wall clock of the recorder.

    Parameters
    ----------
    record : RunRecord
        As `read_bag` has it.

    Returns
    -------
    StepTiming or str
        Or why there is none: the test did not follow the clock.
    """
    if record.configuration.get("run", {}).get("lockstep"):
        return "the test ran in lockstep, without deadlines"
    if "rclpy" not in record.versions:
        return "the test was simulated in process, without a clock"
    begun, closed = _log_times(Path(record.source), record.time_step)
    steps = sorted(begun.keys() & closed.keys())
    if not steps:
        return "no step reached the recorder from its beginning to its end"
    first = begun[steps[0]]
    return StepTiming(
        np.array(steps, dtype=np.float64),
        1e-9 * np.array([begun[step] - first for step in steps], dtype=np.float64),
        1e-9 * np.array([closed[step] - first for step in steps], dtype=np.float64),
        record.time_step,
        record.timing.missed_steps if record.timing is not None else (),
    )


def _log_times(path: Path, time_step: float) -> tuple[dict[int, int], dict[int, int]]:
    """Return when the desired acceleration and the corrected shear of each step were heard first [ns]."""
    heard: dict[str, dict[int, int]] = {DESIRED_ACCELERATION.name: {}, CORRECTED_FORCE.name: {}}
    stamps = StepStamps(time_step)
    for file in bag_files(path):
        topics: dict[int, str] = {}
        with open_regular(file) as stream:
            for entry in records_until_damage(stream):
                if isinstance(entry, Channel):
                    topics[entry.id] = entry.topic.rpartition("/")[2]
                elif isinstance(entry, Message) and (times := heard.get(topics.get(entry.channel_id, ""))) is not None:
                    try:
                        times.setdefault(stamps.step_under_way(read_stamp(entry.data)), entry.log_time)
                    except MalformedMessage:
                        continue  # `read_bag` counts it
    return heard[DESIRED_ACCELERATION.name], heard[CORRECTED_FORCE.name]
