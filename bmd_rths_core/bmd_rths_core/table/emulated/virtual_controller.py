"""A table controller with its table, as a model: the other end of the UDP wire format, without socket and clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.config import VirtualControllerConfig
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.emulated.return_to_rest import at_rest, return_acceleration
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.emulated.virtual_table import VirtualTable
from bmd_rths_core.table.wire import (
    MODULUS,
    ArmMode,
    ControllerPacket,
    ControllerState,
    HostPacket,
    Interlock,
    Kind,
    Rejection,
    decode_host_packet,
    encode_controller_packet,
)

NAN = float("nan")

#: Host and port of whoever sent a packet; only compared here.
Address = tuple[str, int]

#: In real time the table is simulated in steps of this length [ns].
SUBSTEP = 500_000

#: The table is moved at least this often, so that little is left to simulate when an answer is due [ns].
LONGEST_PAUSE = 1_000_000

#: A table that is asked for no more motion lags behind and may ring: it is controlled until its velocity [m/s] ...
STILL = 1e-3

#: ... has been smaller for this long [s], ...
SETTLING_TIME = 0.3

#: ... but no longer than this: without oil pressure, say, it would never be still [s].
LONGEST_SETTLING = 3.0

#: A table that was let go of is at rest below this velocity [m/s]; it may ring a little longer than it is controlled.
RESTING = 1e-2

#: A host that has been silent for longer loses its session to another one, unless its table is moving [ns].
SESSION_SILENCE = 1_000_000_000


class Answer(NamedTuple):
    """A packet that is due.

    Parameters
    ----------
    due : int
        When to send it [ns].
    receiver : Address
        Where to.
    data : bytes
        The packet.
    """

    due: int
    receiver: Address
    data: bytes


class _Owed(NamedTuple):
    """An answer that is due later, with the sensors as they are then."""

    due: int
    sequence: int


class VirtualController:
    """State machine, interlocks and watchdog of a table controller around the model of a table.

    Parameters
    ----------
    config : VirtualControllerConfig
        Answers and limits.
    make_table : callable
        Makes the table for a time step [s]; called whenever the controller is armed.
    floors : int
        Number of floor accelerometers n.
    time_step : float
        Δt of lockstep [s].
    faults : Faults
        Faults, which may change at any time.

    Attributes
    ----------
    state : ControllerState
        What it does.
    interlock : Interlock
        Why it brought its table to rest by itself.
    counts : Counter
        Counts packets by how they were treated (answered, late, refused, …), sessions and interlocks.
    motion : TrueMotion
        True motion of the table, the last one when the controller has let go of it.
    peaks : TrueMotion
        Largest absolute values of it since the beginning.
    """

    _table: VirtualTable | None
    _stuck: float | None
    _next_step: int

    def __init__(
        self,
        config: VirtualControllerConfig,
        make_table: Callable[[float], VirtualTable],
        floors: int,
        time_step: float,
        faults: Faults,
    ) -> None:
        self._config = config
        self._hard_limits = (
            (Interlock.DISPLACEMENT, config.displacement_limit),
            (Interlock.VELOCITY, config.velocity_limit),
            (Interlock.ACCELERATION, config.acceleration_limit),
            (Interlock.FORCE, config.force_limit),
            (Interlock.TRACKING, config.tracking_limit),
        )
        self._make_table = make_table
        self._time_step = time_step
        self._faults = faults
        self._answer_after = round(config.answer_after * 1e9)
        self._watchdog = round(config.watchdog * 1e9)
        self._nothing = TableMeasurement(0, 0.0, NAN, NAN, NAN, NAN, (NAN,) * floors)  # type: ignore[arg-type]
        self.state = ControllerState.IDLE
        self.interlock = Interlock(0)
        self.counts: Counter[str] = Counter()
        self.motion = self.peaks = TrueMotion()
        self._owner: tuple[int, Address] | None = None
        self._sequence: int | None = None
        self._last_answer = b""
        self._heard = 0
        self._answers: list[Answer] = []
        self._at_rest()

    # ---- for the server

    @property
    def at_rest(self) -> bool:
        """True when the table stands: before the controller is armed, and when it has let go of a table at rest."""
        return self._table is None and abs(self.motion.velocity) < RESTING

    def receive(self, data: bytes, sender: Address, now: int) -> None:
        """Take a datagram.

        Parameters
        ----------
        data : bytes
            The datagram.
        sender : Address
            Where it comes from.
        now : int
            Time [ns], never less than before.
        """
        self.advance(now)
        packet = decode_host_packet(data)
        if isinstance(packet, Rejection):
            self.counts[packet.name.lower()] += 1
        elif self._belongs(packet, sender, now):
            self._heard = now
            if packet.sequence == self._sequence:
                self.counts["duplicate"] += 1
                if self._last_answer:
                    self._answers.append(Answer(now, sender, self._last_answer))
            elif self._sequence is not None and (packet.sequence - self._sequence) % MODULUS > MODULUS // 2:
                self.counts["old"] += 1
            else:
                self.counts["received"] += 1
                self._sequence = packet.sequence
                self._last_answer = b""
                if not self._do(packet, now):
                    self._answer(packet.sequence, now)

    def advance(self, now: int) -> None:
        """Let time pass: move the table, answer what is owed, watch the host.

        Parameters
        ----------
        now : int
            Time [ns].
        """
        while self._owed and self._owed[0].due <= now:
            owed = self._owed.pop(0)
            self._move(owed.due)
            self._answer(owed.sequence, owed.due)
        self._move(now)

    def answers(self) -> list[Answer]:
        """Return the packets that are due and forget them."""
        due, self._answers = self._answers, []
        return due if not self._faults.active("dead") else []

    def next_event(self, now: int) -> int:
        """Return when to call `advance` again at the latest [ns].

        Parameters
        ----------
        now : int
            Time [ns].
        """
        if self._table is None or self._lockstep:
            return now + 50_000_000
        return min(now + LONGEST_PAUSE, self._owed[0].due if self._owed else MODULUS**2)

    def reset(self) -> None:
        """Reset an interlock, when the table is at rest."""
        if self.state is ControllerState.INTERLOCK and self._table is None:
            self.state = ControllerState.IDLE
            self.interlock = Interlock(0)

    # ---- packets

    def _belongs(self, packet: HostPacket, sender: Address, now: int) -> bool:
        """Tell whether a packet is of the session; any packet begins one when no host has the table."""
        if self._owner == (packet.session, sender):
            return True
        silent = now - self._heard > SESSION_SILENCE and (self._lockstep or self.state is not ControllerState.STOPPING)
        if self._owner is None or self.state is ControllerState.IDLE or silent:
            self._owner = (packet.session, sender)
            self._sequence = None
            self.counts["sessions"] += 1
            if self.state is not ControllerState.INTERLOCK:
                self.state = ControllerState.IDLE
                self._at_rest()
            return True
        self.counts["wrong_session" if packet.session != self._owner[0] else "wrong_address"] += 1
        return False

    def _do(self, packet: HostPacket, now: int) -> bool:
        """Do what a packet asks for, and return whether its answer comes later."""
        if self._faults.active("frozen"):
            return False
        moving = self.state in (ControllerState.ARMED, ControllerState.RUNNING)
        if packet.kind is Kind.COMMAND and moving:
            return self._command(packet, now)
        if packet.kind is Kind.ARM and self.state in (ControllerState.IDLE, ControllerState.ARMED):
            self._arm(packet.step == ArmMode.LOCKSTEP, now)
        elif packet.kind is Kind.STOP and moving:
            self.state = ControllerState.STOPPING
        elif packet.kind is Kind.EMERGENCY_STOP:
            self._trip(Interlock.EMERGENCY_STOP)
        elif packet.kind is Kind.RESET:
            self.reset()
        if self._lockstep:
            self._return_at_once()
        return False

    def _arm(self, lockstep: bool, now: int) -> None:
        self._at_rest()
        self._lockstep = lockstep
        self._table = self._make_table(self._time_step if lockstep else SUBSTEP * 1e-9)
        self._moved = now
        self.state = ControllerState.ARMED

    def _command(self, packet: HostPacket, now: int) -> bool:
        if packet.step < self._next_step:
            self._trip(Interlock.BAD_PACKET)
            return False
        self._faults.reached(packet.step)
        if self._faults.active("frozen"):
            return False
        self.state = ControllerState.RUNNING
        self._applied, self._next_step = packet.step, packet.step + 1
        if not self._lockstep:
            self._held = packet.acceleration
            self._owed.append(_Owed(now + self._answer_after, packet.sequence))
            return True
        self._exchange(packet.step, packet.acceleration)
        self._return_at_once()
        return False

    def _answer(self, sequence: int, due: int) -> None:
        if self._owner is None:
            return
        session, sender = self._owner
        sensors = self._sensed()
        packet = ControllerPacket(
            state=self.state,
            sequence=sequence,
            step=self._applied,
            interlock=self.interlock,
            clock=due,
            displacement=sensors[1],
            acceleration=sensors[0],
            actuator_force=sensors[2],
            base_shear=sensors[3],
            floor_accelerations=tuple(sensors[4:]),
            session=session,
        )
        data = encode_controller_packet(packet)
        if sequence == self._sequence:
            self._last_answer = data
        self._answers.append(Answer(due, sender, data))

    def _sensed(self) -> list[float]:
        """Return the sensors in the order that the fault ``stuck`` counts them."""
        m = self._measurement
        sensors = [m.table_acceleration, m.table_displacement, m.actuator_force, m.base_shear, *m.floor_accelerations]
        if self._faults.active("nan"):
            sensors[min(int(self._faults.value("nan")), len(sensors) - 1)] = NAN
        if self._faults.active("stuck"):
            index = min(int(self._faults.value("stuck")), len(sensors) - 1)
            self._stuck = sensors[index] if self._stuck is None else self._stuck
            sensors[index] = self._stuck
        else:
            self._stuck = None
        return sensors

    # ---- table

    def _at_rest(self) -> None:
        """Forget the last test."""
        self._table = None
        self._lockstep = False
        self._measurement = self._nothing
        self._stuck = None
        self._owed: list[_Owed] = []
        self._held = 0.0
        self._applied = self._next_step = 0
        self._moved = self._substeps = 0
        self._settled = self._asked = 0.0
        self._faults.reached(-1)

    def _trip(self, reason: Interlock) -> None:
        if self.state is not ControllerState.INTERLOCK:
            self.counts[f"interlock_{reason.name}".lower()] += 1
        self.state = ControllerState.INTERLOCK
        self.interlock |= reason

    def _move(self, until: int) -> None:
        """Move the table in real time."""
        if self._table is None or self._lockstep:
            return
        if self._faults.active("frozen"):
            self._moved = until
            return
        while self._table is not None and self._moved + SUBSTEP <= until:
            self._moved += SUBSTEP
            if self.state is ControllerState.RUNNING:
                if self._moved - self._heard > self._watchdog:
                    self._trip(Interlock.WATCHDOG)
                self._exchange(self._substeps, self._held)
            elif self.state is ControllerState.ARMED:
                self._exchange(self._substeps, 0.0)
            else:
                self._return(self._substeps, SUBSTEP * 1e-9)
            self._substeps += 1

    def _return(self, step: int, duration: float) -> None:
        """Go one step back to rest, and let go of the table when it is there."""
        table = self._table
        if table is None:
            return
        displacement, velocity = table.reference
        asked_to_rest = at_rest(displacement, velocity)
        self._asked = self._asked + duration if asked_to_rest else 0.0
        self._settled = self._settled + duration if asked_to_rest and abs(self.motion.velocity) < STILL else 0.0
        if self._settled > SETTLING_TIME or self._asked > LONGEST_SETTLING:
            self._table = None
            if self.state is ControllerState.STOPPING:
                self.state = ControllerState.IDLE
        else:
            frequency = self._config.return_frequency
            way = return_acceleration(displacement, velocity, frequency, duration)
            self._exchange(step, 0.0 if asked_to_rest else way)

    def _return_at_once(self) -> None:
        """In lockstep time stands still between commands, so the table is at rest before the answer."""
        while self._table is not None and self.state in (ControllerState.STOPPING, ControllerState.INTERLOCK):
            self._return(self._next_step, self._time_step)
            self._next_step += 1

    def _exchange(self, step: int, acceleration: float) -> None:
        table = self._table
        if table is None:
            return
        table.degrade(self._faults.value("valve", 100.0) / 100.0, self._faults.value("pressure", 100.0) / 100.0)
        measured = self._measurement = table.exchange(TableCommand(step, acceleration))
        self.motion = table.motion
        self.peaks = self.peaks.peaks(self.motion)
        displacement, velocity = table.reference
        sensed = (measured.table_displacement, velocity, measured.table_acceleration, measured.actuator_force)
        error = measured.table_displacement - displacement
        for (reason, limit), value in zip(self._hard_limits, (*sensed, error), strict=True):
            if abs(value) > limit:
                self._trip(reason)
