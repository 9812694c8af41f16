"""Publish a test to Foxglove's own WebSocket, from the bag while it is written: read-only."""

from __future__ import annotations

import time
from importlib import import_module
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_msgs_py.message_definitions import message_definition
from bmd_rths_msgs_py.topics import TOPICS

#: What is older when it is read is history, which Foxglove reads from the file itself [s].
_OLD = 5.0

_TYPES = {topic.full_name.rpartition("/")[2]: topic.type_name for topic in TOPICS.values()}


class FoxgloveRelay:
    """A server that Foxglove and Lichtblick connect to; it offers messages and takes nothing.

    Parameters
    ----------
    port : int
        Port of 127.0.0.1; 0 for any that is free.

    Attributes
    ----------
    port : int
        The port.

    Raises
    ------
    InputError
        foxglove-sdk is not installed, or the port is in use.
    """

    def __init__(self, port: int) -> None:
        try:
            self._sdk: Any = import_module("foxglove")
            self._context = self._sdk.Context()
            # No capability: a client can neither publish nor call a service nor set a parameter.
            self._server = self._sdk.start_server(
                name="bmd_rths", host="127.0.0.1", port=port, capabilities=[], context=self._context
            )
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"--foxglove: requires foxglove-sdk ({error}); pip install 'bmd_rths_nodes[foxglove]'"
            ) from error
        except (OSError, RuntimeError) as error:
            raise InputError(f"--foxglove {port}: {error}; a free port of 127.0.0.1 is required") from error
        self.port = int(self._server.port)
        self._channels: dict[str, Any] = {}
        self._follower: BagFollower | None = None

    def follow(self, bag: Path) -> None:
        """Publish another bag from now on.

        Parameters
        ----------
        bag : Path
            The bag; nothing is done while it is not there, or when it is followed already.
        """
        if self._follower is not None and self._follower.path == bag:
            return
        try:
            self._follower = BagFollower(bag, self.take)
        except InputError:
            return

    def look(self) -> None:
        """Publish what is new in the bag."""
        follower = self._follower
        try:
            while follower is not None and follower.look():
                continue
        except InputError:
            self._follower = None  # the page says why

    def take(self, topic: str, data: bytes, heard_ns: int) -> None:
        """Publish a message, unless it is old.

        Parameters
        ----------
        topic : str
            Name of its topic.
        data : bytes
            The message as CDR with encapsulation.
        heard_ns : int
            When it was recorded [ns].
        """
        type_name = _TYPES.get(topic.rpartition("/")[2])
        if type_name is None or time.time() - 1e-9 * heard_ns > _OLD:
            return
        if topic not in self._channels:
            text, _ = message_definition(type_name)
            schema = self._sdk.Schema(name=type_name, encoding="ros2msg", data=text.encode())
            self._channels[topic] = self._sdk.Channel(
                topic, schema=schema, message_encoding="cdr", context=self._context
            )
        self._channels[topic].log(data, log_time=heard_ns)

    def stop(self) -> None:
        """Close the port."""
        self._server.stop()
