"""What a run on the ROS graph comes to, from the start of its processes until its bag is closed."""

from __future__ import annotations

import math
import time
from pathlib import Path

from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, RECORDER, TABLE_DRIVER
from bmd_rths_nodes.run.graph_state import number
from bmd_rths_nodes.run.monitor import RunMonitor
from bmd_rths_nodes.run.operator_stop import OperatorStop
from bmd_rths_nodes.run.processes import NodeProcesses

#: Time between two looks [s].
LOOK_PERIOD = 0.05

#: Longest time until step 0 [s]; six processes have to start and to find each other.
START_TIMEOUT = 60.0

#: Longest wait for the first words of the numerical substructure after Ctrl-C or the loss of a node [s]: on a busy
#: machine a test may be under way before it is discovered, and its table is not at rest. Fast DDS repeats its
#: announcements every 3 s. A node that is discovered is waited for longer.
HEARING_TIMEOUT = 4.0
LONGEST_HEARING_TIMEOUT = 15.0

#: The same of one that waited for others when it was last heard, once a second [s]: its test may have begun since.
NEWS_TIMEOUT = 1.5

#: Longest time until the recorder has closed its bag after the test was lost or interrupted [s], besides the way of the
#: table to rest.
CLOSING_TIMEOUT = 10.0

#: The same when nothing can be recorded any more [s].
FAREWELL_TIME = 4.0

#: What is told of a test that the operator has stopped before step 0.
NOT_BEGUN = "stopped before the test had begun"


class RunFailed(Exception):
    """The run could not be brought to an end; the text says why."""


