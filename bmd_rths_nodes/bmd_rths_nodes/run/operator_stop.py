"""What Ctrl-C does to a run: it brings the table to rest, then stops it at once, then waits no longer."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from bmd_rths_nodes.ros.triggers import EMERGENCY_STOP, STOP
from bmd_rths_nodes.run.monitor import RunMonitor
from bmd_rths_nodes.run.processes import NodeProcesses

#: Longest wait for the answer of the table driver [s], which is asked more than once meanwhile. At an emergency stop it
#: waits for the table controller itself.
ANSWER_TIMEOUT = 2.0

_STEPS = (
    (STOP, "stopping: the table is brought to rest (Ctrl-C again for an emergency stop)"),
    (EMERGENCY_STOP, "emergency stop (Ctrl-C again to leave at once)"),
)


class OperatorStop:
    """Hand the interrupts of a run on to the table driver, and tell what it says.

    Parameters
    ----------
    monitor : RunMonitor
        Asks the table driver.
    processes : NodeProcesses
        Its numerical substructure is asked to end the test when the table driver does not answer.
    interrupts : sequence of int
        Signals received so far; a handler appends to it.
    log : callable
        Prints one line for the operator.
    halt_time : float
        Longest time the table controller needs to confirm an emergency stop [s].
    """

    def __init__(
        self,
        monitor: RunMonitor,
        processes: NodeProcesses,
        interrupts: Sequence[int],
        log: Callable[[str], None],
        halt_time: float,
    ) -> None:
        self._monitor = monitor
        self._processes = processes
        self._interrupts = interrupts
        self._log = log
        self._halt_time = halt_time
        self._taken = 0
        self._asked_last = ""
        self._answer_due = math.inf

    @property
    def asked(self) -> bool:
        """True when the operator wants the test to end."""
        return bool(self._interrupts)

    @property
    def leaving(self) -> bool:
        """True when the operator does not want to wait any longer."""
        return len(self._interrupts) > len(_STEPS)

    def update(self) -> None:
        """Do what has been asked for since the last time, and tell what was done."""
        while self._taken < min(len(self._interrupts), len(_STEPS)):
            service, words = _STEPS[self._taken]
            self._taken += 1
            self._log(words)
            self._monitor.table.call(service)
            self._asked_last = service
            halt_time = self._halt_time if service == EMERGENCY_STOP else 0.0
            self._answer_due = time.perf_counter() + ANSWER_TIMEOUT + halt_time
        for service, answer in self._monitor.table.update():
            self._log(f"table driver: {answer}")
            if service == self._asked_last:
                self._answer_due = math.inf
        if time.perf_counter() > self._answer_due:
            self._answer_due = math.inf
            self._log("the table driver does not answer; the numerical substructure is asked to end the test")
            self._processes.interrupt_first()
