"""ROS domains for tests: each is one test's at a time, whoever else runs these tests on this computer."""

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_DOMAINS = 100

#: UDP ports of DDS: those of domain d begin here, and d times so many further.
_FIRST_PORT, _PORTS = 7400, 250

#: Workers that were started one after the other begin far from each other.
_numbers = itertools.count(os.getpid() * 41 % _DOMAINS)


@contextmanager
def free_domain() -> Iterator[int]:
    """Lock one of a hundred domains; the last one used comes last, as its processes may not be forgotten yet."""
    for _ in range(_DOMAINS):
        number = 1 + next(_numbers) % _DOMAINS
        with open(Path(tempfile.gettempdir()) / f"bmd_rths_{os.getuid()}_test_domain_{number}", "a") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield number
            return
    raise RuntimeError("all ROS domains are in use by other tests")


def ports_of(number: int) -> list[int]:
    """Return the UDP ports that this process has of those of a domain: a node that is left over has some."""
    sockets = set()
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # of the folder that is listed
            sockets.add(str(os.stat(f"/proc/self/fd/{name}").st_ino))
    rows = [line.split() for line in Path("/proc/self/net/udp").read_text().splitlines()[1:]]
    ports = [int(row[1].partition(":")[2], 16) for row in rows if row[9] in sockets]
    return [port for port in ports if (port - _FIRST_PORT) // _PORTS == number]
