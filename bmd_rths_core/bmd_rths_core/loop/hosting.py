"""Run conductor and table driver together, in one thread, by any clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from bmd_rths_core.loop.conductor import Conductor
from bmd_rths_core.loop.states import DriveState, NodeState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action


class Clock(Protocol):
    """The time of a host."""

    def now(self) -> float:
        """Return the time [s]."""

    def wait(self, until: float) -> None:
        """Let time pass until then [s], or until something has arrived for the table controller.

        Parameters
        ----------
        until : float
            Time on this clock [s].
        """


class VirtualClock:
    """A clock that stands at the time it was last waited for."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        return self._now

    def wait(self, until: float) -> None:
        """Be there at once."""
        if until == math.inf:
            raise RuntimeError("nothing is due any more, and the test has not ended")
        self._now = max(self._now, until)


def ending(conductor: Conductor, driver: TableDriver) -> tuple[Outcome | None, str]:
    """Return how a test ended, and why, once its table was brought to rest.

    Parameters
    ----------
    conductor : Conductor
        Its end of the test.
    driver : TableDriver
        What it knows of the way to rest and of the stop: a test is not finished before the table is known to be at
        rest.
    """
    outcome, reason = conductor.outcome, conductor.reason
    later = driver.reason.removeprefix(reason).removeprefix("; ")  # than what has ended the test
    if later not in ("", driver.stop_problem):
        reason = f"{reason}; on the way to rest: {later}"
    if driver.stop_problem:
        outcome = Outcome.FAILED if outcome is Outcome.FINISHED else outcome
        reason = f"{reason}; {driver.stop_problem}"
    return outcome, reason


def run_to_rest(
    conductor: Conductor,
    driver: TableDriver,
    clock: Clock,
    stops_asked: Callable[[], int] = lambda: 0,
) -> None:
    """Run a test to its end and the table to rest; whatever happens, the table is stopped and released.

    Parameters
    ----------
    conductor : Conductor
        Begins the steps; what it is given on a step has to reach the driver.
    driver : TableDriver
        Moves the table.
    clock : Clock
        Tells the time and waits.
    stops_asked : callable
        Tells how often an operator has asked for the end: once is a ramp to rest, twice an emergency stop.

    Raises
    ------
    OSError, RuntimeError
        The table controller cannot be connected.
    """
    conductor.reset()
    try:
        driver.arm()
        while True:
            due = conductor.poll(clock.now())
            due = min(due, driver.poll(clock.now()))  # the stages have taken time
            now = clock.now()
            if conductor.state is not NodeState.ENDED:
                if driver.outcome is not None:
                    conductor.end(driver.outcome, driver.reason, now)
                elif stops_asked():
                    driver.stop(Action.RAMP, Outcome.STOPPED, "stopped by the operator", now)
                    continue
            if conductor.state is NodeState.ENDED:
                if driver.state in (DriveState.ARMED, DriveState.FOLLOWING):
                    driver.finish(conductor.action, now)
                    continue
                if driver.state is not DriveState.RETURNING:
                    return
                if stops_asked() > 1:
                    driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, "emergency stop by the operator", now)
                    continue
            clock.wait(due)
    finally:
        driver.release()
