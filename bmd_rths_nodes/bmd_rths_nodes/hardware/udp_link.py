"""Packets to a table controller and back: one socket, one session, and a count of everything that goes wrong."""

from __future__ import annotations

import math
import secrets
import select
import socket
import time
from collections import Counter
from collections.abc import Mapping

from bmd_rths_core.safety.displacement_command import TableMotion
from bmd_rths_core.table.config import TableConfig, parse_address
from bmd_rths_core.table.wire import (
    LONGEST_DATAGRAM,
    MODULUS,
    ControllerPacket,
    HostPacket,
    Kind,
    Rejection,
    decode_controller_packet,
    encode_host_packet,
)

#: A command without velocity and displacement.
ACCELERATION_ONLY = TableMotion(math.nan, math.nan)

_COUNTS = (
    *("sent", "answered", "resent", "lost", "late", "duplicate", "wrong_address", "wrong_session", "armed"),
    *(reason.name.lower() for reason in Rejection),
)


class UdpLink:
    """The packets of one session between this host and a table controller.

    Only what comes from the address of the controller, is whole and carries the number of the session is an answer; the
    rest is counted and dropped.

    Parameters
    ----------
    config : TableConfig
        Addresses and time-outs.
    floors : int
        Number of floor accelerometers n.
    time_step_ns : int
        Δt [ns].
    """

    def __init__(self, config: TableConfig, floors: int, time_step_ns: int) -> None:
        self._config = config
        self._floors = floors
        self._time_step_ns = time_step_ns
        self._session = secrets.randbits(32)
        self._sequence = 0
        self._socket: socket.socket | None = None
        self._peer = ("", 0)
        self._of_no_use: dict[int, str] = {}
        self._counts = Counter(dict.fromkeys(_COUNTS, 0))

    @property
    def is_open(self) -> bool:
        """True while there is a socket."""
        return self._socket is not None

    @property
    def where(self) -> str:
        """Address of the controller, as a person wrote it."""
        return self._config.address

    @property
    def counts(self) -> Mapping[str, int]:
        """Packets by what became of them."""
        return self._counts

    def open(self) -> None:
        """Bind the socket, if there is none.

        Raises
        ------
        OSError
            An address cannot be used.
        """
        if self._socket is not None:
            return
        local = parse_address("table.local_address", self._config.local_address, any_port=True)
        host, port = parse_address("table.address", self._config.address)
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._peer = (socket.gethostbyname(host), port)
            link.bind(local)
            link.setblocking(False)
        except OSError as error:
            link.close()
            raise OSError(f"{self.where} from {self._config.local_address}: {error.strerror or error}") from error
        self._socket = link

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def count(self, name: str) -> None:
        """Count what happened.

        Parameters
        ----------
        name : str
            What.
        """
        self._counts[name] += 1

    def send(
        self, kind: Kind, step: int = 0, acceleration: float = 0.0, motion: TableMotion = ACCELERATION_ONLY
    ) -> int:
        """Send a new packet once.

        Parameters
        ----------
        kind : Kind
            What is asked for.
        step : int
            Step of a command, or the mode to arm.
        acceleration : float
            Command [m/s²].
        motion : TableMotion
            Velocity and displacement that go with it.

        Returns
        -------
        int
            Sequence number of the packet.

        Raises
        ------
        OSError
            The network refuses to send.
        RuntimeError
            There is no socket.
        """
        return self._send(kind, step, acceleration, motion)[0]

    def ask(
        self, kind: Kind, step: int = 0, acceleration: float = 0.0, motion: TableMotion = ACCELERATION_ONLY
    ) -> ControllerPacket:
        """Send a packet until it is answered.

        Parameters
        ----------
        kind, step, acceleration, motion
            As `send` takes them.

        Returns
        -------
        ControllerPacket

        Raises
        ------
        OSError
            The network refuses to send.
        RuntimeError
            No answer within `table.give_up_after`.
        """
        sequence, data = self._send(kind, step, acceleration, motion)
        give_up = time.perf_counter() + self._config.give_up_after
        while (answer := self._receive(sequence, time.perf_counter() + self._config.resend_after)) is None:
            if time.perf_counter() > give_up:
                raise RuntimeError(
                    f"no answer from {self.where} within {self._config.give_up_after:g} s: "
                    "it is not there, or another host is using it"
                )
            self._connected().sendto(data, self._peer)
            self._counts["resent"] += 1
        return answer

    def readable(self, deadline: float = 0.0) -> bool:
        """Wait for a datagram.

        Parameters
        ----------
        deadline : float
            Until when, by ``time.perf_counter`` [s]; by default look only.
        """
        wait = max(0.0, deadline - time.perf_counter())
        return bool(select.select([self._connected()], [], [], wait)[0])

    def read(self) -> ControllerPacket | None:
        """Read one datagram; None when it is not an answer to this host."""
        try:
            data, sender = self._connected().recvfrom(LONGEST_DATAGRAM)
        except OSError:  # what the network says about packets sent before
            return None
        return self._accepted(data, sender)

    def expect(self, sequence: int, counted_as: str) -> None:
        """Say how the answer to a packet is counted when it comes and nobody waits for it.

        Parameters
        ----------
        sequence : int
            Number of the packet.
        counted_as : str
            Name of the count. Answers that were not announced in this way are duplicates.
        """
        self._of_no_use[sequence] = counted_as

    def count_unasked(self, sequence: int) -> str:
        """Count an answer that nobody waits for.

        Parameters
        ----------
        sequence : int
            Number of the packet it belongs to.

        Returns
        -------
        str
            Name of the count.
        """
        name = self._of_no_use.pop(sequence, "duplicate")
        self._counts[name] += 1
        return name

    def forget(self) -> None:
        """Expect no answer any more."""
        self._of_no_use.clear()

    # ---- details

    def _send(self, kind: Kind, step: int, acceleration: float, motion: TableMotion) -> tuple[int, bytes]:
        sequence = self._sequence
        self._sequence = (sequence + 1) % MODULUS
        time_ns = step * self._time_step_ns if kind is Kind.COMMAND else 0
        packet = HostPacket(kind, sequence, step, time_ns, acceleration, *motion, self._session)
        data = encode_host_packet(packet)
        self._connected().sendto(data, self._peer)
        self._counts["sent"] += 1
        return sequence, data

    def _receive(self, sequence: int, deadline: float) -> ControllerPacket | None:
        """Return the answer to a packet, or None after the deadline; count what else arrives."""
        while self.readable(deadline):
            packet = self.read()
            if packet is not None and packet.sequence == sequence:
                self._counts["answered"] += 1
                return packet
            if packet is not None:
                self.count_unasked(packet.sequence)
            if time.perf_counter() > deadline:
                break
        return None

    def _accepted(self, data: bytes, sender: tuple[str, int]) -> ControllerPacket | None:
        if sender != self._peer:
            self._counts["wrong_address"] += 1
            return None
        packet = decode_controller_packet(data, self._floors)
        if isinstance(packet, Rejection):
            self._counts[packet.name.lower()] += 1
            return None
        if packet.session != self._session:
            self._counts["wrong_session"] += 1
            return None
        return packet

    def _connected(self) -> socket.socket:
        if self._socket is None:
            raise RuntimeError("not connected")
        return self._socket
