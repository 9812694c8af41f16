"""Messages between nodes of one process: handed over first, published when there is nothing more to hand over."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from collections.abc import Set as AbstractSet

from bmd_rths_nodes.ros.agreement import new_instance
from bmd_rths_nodes.ros.status import NodeStatus

Handler = Callable[[bytes], None]


class IntraProcess:
    """What the nodes of one process send, on its way to each other and to the middleware.

    The nodes get the bytes that are published, without the middleware, so that a step does not wait for it. Everybody
    else gets them from the middleware, in the order in which they were sent.

    Parameters
    ----------
    roles : collection of str
        Roles of the nodes of the process.

    Attributes
    ----------
    instance : str
        What tells this process from every other one.
    """

    def __init__(self, roles: Collection[str]) -> None:
        self.instance = new_instance()
        self._is_heard_for = False
        self._roles = frozenset(roles)
        self._consumers: dict[str, dict[str, Handler]] = {}
        self._listeners: dict[str, Callable[[NodeStatus], None]] = {}
        self._to_hand_over: deque[tuple[str, bytes]] = deque()
        self._to_publish: deque[tuple[Handler, bytes]] = deque()

    def has(self, role: str) -> bool:
        """Tell whether a node is one of this process.

        Parameters
        ----------
        role : str
            Its role.
        """
        return role in self._roles

    def consumers(self, topic: str) -> AbstractSet[str]:
        """Return the roles that listen to a topic in this process.

        Parameters
        ----------
        topic : str
            Name of the topic.
        """
        return self._consumers.get(topic, {}).keys()

    def subscribe(self, topic: str, role: str, handler: Handler) -> None:
        """Hand every message of a topic to a node of this process.

        Parameters
        ----------
        topic : str
            Name of the topic.
        role : str
            Role of the node.
        handler : callable
            Gets the bytes.
        """
        self._consumers.setdefault(topic, {})[role] = handler

    def unsubscribe(self, role: str) -> None:
        """Hand nothing to a node any more.

        Parameters
        ----------
        role : str
            Its role.
        """
        for handlers in self._consumers.values():
            handlers.pop(role, None)

    def hear_statuses(self, role: str, handler: Callable[[NodeStatus], None]) -> None:
        """Hand every status that a node of this process tells to another one.

        Parameters
        ----------
        role : str
            Role of the node that listens.
        handler : callable
            Gets the statuses of the others.
        """
        self._listeners[role] = handler

    def needs_a_listener(self) -> bool:
        """Tell whether nobody of this process listens to /diagnostics yet; who asks first does it for all of them."""
        first, self._is_heard_for = not self._is_heard_for, True
        return first

    def tell_status(self, role: str, status: NodeStatus) -> None:
        """Tell the other nodes of this process a status, without the middleware and at once.

        Parameters
        ----------
        role : str
            Role of the node that tells; empty when it is one of another process.
        status : NodeStatus
            What it says.
        """
        for listener, handler in list(self._listeners.items()):
            if listener != role:
                handler(status)

    def sender(self, topic: str, publish: Handler) -> Handler:
        """Return what a node sends the messages of a topic with.

        Parameters
        ----------
        topic : str
            Name of the topic.
        publish : callable
            Gives bytes to the middleware. In a process with one node it is what is returned.
        """
        if len(self._roles) < 2:
            return publish

        def send(data: bytes) -> None:
            self._to_hand_over.append((topic, data))
            self._to_publish.append((publish, data))

        return send

    def deliver(self) -> bool:
        """Hand over what was sent, and what is sent in answer to it; then publish all of it.

        Returns
        -------
        bool
            True when there was anything.
        """
        while self._to_hand_over:
            topic, data = self._to_hand_over.popleft()
            for handler in list(self._consumers.get(topic, {}).values()):
                handler(data)
        return self.publish()

    def publish(self) -> bool:
        """Publish what was sent, without handing it over.

        Returns
        -------
        bool
            True when there was anything.
        """
        found = bool(self._to_publish)
        while self._to_publish:
            publish, data = self._to_publish.popleft()
            publish(data)
        return found
