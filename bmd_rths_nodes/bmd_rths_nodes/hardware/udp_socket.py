"""The socket and the clock of a table controller on the network."""

from __future__ import annotations

import secrets
import select
import socket
import time

from bmd_rths_core.config import Config
from bmd_rths_core.table.config import TableConfig, parse_address
from bmd_rths_core.table.transport import Datagram
from bmd_rths_core.table.udp_controller import UdpTable, make_udp_table
from bmd_rths_core.table.wire import LONGEST_DATAGRAM


class UdpSocket:
    """Datagrams over a UDP socket, timed by ``time.perf_counter``: a `bmd_rths_core.table.transport.Transport`.

    Parameters
    ----------
    config : TableConfig
        Addresses.
    """

    def __init__(self, config: TableConfig) -> None:
        self._config = config
        self._socket: socket.socket | None = None
        self._peer = ("", 0)

    @property
    def is_open(self) -> bool:
        """True between `open` and `close`."""
        return self._socket is not None

    def open(self) -> None:
        """Bind the socket, if there is none."""
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
            where = f"{self._config.address} from {self._config.local_address}"
            raise OSError(f"{where}: {error.strerror or error}") from error
        self._socket = link

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def now(self) -> float:
        """Return the time [s]."""
        return time.perf_counter()

    def send(self, data: bytes) -> float:
        """Send a datagram to the controller, and return when."""
        if self._socket is None:
            raise RuntimeError("not connected")
        # A process is held up when the call returns, milliseconds on a busy machine: the datagram has gone by then.
        sent_at = self.now()
        self._socket.sendto(data, self._peer)
        return sent_at

    def receive(self) -> Datagram | None:
        """Return the next datagram that has arrived."""
        while self._socket is not None:
            try:
                data, sender = self._socket.recvfrom(LONGEST_DATAGRAM)
            except BlockingIOError:
                return None
            except OSError:  # an ICMP error of an earlier packet
                continue
            return Datagram(data, sender == self._peer)
        return None

    def wait(self, until: float) -> bool:
        """Wait until a datagram is there."""
        if self._socket is None:
            return False
        return bool(select.select([self._socket], [], [], max(0.0, until - self.now()))[0])

    def sleep(self, until: float) -> None:
        """Wait until a time, whatever arrives."""
        time.sleep(max(0.0, until - self.now()))


def udp_table(config: Config) -> UdpTable:
    """Return the UDP table controller of a configuration on a socket of this computer; nothing is sent yet.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return make_udp_table(config, UdpSocket(config.table), secrets.randbits(32))
