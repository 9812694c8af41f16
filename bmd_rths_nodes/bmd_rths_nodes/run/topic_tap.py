"""Follow a test by its topics, where no recorder writes a bag on this computer: into a bag for the page alone."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import provenance
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MalformedMessage, read_stamp
from bmd_rths_msgs_py.node_status import is_of_others
from bmd_rths_msgs_py.topics import DESIRED_ACCELERATION, DIAGNOSTICS, NUMERICAL_SUBSTRUCTURE, TOPICS, Topic
from bmd_rths_nodes.ros.versions import ros_versions
from bmd_rths_nodes.run.monitor import RunMonitor

#: The bag of a test that has ended is closed when no signal has come for this long [s].
QUIET_PERIOD = 1.0

#: Longest time that messages wait in memory [s].
FLUSH_PERIOD = 0.05


class TopicTap:
    """Listen to every topic, best effort, and write what comes; a test neither waits for it nor sends again for it.

    Parameters
    ----------
    monitor : RunMonitor
        Listens.
    config : Config
        Configuration of the test: its time step and limits.
    folder : Path
        Where the bags go; one for every test.

    Attributes
    ----------
    bag : Path
        The newest bag.

    Raises
    ------
    InputError
        The ground motion of the configuration cannot be read, or the folder cannot be written.
    """

    def __init__(self, monitor: RunMonitor, config: Config, folder: Path) -> None:
        self._monitor = monitor
        self._folder = folder
        self._stamps = config.run.stamps
        story = provenance(config.as_mapping(), select_ground_motion(config.ground_motion, config.run.time_step))
        story["versions"] |= ros_versions()
        self._story = start_metadata(**story)
        self._tests = 0
        self._writer: BagWriter | None = None
        self._begin()
        for topic in TOPICS.values():
            monitor.listen(topic, partial(self._take, topic))

    def _begin(self) -> None:
        self.close()
        self._tests += 1
        self.bag = self._folder / f"heard_{self._tests}"
        self._writer = BagWriter(self.bag, metadata=self._story, flush_period=FLUSH_PERIOD)
        self._last_step = -1
        self._last_signal = time.perf_counter()

    def _take(self, topic: Topic, data: bytes) -> None:
        if topic is DIAGNOSTICS:
            if is_of_others(data, self._monitor.namespace):
                return
        else:
            try:
                step = self._stamps.step_under_way(read_stamp(data))
            except MalformedMessage:
                return
            if topic is DESIRED_ACCELERATION:
                if step < self._last_step:  # a new test
                    self._begin()
                self._last_step = step
            self._last_signal = time.perf_counter()
        if self._writer is not None:
            now = time.time_ns()
            name = topic.full_name_in(self._monitor.namespace)
            self._writer.write(name, topic.type_name, data, now, now)

    def poll(self) -> None:
        """Write what waits, and close the bag of a test that has ended."""
        if self._writer is None:
            return
        self._writer.flush()
        told = self._monitor.status.get(NUMERICAL_SUBSTRUCTURE)
        ended = self._last_step >= 0 and told is not None and told.state is NodeState.ENDED
        if ended and time.perf_counter() > self._last_signal + QUIET_PERIOD:
            self.close()

    def close(self) -> None:
        """Close the bag, with what is known of the end."""
        writer, self._writer = self._writer, None
        if writer is not None:
            told = self._monitor.status.get(NUMERICAL_SUBSTRUCTURE)
            outcome = "" if told is None else told.values.get("outcome", "")
            reason = "" if told is None else told.message
            writer.close(end_metadata(outcome or "cut", reason if outcome else "nobody listens any more", None))
