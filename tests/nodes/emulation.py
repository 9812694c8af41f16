"""An emulator in a thread of the test, for what needs no process of its own."""

import threading
from contextlib import contextmanager

from bmd_rths_core.config import Config
from bmd_rths_nodes.cli.emulate import make_emulator

#: Lockstep with the linear table, so that everything can be compared bit for bit.
LOCKSTEP = Config().changed(run__lockstep=True, virtual_controller__model="servo", table__controller="udp")


@contextmanager
def emulator(config=LOCKSTEP, faults=()):
    """Run an emulator on a free port; give the emulator and the configuration that leads to it."""
    server = make_emulator(config, "udp://127.0.0.1:0", faults)
    config = config.changed(table__address=f"udp://127.0.0.1:{server.port}")
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(ended.is_set,))
    thread.start()
    try:
        yield server, config
    finally:
        ended.set()
        thread.join()
