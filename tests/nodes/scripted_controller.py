"""A table controller at the far end of a UDP line that answers as a test says."""

import math
import socket
import threading
from collections import Counter

from bmd_rths_core.table.wire import (
    ControllerPacket,
    ControllerState,
    Interlock,
    Kind,
    decode_host_packet,
    encode_controller_packet,
)
from tests.nodes.emulation import LOCKSTEP

#: No thread of a busy machine is this late; a lost answer or a silent host is what the test says it is.
PATIENT = {"table__answer_timeout": 0.09, "run__time_step": 0.1, "virtual_controller__watchdog": 5.0}
REAL_TIME = LOCKSTEP.changed(run__lockstep=False, **PATIENT)


def counts(table):
    return {name.removeprefix("udp_"): int(n) for name, n in table.statistics().items() if n.isdigit()}


def answer_to(packet, state=ControllerState.RUNNING, **changes):
    """Return an ordinary answer to a packet, with some fields changed."""
    fields = {"sequence": packet.sequence, "step": packet.step, "session": packet.session, "acceleration": 0.5}
    fields |= changes
    bits = fields.pop("interlock", Interlock(0))
    floors = fields.pop("floors", (1.0, 2.0))
    return encode_controller_packet(
        ControllerPacket(
            state=state,
            interlock=bits,
            clock=0,
            displacement=0.0,
            actuator_force=0.0,
            base_shear=math.nan,
            floor_accelerations=floors,
            **fields,
        )
    )


class Script:
    """A controller that arms like any other one, and answers commands as a test says."""

    def __init__(self, on_command):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.datagrams = []
        self.state = self.after_stop = ControllerState.IDLE
        self.received = Counter()
        self._on_command = on_command
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        while not self._ended.is_set():
            try:
                data, self.host = self.socket.recvfrom(100)
            except TimeoutError:
                continue
            packet = decode_host_packet(data)
            self.datagrams.append(data)
            self.received[packet.kind] += 1
            if packet.kind is Kind.COMMAND:
                for answer in self._on_command(packet):
                    self.socket.sendto(answer, self.host)
            else:
                if packet.kind is not Kind.STATUS:
                    self.state = ControllerState.ARMED if packet.kind is Kind.ARM else self.after_stop
                bits = Interlock.EMERGENCY_STOP if self.state is ControllerState.INTERLOCK else Interlock(0)
                self.socket.sendto(answer_to(packet, self.state, interlock=bits), self.host)

    def close(self):
        self._ended.set()
        self._thread.join()
        self.socket.close()
        self.other.close()
