"""Table controller over UDP: one socket, one session, and a count of everything that goes wrong on the way."""

from __future__ import annotations

import math
import secrets
import select
import socket
import time
from collections import Counter
from collections.abc import Mapping

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.controller import NoAnswer, TableCommand, TableMeasurement
from bmd_rths_core.table.selection import TableConfig, parse_address
from bmd_rths_core.table.wire import (
    MODULUS,
    ArmMode,
    ControllerPacket,
    ControllerState,
    HostPacket,
    Kind,
    Rejection,
    decode_controller_packet,
    encode_host_packet,
    interlock_names,
)

#: Longer than any packet, so that a datagram that is too long is seen as such.
LONGEST_DATAGRAM = 4096

_COUNTS = (
    *("sent", "answered", "resent", "lost", "late", "duplicate", "wrong_address", "wrong_session", "armed"),
    *(reason.name.lower() for reason in Rejection),
)


class UdpTable:
    """A table controller on the network, as docs/udp_wire_format.md describes it.

    A command in real time is sent once: without an answer in time its step has no measurement (`NoAnswer`). All other
    packets, and commands in lockstep, are sent again with the same sequence number until they are answered; the
    controller recognises that number and does nothing twice.

    Parameters
    ----------
    config : TableConfig
        Addresses and time-outs.
    floors : int
        Number of floor accelerometers n.
    time_step_ns : int
        Δt [ns].
    lockstep : bool
        The controller is a simulator that advances one step a command.
    """

    def __init__(self, config: TableConfig, floors: int, time_step_ns: int, lockstep: bool) -> None:
        self._config = config
        self._floors = floors
        self._time_step_ns = time_step_ns
        self._lockstep = lockstep
        self._session = secrets.randbits(32)
        self._sequence = 0
        self._socket: socket.socket | None = None
        self._peer = ("", 0)
        self._armed = False
        self._last_step = -1
        self._stop_confirmed = True
        self._lost: set[int] = set()
        self._counts = Counter(dict.fromkeys(_COUNTS, 0))

    def connect(self) -> None:
        """Find the controller, wait until it is at rest, and arm it.

        Raises
        ------
        OSError
            An address cannot be used.
        RuntimeError
            The controller does not answer, is in an interlock or is used by another host.
        """
        self.stop()
        if self._socket is None:
            self._open()
        state = self._settled(self._asked(Kind.STATUS))
        if state.state is ControllerState.INTERLOCK and self._config.reset_interlock:
            state = self._reset(state)
        if state.state is ControllerState.INTERLOCK:
            raise RuntimeError(
                f"{self._told(state)}; look at the table, then reset it there or set table.reset_interlock"
            )
        state = self._asked(Kind.ARM, ArmMode.LOCKSTEP if self._lockstep else ArmMode.REAL_TIME)
        if state.state is not ControllerState.ARMED:
            raise RuntimeError(f"{self._told(state)} and cannot be armed")
        self._counts["armed"] += 1
        self._armed = True
        self._last_step = -1
        self._lost.clear()

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Send a command and wait for the answer to exactly this command.

        Parameters
        ----------
        command : TableCommand
            The command. Steps that were skipped are those the controller held the last command for.

        Returns
        -------
        TableMeasurement
            Sensors of the answer.

        Raises
        ------
        NoAnswer
            Real time only: the answer did not come in time.
        OSError
            The network refuses to send.
        RuntimeError
            The controller is stopped, in an interlock, idle or silent, or the step lies in the past.
        """
        step = command.step
        if not self._armed:
            raise RuntimeError(f"command of step {step} refused: the table is stopped")
        if step <= self._last_step:
            raise RuntimeError(f"command of step {step} refused: step {self._last_step + 1} is next")
        self._last_step = step
        if self._lockstep:
            answer = self._asked(Kind.COMMAND, step, command.acceleration)
        else:
            sequence, _ = self._send(Kind.COMMAND, step, command.acceleration)
            received = self._receive(sequence, time.perf_counter() + self._config.answer_timeout)
            if received is None:
                self._counts["lost"] += 1
                self._lost.add(sequence)
                raise NoAnswer(f"no answer to step {step} within {1e3 * self._config.answer_timeout:g} ms")
            answer = received
        if answer.state is not ControllerState.RUNNING:
            raise RuntimeError(self._told(answer))
        if answer.step != step:
            raise RuntimeError(f"{self._where()} answers step {step}, but the last command it applied is {answer.step}")
        return answer.measurement(command.acceleration)

    def stop(self) -> None:
        """Ask for a controlled ramp to rest and wait for its end, no longer than `table.stop_timeout`."""
        if self._armed:
            self._halt(Kind.STOP)

    def emergency_stop(self) -> None:
        """Ask for the emergency stop and wait until it is confirmed."""
        if self._socket is not None:
            self._halt(Kind.EMERGENCY_STOP)

    def close(self) -> None:
        """Stop the table and release the socket."""
        self.stop()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def statistics(self) -> Mapping[str, str]:
        """Return the counts of packets, and whether the last stop was confirmed."""
        return {
            **{f"udp_{name}": str(count) for name, count in self._counts.items()},
            "udp_stop": "confirmed" if self._stop_confirmed else "not confirmed",
        }

    # ---- details

    def _open(self) -> None:
        local = parse_address("table.local_address", self._config.local_address, any_port=True)
        host, port = parse_address("table.address", self._config.address)
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._peer = (socket.gethostbyname(host), port)
            link.bind(local)
            link.setblocking(False)
        except OSError as error:
            link.close()
            raise OSError(f"{self._where()} from {self._config.local_address}: {error.strerror or error}") from error
        self._socket = link

    def _send(self, kind: Kind, step: int = 0, acceleration: float = 0.0) -> tuple[int, bytes]:
        """Send a new packet and return its sequence number and bytes."""
        sequence = self._sequence
        self._sequence = (sequence + 1) % MODULUS
        time_ns = step * self._time_step_ns if kind is Kind.COMMAND else 0
        packet = HostPacket(kind, sequence, step, time_ns, acceleration, math.nan, math.nan, self._session)
        data = encode_host_packet(packet)
        self._link().sendto(data, self._peer)
        self._counts["sent"] += 1
        return sequence, data

    def _asked(self, kind: Kind, step: int = 0, acceleration: float = 0.0) -> ControllerPacket:
        """Send a packet until it is answered."""
        sequence, data = self._send(kind, step, acceleration)
        give_up = time.perf_counter() + self._config.give_up_after
        while (answer := self._receive(sequence, time.perf_counter() + self._config.resend_after)) is None:
            if time.perf_counter() > give_up:
                break
            self._link().sendto(data, self._peer)
            self._counts["resent"] += 1
        else:
            return answer
        raise RuntimeError(f"no answer from {self._where()} within {self._config.give_up_after:g} s")

    def _receive(self, sequence: int, deadline: float) -> ControllerPacket | None:
        """Return the answer to a packet, or None after the deadline; count what else arrives."""
        link, clock = self._link(), time.perf_counter
        while select.select([link], [], [], max(0.0, deadline - clock()))[0]:
            try:
                data, sender = link.recvfrom(LONGEST_DATAGRAM)
            except OSError:  # what the network says about packets sent before
                continue
            packet = self._accepted(data, sender)
            if packet is not None and packet.sequence == sequence:
                self._counts["answered"] += 1
                return packet
            if packet is not None:
                self._count_old(packet.sequence)
            if clock() > deadline:
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

    def _count_old(self, sequence: int) -> None:
        self._counts["late" if sequence in self._lost else "duplicate"] += 1
        self._lost.discard(sequence)

    def _settled(self, state: ControllerPacket) -> ControllerPacket:
        """Wait until the table does not move any more."""
        give_up = time.perf_counter() + self._config.stop_timeout
        while state.state is ControllerState.STOPPING and time.perf_counter() < give_up:
            time.sleep(self._config.resend_after)
            state = self._asked(Kind.STATUS)
        return state

    def _reset(self, state: ControllerPacket) -> ControllerPacket:
        """Reset an interlock, which the controller refuses until its table is at rest."""
        give_up = time.perf_counter() + self._config.stop_timeout
        while state.state is ControllerState.INTERLOCK and time.perf_counter() < give_up:
            time.sleep(self._config.resend_after)
            state = self._asked(Kind.RESET)
        return state

    def _halt(self, kind: Kind) -> None:
        self._armed = self._stop_confirmed = False
        try:
            state = self._settled(self._asked(kind))
        except (OSError, RuntimeError):
            return  # told by `statistics`; the watchdog of the controller brings the table to rest
        self._stop_confirmed = state.state in (ControllerState.IDLE, ControllerState.INTERLOCK)

    def _link(self) -> socket.socket:
        if self._socket is None:
            raise RuntimeError("not connected")
        return self._socket

    def _where(self) -> str:
        return self._config.address

    def _told(self, packet: ControllerPacket) -> str:
        state = packet.state.name.lower()
        if packet.state is ControllerState.INTERLOCK:
            return f"{self._where()} is in an interlock ({interlock_names(packet.interlock)})"
        if packet.state is ControllerState.IDLE:
            return f"{self._where()} is idle: it was stopped or restarted"
        return f"{self._where()} is {state}"


def make_udp_table(config: Config) -> UdpTable:
    """Return the UDP table controller of a configuration; nothing is sent yet.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        The answer time-out is not shorter than the time step.
    """
    run, table = config.run, config.table
    if not run.lockstep and table.answer_timeout >= run.time_step:
        raise InputError(
            f"table.answer_timeout: {table.answer_timeout:g} s is not allowed; "
            f"less than run.time_step, {run.time_step:g} s, is required"
        )
    return UdpTable(table, len(config.specimen.masses), run.time_step_ns, run.lockstep)
