"""When the messages of a bag came, which `read_bag` has no use for."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from mcap.records import Channel, Message
from numpy.typing import NDArray

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.record import RunRecord
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.bag_reader import bag_files
from bmd_rths_msgs_py.cdr import MalformedMessage, read_stamp
from bmd_rths_msgs_py.mcap_records import open_regular, records_until_damage
from bmd_rths_msgs_py.node_status import read_statuses
from bmd_rths_msgs_py.topics import (
    COMMAND,
    CORRECTED_FORCE,
    DESIRED_ACCELERATION,
    DIAGNOSTICS,
    INTERFACE_FORCE,
    MEASUREMENT,
)

#: The messages of a step, in the order in which one follows from the other.
CHAIN = (DESIRED_ACCELERATION, COMMAND, MEASUREMENT, INTERFACE_FORCE, CORRECTED_FORCE)


def read_timing_of_steps(record: RunRecord) -> StepTiming | str:
    """Return when the steps of a bag began and closed on the wall clock.

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
    sent, composed = _sent(Path(record.source), record.time_step)
    begun, closed = sent[DESIRED_ACCELERATION.name], sent[CORRECTED_FORCE.name]
    steps = sorted(begun.keys() & closed.keys())
    if not steps:
        return "no step reached the recorder from its beginning to its end"
    first = begun[steps[0]]
    chain = [topic.name for topic in CHAIN]
    hops = {} if composed else {name: _between(sent[before], sent[name]) for before, name in pairwise(chain)}
    return StepTiming(
        np.array(steps, dtype=np.float64),
        1e-9 * np.array([begun[step] - first for step in steps], dtype=np.float64),
        1e-9 * np.array([closed[step] - first for step in steps], dtype=np.float64),
        record.time_step,
        record.timing.missed_steps if record.timing is not None else (),
        hops,
    )


def _between(before: dict[int, int], after: dict[int, int]) -> NDArray[np.float64]:
    """Return the time from one message of a step to another [ms], of the steps that have both."""
    return 1e-6 * np.array([after[step] - before[step] for step in sorted(before.keys() & after.keys())], dtype=float)


def _sent(path: Path, time_step: float) -> tuple[dict[str, dict[int, int]], bool]:
    """Return when the messages of each step came first [ns], and whether the nodes of the loop were composed."""
    sent: dict[str, dict[int, int]] = {topic.name: {} for topic in CHAIN}
    processes: dict[str, str] = {}
    stamps = StepStamps(time_step)
    for file in bag_files(path):
        topics: dict[int, str] = {}
        with open_regular(file) as stream:
            for entry in records_until_damage(stream):
                if isinstance(entry, Channel):
                    topics[entry.id] = entry.topic.rpartition("/")[2]
                elif isinstance(entry, Message):
                    name = topics.get(entry.channel_id, "")
                    try:
                        if name in sent:
                            sent[name].setdefault(stamps.step_under_way(read_stamp(entry.data)), entry.publish_time)
                        elif name == DIAGNOSTICS.full_name.rpartition("/")[2]:
                            processes |= {s.role: s.values.get("instance", s.role) for s in read_statuses(entry.data)}
                    except MalformedMessage:
                        continue  # `read_bag` counts it
    loop = {processes.get(role, role) for role in (topic.producer for topic in CHAIN)}
    return sent, len(loop) == 1
