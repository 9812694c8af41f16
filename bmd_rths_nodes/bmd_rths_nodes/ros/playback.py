"""Play a recorded run to the nodes on this ROS domain, and collect what they answer."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from bmd_rths_core.analysis.replay import measured_steps, measurement_at
from bmd_rths_core.config import Config
from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.cdr import MalformedMessage, ScalarCodec
from bmd_rths_msgs_py.topics import (
    COMMAND,
    CORRECTED_FORCE,
    DESIRED_ACCELERATION,
    GROUND_ACCELERATION,
    INTERFACE_FORCE,
    MEASUREMENT,
    NUMERICAL_SUBSTRUCTURE,
    REQUIRED_FORCE,
)
from bmd_rths_nodes.ros import qos
from bmd_rths_nodes.ros.messages import codec_of, message_class, owns_the_interface
from bmd_rths_nodes.ros.spin import LONGEST_WAIT, WAKE_UP_MARGIN
from bmd_rths_nodes.run.domain_lock import another_run
from bmd_rths_nodes.run.monitor import DISCOVERY_TIME, RunMonitor

PLAYED_TOPICS = (GROUND_ACCELERATION, DESIRED_ACCELERATION, REQUIRED_FORCE, COMMAND, MEASUREMENT)
ANSWER_TOPICS = (INTERFACE_FORCE, CORRECTED_FORCE)

#: Longest time until the nodes are ready [s].
START_TIMEOUT = 60.0

#: Answers are waited for until nothing more has come for this long [s].
QUIET_PERIOD = 1.0


class NotReady(Exception):
    """The nodes did not get ready; the text says which."""


class Playback:
    """Publish the recorded inputs of the loop, in place of numerical substructure, command shaper and table driver.

    Its node has the name of the numerical substructure, which the force correction waits for, and which tells
    `bmd-rths run` that this domain is taken.

    Parameters
    ----------
    monitor : RunMonitor
        Hears the status of the nodes.
    record : RunRecord
        The run.
    config : Config
        Its configuration.

    Attributes
    ----------
    answers : dict of str to dict of int to float
        Interface and corrected force by topic name and step [N].
    late_steps : int
        Steps that came more than one step late, so that the schedule was moved.

    Raises
    ------
    InputError
        Another run is on this domain.
    """

    def __init__(self, monitor: RunMonitor, record: RunRecord, config: Config) -> None:
        self.answers: dict[str, dict[int, float]] = {topic.name: {} for topic in ANSWER_TOPICS}
        self.late_steps = 0
        self._monitor = monitor
        self._steps = record.steps
        self._stamps, self._time_step = config.run.stamps, config.run.time_step
        self._node = Node(
            NUMERICAL_SUBSTRUCTURE, namespace=monitor.namespace, enable_rosout=False, start_parameter_services=False
        )
        monitor.spin_too(self._node)
        self._publishers: list[Publisher] = []
        monitor.update(DISCOVERY_TIME)
        self._refuse_other_publishers()
        self._senders: list[tuple[Callable[[bytes], None], Callable[[int], bytes | None]]] = []
        for topic in PLAYED_TOPICS:
            publisher = self._node.create_publisher(message_class(topic), topic.name, qos.PUBLISHER)
            self._publishers.append(publisher)
            value_at = _values_of(record, topic.name, with_command=owns_the_interface(config))
            self._senders.append((publisher.publish, partial(self._packed, codec_of(topic, config).pack, value_at)))
        self._subscriptions = [
            self._node.create_subscription(
                message_class(topic), topic.name, self._collector(self.answers[topic.name]), qos.RECORDER, raw=True
            )
            for topic in ANSWER_TOPICS
        ]

    def close(self) -> None:
        """Take the node off the domain."""
        self._node.destroy_node()

    def wait_for(self, roles: Collection[str], interrupts: Sequence[int]) -> None:
        """Wait until nodes have found this one and each other.

        Parameters
        ----------
        roles : collection of str
            Names of the nodes.
        interrupts : sequence of int
            Signals received so far; a handler appends to it. The first one ends the waiting.

        Raises
        ------
        NotReady
            They have not in `START_TIMEOUT`.
        InputError
            Another run on this domain was discovered meanwhile.
        """
        give_up = time.perf_counter() + START_TIMEOUT
        self._wait(lambda: self._matched(roles), interrupts, give_up)
        self._monitor.status.clear()  # what they told before may be about somebody else
        self._wait(lambda: not self._unready(roles), interrupts, give_up)
        if self._unready(roles) and not interrupts:
            raise NotReady(f"not ready after {START_TIMEOUT:g} s: {', '.join(self._unready(roles))}")

    def play(self, rate: float, interrupts: Sequence[int], progress: Callable[[int], None]) -> None:
        """Publish every step at its time, then wait for the last answers.

        Parameters
        ----------
        rate : float
            How much faster than recorded [1].
        interrupts : sequence of int
            Signals received so far; a handler appends to it. The first one ends the playback.
        progress : callable
            Called with the number of steps that were published.
        """
        period = self._time_step / rate
        due = time.perf_counter()
        for step in range(self._steps):
            while not interrupts and (wait := due - time.perf_counter() - WAKE_UP_MARGIN) > 0.0:
                self._monitor.update(min(wait, LONGEST_WAIT))
            if interrupts:
                return
            while (now := time.perf_counter()) < due:
                pass
            if now - due > period:  # as the numerical substructure does: steps are never played in a burst
                self.late_steps += 1
                due = now
            for publish, packed in self._senders:
                message = packed(step)
                if message is not None:
                    publish(message)
            due += period
            progress(step + 1)
        heard = -1
        while self._heard() > heard and not interrupts:
            heard = self._heard()
            self._wait(self._complete, interrupts, time.perf_counter() + QUIET_PERIOD)

    def _refuse_other_publishers(self) -> None:
        own = 1 if self._publishers else 0
        for topic in PLAYED_TOPICS:
            name = self._node.resolve_topic_name(topic.name)
            if self._node.count_publishers(name) > own:
                raise another_run(f"it publishes {name}")

    def _matched(self, roles: Collection[str]) -> bool:
        """Tell whether every listener on this domain is connected, and the nodes are among them."""
        self._refuse_other_publishers()
        listeners = set()
        for publisher in self._publishers:
            found = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            if publisher.get_subscription_count() < len(found):
                return False
            listeners |= {info.node_name for info in found}
        return listeners >= set(roles)

    def _unready(self, roles: Collection[str]) -> list[str]:
        """Return the nodes that have not told that they are ready, and what they told."""
        self._refuse_other_publishers()
        told = {role: self._monitor.status.get(role) for role in roles}
        return [
            f"{role} ({'silent' if entry is None else entry.message or entry.state})"
            for role, entry in told.items()
            if entry is None or entry.state != NodeState.READY
        ]

    def _wait(self, condition: Callable[[], bool], interrupts: Sequence[int], give_up: float) -> None:
        while not condition() and not interrupts and time.perf_counter() < give_up:
            self._monitor.update(0.02)

    def _heard(self) -> int:
        return sum(len(answers) for answers in self.answers.values())

    def _complete(self) -> bool:
        return all(self._steps - 1 in answers for answers in self.answers.values())

    def _packed(self, pack: Callable[[int, Any], bytes], value_at: Callable[[int], Any], step: int) -> bytes | None:
        value = value_at(step)
        return None if value is None else pack(self._stamps.of(step), value)

    def _collector(self, answers: dict[int, float]) -> Callable[[bytes], None]:
        unpack = ScalarCodec().unpack

        def on_message(data: bytes) -> None:
            try:
                stamp, value = unpack(data)
            except MalformedMessage:
                return
            step = self._stamps.step(stamp)
            if step is not None and step < self._steps:
                answers[step] = value

        return on_message


def _values_of(record: RunRecord, name: str, with_command: bool) -> Callable[[int], Any]:
    """Return a function that has the recorded value of a step, or None; the desired acceleration with the command."""
    if name == MEASUREMENT.name:
        measured = measured_steps(record)
        return lambda step: measurement_at(record, step) if measured[step] else None
    signal = getattr(record, name).tolist()
    if name == DESIRED_ACCELERATION.name and with_command:
        command = record.command.tolist()
        return lambda step: None if math.isnan(signal[step]) else (signal[step], command[step])
    return lambda step: None if math.isnan(signal[step]) else signal[step]