class RunFollower:
    """Follow a run by what its nodes tell, and decide when there is nothing more to wait for.

    Parameters
    ----------
    monitor : RunMonitor
        Hears the nodes.
    processes : NodeProcesses
        Their processes.
    operator : OperatorStop
        Hands on what the operator asks for.
    time_to_rest : float
        Longest time the table needs to come to rest [s].

    Attributes
    ----------
    problem : str
        Text that says what went wrong; empty while nothing has.
    """

    def __init__(
        self, monitor: RunMonitor, processes: NodeProcesses, operator: OperatorStop, time_to_rest: float
    ) -> None:
        self._monitor = monitor
        self._processes = processes
        self._operator = operator
        self.problem = ""
        self._give_up = time.perf_counter() + START_TIMEOUT
        self._hear_from = math.inf
        self._end_due = -math.inf
        self._time_to_rest = time_to_rest
        self._closing = time_to_rest + CLOSING_TIMEOUT
        self._bag_is_lost = False
        self._unrecorded_since = math.inf

    @property
    def progress(self) -> tuple[str, int]:
        """A text of the state of the run, and the steps begun."""
        told = self._monitor.status.get(NUMERICAL_SUBSTRUCTURE)
        step = None if told is None else number(told.values.get("step"))
        if told is None or step is None:
            return "starting", 0
        words = f"{told.state}, {number(told.values.get('missed_deadlines')) or 0} deadlines missed"
        if self._operator.asked:
            words = "stopping"
            driver = self._monitor.status.get(TABLE_DRIVER)
            table = "" if driver is None else driver.values.get("table", "")
            if table == "moving":
                words = "stopping, the table moves"
            elif table and told.state == NodeState.ENDED:
                words = "stopping, the bag is being closed"
        return words, int(step)

    def look(self) -> Path | None:
        """Hear what is told and judge it.

        Returns
        -------
        Path or None
            The bag, when it is closed.

        Raises
        ------
        RunFailed
            Nothing more is to be expected.
        """
        self._monitor.update(LOOK_PERIOD)
        if self._operator.asked and (self._started or not self._state):  # what is not heard of may be a test
            self._operator.update()
        if (bag := self._closed_bag()) is not None:
            return bag
        self._judge_processes()
        if self._at_rest:  # what is left to wait for is the bag
            longest = 0.0 if self._bag_is_lost else CLOSING_TIMEOUT
            self._give_up = min(self._give_up, time.perf_counter() + longest)
        if time.perf_counter() > self._give_up or self._operator.leaving:
            raise RunFailed(self.problem or self._excuse())
        return None

    @property
    def _state(self) -> str:
        told = self._monitor.status.get(NUMERICAL_SUBSTRUCTURE)
        return "" if told is None else told.state

    @property
    def _started(self) -> bool:
        return self._state in (NodeState.RUNNING, NodeState.ENDED)

    @property
    def _at_rest(self) -> bool:
        """True when the test has ended and the table driver has told that the table stands."""
        driver = self._monitor.status.get(TABLE_DRIVER)
        return self._state == NodeState.ENDED and driver is not None and driver.values.get("table") == "at rest"

    def _closed_bag(self) -> Path | None:
        """Return the bag when the recorder has closed it, and take note of one that cannot be recorded any more."""
        recorder = self._monitor.status.get(RECORDER)
        if recorder is None:
            return None
        if recorder.state is NodeState.TRIPPED and not self.problem:
            self.problem = f"{RECORDER}: {recorder.message}"
            self._bag_is_lost = True
            self._wait_for(self._time_to_rest + FAREWELL_TIME)
        closed = recorder.state is NodeState.ENDED
        if recorder.state is NodeState.INACTIVE and self._started:  # a test that is not recorded is of no use
            self.problem = self.problem or f"{RECORDER}: it was deactivated before the test had ended"
            # The numerical substructure ends it by itself and says why; a signal would say that it was the operator.
            now = time.perf_counter()
            self._unrecorded_since = min(self._unrecorded_since, now)
            closed = self._state == NodeState.ENDED or now > self._unrecorded_since + FAREWELL_TIME
        return Path(recorder.values["bag"]) if closed and recorder.values.get("bag") else None

    def _wait_for(self, seconds: float) -> None:
        self._give_up = time.perf_counter() + seconds

    def _judge_processes(self) -> None:
        """Notice a process that has ended, and set how long to wait for the rest."""
        undisturbed = not self.problem and not self._operator.asked
        if undisturbed and not self._started and (tripped := self._tripped()):
            self.problem = tripped
            undisturbed = False
            self._end_due = time.perf_counter() + FAREWELL_TIME  # a test it has part in ends by itself, with a bag
        lost = self._processes.lost()
        if lost is not None and undisturbed:
            self.problem = f"{lost.name} ended with status {lost.process.returncode}: {lost.last_words()}"
            undisturbed = False
            if lost.name == RECORDER:  # a test that is not recorded is of no use
                self._processes.interrupt_first()
                self._bag_is_lost = True
                self._closing = self._time_to_rest + FAREWELL_TIME
        if self._state == NodeState.RUNNING and undisturbed:
            self._wait_for(math.inf)
        elif self._started or not (undisturbed or self._may_be_heard_of() or time.perf_counter() < self._end_due):
            longest = self._closing if self._started else 0.0
            self._give_up = min(self._give_up, time.perf_counter() + longest)

    def _tripped(self) -> str:
        """Return which node has tripped for good, and why; empty when none has. An operator's stop can be reset."""
        for role, told in sorted(self._monitor.status.items()):
            if told.state is NodeState.TRIPPED and told.values.get("outcome") != Outcome.STOPPED:
                return f"{role}: {told.message}"
        return ""

    def _may_be_heard_of(self) -> bool:
        """Tell whether the numerical substructure may run a test of which nothing was heard yet."""
        now = time.perf_counter()
        self._hear_from = min(self._hear_from, now)
        there = self._processes.first_runs and NUMERICAL_SUBSTRUCTURE in self._monitor.nodes_there()
        longest = LONGEST_HEARING_TIMEOUT if there else HEARING_TIMEOUT
        if self._state == NodeState.WAITING:
            longest = 0.0 if self._operator.asked else NEWS_TIMEOUT
        return self._state in ("", NodeState.WAITING, NodeState.READY) and now < self._hear_from + longest

    def _excuse(self) -> str:
        """Return why the run could not be brought to an end."""
        told = self._monitor.status
        if self._operator.asked and self._started:
            bag = told[RECORDER].values.get("bag", "") if RECORDER in told else ""
            return f"stopped without waiting for the end of the recording; what was recorded is in {bag or 'no bag'}"
        if self._operator.asked:
            return NOT_BEGUN
        substructure = told.get(NUMERICAL_SUBSTRUCTURE)
        if self._started and substructure is not None:
            return f"{substructure.message}; the recorder did not close its bag within {self._closing:.3g} s"
        waiting_for = substructure.values.get("waiting_for", "") if substructure else NUMERICAL_SUBSTRUCTURE
        notes = {peer.message for peer in told.values() if peer.state == NodeState.WAITING} - {NodeState.WAITING}
        why = f" ({'; '.join(sorted(notes))})" if notes else ""
        return (
            f"the nodes did not find each other within {START_TIMEOUT:g} s; "
            f"waiting for {waiting_for or 'the recorder'}{why}"
        )
