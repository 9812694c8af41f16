"""Table controller over UDP: commands and their answers, with and without waiting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from bmd_rths_core.config import Config
from bmd_rths_core.safety.displacement_command import DisplacementCommand, TableMotion
from bmd_rths_core.table.config import TableConfig
from bmd_rths_core.table.controller import NoAnswer, TableCommand, TableMeasurement
from bmd_rths_core.table.transport import Transport
from bmd_rths_core.table.udp_session import ACCELERATION_ONLY, MOST_DATAGRAMS, UdpSession
from bmd_rths_core.table.wire import MODULUS, ArmMode, ControllerPacket, ControllerState, Kind, interlock_names
from bmd_rths_core.time_steps import StepStamps

#: Time between two packets of a host that waits for the first command [s]; controllers let go of a host after 1 s.
KEEP_ALIVE_PERIOD = 0.25


class _Pending(NamedTuple):
    """A command in real time that is not answered yet."""

    command: TableCommand
    deadline: float


class UdpTable:
    """A table controller on the network, as docs/reference/udp_wire_format.md describes it.

    A command in real time is sent once: without an answer in time its step has no measurement. `begin` and `poll` do
    not wait for it, `exchange` does. All other packets, and commands in lockstep, are sent again with the same sequence
    number until they are answered; the controller recognises that number and does nothing twice.

    Parameters
    ----------
    config : TableConfig
        Addresses and time-outs.
    floors : int
        Number of floor accelerometers n.
    stamps : StepStamps
        Test times of the steps.
    lockstep : bool
        The controller is a simulator that advances one step a command.
    transport : Transport
        Datagrams and clock of the host.
    session : int
        Number of the session, 32 bits, that no other host has.
    motion : DisplacementCommand, optional
        Makes velocity and displacement of each command; without it they are not sent.
    """

    def __init__(
        self,
        config: TableConfig,
        floors: int,
        stamps: StepStamps,
        lockstep: bool,
        transport: Transport,
        session: int,
        motion: DisplacementCommand | None = None,
    ) -> None:
        self._config = config
        self._lockstep = lockstep
        self._motion = motion
        self._transport = transport
        self._link = UdpSession(config, floors, stamps, transport, session)
        self._armed = False
        self._last_step = -1
        self._last_acceleration = 0.0
        self._stop_confirmed = True
        self._pending: dict[int, _Pending] = {}
        self._answer_timeout = config.answer_timeout
        self._keep_alive_due = 0.0

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
        self._transport.open()
        state = self._settled(self._link.ask(Kind.STATUS))
        if state.state is ControllerState.INTERLOCK and self._config.reset_interlock:
            state = self._reset(state)
        if state.state is ControllerState.INTERLOCK:
            raise RuntimeError(
                f"{self._told(state)}; look at the table, then reset the interlock there "
                "or start with table.reset_interlock=true"
            )
        state = self._link.ask(Kind.ARM, ArmMode.LOCKSTEP if self._lockstep else ArmMode.REAL_TIME)
        if state.state is not ControllerState.ARMED:
            raise RuntimeError(f"{self._told(state)} and cannot be armed")
        self._link.count("armed")
        self._armed = True
        self._last_step = -1
        self._last_acceleration = 0.0
        self._pending.clear()
        self._answer_timeout = self._config.answer_timeout
        self._link.forget()
        self._keep_alive_due = self._transport.now() + KEEP_ALIVE_PERIOD
        if self._motion is not None:
            self._motion.reset()

    @property
    def awaiting(self) -> bool:
        """True while the answer to a command is neither there nor given up."""
        return bool(self._pending)

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
        if self._lockstep:
            return self._measured(self._link.ask(Kind.COMMAND, *command, self._next(command)), command)
        self.begin(command)
        while self._pending:
            measurement = self.poll()
            if measurement is not None and measurement.step == command.step:
                return measurement
            self._transport.wait(min((pending.deadline for pending in self._pending.values()), default=0.0))
        raise NoAnswer(f"no answer to step {command.step} within {1e3 * self._config.answer_timeout:g} ms")

    def begin(self, command: TableCommand) -> float:
        """Send a command in real time and return when; `poll` returns its measurement.

        Parameters
        ----------
        command : TableCommand
            As for `exchange`. Commands that are not answered yet stay valid: each answer belongs to one of them.

        Raises
        ------
        OSError
            The network refuses to send.
        RuntimeError
            The table is stopped, or the step lies in the past.
        """
        sequence = self._link.send(Kind.COMMAND, *command, self._next(command))
        sent_at = self._link.sent_at
        self._pending[sequence] = _Pending(command, sent_at + self._answer_timeout)
        return sent_at

    def be_patient(self) -> None:
        """Take answers up to `table.give_up_after` from now on, until the next `connect`."""
        self._answer_timeout = max(self._config.answer_timeout, self._config.give_up_after)

    def poll(self) -> TableMeasurement | None:
        """Return the measurement of a command whose answer has come, without waiting.

        Answers that do not come in time are given up and counted, also those that a newer one has overtaken. Before the
        first command the controller is asked for its status now and then, so that the session lasts.

        Returns
        -------
        TableMeasurement or None

        Raises
        ------
        OSError
            The network refuses to send.
        RuntimeError
            The controller is stopped, in an interlock or idle.
        """
        if not self._armed:
            return None
        self._stay_in_session()
        for _ in range(MOST_DATAGRAMS):
            packet = self._link.read()
            if packet is None:
                break
            if packet.sequence in self._pending:
                while (older := next(iter(self._pending))) != packet.sequence:
                    self._give_up(older)
                command = self._pending.pop(packet.sequence).command
                self._link.count("answered")
                return self._measured(packet, command)
            asked_for = self._link.count_unasked(packet.sequence) == "answered"
            if asked_for and packet.state not in (ControllerState.ARMED, ControllerState.RUNNING):
                raise RuntimeError(self._told(packet))
        now = self._transport.now()
        for sequence in [sequence for sequence, pending in self._pending.items() if pending.deadline <= now]:
            self._give_up(sequence)
        return None

    def stop(self) -> None:
        """Ask for a controlled ramp to rest and wait for its end, no longer than `table.stop_timeout`."""
        if self._armed:
            self._halt(Kind.STOP)

    def emergency_stop(self) -> None:
        """Ask for the emergency stop and wait until it is confirmed."""
        if self._transport.is_open:
            self._halt(Kind.EMERGENCY_STOP)

    def close(self) -> None:
        """Stop the table and release the socket."""
        self.stop()
        self._transport.close()

    @property
    def stop_confirmed(self) -> bool:
        """False while the controller has not said that its table is at rest after the last stop."""
        return self._stop_confirmed

    def statistics(self) -> Mapping[str, str]:
        """Return the counts of packets, and whether the last stop was confirmed."""
        return {
            **{f"udp_{name}": str(count) for name, count in self._link.counts.items()},
            "udp_stop": "confirmed" if self._stop_confirmed else "not confirmed",
        }

    # ---- details

    def _next(self, command: TableCommand) -> TableMotion:
        """Check that a command may be sent now, and return what goes with it."""
        step, skipped = command.step, command.step - self._last_step - 1
        if not self._armed:
            raise RuntimeError(f"command of step {step} refused: the table is stopped")
        if skipped < 0:
            raise RuntimeError(f"command of step {step} refused: step {self._last_step + 1} is next")
        if step >= MODULUS:
            raise RuntimeError(f"command of step {step} refused: the wire format has room for {MODULUS - 1}")
        motion = ACCELERATION_ONLY
        if self._motion is not None:
            for _ in range(skipped):
                self._motion.step(self._last_acceleration)
            motion = self._motion.step(command.acceleration)
        self._last_step, self._last_acceleration = command
        return motion

    def _measured(self, answer: ControllerPacket, command: TableCommand) -> TableMeasurement:
        """Return the sensors in the answer to a command, if the controller runs as it should."""
        if answer.state is not ControllerState.RUNNING:
            raise RuntimeError(self._told(answer))
        # The next command may have been applied before this answer was due.
        if not command.step <= answer.step <= self._last_step:
            raise RuntimeError(
                f"{self._link.where} answers step {command.step}, but the last command it applied is {answer.step}"
            )
        return answer.measurement(command.acceleration)._replace(step=command.step)

    def _stay_in_session(self) -> None:
        """Ask for the status while nothing else is sent. Once there are commands, their absence has to be noticed."""
        now = self._transport.now()
        if self._last_step < 0 and now >= self._keep_alive_due:
            self._keep_alive_due = now + KEEP_ALIVE_PERIOD
            self._link.expect(self._link.send(Kind.STATUS), "answered")

    def _give_up(self, sequence: int) -> None:
        """Count a command in real time as lost: its step has no measurement."""
        del self._pending[sequence]
        self._link.expect(sequence, "late")
        self._link.count("lost")

    def _settled(self, state: ControllerPacket) -> ControllerPacket:
        """Wait until the table does not move any more."""
        give_up = self._transport.now() + self._config.stop_timeout
        while state.state is ControllerState.STOPPING and self._transport.now() < give_up:
            self._transport.sleep(self._transport.now() + self._config.resend_after)
            state = self._link.ask(Kind.STATUS)
        return state

    def _reset(self, state: ControllerPacket) -> ControllerPacket:
        """Reset an interlock, which the controller refuses until its table is at rest."""
        give_up = self._transport.now() + self._config.stop_timeout
        while state.state is ControllerState.INTERLOCK and self._transport.now() < give_up:
            self._transport.sleep(self._transport.now() + self._config.resend_after)
            state = self._link.ask(Kind.RESET)
        return state

    def _halt(self, kind: Kind) -> None:
        self._armed = self._stop_confirmed = False
        for sequence in list(self._pending):
            self._give_up(sequence)
        try:
            state = self._settled(self._link.ask(kind))
        except (OSError, RuntimeError):
            return  # `statistics` tells it; the watchdog of the controller brings the table to rest
        self._stop_confirmed = state.state in (ControllerState.IDLE, ControllerState.INTERLOCK)

    def _told(self, packet: ControllerPacket) -> str:
        state = packet.state.name.lower()
        if packet.state is ControllerState.INTERLOCK:
            return f"{self._link.where} is in an interlock ({interlock_names(packet.interlock)})"
        if packet.state is ControllerState.IDLE:
            return f"{self._link.where} is idle: it was stopped or restarted"
        return f"{self._link.where} is {state}"


def make_udp_table(config: Config, transport: Transport, session: int) -> UdpTable:
    """Return the UDP table controller of a configuration; nothing is sent yet.

    Parameters
    ----------
    config : Config
        The whole configuration.
    transport : Transport
        Datagrams and clock of the host.
    session : int
        Number of the session, 32 bits, that no other host has.
    """
    run, table = config.run, config.table
    table = replace(table, answer_timeout=table.answer_timeout or run.time_step)
    motion = DisplacementCommand(config.safety, run.time_step) if table.send_displacement else None
    floors = len(config.specimen.masses)
    return UdpTable(table, floors, run.stamps, run.lockstep, transport, session, motion)
