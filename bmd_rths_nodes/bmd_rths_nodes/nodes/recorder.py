"""Recorder: every topic of a run into an MCAP bag."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_core.record import TimingStatistics, provenance
from bmd_rths_core.safety.way_to_rest import longest_way_to_rest
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import MalformedMessage, read_stamp
from bmd_rths_msgs_py.node_status import is_of_others
from bmd_rths_msgs_py.topics import (
    DESIRED_ACCELERATION,
    DIAGNOSTICS,
    GROUND_ACCELERATION,
    NUMERICAL_SUBSTRUCTURE,
    RECORDER,
    REQUIRED_FORCE,
    TABLE_DRIVER,
    TOPICS,
    WAY_TO_REST_TOPICS,
    Topic,
)
from bmd_rths_nodes.ros import qos, status
from bmd_rths_nodes.ros.agreement import with_motion
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.step_order import StepOrder
from bmd_rths_nodes.ros.versions import ros_versions
from bmd_rths_nodes.run.bag_names import new_bag_directory

#: The bag is closed when the test has ended, the table is at rest and nothing more has come for this long [s] ...
QUIET_PERIOD = 0.2

#: ... and for so many looks: a process that got no turn for that time has messages to read.
QUIET_LOOKS = 4

#: Topics of the numerical substructure: it publishes them at every step that it begins.
SENT_AT_EVERY_STEP = (GROUND_ACCELERATION, DESIRED_ACCELERATION, REQUIRED_FORCE)

#: In lockstep the recorder tells how far it is after so many steps, and the numerical substructure waits for it.
TELL_STEPS = 100

#: A test that is under way but silent for this long has lost its numerical substructure [s]; longer than a step of
#: lockstep may take. A table that moves is waited for in addition to that.
TEST_LOST_AFTER = 6.0

#: Longest wait for the end of a test that is under way when the process is asked to end [s], besides the way of the
#: table to rest.
LONGEST_FAREWELL = 2.0

#: What a bag says of a test whose table was still moving when it was last heard of.
NOT_TOLD = "it did not tell that the table is at rest"

#: Added to the niceness of the recorder's process.
NICENESS = 5


class End(NamedTuple):
    """How a test ended, as the numerical substructure told it."""

    outcome: Outcome
    reason: str
    step: int
    timing: TimingStatistics | None

    @classmethod
    def told_by(cls, status: NodeStatus) -> End | None:
        """Return what a status says of the end; None when it says nothing that can be understood."""
        outcome, step = status.values.get("outcome", ""), status.values.get("step", "")
        if outcome not in set(Outcome):
            return None
        begun = int(step) if step.isdecimal() else 0
        return cls(Outcome(outcome), status.message, begun, _timing(status.values))


class RecorderNode(StageNode):
    """Node around `bmd_rths_msgs_py.bag_writer.BagWriter`.

    The bag is opened, with the whole story of the test, when the node is activated, and closed when the numerical
    substructure has told how the test ended, and the table driver that the table is at rest. The next test that the
    numerical substructure offers then gets the next bag.
    """

    ROLE = RECORDER

    def configure_stage(self, config: Config) -> None:
        """Subscribe to every topic."""
        self._motion = select_ground_motion(config.ground_motion, config.run.time_step)
        self._time_to_rest = longest_way_to_rest(config.safety, config.run.time_step) + config.table.halt_time
        self._writer: BagWriter | None = None
        self._bag = ""
        self._forget_the_last_test()
        for topic in TOPICS.values():
            after = topic in WAY_TO_REST_TOPICS
            recorder = self._recorder_of_the_way_to_rest(topic) if after else self._recorder_of(topic)
            on_message = self._record_diagnostics if topic is DIAGNOSTICS else recorder
            self.subscribe_raw(topic, on_message, qos.RECORDER)

    def reset_stage(self) -> None:
        """Open a new bag."""
        start = provenance(self.config.as_mapping(), self._motion)
        start["versions"] |= ros_versions()
        directory = new_bag_directory(Path(self.config.recorder.directory), self._motion.name, self.config.run.scheme)
        self._writer = BagWriter(
            directory,
            metadata=start_metadata(**start),
            flush_period=self.config.recorder.flush_period,
        )
        self._bag = str(directory)
        self._flush_due = 0.0
        self._last_message = time.perf_counter()
        self._quiet_looks = 0
        self._messages = 0
        self._forget_the_last_test()

    def _forget_the_last_test(self) -> None:
        """Know nothing of a test: statuses of other nodes come before the first activation too."""
        uncounted = (*WAY_TO_REST_TOPICS, DIAGNOSTICS)
        self._next_step = {topic.name: 0 for topic in TOPICS.values() if topic not in uncounted}
        self._steps_told_of = 0
        self._end: End | None = None
        self._table_moves = False
        self._trip = self._stop_problem = ""
        self._controller: str | None = None

    def shared_parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the parameters and, because the name of a file says little, what the ground motion is."""
        return with_motion(super().shared_parameters(), self._motion)

    @property
    def in_real_time(self) -> bool:
        """False: the recorder has time, and is to take none from the loop."""
        return False

    def stop_stage(self) -> None:
        """Close the bag, whatever has come so far."""
        if not self.configured or self._writer is None:
            return
        if self._end is not None:
            self._close_as_told(self._end)
        elif self.ending is None and self.order.steps > 0:
            self._close("failed", "the recorder was deactivated before the test ended", None)
        else:
            self._close("stopped", "the recorder was stopped before the test ended", None)

    @property
    def ready_words(self) -> str:
        """Say where the test is recorded."""
        return f"ready; the test begins when every node is, and is recorded in {self._bag}"

    def wants_more_time(self, waited: float, hurried: bool) -> bool:
        """Wait for the end of a test that is under way, and for the way of the table to rest."""
        if self.state != NodeState.READY or self.order.steps == 0 or self._writer is None:
            return False
        return waited < LONGEST_FAREWELL + (self._time_to_rest if self._table_moves and not hurried else 0.0)

    def status_values(self) -> dict[str, str]:
        """Tell the bag, how many messages are in it, and how many steps are complete."""
        if not self._bag_was_opened():
            return {}
        return {"bag": self._bag, "messages": str(self._messages), "recorded_steps": str(self._recorded_steps())}

    def poll(self, now: float) -> float:
        """Flush the bag, and close it when the test has ended."""
        if self._bag_was_opened() and self._writer is not None:
            if now >= self._flush_due:
                self._guarded(self._writer.flush)
                self._flush_due = now + self.config.recorder.flush_period
            silence = now - self._last_message
            self._quiet_looks += 1
            if self._end is not None and self._is_quiet(silence, self._end):
                self._close_as_told(self._end)
            elif self._end is None and self.order.steps > 0 and silence > self._longest_silence():
                self._close("failed", f"no message for {TEST_LOST_AFTER:g} s: the numerical substructure is gone", None)
            return self._flush_due
        return math.inf

    def _is_quiet(self, silence: float, end: End) -> bool:
        """Tell whether nothing more is to be expected."""
        longest = self._longest_silence() if self._table_moves or self._lacks_steps(end) else QUIET_PERIOD
        return silence > longest and self._quiet_looks > QUIET_LOOKS

    def _longest_silence(self) -> float:
        return TEST_LOST_AFTER + (self._time_to_rest if self._table_moves else 0.0)

    def _lacks_steps(self, end: End) -> bool:
        """Tell whether messages of an ended test may still come: what got lost is sent again after 3 s only."""
        if end.outcome is Outcome.FAILED:
            return False  # where a node is gone nothing more comes
        # The last step of a test that did not finish may not have come round.
        least = end.step if end.outcome is Outcome.FINISHED else end.step - 1
        sent = min(self._next_step[topic.name] for topic in SENT_AT_EVERY_STEP)
        return sent < end.step or self._recorded_steps() < least

    def _recorded_steps(self) -> int:
        return min(self._next_step.values())

    def _tell_lockstep(self) -> None:
        """Tell how far the recording is, so that the loop does not run away from it."""
        if self._recorded_steps() >= self._steps_told_of + TELL_STEPS:
            self._steps_told_of = self._recorded_steps()
            self.publish_status()

    def _bag_was_opened(self) -> bool:
        return self.configured and bool(self._bag)

    def _recorder_of(self, topic: Topic) -> Callable[[bytes], None]:
        """Return the function that records the messages of a topic and counts those that did not come."""
        name, stamps = topic.name, self.config.run.stamps
        full_name = topic.full_name_in(self.get_namespace())
        lockstep = self.config.run.lockstep

        def on_message(data: bytes) -> None:
            if self._writer is None:
                return
            self._record(full_name, topic, data)
            self._note_message()
            try:
                step = stamps.step_under_way(read_stamp(data))
            except MalformedMessage:
                self.order.malformed += 1
                return
            self.order.lost += max(0, step - self._next_step[name])
            self._next_step[name] = step + 1
            if lockstep:
                self._tell_lockstep()

        return on_message

    def _recorder_of_the_way_to_rest(self, topic: Topic) -> Callable[[bytes], None]:
        """Return the function that records what follows a test; what precedes its steps is of an earlier one."""
        full_name = topic.full_name_in(self.get_namespace())

        def on_message(data: bytes) -> None:
            if self._writer is not None and self.order.steps > 0:
                self._record(full_name, topic, data)
                self._note_message()

        return on_message

    def _note_message(self) -> None:
        self._last_message = time.perf_counter()
        self._quiet_looks = 0
        self.order.steps += 1

    def _record_diagnostics(self, data: bytes) -> None:
        if not is_of_others(data, self.get_namespace()):
            self._record(DIAGNOSTICS.name, DIAGNOSTICS, data)

    @property
    def free(self) -> bool:
        """True before the first step of a test, and when its bag is closed: one bag holds one test."""
        before = super().free and self.order.steps == 0 and self._end is None
        return before or self.state is NodeState.ENDED

    def on_new_test(self) -> None:
        """Open the next bag, where the last one is closed."""
        super().on_new_test()
        if self.state is not NodeState.ENDED:
            return
        self.order = StepOrder(self.config.run.stamps)
        try:
            self.reset_stage()
        except InputError as error:
            self.set_state(NodeState.TRIPPED, str(error), status.ERROR)
        else:
            self.set_state(NodeState.WAITING)

    def on_peer(self, peer: NodeStatus) -> None:
        """Take note of the end of the test, and of the table."""
        if peer.role == NUMERICAL_SUBSTRUCTURE and peer.state is NodeState.ENDED:
            self._end = End.told_by(peer) or self._end
        elif peer.role == TABLE_DRIVER:
            self._table_moves = peer.values.get("table") == "moving"
            self._stop_problem = peer.values.get("stop_problem", "")
            self._controller = peer.values.get("controller", self._controller or "")
            self._trip = peer.message if peer.state is NodeState.TRIPPED else self._trip

    def on_missed_beginning(self) -> None:
        """Record nothing: a test is recorded from its beginning or not at all."""
        self.on_disturbance("refused: a test is under way, and this recorder was not there when it began")

    def on_disturbance(self, problem: str) -> None:
        """Record no more: the test has a recorder."""
        self._close("failed", problem, None)
        super().on_disturbance(problem)

    def _record(self, name: str, topic: Topic, data: bytes) -> None:
        now = time.time_ns()
        writer = self._writer
        if writer is not None and self._guarded(lambda: writer.write(name, topic.type_name, data, now, now)):
            self._messages += 1

    def _guarded(self, action: Callable[[], None]) -> bool:
        """Do something with the disk; when it fails, the test must not go on unrecorded."""
        try:
            action()
        except OSError as error:
            self._writer = None
            self.set_state(NodeState.TRIPPED, f"{self._bag}: cannot be written: {error.strerror}", status.ERROR)
            return False
        return True

    def _close_as_told(self, end: End) -> None:
        # What the table driver did after the end, an emergency stop on the way to rest, belongs to how it ended.
        unconfirmed = NOT_TOLD if self._table_moves else self._stop_problem
        outcome, reason = end.outcome, end.reason
        for problem in (self._trip, unconfirmed):
            if problem not in reason:
                reason += f"; {TABLE_DRIVER}: {problem}"
        if unconfirmed and outcome is Outcome.FINISHED:
            outcome = Outcome.FAILED
        self._close(str(outcome), reason, end.timing)

    def _close(self, outcome: str, reason: str, timing: TimingStatistics | None) -> None:
        writer = self._writer
        end = end_metadata(outcome, reason, timing, self._controller)
        if writer is not None and self._guarded(lambda: writer.close(end)):
            self.get_logger().info(f"{self._messages} messages in {self._bag}; {outcome}: {reason}")
            self.set_state(NodeState.ENDED, self._bag)
        self._writer = None


def _timing(values: Mapping[str, str]) -> TimingStatistics | None:
    """Return what a node told of its deadlines; None when it told nothing, or what cannot be understood."""
    try:
        return TimingStatistics(
            missed_deadlines=int(values["missed_deadlines"]),
            max_consecutive_misses=int(values["max_consecutive_misses"]),
            missed_steps=tuple(int(step) for step in json.loads(values["missed_steps"])),
            late_ticks=int(values["late_ticks"]),
            closure_ms={name: float(values[f"closure_ms_{name}"]) for name in ("p50", "p99", "max")},
            closure_counts=tuple(int(count) for count in json.loads(values.get("closure_counts", "[]"))),
            slow_integrations=int(values.get("slow_integrations", "0")),
        )
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def main() -> int:
    """Run the node, behind the loop: it has a history to fall back on, the loop has a deadline."""
    os.nice(NICENESS)
    return run_nodes([RecorderNode])


if __name__ == "__main__":
    sys.exit(main())
