"""What every node of a run has in common: parameters, lifecycle, topics, order of the steps, status."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.cdr import MalformedMessage
from bmd_rths_msgs_py.topics import NAMESPACE, Topic
from bmd_rths_nodes.roles import ROLES
from bmd_rths_nodes.ros import qos, status, triggers
from bmd_rths_nodes.ros.agreement import Agreement, Heard
from bmd_rths_nodes.ros.ending_signals import Ending
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.messages import codec_of, consumers_of, message_class
from bmd_rths_nodes.ros.parameters import (
    changed_configuration,
    declare_configuration,
    read_configuration,
    refuse_other_name,
    refuse_unsupported,
)
from bmd_rths_nodes.ros.status import NodeStatus

#: How often a node tells its status [s]: before its first step, and afterwards.
PREPARATION_PERIOD = 0.1
STATUS_PERIOD = 1.0

#: How often a node looks whether somebody else publishes what it listens to [s].
LOOK_PERIOD = 0.1

#: Longest wait for the last status to be acknowledged when the process ends [s].
FAREWELL_TIMEOUT = 1.0

#: States in which messages are looked at.
_TAKING_PART = (NodeState.WAITING, NodeState.READY, NodeState.RUNNING)


class StageNode(LifecycleNode, ABC):
    """A managed node around one stage: converts in, calls the stage, converts out, publishes.

    Subclasses name their role, make their stage and topics in `configure_stage`, and forget the past in
    `reset_stage`. Everything is driven by the messages and by `poll`, which the spin loop calls; there are no timers.

    Parameters
    ----------
    intra_process : IntraProcess
        Nodes of the same process, which get their messages from there.
    """

    ROLE: ClassVar[str]

    steps: int
    _steps_told: int

    def __init__(self, intra_process: IntraProcess) -> None:
        super().__init__(self.ROLE, namespace=NAMESPACE)
        self._intra_process = intra_process
        refuse_other_name(self, f"/{NAMESPACE}/{self.ROLE}")
        self.config: Config = read_configuration(self)
        declare_configuration(self, self.config, ROLES[self.ROLE].sections)
        self.declare_parameter(
            "autostart", True, ParameterDescriptor(description="Configure and activate the node when it starts")
        )
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.problem = ""
        self.to_log: list[tuple[bytes, str]] = []
        self.state = NodeState.INACTIVE
        self.level = status.OK
        self.note = ""
        self.configured = False
        self._publishers_of: list[tuple[Topic, Publisher]] = []
        self._subscriptions_of: list[Subscription] = []
        self._inputs: list[tuple[str, Callable[[], int]]] = []
        # Nodes that have no section of the table see the default, which is simulated.
        at_once = self.config.run.lockstep or self.config.table.controller == "simulated"
        self._settled_at = 0.0 if at_once else time.perf_counter() + self.config.run.settling_time
        self._look_due = 0.0
        self._status_told = self._status_due = 0.0
        self.stepped_at = 0.0
        self._last_words = False
        self.ending: Ending | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS)
        self.agreement = Agreement(self.ROLE, intra_process.instance)
        intra_process.hear_statuses(self.ROLE, self._hear)
        if intra_process.needs_a_listener():
            self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos.DIAGNOSTICS)
        self._forget_counts()
        triggers.offer(self, self.operator_services())

    # ---- for subclasses

    @abstractmethod
    def configure_stage(self, config: Config) -> None:
        """Make stage, publishers and subscriptions; may raise InputError."""

    def reset_stage(self) -> None:
        """Return the stage to rest, before step 0."""

    def stop_stage(self) -> None:
        """Leave everything safe; called when the node is deactivated or its process ends."""

    def status_values(self) -> dict[str, str]:
        """Return what this node tells besides its state."""
        return {}

    def urgent_values(self) -> dict[str, str]:
        """Return what the nodes of this process have to know of a change of state at once; everything else follows."""
        return {}

    def operator_services(self) -> Mapping[str, Callable[[], str]]:
        """Return what an operator can ask this node for at any time, by name, as `triggers.offer` takes it."""
        return {}

    def on_peer(self, peer: NodeStatus) -> None:
        """Take note of what another node of this test says of itself."""

    def on_missed_beginning(self) -> None:
        """Take note of a test that began without this node."""

    @property
    def free(self) -> bool:
        """True when the node is in no test that it would give up for a new one."""
        return self.state in _TAKING_PART

    def shared_parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Return what has to be the same in every node that has it, by section."""
        mapping = self.config.as_mapping()
        sections = ROLES[self.ROLE].sections
        return {section: mapping[section] for section in (mapping if sections is None else sections)}

    def on_disturbance(self, problem: str) -> None:
        """Take no part in the test any more: somebody else publishes what this node listens to."""
        self.set_state(NodeState.TRIPPED, problem, status.ERROR)

    def wants_more_time(self, waited: float, hurried: bool) -> bool:
        """Tell whether the node still has to hear something before its process may end.

        Parameters
        ----------
        waited : float
            Time since the process was asked to end, the last time [s].
        hurried : bool
            True when it was asked twice.
        """
        return False

    def publish_to(self, topic: Topic) -> Callable[[int, Any], None]:
        """Create the publisher of a topic and return a function that sends the value of a step."""
        publisher = self.create_publisher(message_class(topic), topic.name, qos.PUBLISHER)
        self._publishers_of.append((topic, publisher))
        publish = self._intra_process.sender(topic.name, publisher.publish)
        pack = codec_of(topic, self.config).pack
        time_step_ns = self.config.run.time_step_ns

        def send(step: int, value: Any) -> None:
            publish(pack(step * time_step_ns, value))

        return send

    def subscribe_to(
        self, topic: Topic, step: Callable[[int, Any], None], newest_only: bool = False, begins_test: bool = True
    ) -> None:
        """Subscribe a stage to a topic; `step` gets step index and value, in the order of the steps.

        Messages that are malformed, repeated or older than the last one are counted and dropped; skipped steps are
        counted as lost. Step 0 after a later one begins a new test, unless another topic says so earlier
        (`begins_test`). With `newest_only`, a message that was not read in time is skipped when a newer one is there;
        in lockstep there never is.
        """
        time_step_ns = self.config.run.time_step_ns
        unpack = codec_of(topic, self.config).unpack
        name = topic.name

        def on_message(data: bytes) -> None:
            if self.state not in _TAKING_PART:
                return
            try:
                stamp, value = unpack(data)
            except MalformedMessage as error:
                self._count_malformed(topic, str(error))
                return
            index, remainder = divmod(stamp, time_step_ns)
            if remainder:
                self._count_malformed(topic, f"stamp {stamp} ns is not a multiple of {time_step_ns} ns")
                return
            expected = self._expected.get(name, 0)
            if index == 0 and expected > 1:
                if begins_test:
                    self.reset_stage()
            elif index < expected:
                self.out_of_order += 1
                return
            elif index > expected:
                self.lost += index - expected
            self._expected[name] = index + 1
            self.steps += 1
            self.stepped_at = time.perf_counter()
            step(index, value)

        if self._intra_process.has(topic.producer):
            self._intra_process.subscribe(name, self.ROLE, on_message)
            resolved = self.resolve_topic_name(name)  # publishers are counted by the name they have in the end
            self._inputs.append((resolved, lambda: self.count_publishers(resolved)))
            return
        in_real_time = qos.NEWEST if newest_only else qos.STAGE
        profile = qos.LOCKSTEP_STAGE if self.config.run.lockstep else in_real_time
        subscription = self.subscribe_raw(topic, on_message, profile)
        self._inputs.append((subscription.topic_name, subscription.get_publisher_count))

    def subscribe_raw(self, topic: Topic, on_message: Callable[[bytes], None], profile: QoSProfile) -> Subscription:
        """Subscribe to the bytes of a topic."""
        subscription = self.create_subscription(message_class(topic), topic.name, on_message, profile, raw=True)
        self._subscriptions_of.append(subscription)
        return subscription

    def set_state(self, state: NodeState, note: str = "", level: bytes = status.OK) -> None:
        """Change the state and tell it at once, to the nodes of this process first: a table may wait for it."""
        self.state, self.note, self.level = state, note, level
        self._intra_process.tell_status(self.ROLE, self._status(self.urgent_values()))
        self.publish_status()

    def log_later(self, text: str, level: bytes = status.OK) -> None:
        """Log a line when no node of this process drives a test or a table: a log call may stall it."""
        self.to_log.append((level, text))

    @property
    def drives(self) -> bool:
        """True while something moves that must not wait for a log call."""
        return False

    def flush_log(self) -> None:
        """Log what was kept back."""
        while self.to_log:
            level, text = self.to_log.pop(0)
            if level == status.OK:
                self.get_logger().info(text)
            elif level == status.WARN:
                self.get_logger().warning(text)
            else:
                self.get_logger().error(text)

    def expect_a_new_test(self) -> None:
        """Look for the peers, and begin at step 0."""
        self._forget_counts()
        self.agreement.begin(self.shared_parameters())
        self.set_state(NodeState.WAITING)

    def status_due_within(self, seconds: float) -> None:
        """Tell the status soon, that is `seconds` after it was last told."""
        self._status_due = min(self._status_due, self._status_told + seconds)

    # ---- for the spin loop

    def poll(self, now: float) -> float:
        """Do what the loop waits for.

        Parameters
        ----------
        now : float
            Time of `time.perf_counter` [s].

        Returns
        -------
        float
            When to call again at the latest.
        """
        return math.inf

    @property
    def house_due(self) -> float:
        """When to call `keep_house`, as soon as the loop leaves time for it."""
        return min(self._status_due, self._look_due)

    def keep_house(self, now: float) -> None:
        """Do what the loop does not wait for: tell the status, and look whether somebody else publishes.

        Parameters
        ----------
        now : float
            Time of `time.perf_counter` [s].
        """
        if now >= self._status_due:
            idle = self.steps == self._steps_told
            if idle and self.state in (NodeState.WAITING, NodeState.READY):
                self.note = self._disturbance() or self.agreement.obstacle(now)
                found = now >= self._settled_at and not self.note and self._matched()
                self.state = NodeState.READY if found else NodeState.WAITING
            self._steps_told = self.steps
            self.publish_status()
        if now >= self._look_due:
            self._look_due = now + LOOK_PERIOD
            under_way = self.steps > self._steps_told and self.state in _TAKING_PART
            if under_way and (problem := self._disturbance()):
                self.on_disturbance(problem)

    def publish_status(self) -> None:
        """Tell the status now."""
        prepares = self.steps == 0 and self.state in (NodeState.WAITING, NodeState.READY)
        self._status_told = time.perf_counter()
        self._status_due = self._status_told + (PREPARATION_PERIOD if prepares else STATUS_PERIOD)
        own = self._status(
            {
                **self.status_values(),
                **self.agreement.values(),
                "lost": str(self.lost),
                "out_of_order": str(self.out_of_order),
                "malformed": str(self.malformed),
            }
        )
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        self._diagnostics.publish(status.to_message(own, seconds, nanoseconds))
        self._intra_process.tell_status(self.ROLE, own)

    def _status(self, values: Mapping[str, str]) -> NodeStatus:
        values = {**values, **self.agreement.identity()}
        return NodeStatus(self.get_fully_qualified_name(), self.state, self.level, self.note, values, time.time())

    def make_safe(self, ending: Ending) -> None:
        """Leave everything safe, because the process ends.

        Parameters
        ----------
        ending : Ending
            Tells whether the operator asks again meanwhile.
        """
        self.ending = ending
        told = self._status_told
        self.stop_stage()
        self._last_words = self._status_told > told

    def say_farewell(self) -> None:
        """See that what was told while everything was made safe arrives.

        The middleware asks for acknowledgements every few seconds only, so that a status of any time before, which has
        long arrived, would be waited for in vain.
        """
        if self._last_words:
            self._diagnostics.wait_for_all_acked(Duration(seconds=FAREWELL_TIMEOUT))

    # ---- lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make stage and topics from the parameters."""
        try:
            self.configure_stage(self.config)
        except InputError as error:
            self.problem = str(error)
            self.get_logger().error(self.problem)
            self._destroy_topics()
            return TransitionCallbackReturn.FAILURE
        self.configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to rest and look for the peers."""
        try:
            self.reset_stage()
        except InputError as error:
            self.problem = str(error)
            self.get_logger().error(self.problem)
            return TransitionCallbackReturn.FAILURE
        self.expect_a_new_test()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking part."""
        self.stop_stage()
        self.set_state(NodeState.INACTIVE)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give up stage and topics, so that the parameters can be changed."""
        self._destroy_topics()
        self.configured = False
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking part for good."""
        self.stop_stage()
        self.set_state(NodeState.INACTIVE)
        self._destroy_topics()
        self.configured = False
        return super().on_shutdown(state)

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:
        """Answer a request for a transition that is not possible, which rclpy 7.1 leaves unanswered."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)  # type: ignore[misc]
        except rclpy_implementation.RCLError as error:
            self.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response

    # ---- details

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for peer in status.from_message(message):
            if peer.instance != self._intra_process.instance:
                self._intra_process.tell_status("", peer)

    def _hear(self, peer: NodeStatus) -> None:
        """Believe the nodes of this test and nobody else."""
        unbound = not self.agreement.run
        heard = self.agreement.hear(peer, time.perf_counter(), self.free)
        if heard is Heard.ADOPTED:
            self.status_due_within(0.0)
        elif heard is Heard.LATE:
            self.on_missed_beginning()
        elif heard is Heard.RIVAL and peer.run and unbound and self.free:
            self.on_disturbance(f"refused: a second {self.ROLE} takes part in the test ({peer.instance})")
        if heard in (Heard.BELIEVED, Heard.ADOPTED) and self.configured:
            self.on_peer(peer)

    def _forget_counts(self) -> None:
        """Begin to count anew: the next step of each topic, and what went wrong."""
        self._expected: dict[str, int] = {}
        self.steps = self._steps_told = 0
        self.malformed = self.out_of_order = self.lost = 0

    def _matched(self) -> bool:
        """Tell whether both ends of every connection of this node that the loop needs have found each other."""
        for topic, publisher in self._publishers_of:
            readers = self.get_subscriptions_info_by_topic(publisher.topic_name)
            needed = consumers_of(topic, self.config)
            needed -= self._intra_process.consumers(topic.name)
            if not needed <= {r.node_name for r in readers} or publisher.get_subscription_count() < len(readers):
                return False
        heard = (subscription.get_publisher_count() for subscription in self._subscriptions_of)
        return all(heard) and all(count_publishers() for _, count_publishers in self._inputs)

    def _disturbance(self) -> str:
        """Return which input of this node has more than one publisher, in words; empty when none has."""
        for topic_name, count_publishers in self._inputs:
            count = count_publishers()
            if count > 1:
                return f"{topic_name} has {count} publishers, one is allowed"
        return ""

    def _count_malformed(self, topic: Topic, problem: str) -> None:
        self.malformed += 1
        if self.malformed == 1:
            self.log_later(f"{topic.name}: message dropped: {problem}; further ones are only counted", status.WARN)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        if self.configured:
            reason = f"{self.ROLE} is configured; parameters can be changed after the cleanup transition"
            return SetParametersResult(successful=False, reason=reason)
        try:
            refuse_unsupported(parameters)
            self.config = changed_configuration(self.config, parameters)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _destroy_topics(self) -> None:
        self._intra_process.publish()
        self._intra_process.unsubscribe(self.ROLE)
        for _, publisher in self._publishers_of:
            self.destroy_publisher(publisher)
        for subscription in self._subscriptions_of:
            self.destroy_subscription(subscription)
        self._publishers_of.clear()
        self._subscriptions_of.clear()
        self._inputs.clear()
