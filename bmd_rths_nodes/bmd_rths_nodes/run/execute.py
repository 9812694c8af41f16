"""One test on the ROS graph, from the start of its processes to its bag."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.safety.way_to_rest import longest_way_to_rest
from bmd_rths_nodes.roles import COMPOSED_LOOP, LOOP, ROLES, module_of
from bmd_rths_nodes.run.domain_lock import another_run, domain_lock
from bmd_rths_nodes.run.follower import NOT_BEGUN, RunFailed, RunFollower
from bmd_rths_nodes.run.monitor import RunMonitor
from bmd_rths_nodes.run.operator_stop import OperatorStop
from bmd_rths_nodes.run.processes import NodeProcesses

#: The modules of the processes of a test; the one with the numerical substructure is the first.
PROCESSES = tuple(role.module for role in ROLES.values())
COMPOSED_PROCESSES = (module_of(COMPOSED_LOOP), *(role.module for role in ROLES.values() if role not in LOOP))

#: Text of the state of a test whose processes are ended.
ENDING = "ending"


class RecordedRun(NamedTuple):
    """A test whose bag is closed.

    Parameters
    ----------
    bag : Path
        The bag; it says how the test ended.
    problem : str
        Text that says what went wrong with its processes; empty when nothing did.
    """

    bag: Path
    problem: str


def run_on_ros(
    config: Config,
    modules: Sequence[str],
    monitor: RunMonitor,
    interrupts: Sequence[int],
    log: Callable[[str], None],
    on_progress: Callable[[str, int], None],
) -> RecordedRun:
    """Start the nodes of a test, follow it until its bag is closed, and end every process.

    Parameters
    ----------
    config : Config
        The whole configuration; the test is recorded, in the folder it names.
    modules : sequence of str
        `PROCESSES` or `COMPOSED_PROCESSES`.
    monitor : RunMonitor
        Hears the nodes, in the namespace they get.
    interrupts : sequence of int
        Signals received so far; a handler appends to it. `OperatorStop` says what each does.
    log : callable
        Prints one line for the operator.
    on_progress : callable
        Called with a text of the state of the test and the steps begun, several times a second, and with `ENDING` when
        the processes are to be ended.

    Returns
    -------
    RecordedRun
        The bag, however the test ended.

    Raises
    ------
    InputError
        Another run is active in this namespace of the ROS domain; nothing has entered it.
    RunFailed
        There is no bag that was closed.
    """
    with domain_lock(monitor.namespace), tempfile.TemporaryDirectory(prefix="bmd_rths_") as scratch:
        parameter_file = Path(scratch) / "parameters.yaml"
        parameter_file.write_text(dump_config(config), encoding="utf-8")
        processes = NodeProcesses(modules, parameter_file, Path(scratch), monitor.namespace)
        operator = OperatorStop(monitor, processes, interrupts, log, config.table.halt_time)
        # Twice: what the clock has added up to may have to be taken back by a second way.
        time_to_rest = longest_way_to_rest(config.safety, config.run.time_step) + config.table.halt_time
        try:
            if others := monitor.nodes_already_there():
                raise another_run(", ".join(others))
            if interrupts:
                raise RunFailed(NOT_BEGUN)
            monitor.believe_only(processes.owns)
            processes.let_in()
            return _followed(RunFollower(monitor, processes, operator, time_to_rest), on_progress)
        finally:
            processes.stop(time_to_rest, interrupts, log, hurried=operator.leaving)
            monitor.believe_only(lambda told: True)


def _followed(follower: RunFollower, on_progress: Callable[[str, int], None]) -> RecordedRun:
    """Follow a test until its bag is closed."""
    try:
        while (bag := follower.look()) is None:
            on_progress(*follower.progress)
        return RecordedRun(bag, follower.problem)
    finally:
        on_progress(ENDING, follower.progress[1])
