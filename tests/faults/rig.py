"""A rig in virtual time: the loop, its table driver and its UDP controller, on a network and a clock in memory.

Nothing of the product is written again here. Conductor, table driver, supervisor and `UdpTable` are those that a test
in the laboratory runs; only the datagrams and the time are of this module.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.loop.conductor import Begun
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import RunRecord
from bmd_rths_core.table.emulated.faults import Faults, FaultyNetwork, parse_fault
from bmd_rths_core.table.transport import Datagram
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_core.table.wire import HostPacket, Kind, encode_host_packet

HOST, STRANGER = ("127.0.0.1", 1), ("127.0.0.1", 2)
SESSION = 7


@dataclass(frozen=True)
class Trial:
    """A test with a fault.

    Parameters
    ----------
    fault : str
        The fault, for a person.
    config : Config
        Configuration of the test.
    begins : int
        Step of the fault.
    faults : tuple of str
        Of network, controller and table, as `parse_fault` takes them.
    command, shear : callable, optional
        What step and value of the command before the supervisor, and of the corrected shear, are turned into.
    beside : callable, optional
        What else happens on the network at each step.
    dies : bool
        The host sends nothing more from that step on.
    must_end : bool
        A test that goes on would be wrong.
    can_rest : bool
        False when nobody can bring the table to rest any more.
    """

    fault: str
    config: Config
    begins: int
    faults: tuple[str, ...] = ()
    command: Callable[[int, float], float] | None = None
    shear: Callable[[int, float], float] | None = None
    beside: Callable[[VirtualNetwork, int], None] | None = None
    dies: bool = False
    must_end: bool = False
    can_rest: bool = True


class VirtualNetwork:
    """Transport and clock of a host, and the controller at the other end: all in virtual time [ns]."""

    def __init__(self, config: Config, faults: Faults) -> None:
        self.controller = make_virtual_controller(config, faults)
        self._there, self._back = (FaultyNetwork(faults, 2 * config.run.seed + i) for i in range(2))
        self._arriving: list[tuple[int, int, bytes]] = []
        self._returning: list[tuple[int, int, bytes]] = []
        self._inbox: list[bytes] = []
        self._number = 0
        self.time = 10**9
        self.cut = False
        self.is_open = False

    # ---- Transport and Clock

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def now(self) -> float:
        return self.time * 1e-9

    def send(self, data: bytes) -> float:
        if not self.cut:
            self._transmit(self._there, self._arriving, data)
        return self.now()

    def receive(self) -> Datagram | None:
        self._deliver()
        return Datagram(self._inbox.pop(0), True) if self._inbox else None

    def wait(self, until: float) -> bool:
        """Let time pass until something arrives."""
        # What is due a rounding error later is a nanosecond away, and not now.
        end = max(self._nanoseconds(until), self.time + (until > self.now()))
        while True:
            self._deliver()
            if self._inbox or self.time >= end:
                return bool(self._inbox)
            self._to_next_event(end)

    def sleep(self, until: float) -> None:
        self.pass_time(self._nanoseconds(until))

    # ---- the world around

    def pass_time(self, until: int) -> None:
        """Let time pass; what arrives is not read."""
        while True:
            self._deliver()
            if self.time >= until:
                return
            self._to_next_event(until)

    def stall(self, seconds: float) -> None:
        """Let the host do nothing for a time."""
        self.pass_time(self.time + round(seconds * 1e9))

    def intrude(self, kind: Kind, step: int, acceleration: float) -> None:
        """Send a packet of another host."""
        packet = HostPacket(kind, step, step, 0, acceleration, math.nan, math.nan, SESSION + 1)
        self.controller.receive(encode_host_packet(packet), STRANGER, self.time)

    def _nanoseconds(self, seconds: float) -> int:
        return math.ceil(seconds * 1e9 - 1e-3)  # what is due is not early

    def _to_next_event(self, until: int) -> None:
        queued = [queue[0][0] for queue in (self._arriving, self._returning) if queue]
        self.time = max(self.time, min(until, self.controller.next_event(self.time), *queued))

    def _deliver(self) -> None:
        controller = self.controller
        while self._arriving and self._arriving[0][0] <= self.time:
            controller.receive(heapq.heappop(self._arriving)[2], HOST, self.time)
        controller.advance(self.time)
        for answer in controller.answers():
            if answer.receiver == HOST:
                self._transmit(self._back, self._returning, answer.data)
        while self._returning and self._returning[0][0] <= self.time:
            self._inbox.append(heapq.heappop(self._returning)[2])

    def _transmit(self, network: FaultyNetwork, queue: list[tuple[int, int, bytes]], data: bytes) -> None:
        for due, arriving in network.transmit(data, self.time):
            self._number += 1
            heapq.heappush(queue, (due, self._number, arriving))


class HostDied(Exception):
    """The process of the host is gone."""


class FaultyLoop(RthsLoop):
    """The loop, with the faults of a trial between its stages."""

    def __init__(self, trial: Trial, network: VirtualNetwork) -> None:
        config = trial.config
        motion = select_ground_motion(config.ground_motion, config.run.time_step)
        super().__init__(config, motion, make_udp_table(config, network, SESSION), network)
        self._trial, self._network = trial, network
        self._now = -1
        if trial.command is not None:
            self._command_shaper = _Altered(self._command_shaper, self, trial.command)  # type: ignore[assignment]
        if trial.shear is not None:
            self._force_correction = _Altered(self._force_correction, self, trial.shear)  # type: ignore[assignment]

    def _on_step(self, begun: Begun) -> None:
        trial, self._now = self._trial, begun.step
        if trial.beside is not None:
            trial.beside(self._network, begun.step)
        if trial.dies and begun.step == trial.begins:
            self._network.cut = True
            raise HostDied
        super()._on_step(begun)


class _Altered:
    """A stage whose output a fault changes."""

    def __init__(self, stage, loop: FaultyLoop, change: Callable[[int, float], float]) -> None:
        self._stage, self._loop, self._change = stage, loop, change

    def __getattr__(self, name: str):
        return getattr(self._stage, name)

    def step(self, *values: float) -> float:
        return self._change(self._loop._now, self._stage.step(*values))


class Rig:
    """A test in virtual time, as the nodes run it in real time."""

    def __init__(self, trial: Trial) -> None:
        config = trial.config
        faults = Faults(parse_fault(text, config.virtual_controller.model) for text in trial.faults)
        self.network = VirtualNetwork(config, faults)
        self.loop = FaultyLoop(trial, self.network)
        self.ended_at = 0
        self.record: RunRecord | None = None

    def run(self) -> tuple[str, str]:
        """Run the test and bring the table to rest; return how and why it ended."""
        conductor = self.loop.conductor
        end = conductor.end

        def noted(*arguments):
            self.ended_at = self.ended_at or self.network.time
            end(*arguments)

        conductor.end = noted
        try:
            record = self.record = self.loop.run()
        except HostDied:
            self.ended_at = self.network.time
            return "failed", "the host is dead"
        return record.outcome, record.reason
