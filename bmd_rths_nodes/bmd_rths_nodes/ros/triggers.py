"""Services of the type std_srvs/Trigger: what an operator asks of a node, and the text it answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from bmd_rths_nodes.ros import qos

STOP, EMERGENCY_STOP, RESET = "stop", "emergency_stop", "reset"
NEXT_TEST = "next_test"

#: Time after which a request without an answer is sent again [s]. The middleware repeats what was lost after up to 3 s,
#: or as soon as there is more to send; what was sent before the node was found it does not repeat at all.
REPEAT_PERIOD = 0.5

#: How often a request is sent again.
MOST_REPEATS = 3


class Refused(Exception):
    """A node does not do what it was asked for; the text says why."""


def offer(node: Node, services: Mapping[str, Callable[[], str]]) -> None:
    """Offer services below the name of a node.

    Parameters
    ----------
    node : Node
        The node.
    services : Mapping of str to callable
        By name, what each does. It returns a text of what was done, or raises `Refused`.
    """
    for name, action in services.items():
        node.create_service(Trigger, f"~/{name}", _handler(action), qos_profile=qos.OPERATOR)


def _handler(action: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def on_request(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message = action()
            response.success = True
        except Refused as refusal:
            response.message = str(refusal)
        return response

    return on_request


class TriggerClients:
    """The services of another node, called without waiting for the answer, and again when there is none.

    Only for services that may be called twice.

    Parameters
    ----------
    node : Node
        The node that calls.
    answerer : str
        Full name of the node that answers. The clients have to find it before a call is of use, so make them early.
    names : str
        Names of the services.
    """

    def __init__(self, node: Node, answerer: str, *names: str) -> None:
        self._clients = {name: node.create_client(Trigger, f"{answerer}/{name}") for name in names}
        self._requests: dict[str, list[Future]] = {}
        self._repeat_due = 0.0

    def call(self, name: str) -> None:
        """Call a service; nobody need be there.

        Parameters
        ----------
        name : str
            Its name.
        """
        self._request(name)
        self._repeat_due = time.perf_counter() + REPEAT_PERIOD

    def update(self) -> list[tuple[str, str]]:
        """Repeat what has no answer; to be called often.

        Returns
        -------
        list of (str, str)
            Services that have answered since the last look, each once, and what they said.
        """
        answers = []
        for name, requests in list(self._requests.items()):
            answered = next((request for request in requests if request.done()), None)
            if answered is not None:
                answers.append((name, answered.result().message))
                for request in self._requests.pop(name):
                    self._clients[name].remove_pending_request(request)
        now = time.perf_counter()
        if now >= self._repeat_due:
            self._repeat_due = now + REPEAT_PERIOD
            for name, requests in self._requests.items():
                if len(requests) <= MOST_REPEATS:
                    self._request(name)
        return answers

    def _request(self, name: str) -> None:
        self._requests.setdefault(name, []).append(self._clients[name].call_async(Trigger.Request()))
