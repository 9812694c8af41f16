"""The process of the page: serve it, and pass what is asked there on to the process that started this one."""

from __future__ import annotations

import asyncio
import json
import sys
import threading
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.monitor_page.process import lower_priority
from bmd_rths_nodes.monitor_page.recordings import Recordings
from bmd_rths_nodes.monitor_page.server import MonitorServer

#: Longest wait for an answer of the process that started this one [s].
ANSWER_TIMEOUT = 3.0

#: What the operator reads when there is no answer in time.
NO_ANSWER = "NO ANSWER: use the terminal (Ctrl-C) or the emergency stop of the hydraulics"


class Pipes:
    """What goes to and comes from the process that started this one, a line of JSON each."""

    def __init__(self) -> None:
        self._number = 0
        self._answers: dict[int, asyncio.Future[str]] = {}
        self.server: MonitorServer

    async def ask(self, what: str) -> str:
        """Ask for a stop, and wait for the answer."""
        self._number += 1
        answer = asyncio.get_running_loop().create_future()
        self._answers[self._number] = answer
        print(json.dumps({"ask": what, "number": self._number}), flush=True)
        try:
            return await asyncio.wait_for(answer, ANSWER_TIMEOUT)
        except asyncio.TimeoutError:
            return NO_ANSWER

    def take(self, line: str) -> None:
        """Take a line."""
        told = json.loads(line)
        if "bag" in told:
            self.server.recordings.add(Path(told["bag"]))
        elif "say" in told:
            self.server.said.append(str(told["say"]))
        elif "answer" in told:
            answer = self._answers.pop(told["number"], None)
            if answer is not None and not answer.done():
                answer.set_result(str(told["answer"]))


async def serve(port: int, foxglove: int | None) -> None:
    """Serve until nobody listens any more."""
    pipes = Pipes()
    pipes.server = MonitorServer(Recordings(), port, pipes.ask, foxglove)
    pipes.server.start()
    print(json.dumps({"url": pipes.server.url}), flush=True)
    loop, ended = asyncio.get_running_loop(), asyncio.Event()

    def listen() -> None:
        for line in sys.stdin:
            loop.call_soon_threadsafe(pipes.take, line)
        loop.call_soon_threadsafe(ended.set)

    threading.Thread(target=listen, daemon=True).start()
    await ended.wait()


def main() -> int:
    """Run the page."""
    lower_priority()
    try:
        port, foxglove = sys.argv[1:3]
        asyncio.run(serve(int(port), int(foxglove) if foxglove else None))
    except InputError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
