"""Send packets to a table controller and take its answers: one session, with a count of everything that goes wrong."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from bmd_rths_core.safety.displacement_command import TableMotion
from bmd_rths_core.table.config import TableConfig
from bmd_rths_core.table.transport import Datagram, Transport
from bmd_rths_core.table.wire import (
    MODULUS,
    ControllerPacket,
    HostPacket,
    Kind,
    Rejection,
    decode_controller_packet,
    encode_host_packet,
)
from bmd_rths_core.time_steps import StepStamps

#: Most datagrams that are looked at in one go, so that a flood of them does not keep the host.
MOST_DATAGRAMS = 16

#: A command without velocity and displacement.
ACCELERATION_ONLY = TableMotion(math.nan, math.nan)

_COUNTS = (
    *("sent", "answered", "resent", "lost", "late", "duplicate", "wrong_address", "wrong_session", "armed"),
    *(reason.name.lower() for reason in Rejection),
)


class UdpSession:
    """The packets of one session between this host and a table controller.

    Only what comes from the address of the controller, is whole and carries the number of the session is an answer; the
    rest is counted and dropped.

    Parameters
    ----------
    config : TableConfig
        Addresses and time-outs.
    floors : int
        Number of floor accelerometers n.
    stamps : StepStamps
        Test times of the steps.
    transport : Transport
        Datagrams and clock of the host.
    session : int
        Number of the session, 32 bits, that no other host has.

    Attributes
    ----------
    sent_at : float
        When the last packet went out [s].
    """

    def __init__(
        self, config: TableConfig, floors: int, stamps: StepStamps, transport: Transport, session: int
    ) -> None:
        self._config = config
        self._transport = transport
        self._floors = floors
        self._stamps = stamps
        self._session = session
        self._sequence = 0
        self._of_no_use: dict[int, str] = {}
        self._counts = Counter(dict.fromkeys(_COUNTS, 0))
        self.sent_at = -math.inf

    @property
    def where(self) -> str:
        """Address of the controller, as it is configured."""
        return self._config.address

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of packets that were sent, answered, lost and so on."""
        return self._counts

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
        now = self._transport.now
        give_up = now() + self._config.give_up_after
        while (answer := self._receive(sequence, now() + self._config.resend_after)) is None:
            if now() > give_up:
                raise RuntimeError(
                    f"no answer from {self.where} within {self._config.give_up_after:g} s: "
                    "it is not there, or another host is using it"
                )
            self._transport.send(data)
            self._counts["resent"] += 1
        return answer

    def read(self) -> ControllerPacket | None:
        """Return the next answer to this host among the next `MOST_DATAGRAMS`, without waiting; count the others."""
        for _ in range(MOST_DATAGRAMS):
            datagram = self._transport.receive()
            if datagram is None:
                return None
            packet = self._accepted(datagram)
            if packet is not None:
                return packet
        return None

    def expect(self, sequence: int, counted_as: str) -> None:
        """Set under which name a late answer to a packet is counted.

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
        time_ns = self._stamps.of(step) if kind is Kind.COMMAND else 0
        packet = HostPacket(kind, sequence, step, time_ns, acceleration, *motion, self._session)
        data = encode_host_packet(packet)
        self.sent_at = self._transport.send(data)
        self._counts["sent"] += 1
        return sequence, data

    def _receive(self, sequence: int, deadline: float) -> ControllerPacket | None:
        """Return the answer to a packet, or None after the deadline; count what else arrives."""
        while True:
            packet = self.read()
            if packet is not None and packet.sequence == sequence:
                self._counts["answered"] += 1
                return packet
            if packet is not None:
                self.count_unasked(packet.sequence)
            elif not self._transport.wait(deadline):
                return None
            if self._transport.now() > deadline:
                return None

    def _accepted(self, datagram: Datagram) -> ControllerPacket | None:
        if not datagram.from_controller:
            self._counts["wrong_address"] += 1
            return None
        packet = decode_controller_packet(datagram.data, self._floors)
        if isinstance(packet, Rejection):
            self._counts[packet.name.lower()] += 1
            return None
        if packet.session != self._session:
            self._counts["wrong_session"] += 1
            return None
        return packet
