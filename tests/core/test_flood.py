"""A flood of datagrams on the port of the host keeps it from nothing: neither polling nor its way to rest."""

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.transport import Datagram
from bmd_rths_core.table.udp_controller import make_udp_table
from tests.faults.rig import SESSION, VirtualNetwork

CONFIG = Config().changed(virtual_controller__model="servo")


class Flooded(VirtualNetwork):
    """Between two answers there is always something that nobody has asked for."""

    nonsense = None
    answers_every = 10
    received = 0

    def receive(self):
        self.received += 1
        assert self.received < 5000, "the host reads for ever"
        if self.nonsense is None or self.received % self.answers_every == 0:
            return super().receive()
        return self.nonsense


@pytest.mark.parametrize(
    ("nonsense", "counted"),
    [(Datagram(b"x", True), "udp_length"), (Datagram(bytes(88), False), "udp_wrong_address")],
)
def test_a_flood_does_not_keep_the_host(nonsense, counted):
    network = Flooded(CONFIG, Faults([]))
    table = make_udp_table(CONFIG, network, SESSION)
    table.connect()
    network.nonsense, measured = nonsense, []
    for step in range(20):
        network.received = 0
        table.begin(TableCommand(step, 0.0))
        for _ in range(10):
            network.stall(0.0005)
            if (measurement := table.poll()) is not None:
                measured.append(measurement.step)
    assert measured == list(range(20))
    assert int(table.statistics()[counted]) > 1000
    network.received = 0
    table.close()
    assert table.stop_confirmed


def test_nothing_but_nonsense_is_left_for_the_next_look():
    network = Flooded(CONFIG, Faults([]))
    table = make_udp_table(CONFIG, network, SESSION)
    table.connect()
    network.nonsense, network.answers_every = Datagram(b"x", True), 10**6
    assert table.poll() is None
