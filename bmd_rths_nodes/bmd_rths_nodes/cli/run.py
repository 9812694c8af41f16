"""``bmd-rths run``: start the ROS graph, run the test, print its errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from bmd_rths_nodes.cli import preflight
from bmd_rths_nodes.cli.commission import age_in_words
from bmd_rths_nodes.cli.configuration import RECORD_OPTIONS, ConfigChoice, configured
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import json_option, log, namespace_option, output_folder, progress_bar
from bmd_rths_nodes.cli.results import result_of, show
from bmd_rths_nodes.cli.ros_required import require_ros

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.record import RunRecord
    from bmd_rths_nodes.cli.monitor_web import RunPage
    from bmd_rths_nodes.run.monitor import RunMonitor

#: Longest time that data wait in the memory of the recorder while a page follows the bag [s].
_FLUSH_PERIOD = 0.05

_TOO_SLOW = (
    "{} deadlines were missed, at most {} in a row{}. "
    "This computer, or the table controller, did not keep up with the time step. Ending other work, --composed or a "
    "longer run.time_step help; run.longest_miss_time and safety.stale_shear_time say how long the loop waits."
)


@click.command(epilog="Example: bmd-rths run config/simplified_bmd.yaml --scheme plc_fc --output bags")
@configured("scheme", "motion", *RECORD_OPTIONS, "table")
@click.option("--lockstep", is_flag=True, help="Start each step when the last one has closed, as fast as it goes.")
@click.option("--composed", is_flag=True, help="Run the five nodes of the loop in one process.")
@click.option(
    "--override-preflight",
    is_flag=True,
    help="Run also what the pre-flight refuses: a loop that is not stable, or a predicted limit. The bag tells.",
)
@click.option("--output", type=click.Path(path_type=Path), help="Folder the bag is written into.")
@click.option("--monitor", "with_page", is_flag=True, help="Show the test live on a page for a browser, with STOP.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of --monitor. [default: any that is free]")
@namespace_option
@json_option
def run(
    choice: ConfigChoice,
    lockstep: bool,
    composed: bool,
    override_preflight: bool,
    output: Path | None,
    with_page: bool,
    port: int,
    namespace: str,
    as_json: bool,
) -> int:
    """Run a test on the ROS graph, record it and print its errors.

    Predicts the whole test with the identified models, and refuses it when that passes a limit or the loop is not
    stable. Starts the five nodes and the recorder, waits until they have found each other, runs the ground motion and
    computes the errors from the bag. Ctrl-C ends the test in order and brings the table to rest; a second one stops it
    at once, a third one does not wait for the bag. The page of --monitor reads the bag and listens to no topic.
    """
    require_ros("run")
    from bmd_rths_core.ground_motion.as_run import ground_motion_as_run
    from bmd_rths_nodes.hardware.controllers import make_table_controller
    from bmd_rths_nodes.run.execute import COMPOSED_PROCESSES, PROCESSES
    from bmd_rths_nodes.run.follower import RunFailed
    from bmd_rths_nodes.run.monitor import RunMonitor

    resolved = choice.resolve(run__record=True, **({"recorder__flush_period": _FLUSH_PERIOD} if with_page else {}))
    if lockstep:
        resolved = resolved.changed(run__lockstep=True)
    if override_preflight:
        resolved = resolved.changed(run__preflight="override")
    make_table_controller(resolved)  # refuses what is wrong before any process is started; nothing is connected
    ran = ground_motion_as_run(resolved.ground_motion, resolved.run.time_step)
    motion = ran.motion
    folder = output if output is not None else Path(resolved.recorder.directory)
    resolved = resolved.changed(recorder__directory=str(folder.absolute()))
    with _page(with_page, port) as page:  # to the very end, so that a browser sees how the test has ended
        # The monitor looks for another run while this one is predicted.
        with output_folder(folder), RunMonitor(namespace) as monitor:
            prediction = preflight.checked(resolved, motion)
            if prediction is not None:
                log(preflight.in_words(resolved, prediction))
            preflight.tell_motion(resolved, ran)
            if resolved.table.controller != "simulated":
                log(age_in_words(choice.config))
            try:
                bag = _run(resolved, motion.steps, COMPOSED_PROCESSES if composed else PROCESSES, monitor, page)
            except RunFailed as error:
                log(f"error: {error}")
                return 1
        # Not before: the test need not wait for what it is analysed with.
        from bmd_rths_core.analysis.run_analysis import analysed
        from bmd_rths_msgs_py.bag_reader import read_bag

        record = read_bag(bag)
        _explain_misses(record)
        predicted = None if prediction is None else preflight.as_mapping(prediction)
        show({**result_of(analysed(record)), "preflight": predicted, "bag": str(bag)}, as_json)
        return 0 if record.outcome == "finished" else 1


def _explain_misses(record: RunRecord) -> None:
    """Say that a test did not keep real time, and what to do when missed deadlines ended it, or may have."""
    from bmd_rths_core.report.wording import lateness

    timing = record.timing
    if record.outcome == "finished" and record.kept_time is False:
        log(f"warning: the test did not keep real time: {lateness(record)}")
    if timing is None or not timing.missed_deadlines or record.outcome not in ("failed", "limit"):
        return
    led = "; late shears make the command jump and drift, which may have led to the limit"
    log(
        _TOO_SLOW.format(
            timing.missed_deadlines, timing.max_consecutive_misses, led if record.outcome == "limit" else ""
        )
    )


@contextmanager
def _page(wanted: bool, port: int) -> Iterator[RunPage | None]:
    """Show the page while the test runs, if it is wanted."""
    if not wanted:
        yield None
        return
    from bmd_rths_nodes.cli.monitor_web import RunPage

    with RunPage(port) as page:
        yield page


def _run(
    config: Config, steps: int, modules: tuple[str, ...], monitor: RunMonitor, page: RunPage | None = None
) -> Path:
    """Run the processes to the end of the test, show progress, and return the bag."""
    from bmd_rths_msgs_py.topics import RECORDER
    from bmd_rths_nodes.run.execute import ENDING, run_on_ros

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    with collected_interrupts() as interrupts, progress_bar(*columns, TimeElapsedColumn()) as progress:
        task = progress.add_task("starting", total=steps)
        if page is not None:
            page.follow(interrupts)

        def show_progress(description: str, begun: int) -> None:
            progress.update(task, description=description, completed=begun)
            if page is not None:
                recorder = monitor.status.get(RECORDER)
                page.show("" if recorder is None else recorder.values.get("bag", ""))
                if description == ENDING:
                    page.end()

        tell = log if page is None else page.log
        try:
            recorded = run_on_ros(config, modules, monitor, interrupts, tell, show_progress)
        finally:
            if page is not None:
                page.leave()
    if recorded.problem:
        log(f"error: {recorded.problem}")
    return recorded.bag
