"""Services of the type std_srvs/Trigger: what an operator asks of a node, and its answer in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from bmd_rths_msgs_py.topics import NAMESPACE

STOP, EMERGENCY_STOP, RESET = "stop", "emergency_stop", "reset"


class Refused(Exception):
    """A node does not do what it was asked for; the text says why."""


def offer(node: Node, services: Mapping[str, Callable[[], str]]) -> None:
    """Offer services below the name of a node.

    Parameters
    ----------
    node : Node
        The node.
    services : Mapping of str to callable
        By name, what each does. It returns what was done, in words, or raises `Refused`.
    """
    for name, action in services.items():
        node.create_service(Trigger, f"~/{name}", _handler(action))


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
    """The services of another node, called without waiting for the answer.

    Parameters
    ----------
    node : Node
        The node that calls.
    role : str
        The node that answers. The clients have to find it before a call is of use, so make them early.
    names : str
        Names of the services.
    """

    def __init__(self, node: Node, role: str, *names: str) -> None:
        self._clients = {name: node.create_client(Trigger, f"/{NAMESPACE}/{role}/{name}") for name in names}
        self._calls: list[Future] = []

    def call(self, name: str) -> None:
        """Call a service; nobody need be there.

        Parameters
        ----------
        name : str
            Its name.
        """
        self._calls.append(self._clients[name].call_async(Trigger.Request()))

    def answers(self) -> list[str]:
        """Return the answers that have come since the last look."""
        done = [call for call in self._calls if call.done()]
        self._calls = [call for call in self._calls if not call.done()]
        return [call.result().message for call in done]
