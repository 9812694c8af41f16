"""Virtual table controller on UDP: sockets and clock around `bmd_rths_core.table.emulated.virtual_controller`."""

from __future__ import annotations

import heapq
import json
import select
import socket
import time
from collections.abc import Callable
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_core.table.emulated.faults import Fault, Faults, FaultyNetwork
from bmd_rths_core.table.emulated.virtual_controller import VirtualController
from bmd_rths_core.table.wire import LONGEST_DATAGRAM

#: When this process gets no turn for longer, its virtual time stands still, so that the host is not blamed [ns].
LONGEST_STALL = 10_000_000


class Emulator:
    """A UDP server with a virtual table controller, and a control port for faults at run time.

    The control port listens on this computer only. It takes one line of text a datagram and answers with one JSON
    object: ``loss=10`` or any other fault as ``--fault`` takes it, ``clear loss``, ``reset``, ``status``.

    Parameters
    ----------
    controller : VirtualController
        The controller.
    faults : Faults
        Its faults.
    parse : callable
        Reads a fault that its table can have, as `parse_fault` does.
    seed : int
        Seed of the network.
    address : tuple of str and int
        Where to listen; port 0 is any free one.

    Raises
    ------
    OSError
        The address cannot be used.
    """

    def __init__(
        self,
        controller: VirtualController,
        faults: Faults,
        parse: Callable[[str], Fault],
        seed: int,
        address: tuple[str, int],
    ) -> None:
        self._controller = controller
        self._faults = faults
        self._parse = parse
        self._inbound, self._outbound = FaultyNetwork(faults, 2 * seed), FaultyNetwork(faults, 2 * seed + 1)
        self._socket = _bound(address)
        try:
            self._control = _bound(("127.0.0.1", 0))
        except OSError:
            self._socket.close()
            raise
        self._arriving: list[tuple[int, int, bytes, tuple[str, int]]] = []
        self._leaving: list[tuple[int, int, bytes, tuple[str, int]]] = []
        self._number = 0
        self._stalled = 0
        self.answered = 0

    @property
    def port(self) -> int:
        """Port of the controller."""
        return self._socket.getsockname()[1]

    @property
    def control_port(self) -> int:
        """Port for faults at run time, on this computer only."""
        return self._control.getsockname()[1]

    def run(self, ended: Callable[[], bool]) -> None:
        """Serve until the end.

        Parameters
        ----------
        ended : callable
            Asked at least every 0.05 s whether to end.
        """
        clock = time.perf_counter_ns
        try:
            while not ended():
                begin = clock()
                now = begin - self._stalled
                self._serve(now)
                wait = max(0, self._next_event(now) - (clock() - self._stalled))
                readable, _, _ = select.select([self._socket, self._control], [], [], wait * 1e-9)
                late = clock() - begin - wait
                self._stalled += late if late > LONGEST_STALL else 0
                if self._socket in readable:
                    self._read()
                if self._control in readable:
                    self._be_controlled()
        finally:
            self._socket.close()
            self._control.close()

    def statistics(self) -> dict[str, Any]:
        """Return state, interlock, counts, and the true motion of the table: the present one and its peaks."""
        motion, peaks = self._controller.motion._asdict(), self._controller.peaks._asdict()
        return {
            "state": self._controller.state.name.lower(),
            "interlock": int(self._controller.interlock),
            "at_rest": self._controller.at_rest,
            "answered": self.answered,
            "stalled_ms": round(self._stalled * 1e-6, 3),
            **{name: float(f"{value:.6g}") for name, value in motion.items()},
            **{f"peak_{name}": float(f"{value:.6g}") for name, value in peaks.items()},
            **self._controller.counts,
        }

    # ---- details

    def _read(self) -> None:
        now = time.perf_counter_ns() - self._stalled
        while True:
            try:
                data, sender = self._socket.recvfrom(LONGEST_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # an ICMP error of an earlier packet
                continue
            for due, arriving in self._inbound.transmit(data, now):
                self._number += 1
                heapq.heappush(self._arriving, (due, self._number, arriving, sender))

    def _serve(self, now: int) -> None:
        """Receive packets, move the table, and send the answers that are due."""
        controller = self._controller
        while self._arriving and self._arriving[0][0] <= now:
            _, _, data, sender = heapq.heappop(self._arriving)
            controller.receive(data, sender, now)
        controller.advance(now)
        for answer in controller.answers():
            for due, data in self._outbound.transmit(answer.data, now):
                self._number += 1
                heapq.heappush(self._leaving, (due, self._number, data, answer.receiver))
        while self._leaving and self._leaving[0][0] <= now:
            _, _, data, receiver = heapq.heappop(self._leaving)
            try:
                self._socket.sendto(data, receiver)
            except OSError:  # the packet is lost, as on any network
                continue
            self.answered += 1

    def _next_event(self, now: int) -> int:
        queued = [queue[0][0] for queue in (self._arriving, self._leaving) if queue]
        return min([self._controller.next_event(now), *queued])

    def _be_controlled(self) -> None:
        try:
            data, sender = self._control.recvfrom(LONGEST_DATAGRAM)
            self._control.sendto(json.dumps(self._obey(data.decode("utf-8", "replace").strip())).encode(), sender)
        except OSError:
            return

    def _obey(self, line: str) -> dict[str, Any]:
        word, _, rest = line.partition(" ")
        if word == "clear":
            self._faults.clear(rest.strip())
        elif word == "reset":
            self._controller.reset()
        elif word != "status":
            try:
                self._faults.set(self._parse(line))
            except InputError as error:
                return {"error": str(error)}
        return self.statistics()


def _bound(address: tuple[str, int]) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.bind(address)
    except OSError:
        bound.close()
        raise
    bound.setblocking(False)
    return bound
