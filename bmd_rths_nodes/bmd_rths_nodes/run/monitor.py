"""Watch a run from outside: the status of every node, as told on /diagnostics; and stop its table."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from types import TracebackType

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bmd_rths_msgs_py.topics import DIAGNOSTICS, NAMESPACE, ROLES, TABLE_DRIVER, Topic
from bmd_rths_nodes.ros import qos, status
from bmd_rths_nodes.ros.messages import message_class
from bmd_rths_nodes.ros.middleware import prepare_middleware
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.triggers import EMERGENCY_STOP, STOP, TriggerClients

#: Time from the start of a monitor in which nodes that are already there are discovered, on a busy machine too [s].
DISCOVERY_TIME = 2.0


class RunMonitor:
    """A node that listens to /diagnostics and publishes nothing; a context manager, one in a process.

    Parameters
    ----------
    namespace : str
        Namespace of the run.
    discovery_time : float
        Time in which nodes that are already there are discovered [s].

    Attributes
    ----------
    status : dict of str to NodeStatus
        Latest status of every role heard of. One that was told before, which a bag that is played repeats, is not.
    heard : dict of str to float
        When it came, by `time.perf_counter` [s].
    table : TriggerClients
        Stop and emergency stop of the table driver.
    """

    def __init__(self, namespace: str = NAMESPACE, discovery_time: float = DISCOVERY_TIME) -> None:
        self.namespace = namespace
        self._discovery_time = discovery_time
        self._believes: Callable[[NodeStatus], bool] = lambda told: True
        self._seen: set[str] = set()
        self.status: dict[str, NodeStatus] = {}
        self.heard: dict[str, float] = {}

    def __enter__(self) -> RunMonitor:
        """Start listening."""
        self._begin = time.perf_counter()
        prepare_middleware()
        # No arguments: the command line is not one of ROS.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(f"rths_monitor_{os.getpid()}", enable_rosout=False, start_parameter_services=False)
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos.DIAGNOSTICS)
        self.table = TriggerClients(self._node, f"{self.namespace}/{TABLE_DRIVER}", STOP, EMERGENCY_STOP)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening; the executor would keep the node on the domain for as long as this process lives."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def believe_only(self, believes: Callable[[NodeStatus], bool]) -> None:
        """Forget what was told so far, and listen to some nodes only.

        Parameters
        ----------
        believes : callable
            Tells whether a status is one of theirs.
        """
        self._believes = believes
        self._forget()

    @property
    def live(self) -> dict[str, NodeStatus]:
        """Latest status of every role whose node is, or was, on the domain: a bag that is played has no such node."""
        self._seen.update(self.nodes_there())
        return {role: told for role, told in self.status.items() if role in self._seen}

    def update(self, seconds: float) -> None:
        """Listen for some time.

        Parameters
        ----------
        seconds : float
            How long [s].
        """
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def listen(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        """Give the bytes of every message of a topic to a function, best effort.

        Parameters
        ----------
        topic : Topic
            The topic.
        on_message : callable
            Takes a message as CDR.
        """
        profile = qos.DIAGNOSTICS if topic is DIAGNOSTICS else qos.WATCHER
        name = topic.full_name_in(self.namespace)
        self._node.create_subscription(message_class(topic), name, on_message, profile, raw=True)

    def spin_too(self, node: Node) -> None:
        """Take the messages of another node of this process too, until it is destroyed.

        Parameters
        ----------
        node : Node
            The node.
        """
        self._executor.add_node(node)

    def nodes_already_there(self) -> list[str]:
        """Return the nodes of another run in the same domain and namespace, as soon as any is discovered.

        Returns
        -------
        list of str
            Roles, empty when there was time to discover them and the domain is free for the namespace.
        """
        while (
            not (found := self.nodes_there() or sorted(self.status))
            and time.perf_counter() < self._begin + self._discovery_time
        ):
            self.update(0.05)
        return found

    def forget_run(self, longest: float) -> None:
        """Wait until the nodes of a run that has ended are gone, and forget what they told.

        Parameters
        ----------
        longest : float
            Longest wait [s]; nodes that are still there then are those of another run.
        """
        give_up = time.perf_counter() + longest
        while self.nodes_already_there() and time.perf_counter() < give_up:
            self._forget()
            self.update(0.05)

    def nodes_there(self) -> list[str]:
        """Return the nodes of a run that are discovered by now.

        Returns
        -------
        list of str
            Roles.
        """
        names = self._node.get_node_names_and_namespaces()
        return sorted({name for name, namespace in names if namespace == self.namespace and name in ROLES})

    def other_namespaces(self) -> list[str]:
        """Return the namespaces of other runs on the domain that are discovered by now.

        Returns
        -------
        list of str
            In the order of the alphabet.
        """
        names = self._node.get_node_names_and_namespaces()
        return sorted({namespace for name, namespace in names if name in ROLES} - {self.namespace})

    def all_nodes(self) -> list[str]:
        """Return the full names of all nodes on the domain that are discovered by now, without this one.

        Returns
        -------
        list of str
            In the order of the alphabet; hidden ones are left out.
        """
        own = self._node.get_name()
        names = self._node.get_node_names_and_namespaces()
        return sorted({f"{place.rstrip('/')}/{name}" for name, place in names if name != own and name[:1] != "_"})

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for told in status.from_message(message):
            before = self.status.get(told.role)
            own = told.namespace == self.namespace
            # One from the future was told before the clock was set back.
            new = before is None or told.stamp >= before.stamp or before.stamp > time.time()
            if own and self._believes(told) and new:
                self.status[told.role] = told
                self.heard[told.role] = time.perf_counter()

    def _forget(self) -> None:
        self.status.clear()
        self.heard.clear()
        self._seen.clear()
