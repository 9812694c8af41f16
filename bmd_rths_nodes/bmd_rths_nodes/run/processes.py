"""Start the nodes of a run as processes, notice when one is lost, and leave none behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bmd_rths_msgs_py.topics import NAMESPACE, TABLE_DRIVER
from bmd_rths_nodes.roles import COMPOSED_LOOP
from bmd_rths_nodes.ros.agreement import is_of_process
from bmd_rths_nodes.ros.ending_signals import REPEAT_TIME
from bmd_rths_nodes.ros.spin import DOOR_VARIABLE, SUPERVISOR_VARIABLE
from bmd_rths_nodes.ros.status import NodeStatus

#: Time a process is given to end after SIGINT before it is killed [s], besides the way of the table to rest.
PATIENCE = 4.0

#: Time between two looks whether they have ended [s].
LOOK_PERIOD = 0.02

#: What lets a process in.
_WELCOME = "enter"


@dataclass
class Supervised:
    """A process of the run.

    Parameters
    ----------
    module : str
        Python module it runs.
    process : Popen
        The process.
    log : Path
        Where its output goes.
    """

    module: str
    process: subprocess.Popen[bytes]
    log: Path
    _interrupted: bool = False

    @property
    def name(self) -> str:
        """Name for a person."""
        return self.module.rpartition(".")[2]

    def interrupt(self) -> None:
        """Ask it to end in order, once: a second time would be an emergency stop."""
        if not self._interrupted:
            self._interrupted = True
            self.process.send_signal(signal.SIGINT)

    def last_words(self) -> str:
        """Return the last line it wrote, of those that are no mere information."""
        lines = [line for line in self.log.read_text(errors="replace").strip().splitlines() if "[INFO]" not in line]
        return lines[-1].removeprefix("error: ") if lines else "it wrote nothing"


class NodeProcesses:
    """The processes of one run. They load what they need, and wait to be let in before they enter the ROS domain.

    Parameters
    ----------
    modules : sequence of str
        Python modules to run, the one with the numerical substructure first.
    parameter_file : Path
        ROS parameter file all of them get.
    log_folder : Path
        Where their output goes.
    namespace : str
        Of the nodes.
    """

    def __init__(
        self, modules: Sequence[str], parameter_file: Path, log_folder: Path, namespace: str = NAMESPACE
    ) -> None:
        given = ("--ros-args", "--params-file", str(parameter_file), "-r", f"__ns:={namespace}")
        environment = {**os.environ, SUPERVISOR_VARIABLE: str(os.getpid()), DOOR_VARIABLE: _WELCOME}
        self.started: list[Supervised] = []
        for module in modules:
            log = log_folder / f"{module.rpartition('.')[2]}.log"
            with open(log, "wb") as output:
                process = subprocess.Popen(
                    [sys.executable, "-m", module, *given],
                    stdin=subprocess.PIPE,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    # Ctrl-C on the terminal must reach this process only, which ends the run in order.
                    start_new_session=True,
                )
            self.started.append(Supervised(module, process, log))

    def let_in(self) -> None:
        """Let every process enter the ROS domain."""
        self._answer_at_the_door(_WELCOME)

    def lost(self) -> Supervised | None:
        """Return a process that has ended, if there is one."""
        return next((p for p in self.started if p.process.poll() is not None), None)

    def owns(self, status: NodeStatus) -> bool:
        """Tell whether a status was told by one of the processes, and not by a node of somebody else.

        Parameters
        ----------
        status : NodeStatus
            The status.
        """
        return any(is_of_process(status.instance, supervised.process.pid) for supervised in self.started)

    @property
    def first_runs(self) -> bool:
        """True while there is a process with the numerical substructure."""
        return self.started[0].process.poll() is None

    def interrupt_first(self) -> None:
        """Ask the process with the numerical substructure to end the test."""
        self.started[0].interrupt()

    def stop(
        self, time_to_rest: float, interrupts: Sequence[int], log: Callable[[str], None], hurried: bool = False
    ) -> None:
        """End every process: ask first, kill what does not end.

        Parameters
        ----------
        time_to_rest : float
            Longest time the table needs to come to rest [s]; its process is not killed on the way.
        interrupts : sequence of int
            Signals received so far; a handler appends to it. A further one is handed on, an emergency stop; the
            one after that ends the wait.
        log : callable
            Prints one line for the operator.
        hurried : bool
            The operator does not want to wait: the processes are asked twice, and the way to rest is not waited for.
        """
        self._answer_at_the_door("")
        for supervised in self._running():
            supervised.interrupt()
        before, handed_on, asked = len(interrupts), False, time.perf_counter()
        give_up = asked + PATIENCE + (0.0 if hurried else time_to_rest)
        while self._running() and time.perf_counter() < give_up:
            further = len(interrupts) - before
            if (further or hurried) and not handed_on and time.perf_counter() > asked + 1.5 * REPEAT_TIME:
                handed_on = True
                if not hurried:
                    log("emergency stop (Ctrl-C again to leave at once)")
                for supervised in self._running():
                    supervised.process.send_signal(signal.SIGINT)
            if further > 1 or self._table_is_left_at_rest():
                give_up = min(give_up, time.perf_counter() + PATIENCE)
            time.sleep(LOOK_PERIOD)
        for supervised in self._running():
            supervised.process.kill()
            supervised.process.wait()

    def _answer_at_the_door(self, words: str) -> None:
        """Tell every process that still waits whether it may come in; without a word it ends."""
        for door in [supervised.process.stdin for supervised in self.started]:
            if door is not None and not door.closed:
                with suppress(BrokenPipeError), door:  # it may have ended meanwhile
                    door.write(words.encode())

    def _table_is_left_at_rest(self) -> bool:
        """Tell whether the process that drives the table has ended in order, which it does when the table stands."""
        return any(p.name in (TABLE_DRIVER, COMPOSED_LOOP) and p.process.returncode == 0 for p in self.started)

    def _running(self) -> list[Supervised]:
        return [supervised for supervised in self.started if supervised.process.poll() is None]
