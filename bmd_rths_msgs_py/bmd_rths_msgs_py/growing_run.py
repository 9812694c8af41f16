"""A run as far as its messages have come: signals, what the nodes told, and when the steps were heard."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bmd_rths_core.analysis.limit_use import LimitWatch
from bmd_rths_core.analysis.live_signals import LiveSignals
from bmd_rths_core.analysis.moving_tracking import MovingTracking
from bmd_rths_core.analysis.thinning import thinned
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.record import TimingStatistics
from bmd_rths_core.renamed_parameters import convert_renamed
from bmd_rths_core.run_config import RunConfig
from bmd_rths_msgs_py.bag_description import motion_of, read_object, read_timing
from bmd_rths_msgs_py.bag_reader import step_of_stamp
from bmd_rths_msgs_py.cdr import MalformedMessage, MeasurementCodec, ScalarCodec, count_floors
from bmd_rths_msgs_py.node_status import NodeStatus, read_statuses
from bmd_rths_msgs_py.topics import DIAGNOSTICS, MEASUREMENT, SCALAR_TOPICS


@dataclass(frozen=True)
class Told:
    """A status, and where in the test it was heard.

    Parameters
    ----------
    step : int
        Number of steps that were complete then.
    heard : float
        When, on the wall clock of who heard it [s].
    status : NodeStatus
        The status.
    """

    step: int
    heard: float
    status: NodeStatus


class GrowingRun:
    """One run, message by message; nothing of it is guessed, and what is malformed is counted and left out.

    Parameters
    ----------
    story : Mapping of str to str
        What the run tells of itself at its start, see `bag_description.start_metadata`.

    Attributes
    ----------
    config : Config
        Its configuration.
    motion, versions : Mapping
        As in a `RunRecord`.
    signals : LiveSignals
        The signals by step.
    tracking : MovingTracking
        How the table followed.
    limits : LimitWatch
        How near the limits were.
    told : list of Told
        What the nodes told, in the order in which it was heard.
    malformed : int
        Messages that were left out.
    last_heard, last_signal : float
        When the last message, and the last one of a signal, was heard [s]; 0 before the first one.
    outcome, reason : str
        How the run ended; empty while that is not known.
    timing : TimingStatistics, optional
        What the end tells of the deadlines.

    Raises
    ------
    InputError
        The story is not one of a run.
    """

    def __init__(self, story: Mapping[str, str]) -> None:
        configuration, _ = convert_renamed(read_object(story, "configuration"), RunConfig.time_step)
        self.config: Config = config_from_mapping(configuration)
        self.motion: Mapping[str, Any] = motion_of(story)
        self.versions: Mapping[str, Any] = read_object(story, "versions")
        run = self.config.run
        self.signals = LiveSignals()
        self.tracking = MovingTracking(run.time_step)
        self.limits = LimitWatch(self.config.safety, run.time_step)
        self.told: list[Told] = []
        self.malformed = 0
        self.last_heard = self.last_signal = 0.0
        self.outcome = self.reason = ""
        self.timing: TimingStatistics | None = None
        self._stamps = run.stamps
        self._unpack_measurement: Callable[[bytes], Any] | None = None
        self._unpack_scalar = ScalarCodec().unpack
        self._scalars = {topic.name for topic in SCALAR_TOPICS}

    def take(self, topic: str, data: bytes, heard_ns: int) -> None:
        """Take a message.

        Parameters
        ----------
        topic : str
            Name of its topic, in any namespace.
        data : bytes
            The message as CDR with encapsulation.
        heard_ns : int
            When it was heard, on the wall clock [ns].
        """
        try:
            if topic == DIAGNOSTICS.full_name:
                self._take_statuses(data, heard_ns)
            else:
                self._take_signal(topic.rpartition("/")[2], data)
                self.last_signal = 1e-9 * heard_ns
        except MalformedMessage:
            self.malformed += 1
        self.last_heard = 1e-9 * heard_ns

    def _take_statuses(self, data: bytes, heard_ns: int) -> None:
        step = self.signals.complete
        self.told += [Told(step, 1e-9 * heard_ns, status) for status in read_statuses(data)]

    def _take_signal(self, name: str, data: bytes) -> None:
        if name in self._scalars:
            stamp_ns, value = self._unpack_scalar(data)
            step = step_of_stamp(stamp_ns, self._stamps)
            self.signals.put(name, step, value)
        elif name == MEASUREMENT.name:
            if self._unpack_measurement is None:
                self._unpack_measurement = MeasurementCodec(count_floors(data), self._stamps).unpack
            stamp_ns, measurement = self._unpack_measurement(data)
            step_of_stamp(stamp_ns, self._stamps)
            self.signals.put_measurement(measurement)

    def take_end(self, story: Mapping[str, str]) -> None:
        """Take how the run ended.

        Parameters
        ----------
        story : Mapping of str to str
            See `bag_description.end_metadata`.
        """
        self.outcome, self.reason = str(story.get("outcome", "")), str(story.get("reason", ""))
        self.timing = read_timing(story)

    @property
    def shown_steps(self) -> int:
        """Number of steps that can be shown: those that are complete, and in the end all."""
        return self.signals.steps if self.outcome else self.signals.complete

    def judge(self) -> None:
        """Bring tracking and limits up to the steps that can be shown."""
        steps, signals = self.shown_steps, self.signals.signals()
        self.tracking.advance(signals["desired_acceleration"][:steps], signals["table_acceleration"][:steps])
        self.limits.advance(signals, steps)

    def overview(self) -> tuple[list[float], list[float]]:
        """Return time [s] and ground acceleration [m/s²] of all steps so far, thinned; a gap is zero."""
        steps = self.shown_steps
        ground = np.nan_to_num(self.signals.columns["ground_acceleration"][:steps])
        time, values = thinned(self.config.run.time_step * np.arange(steps, dtype=np.float64), ground)
        return time.tolist(), values.tolist()
