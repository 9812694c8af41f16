"""What every node of a run has in common: topics, order of the steps, status, and the test it takes part in."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.cdr import MalformedMessage
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, Topic
from bmd_rths_nodes.roles import ROLES
from bmd_rths_nodes.ros import qos, status, triggers
from bmd_rths_nodes.ros.agreement import Agreement, Heard
from bmd_rths_nodes.ros.connections import Connections
from bmd_rths_nodes.ros.end_of_test import EndOfTest
from bmd_rths_nodes.ros.ending_signals import Ending
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.managed_node import ManagedNode
from bmd_rths_nodes.ros.messages import codec_of
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.step_order import StepOrder

#: How often a node tells its status [s]: before its first step, and afterwards.
PREPARATION_PERIOD = 0.1
STATUS_PERIOD = 1.0

#: How often a node looks whether somebody else publishes what it listens to [s].
LOOK_PERIOD = 0.1

#: A node that waits says for whom when it has waited for this long [s], and when that changes.
CONSOLE_PATIENCE = 2.0

#: Longest wait for the last status to be acknowledged when the process ends [s].
FAREWELL_TIMEOUT = 1.0

#: States in which messages are looked at.
_TAKING_PART = (NodeState.WAITING, NodeState.READY, NodeState.RUNNING)


class StageNode(ManagedNode):
    """A managed node around one stage: converts in, calls the stage, converts out, publishes.

    Subclasses name their role, make their stage and topics in `configure_stage`, and forget the past in
    `reset_stage`. Everything is driven by the messages and by `poll`, which the spin loop calls; there are no timers.

    Parameters
    ----------
    intra_process : IntraProcess
        Nodes of the same process, which get their messages from there.
    """

    #: Names of the services that `operator_services` offers.
    SERVICES: ClassVar[tuple[str, ...]] = ()

    def __init__(self, intra_process: IntraProcess) -> None:
        super().__init__()
        self._intra_process = intra_process
        self._connections = Connections(self, self.ROLE, intra_process)
        self.order = StepOrder(self.config.run.stamps)
        self._steps_told = 0
        self.state = NodeState.INACTIVE
        self.level = status.OK
        self.note = ""
        # Nodes that have no section of the table see the default, which is simulated.
        at_once = self.config.run.lockstep or self.config.table.controller == "simulated"
        self._settled_at = 0.0 if at_once else time.perf_counter() + self.config.run.settling_time
        self._look_due = 0.0
        self._status_told = self._status_due = 0.0
        self.stepped_at = 0.0
        self._last_words = False
        self.end_of_test = EndOfTest(self.config.run.record)
        self._said = ""
        self._say_due = math.inf
        self.ending: Ending | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS)
        self.agreement = Agreement(self.ROLE, intra_process.instance)
        intra_process.hear_statuses(self.ROLE, self._hear)
        if intra_process.needs_a_listener():
            self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos.DIAGNOSTICS)
        triggers.offer(self, self.operator_services())

    # ---- for subclasses

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

    def on_told(self, peer: NodeStatus) -> None:
        """Take note of what another node says of itself, whether or not it takes part in this test."""

    def on_new_test(self) -> None:
        """Take part in the test that the numerical substructure has just offered."""
        if self.end_of_test.outcome:  # it follows another one, for which the same words were said
            self._said = ""
        self.end_of_test = EndOfTest(self.config.run.record)
        self.order.expect_new_test()

    def takes(self, topic: str) -> bool:
        """Tell whether a message of a topic of the loop is looked at now."""
        return self.state in _TAKING_PART

    def on_missed_beginning(self) -> None:
        """Take note of a test that began without this node."""

    @property
    def free(self) -> bool:
        """True when the node is in no test that it would give up for a new one."""
        return self.state in _TAKING_PART

    def shared_parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Return what has to be the same in every node that has it, by section."""
        mapping = self.config.as_mapping()
        declared = ROLES[self.ROLE].sections
        sections = mapping if declared is None else dict.fromkeys((*declared, *self.further_sections()))
        own = ("real_time",)  # of each process, as it needs it
        return {section: mapping[section] for section in sections if section not in own}

    @property
    def in_real_time(self) -> bool:
        """True when the process of this node has to be in time."""
        return not self.config.run.lockstep

    def further_sections(self) -> tuple[str, ...]:
        """Return the sections that this node reads besides those of its role."""
        return ()

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

    def publish_to(self, topic: Topic, at_once: bool = False) -> Callable[[int, Any], None]:
        """Create the publisher of a topic and return a function that sends the value of a step.

        What no node of this process listens to can be sent `at_once`, also while the process ends.
        """
        return self._connections.publish_to(topic, self.config, at_once)

    def subscribe_to(
        self, topic: Topic, step: Callable[[int, Any], None], newest_only: bool = False, begins_test: bool = True
    ) -> None:
        """Subscribe a stage to a topic; `step` gets step index and value, in the order of the steps.

        Messages that are malformed, repeated or older than the last one are counted and dropped; skipped steps are
        counted as lost. Step 0 after a later one, and the first step of a test that was offered since, begin a new test
        unless another topic says so earlier (`begins_test`). With `newest_only`, a message that was not read in time is
        skipped when a newer one is there; in lockstep there never is.
        """
        unpack = codec_of(topic, self.config).unpack
        name = topic.name

        def on_message(data: bytes) -> None:
            if not self.takes(name):
                return
            try:
                stamp, value = unpack(data)
                taken = self.order.take(name, stamp)
            except MalformedMessage as error:
                self._count_malformed(topic, str(error))
                return
            if taken is None:
                return
            if taken.begins_anew and begins_test:
                self.reset_stage()
            self.stepped_at = time.perf_counter()
            step(taken.step, value)

        in_real_time = qos.NEWEST if newest_only else qos.STAGE
        self._connections.listen(topic, on_message, qos.LOCKSTEP_STAGE if self.config.run.lockstep else in_real_time)

    def subscribe_raw(self, topic: Topic, on_message: Callable[[bytes], None], profile: QoSProfile) -> None:
        """Subscribe to the bytes of a topic."""
        self._connections.listen_beside(topic, on_message, profile)

    def set_state(self, state: NodeState, note: str = "", level: bytes = status.OK) -> None:
        """Change the state and tell it at once, to the nodes of this process first: a table may wait for it."""
        self.state, self.note, self.level = state, note, level
        self._intra_process.tell_status(self.ROLE, self._status(self.urgent_values()))
        self.publish_status()

    def take_part(self) -> None:
        """Look for the peers, and begin at step 0."""
        self.order = StepOrder(self.config.run.stamps)
        self._steps_told = 0
        self.end_of_test = EndOfTest(self.config.run.record)
        self._said = ""
        self.agreement.begin(self.shared_parameters())
        self.set_state(NodeState.WAITING)

    def take_no_part(self) -> None:
        """Tell that the node is inactive."""
        self.set_state(NodeState.INACTIVE)

    def give_up_topics(self) -> None:
        """Destroy publishers and subscriptions."""
        self._connections.destroy()

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

    def is_done(self, now: float) -> bool:
        """Tell whether the process may end because the test is over, as ``exit_when_done`` asks."""
        return self.end_of_test.over(now) and bool(self.get_parameter("exit_when_done").value)

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
            idle = self.order.steps == self._steps_told
            if idle and self.state in (NodeState.WAITING, NodeState.READY):
                self.note = self._connections.disturbance() or self.agreement.obstacle(now)
                found = now >= self._settled_at and not self.note and self._connections.matched(self.config)
                self.state = NodeState.READY if found else NodeState.WAITING
            self._steps_told = self.order.steps
            self.publish_status()
            if idle and self.state in (NodeState.WAITING, NodeState.READY):
                self._say_what_is_waited_for(now)
        if now >= self._look_due:
            self._look_due = now + LOOK_PERIOD
            under_way = self.order.steps > self._steps_told and self.state in _TAKING_PART
            if under_way and (problem := self._connections.disturbance()):
                self.on_disturbance(problem)

    def publish_status(self) -> None:
        """Tell the status now."""
        prepares = self.order.steps == 0 and self.state in (NodeState.WAITING, NodeState.READY)
        self._status_told = time.perf_counter()
        self._status_due = self._status_told + (PREPARATION_PERIOD if prepares else STATUS_PERIOD)
        own = self._status(
            {
                **self.status_values(),
                **self.agreement.values(),
                "lost": str(self.order.lost),
                "out_of_order": str(self.order.out_of_order),
                "malformed": str(self.order.malformed),
            }
        )
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        self._diagnostics.publish(status.to_message(own, seconds, nanoseconds))
        self._intra_process.tell_status(self.ROLE, own)
        self.end_of_test.hear(own)

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
        """See that what was told while everything was made safe arrives; it is acknowledged at once."""
        if self._last_words:
            self._diagnostics.wait_for_all_acked(Duration(seconds=FAREWELL_TIMEOUT))

    # ---- details

    def waited_for(self) -> str:
        """Return for whom the node waits, for a person; empty when that is not known."""
        return ", ".join(self._connections.missing(self.config))

    @property
    def ready_words(self) -> str:
        """What the node says on the console when it is ready."""
        return "ready; the test begins when every node is, and nothing is said until it has ended"

    def _say_the_end(self, peer: NodeStatus) -> None:
        """Say on the console how the test has ended, once, where no other node of the process does."""
        if peer.role != NUMERICAL_SUBSTRUCTURE or self._intra_process.has(NUMERICAL_SUBSTRUCTURE):
            return
        outcome = peer.values.get("outcome", "") if peer.state is NodeState.ENDED else ""
        words = f"the test has ended, {outcome}: {peer.message}"
        if outcome and words != self._said:
            self._said = words
            self.log_later(words)

    def _say_what_is_waited_for(self, now: float) -> None:
        """Say on the console that the node waits, and for whom, or that it is ready: not while a test is under way."""
        if self.end_of_test.outcome:  # nobody has offered another test yet
            return
        words = self.ready_words
        if self.state is NodeState.WAITING:
            words = f"waiting for {self.note or self.waited_for() or 'the others'}"
        if words == self._said:
            self._say_due = math.inf
        elif self.state is NodeState.READY or now >= self._say_due:
            self._said, self._say_due = words, math.inf
            self.log_later(words)
        else:
            self._say_due = min(self._say_due, now + CONSOLE_PATIENCE)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for peer in status.from_message(message):
            own = peer.namespace == self.get_namespace()  # otherwise it is of another rig
            if own and peer.instance != self._intra_process.instance:
                self._intra_process.tell_status("", peer)

    def _hear(self, peer: NodeStatus) -> None:
        """Believe the nodes of this test and nobody else."""
        self.on_told(peer)
        unbound = not self.agreement.run
        heard = self.agreement.hear(peer, time.perf_counter(), self.free)
        if heard is Heard.ADOPTED:
            self.on_new_test()
            self.status_due_within(0.0)
        elif heard is Heard.LATE:
            self.on_missed_beginning()
        elif heard is Heard.RIVAL and peer.run and unbound and self.free:
            self.on_disturbance(f"refused: a second {self.ROLE} takes part in the test ({peer.instance})")
        if heard in (Heard.BELIEVED, Heard.ADOPTED) and self.configured:
            self.end_of_test.hear(peer)
            self._say_the_end(peer)
            self.on_peer(peer)

    def _count_malformed(self, topic: Topic, problem: str) -> None:
        self.order.malformed += 1
        if self.order.malformed == 1:
            self.log_later(f"{topic.name}: message dropped: {problem}; further ones are only counted", status.WARN)
