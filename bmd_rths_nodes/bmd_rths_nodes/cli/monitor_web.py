"""``bmd-rths monitor --web``: the same as a page for a browser, live from the bag, or of recordings."""

from __future__ import annotations

import asyncio
import json
import queue
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.options import log
from bmd_rths_nodes.monitor_page.process import PageProcess, lower_priority

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_nodes.run.monitor import RunMonitor
    from bmd_rths_nodes.run.topic_tap import TopicTap

#: Time between two looks at the graph [s].
_PERIOD = 0.05

#: Words for a browser's address on the terminal.
WATCH = "watch the test at"


def show_recordings(path: Path, port: int, foxglove: int | None, as_json: bool, interrupts: Sequence[int]) -> int:
    """Serve the page of a bag or of a folder until Ctrl-C; no ROS is needed and no table can be stopped."""
    from bmd_rths_nodes.monitor_page.recordings import Recordings
    from bmd_rths_nodes.monitor_page.server import MonitorServer

    if not path.exists():
        raise InputError(f"{path}: no such file or folder; a bag, or a folder of bags, is required")
    lower_priority()

    async def serve() -> None:
        server = MonitorServer(Recordings(path), port, foxglove=foxglove)
        server.start()
        _tell(server.url, as_json, f"{path}:")
        while not interrupts:
            await asyncio.sleep(_PERIOD)
        server.stop()

    asyncio.run(serve())
    return 0


def show_graph(
    monitor: RunMonitor,
    port: int,
    foxglove: int | None,
    config: Config | None,
    as_json: bool,
    interrupts: Sequence[int],
) -> int:
    """Serve the page of the run on this ROS domain until Ctrl-C, in a process of its own.

    Without a configuration it follows the bag of the recorder, with one the topics.
    """
    from bmd_rths_msgs_py.topics import RECORDER

    asked: queue.Queue[str] = queue.Queue()

    def on_ask(what: str) -> str:
        asked.put(what)
        return f"asked the table driver: {what.replace('_', ' ')}"

    with ExitStack() as stack, PageProcess(port, foxglove, on_ask) as page:
        tap = None if config is None else stack.enter_context(_tap(monitor, config))
        _tell(page.url, as_json, WATCH)
        while not interrupts:
            monitor.update(_PERIOD)
            if tap is not None:
                tap.poll()
                page.show(str(tap.bag))
            else:
                recorder = monitor.status.get(RECORDER)
                page.show("" if recorder is None else recorder.values.get("bag", ""))
            while not asked.empty():
                monitor.table.call(asked.get())
            for service, answer in monitor.table.update():
                page.say(f"table driver, {service.replace('_', ' ')}: {answer}")
            if not page.runs:
                log("error: the page has ended")
                return 1
    return 0


@contextmanager
def _tap(monitor: RunMonitor, config: Config) -> Iterator[TopicTap]:
    """Listen to the topics, into a folder that is gone in the end."""
    from bmd_rths_nodes.run.topic_tap import TopicTap

    with tempfile.TemporaryDirectory(prefix="bmd_rths_heard_") as folder:
        tap = TopicTap(monitor, config, Path(folder))
        try:
            yield tap
        finally:
            tap.close()


class RunPage:
    """The page of ``bmd-rths run --monitor``: what is asked for there does what Ctrl-C does.

    Parameters
    ----------
    port : int
        Port of the page; 0 for any that is free.
    """

    #: So many times Ctrl-C is what each request amounts to, while a test is followed.
    _PRESSES: dict[str, int] = {"stop": 1, "emergency_stop": 2}  # noqa: RUF012

    def __init__(self, port: int) -> None:
        self._interrupts: list[int] | None = None
        self._presses_before = 0
        self._ending = False
        self._page = PageProcess(port, None, self._on_ask)
        _tell(self._page.url, False, WATCH)

    def __enter__(self) -> RunPage:
        """Return the page."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the page."""
        self._page.__exit__()

    def follow(self, interrupts: list[int]) -> None:
        """Hand requests on from now on.

        Parameters
        ----------
        interrupts : list of int
            Signals received so far; a request appends to it, as Ctrl-C does.
        """
        self._interrupts = interrupts

    def end(self) -> None:
        """Take note that the test is over and its processes are ended, which brings a table that moves to rest."""
        if not self._ending:
            self._ending, self._presses_before = True, len(self._interrupts or ())

    def leave(self) -> None:
        """Hand nothing on any more: no process of the test is left."""
        self._interrupts = None

    def show(self, bag: str) -> None:
        """Show a bag."""
        self._page.show(bag)

    def log(self, text: str) -> None:
        """Print a line, and show it on the page."""
        log(text)
        self._page.say(text)

    def _on_ask(self, what: str) -> str:
        interrupts = self._interrupts
        if interrupts is None:
            return "no test is running"
        presses = self._presses_before + self._PRESSES[what] - self._ending
        while len(interrupts) < presses:
            interrupts.append(0)
        return f"asked for: {what.replace('_', ' ')}"


def _tell(url: str, as_json: bool, words: str) -> None:
    if as_json:
        click.echo(json.dumps({"url": url}))
    else:
        log(f"{words} {url}")
