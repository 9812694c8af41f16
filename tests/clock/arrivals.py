"""A table controller on UDP that notes when each packet arrives: what the far end of the wire sees, by the clock.

It moves an ideal, rigid table: the acceleration is the command, held until the next one. Arrival is stamped by the
kernel, so that this process being late changes nothing.
"""

from __future__ import annotations

import math
import random
import select
import socket
import struct
import threading
import time
from typing import NamedTuple

import numpy as np

from bmd_rths_core.table.wire import (
    ControllerPacket,
    ControllerState,
    Interlock,
    Kind,
    Rejection,
    decode_host_packet,
    encode_controller_packet,
)

#: Linux, not in the socket module of Python.
SO_TIMESTAMPNS = 35


class Arrival(NamedTuple):
    """A packet: when it arrived [s, wall clock], what it was, step and acceleration of a command."""

    time: float
    kind: Kind
    step: int
    acceleration: float


class Held(NamedTuple):
    """What became of commands that were each held until the next one."""

    velocity: float  # at the end [m/s]
    displacement: float  # at the end [m]
    largest_velocity: float
    largest_displacement: float


class ArrivalController:
    """The controller, in a thread of its own.

    Parameters
    ----------
    answer_after : float or callable
        Time from a command to its answer [s], or step to that.
    floors : int
        Floors of the rigid specimen.
    lost : callable, optional
        Step to whether its answer is lost.
    floor_gain : float
        Part of the acceleration of the table that the floors have; the loop is unstable when it is large.
    """

    def __init__(self, answer_after=0.003, floors=2, lost=lambda step: False, floor_gain=1.0):
        self.arrivals: list[Arrival] = []
        self._answer_after = answer_after if callable(answer_after) else lambda step: answer_after
        self._floors, self._lost, self._floor_gain = floors, lost, floor_gain
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._state = ControllerState.IDLE
        self._at, self._x, self._v, self._a, self._step = 0.0, 0.0, 0.0, 0.0, 0
        self._random = random.Random(0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    @property
    def address(self):
        return f"udp://127.0.0.1:{self._socket.getsockname()[1]}"

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self._socket.close()

    @property
    def commands(self) -> list[Arrival]:
        return [arrival for arrival in self.arrivals if arrival.kind is Kind.COMMAND]

    def _serve(self):
        owed = []
        while not self._ended.is_set():
            wait = min((due for due, *_ in owed), default=math.inf) - time.time()
            select.select([self._socket], [], [], min(max(0.0, wait), 0.05))
            while self._read(owed):
                pass
            now = time.time()
            for due, packet, sender in [item for item in owed if item[0] <= now]:
                owed.remove((due, packet, sender))
                self._answer(packet, sender)

    def _read(self, owed):
        try:
            data, ancillary, _, sender = self._socket.recvmsg(200, 100)
        except BlockingIOError:
            return False
        seconds, nanoseconds = struct.unpack("qq", ancillary[0][2][:16])
        arrived = seconds + 1e-9 * nanoseconds
        packet = decode_host_packet(data)
        assert not isinstance(packet, Rejection)
        self.arrivals.append(Arrival(arrived, packet.kind, packet.step, packet.acceleration))
        if packet.kind is Kind.COMMAND:
            self._hold(arrived, packet.acceleration)
            self._state, self._step = ControllerState.RUNNING, packet.step
            if not self._lost(packet.step):
                owed.append((arrived + self._answer_after(packet.step), packet, sender))
            return True
        if packet.kind is Kind.ARM:
            self._state = ControllerState.ARMED
            self._at, self._x, self._v, self._a, self._step = arrived, 0.0, 0.0, 0.0, 0
        elif packet.kind in (Kind.STOP, Kind.RESET):
            self._state = ControllerState.IDLE
        elif packet.kind is Kind.EMERGENCY_STOP:
            self._state = ControllerState.INTERLOCK
        self._answer(packet, sender)
        return True

    def _noise(self):
        return [self._random.gauss(0.0, 1e-3) for _ in range(self._floors)]

    def _hold(self, until, then):
        duration = until - self._at
        self._x += duration * (self._v + 0.5 * duration * self._a)
        self._v += duration * self._a
        self._at, self._a = until, then

    def _answer(self, packet, sender):
        self._hold(time.time(), self._a)
        interlock = Interlock.EMERGENCY_STOP if self._state is ControllerState.INTERLOCK else Interlock(0)
        answer = ControllerPacket(
            state=self._state,
            sequence=packet.sequence,
            step=self._step,
            interlock=interlock,
            clock=time.monotonic_ns(),
            displacement=self._x,
            acceleration=self._a + self._random.gauss(0.0, 1e-3),
            actuator_force=0.0,
            base_shear=math.nan,
            floor_accelerations=tuple(
                self._floor_gain * self._a + self._random.gauss(0.0, 1e-3) for _ in range(self._floors)
            ),
            session=packet.session,
        )
        self._socket.sendto(encode_controller_packet(answer), sender)


def held(commands: list[Arrival]) -> Held:
    """Integrate commands that were each held until the next one arrived; the last one, which is zero, for no time."""
    times = np.array([arrival.time for arrival in commands])
    accelerations = np.array([arrival.acceleration for arrival in commands])
    durations = np.diff(times)
    steps = accelerations[:-1] * durations
    velocity = np.concatenate(([0.0], np.cumsum(steps)))
    displacement = np.concatenate(([0.0], np.cumsum(durations * (velocity[:-1] + 0.5 * steps))))
    return Held(velocity[-1], displacement[-1], np.abs(velocity).max(), np.abs(displacement).max())


def periods(commands: list[Arrival]) -> np.ndarray:
    """Return the times between commands [s]."""
    return np.diff([arrival.time for arrival in commands])
