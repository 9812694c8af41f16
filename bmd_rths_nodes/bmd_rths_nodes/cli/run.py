"""``bmd-rths run``: the ROS graph, from start to the errors of the test."""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path

import click
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.selection import select_ground_motion
from bmd_rths_core.report.analysis import analysed
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, RECORDER
from bmd_rths_nodes.cli import preflight
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import json_option, log, output_folder, progress_bar
from bmd_rths_nodes.cli.results import result_of, show
from bmd_rths_nodes.hardware.controllers import make_table_controller
from bmd_rths_nodes.operator_stop import OperatorStop
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.monitor import RunMonitor
from bmd_rths_nodes.supervisor import Supervisor

_RECORDER_MODULE = "bmd_rths_nodes.recorder_node"
_PROCESSES = (
    "bmd_rths_nodes.numerical_substructure_node",
    "bmd_rths_nodes.command_shaper_node",
    "bmd_rths_nodes.table_driver_node",
    "bmd_rths_nodes.shear_estimator_node",
    "bmd_rths_nodes.force_correction_node",
    _RECORDER_MODULE,
)
_COMPOSED_PROCESSES = ("bmd_rths_nodes.composition", _RECORDER_MODULE)

#: Longest time until step 0 [s]; six processes have to start and to find each other.
START_TIMEOUT = 60.0

#: Longest time until the recorder has closed its bag after the test was lost or interrupted [s].
CLOSING_TIMEOUT = 10.0

#: Time the table is given to come to rest when nothing can be recorded any more [s].
FAREWELL_TIME = 4.0


_TOO_SLOW = (
    "This computer, or the table controller, did not keep up with the time step. Ending other work, --composed or a "
    "longer run.time_step help; run.max_consecutive_misses and safety.stale_shear_limit say how long the loop waits."
)


class RunFailed(Exception):
    """The run could not be brought to an end; the text says why."""


@click.command(epilog="Example: bmd-rths run config/simplified_bmd.yaml --scheme plc_fc --output bags")
@configured("scheme", "motion", "component", "table")
@click.option("--lockstep", is_flag=True, help="Start each step when the last one has closed, as fast as it goes.")
@click.option("--composed", is_flag=True, help="Run the five nodes of the loop in one process.")
@click.option(
    "--override-preflight",
    is_flag=True,
    help="Run also what the pre-flight refuses: a loop that is not stable, or a predicted limit. The bag tells.",
)
@click.option("--output", type=click.Path(path_type=Path), help="Folder the bag is written into.")
@json_option
def run(
    choice: ConfigChoice,
    lockstep: bool,
    composed: bool,
    override_preflight: bool,
    output: Path | None,
    as_json: bool,
) -> int:
    """Run a test on the ROS graph, record it and print its errors.

    Predicts the whole test with the identified models, and refuses it when that passes a limit or the loop is not
    stable. Starts the five nodes and the recorder, waits until they have found each other, runs the ground motion and
    computes the errors from the bag. Ctrl-C ends the test in order and brings the table to rest; a second one stops it
    at once, a third one does not wait for the bag.
    """
    resolved = choice.resolve(run__record=True)
    if lockstep:
        resolved = resolved.changed(run__lockstep=True)
    if override_preflight:
        resolved = resolved.changed(run__preflight="override")
    make_table_controller(resolved)  # refuses what is wrong before any process is started; nothing is connected
    motion = select_ground_motion(resolved.ground_motion, resolved.run.time_step)
    prediction = preflight.checked(resolved, motion)
    folder = output if output is not None else Path(resolved.recorder.directory)
    resolved = resolved.changed(recorder__directory=str(folder.absolute()))
    with output_folder(folder):
        if prediction is not None:
            log(preflight.in_words(resolved, prediction))
        try:
            bag = _run(resolved, motion.steps, _COMPOSED_PROCESSES if composed else _PROCESSES)
        except RunFailed as error:
            log(f"error: {error}")
            return 1
    record = read_bag(bag)
    if record.outcome == "failed" and "deadlines in a row" in record.reason:
        log(_TOO_SLOW)
    predicted = None if prediction is None else preflight.as_mapping(prediction)
    show({**result_of(analysed(record)), "preflight": predicted, "bag": str(bag)}, as_json)
    return 0 if record.outcome == "finished" else 1


