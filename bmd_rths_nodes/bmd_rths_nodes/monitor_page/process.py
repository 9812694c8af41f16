"""The page as a process of its own, beside the one that knows ROS: what goes to and fro on its pipes."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError

#: Longest wait for the page to begin [s].
START_TIMEOUT = 30.0

#: Lines that may wait for a page that takes none; further ones are dropped, for nobody waits for a page.
_MOST_WAITING = 100


class PageProcess:
    """Start the page, tell it what to show, and hear what the operator asks for there; a context manager.

    It is never waited for: a page that hangs or is killed costs the test nothing.

    Parameters
    ----------
    port : int
        Port of the page; 0 for any that is free.
    foxglove : int or None
        Port on which Foxglove can watch.
    on_ask : callable
        Called with ``"stop"`` or ``"emergency_stop"``, in a thread of its own, and returns a text of what comes of it.

    Attributes
    ----------
    url : str
        Address of the page, with the token.

    Raises
    ------
    InputError
        The page does not begin: the port is in use.
    """

    def __init__(self, port: int, foxglove: int | None, on_ask: Callable[[str], str]) -> None:
        self._on_ask = on_ask
        self._bag = ""
        self._lines: queue.Queue[str | None] = queue.Queue(_MOST_WAITING)
        ports = (str(port), "" if foxglove is None else str(foxglove))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bmd_rths_nodes.monitor_page.child", *ports],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C on the terminal is for the test
        )
        first = self._first_line()
        if "url" not in first:
            self._process.kill()
            self._process.wait()
            raise InputError(str(first.get("error", "the page did not begin")))
        self.url = str(first["url"])
        for work in (self._write, self._read):
            threading.Thread(target=work, daemon=True).start()

    def _first_line(self) -> dict[str, Any]:
        timer = threading.Timer(START_TIMEOUT, self._process.kill)
        timer.start()
        try:
            assert self._process.stdout is not None
            found = json.loads(self._process.stdout.readline() or "{}")
        except ValueError:
            found = {}
        finally:
            timer.cancel()
        return found if isinstance(found, dict) else {}

    def __enter__(self) -> PageProcess:
        """Return the page."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the page."""
        self._put(None)
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def runs(self) -> bool:
        """True while the page is there."""
        return self._process.poll() is None

    def show(self, bag: str) -> None:
        """Show a bag, if it is another one than before.

        Parameters
        ----------
        bag : str
            Its folder, on this computer; nothing is done for an empty one.
        """
        if bag and bag != self._bag and Path(bag).is_dir():
            self._bag = bag
            self._put(json.dumps({"bag": bag}))

    def say(self, text: str) -> None:
        """Show the operator a line.

        Parameters
        ----------
        text : str
            The line.
        """
        self._put(json.dumps({"say": text}))

    def _put(self, line: str | None) -> None:
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            return

    def _write(self) -> None:
        assert self._process.stdin is not None
        with self._process.stdin as pipe:
            try:
                while (line := self._lines.get()) is not None:
                    pipe.write(f"{line}\n")
                    pipe.flush()
            except OSError:
                return

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            asked = json.loads(line)
            answer = self._on_ask(asked["ask"])
            self._put(json.dumps({"answer": answer, "number": asked["number"]}))


def lower_priority(by: int = 10) -> None:
    """Let the loop, and the recorder, have the processor first."""
    if hasattr(os, "nice"):
        os.nice(by)
