"""Collect Ctrl-C, SIGTERM and SIGHUP, for commands that end a test in order."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from bmd_rths_nodes.ros.ending_signals import ending_signals


@contextmanager
def collected_interrupts() -> Iterator[list[int]]:
    """Append SIGINT, SIGTERM and SIGHUP to a list instead of dying of them; SIGHUP not where nohup ignores it."""
    received: list[int] = []
    before = {number: signal.signal(number, lambda n, _: received.append(n)) for number in ending_signals()}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