def _run(config: Config, steps: int, modules: tuple[str, ...]) -> Path:
    """Run the processes to the end of the test and return the bag."""
    with (
        tempfile.TemporaryDirectory(prefix="bmd_rths_") as scratch,
        collected_interrupts() as interrupts,
        RunMonitor() as monitor,
    ):
        others = monitor.nodes_already_there()
        if others:
            raise InputError(
                f"another run is active on this ROS domain ({', '.join(others)}); "
                "end it, or set ROS_DOMAIN_ID to a free domain"
            )
        parameter_file = Path(scratch) / "parameters.yaml"
        parameter_file.write_text(dump_config(config), encoding="utf-8")
        supervisor = Supervisor(modules, parameter_file, Path(scratch))
        try:
            return _follow(monitor, supervisor, steps, interrupts)
        finally:
            supervisor.stop()


def _follow(monitor: RunMonitor, supervisor: Supervisor, steps: int, interrupts: list[int]) -> Path:
    """Show progress until the recorder has closed the bag."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    problem = ""
    operator = OperatorStop(monitor, supervisor, interrupts, log)
    give_up = time.perf_counter() + START_TIMEOUT
    with progress_bar(*columns, TimeElapsedColumn()) as progress:
        task = progress.add_task("starting", total=steps)
        while True:
            monitor.update(0.05)
            substructure = monitor.status.get(NUMERICAL_SUBSTRUCTURE)
            recorder = monitor.status.get(RECORDER)
            state = "" if substructure is None else substructure.state
            running, started = state == status.RUNNING, state in (status.RUNNING, status.ENDED)
            if operator.asked and started:
                operator.update()
            if recorder is not None and recorder.state == status.ENDED:
                if problem:
                    log(f"error: {problem}")
                return Path(recorder.values["bag"])
            if substructure is not None and "step" in substructure.values:
                missed = substructure.values["missed_deadlines"]
                progress.update(
                    task,
                    description=f"{substructure.state}, {missed} deadlines missed",
                    completed=int(substructure.values["step"]),
                )
            if recorder is not None and recorder.state == status.TRIPPED and not problem:
                problem = f"{RECORDER}: {recorder.message}"
                give_up = time.perf_counter() + FAREWELL_TIME
            lost = supervisor.lost()
            if lost is not None and not problem and not operator.asked:
                problem = f"{lost.name} ended with status {lost.process.returncode}: {lost.last_words()}"
                wait = CLOSING_TIMEOUT
                if lost.module == _RECORDER_MODULE:  # a test that is not recorded is of no use
                    supervisor.interrupt_first()
                    wait = FAREWELL_TIME
                give_up = time.perf_counter() + (wait if started else 0.0)
            elif running and not problem and not operator.asked:
                give_up = math.inf
            elif started or operator.asked:
                give_up = min(give_up, time.perf_counter() + (CLOSING_TIMEOUT if started else 0.0))
            if time.perf_counter() > give_up or operator.leaving:
                raise RunFailed(problem or _excuse(monitor, operator.asked, started))


def _excuse(monitor: RunMonitor, asked_to_stop: bool, started: bool) -> str:
    if asked_to_stop and started:
        bag = monitor.status[RECORDER].values.get("bag", "") if RECORDER in monitor.status else ""
        return f"stopped without waiting for the end of the recording; what was recorded is in {bag or 'no bag'}"
    if asked_to_stop:
        return "stopped before the test had begun"
    substructure = monitor.status.get(NUMERICAL_SUBSTRUCTURE)
    if started and substructure is not None:
        return f"{substructure.message}; the recorder did not close its bag within {CLOSING_TIMEOUT:g} s"
    waiting_for = substructure.values.get("waiting_for", "") if substructure else NUMERICAL_SUBSTRUCTURE
    notes = {told.message for told in monitor.status.values() if told.state == status.WAITING} - {status.WAITING}
    why = f" ({'; '.join(sorted(notes))})" if notes else ""
    return (
        f"the nodes did not find each other within {START_TIMEOUT:g} s; "
        f"waiting for {waiting_for or 'the recorder'}{why}"
    )
