"""``bmd-rths campaign``: every ground motion with every scheme and variation, in process or on the ROS graph."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import yaml
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import RECORD_OPTIONS, ConfigChoice, configured
from bmd_rths_nodes.cli.error_tables import show_error_tables
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import check_writable, json_option, log, progress_bar
from bmd_rths_nodes.cli.ros_required import require_ros

if TYPE_CHECKING:
    from bmd_rths_core.campaign.motions import CampaignMotion
    from bmd_rths_core.campaign.robustness import RobustnessStudy
    from bmd_rths_core.campaign.study import Piece, Study
    from bmd_rths_core.config import Config
    from bmd_rths_nodes.campaign.pool import Results
    from bmd_rths_nodes.campaign.results import CampaignResults

#: One more process is started for this many runs; for fewer it takes longer to start than it saves.
_WORTH_A_PROCESS = 64


@click.command(epilog="Example: bmd-rths campaign --motions records --vary force_correction.gain=0.3,0.5,0.7")
@configured(*RECORD_OPTIONS, default="simplified_bmd")
@click.option(
    "--motions",
    "source",
    required=True,
    metavar="DIR|LIST",
    type=click.Path(path_type=Path),
    help="Folder with records, one record, or a list with file[,component[,unit]] in every line.",
)
@click.option("--schemes", default=",".join(SCHEME_NAMES), show_default=True, metavar="NAMES", help="Schemes.")
@click.option(
    "--vary",
    "variations",
    multiple=True,
    metavar="SECTION.KEY=A,B,C",
    help="Values of a parameter; repeatable, all combinations are run. An array stands in brackets.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes on this machine; by default one for every core, or this one alone where there is little to do.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on instead (pip install distributed).")
@click.option(
    "--ros",
    "on_ros",
    is_flag=True,
    help="Make every run on the ROS graph, in lockstep, with a bag that its result is computed from; implies --bags.",
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default="campaign",
    show_default=True,
    help="Folder of the results; what it holds already is not run again.",
)
@click.option(
    "--capture",
    is_flag=True,
    help="Compute the capture of every run too, by two more runs each; part of what a run is.",
)
@click.option("--margins", "with_margins", is_flag=True, help="Compute the stability margin of every loop too.")
@click.option(
    "--plots",
    is_flag=True,
    help="Draw the study into the folder plots in --output: error over each varied parameter, box plots, maps of two.",
)
@click.option("--bags", "with_bags", is_flag=True, help="Write a bag of every run into the folder bags in --output.")
@json_option
def campaign(
    choice: ConfigChoice,
    source: Path,
    schemes: str,
    variations: tuple[str, ...],
    jobs: int | None,
    scheduler: str | None,
    on_ros: bool,
    output: Path,
    capture: bool,
    with_margins: bool,
    plots: bool,
    with_bags: bool,
    as_json: bool,
) -> int:
    """Run every ground motion with every scheme and variation, and print the errors, beside those of the paper.

    The runs are those of `bmd-rths simulate`; with --ros those of `bmd-rths run --lockstep --composed` without its
    pre-flight, one after the other. Without CONFIG it is the installed simplified_bmd. Results go to campaign.csv in
    --output as they come (and to campaign.parquet at the end, if pyarrow is installed): the same command goes on where
    a study was stopped. At the end study.csv has the runs of this command, with a column for each varied parameter. An
    unstable run is a result; the exit status is 0.
    """
    if plots:
        from bmd_rths_nodes.cli.report_file import require_matplotlib

        require_matplotlib("--plots")
    if jobs is not None and scheduler is not None:
        raise InputError("--jobs, --scheduler: only one of them is possible")
    if on_ros and (jobs is not None or scheduler is not None):
        raise InputError("--ros: one run after the other; neither --jobs nor --scheduler is possible")
    if on_ros:
        require_ros("campaign --ros")
    from concurrent.futures.process import BrokenProcessPool

    from bmd_rths_core.analysis.assumptions import assumptions
    from bmd_rths_core.campaign.motions import read_motions
    from bmd_rths_core.campaign.paper_tables import changes_the_system, is_paper_system
    from bmd_rths_core.campaign.study import Study
    from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY
    from bmd_rths_nodes.campaign.pool import CampaignStopped
    from bmd_rths_nodes.campaign.results import CampaignResults

    config = choice.resolve().changed(table__controller="simulated")
    vary = dict(_variation(text) for text in variations)
    names = scheme_names(schemes)
    said = dataclasses.replace(
        config.ground_motion,
        component=choice.component or ONLY,
        unit=choice.unit or FROM_FILE,
        record_time_step=choice.dt or 0.0,
        columns=choice.columns or FROM_FILE,
    )
    found = read_motions(source, said)
    for file, problem in found.left_out.items():
        log(f"left out: {file}: {problem}")
    study = (_study_on_ros if on_ros else Study)(config, found.motions, names, vary, capture=capture)
    check_writable(output)
    with contextlib.closing(CampaignResults(output)) as results:
        bags = _prepared(output / "bags") if with_bags or on_ros else None
        try:
            keys, done = run_study(study, results, bags, jobs, scheduler)
        except BrokenProcessPool:
            log("error: a process of the campaign was killed; the same command goes on where it was")
            return 1
        except CampaignStopped as stop:
            log(f"{stop}; what is finished stays, the same command goes on where it was")
            return 1
        if done:
            log(f"{done} of {len(keys)} runs were in {results.path} already")
        told = (_told(results.read(key), bags) for key in keys)
        parquet = results.write_parquet()
        study_file = _write_study(config, (results.read(key) for key in keys), with_margins, output)
        drawn = _draw([results.read(key) for key in keys], vary, output / "plots") if plots else []
        if as_json:
            _print_json(told, found.left_out, assumptions(config))
        else:
            paper = is_paper_system(config) and not changes_the_system(vary)
            show_error_tables(told, paper, assumed=(assumptions(config),))
            click.echo(f"results: {results.path}" + (f" {parquet}" if parquet else ""))
            click.echo(f"study: {study_file}")
            for path in drawn:
                click.echo(f"plot: {path}")
    return 0


def run_study(
    study: Study | RobustnessStudy, results: CampaignResults, bags: Path | None, jobs: int | None, scheduler: str | None
) -> tuple[list[str], int]:
    """Run what has no result yet; return the keys of all runs in their order, and how many were not run again."""
    from bmd_rths_nodes.campaign import pool

    keys: list[str] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with progress_bar(*columns) as progress:
        task = progress.add_task("runs", total=study.size)
        pending = _pending(study, results, bags, keys, lambda runs: progress.advance(task, runs))
        run = pool.PieceRunner(bags)
        processes = jobs or min(usable_cores(), 1 + study.size // _WORTH_A_PROCESS)
        if study.engine and bags is not None:
            finished = _on_ros(pending, bags, lambda text: progress.update(task, description=f"{text}; runs"))
        elif scheduler is not None:
            finished = pool.on_cluster(pending, run, scheduler)
        elif processes == 1:
            finished = pool.in_process(pending, run)
        else:
            finished = pool.in_processes(pending, run, processes)
        ran = 0
        for piece in finished:
            ran += len(piece)
            results.append(result for result in piece if result["key"] not in results)
            progress.advance(task, len(piece))
    return keys, len(keys) - ran


def _write_study(config: Config, results: Iterator[dict[str, Any]], with_margins: bool, output: Path) -> Path:
    from bmd_rths_core.campaign.margins import margins_of
    from bmd_rths_nodes.campaign.study_file import tidy_row, write_study

    margins: dict[str, dict[str, float | None]] = {}
    rows = []
    for result in results:
        own: dict[str, float | None] = {}
        if with_margins:
            loop = json.dumps([result["scheme"], result["variation"]])
            if loop not in margins:
                margins[loop] = margins_of(config, result["scheme"], result["variation"])
            own = margins[loop]
        rows.append(tidy_row(result, own))
    return write_study(rows, output)


def _draw(results: Sequence[dict[str, Any]], vary: Mapping[str, Sequence[object]], folder: Path) -> list[Path]:
    from bmd_rths_core.campaign.study_plots import study_plots
    from bmd_rths_core.plots.study import write_study_plots

    check_writable(folder)
    return write_study_plots(study_plots(results, vary), folder)


def usable_cores() -> int:
    """Return the cores this process may use, or all where the system does not tell (macOS, Windows)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _study_on_ros(
    config: Config,
    motions: Sequence[CampaignMotion],
    schemes: Sequence[str],
    vary: Mapping[str, Sequence[object]],
    capture: bool,
) -> Study:
    from bmd_rths_core.campaign.study import Study
    from bmd_rths_nodes.campaign.on_ros import DECIDED, ENGINE

    for name in vary:
        if name in DECIDED or name == "recorder.directory":
            raise InputError(f"--vary {name}: is decided by --ros")
    decided = {name.replace(".", "__"): value for name, value in DECIDED.items()}
    return Study(config.changed(**decided), motions, schemes, vary, ENGINE, capture)


def _on_ros(pieces: Iterator[Piece], bags: Path, on_progress: Callable[[str], None]) -> Iterator[Results]:
    from bmd_rths_nodes.campaign.on_ros import RosRunner  # a campaign in process need not wait for rclpy

    with collected_interrupts() as interrupts:
        yield from RosRunner(bags, interrupts, log, on_progress).results(pieces)


def _variation(text: str) -> tuple[str, list[object]]:
    name, equals, values = text.partition("=")
    try:
        parsed = yaml.safe_load(f"[{values}]")
    except yaml.YAMLError as error:
        raise InputError(f"--vary {text}: {values!r} is not a list of YAML values") from error
    if not equals or "." not in name or not parsed:
        raise InputError(f"--vary {text}: SECTION.KEY=A,B,C is required")
    return name, parsed


def scheme_names(text: str) -> list[str]:
    """Return the compensators of ``--schemes``, each once."""
    from bmd_rths_core.compensators.registry import compensators

    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in compensators():
            raise InputError(f"--schemes {text}: {name!r} is unknown; some of {','.join(compensators())} are required")
    return list(dict.fromkeys(names))


def _prepared(bags: Path) -> Path:
    """Make the folder of the bags, without those that a killed study left half written."""
    check_writable(bags)
    for partial in bags.glob(".*"):
        shutil.rmtree(partial, ignore_errors=True)
    return bags.absolute()


def _pending(
    study: Study | RobustnessStudy,
    results: CampaignResults,
    bags: Path | None,
    keys: list[str],
    skipped: Callable[[int], None],
) -> Iterator[Piece]:
    """Return what is left to run, and note the keys of all runs."""
    from bmd_rths_nodes.campaign.pool import has_bag

    def is_done(key: str) -> bool:
        return key in results and (bags is None or has_bag(results.read(key), bags))

    for piece in study.pieces():
        keys += [run.key for run in piece.runs]
        left = tuple(run for run in piece.runs if not is_done(run.key))
        skipped(len(piece.runs) - len(left))
        if left:
            yield dataclasses.replace(piece, runs=left)


def _told(result: dict[str, Any], bags: Path | None) -> dict[str, Any]:
    from bmd_rths_nodes.campaign.pool import bag_of

    return result if bags is None else {**result, "bag": str(bag_of(result, bags))}


def _print_json(results: Iterator[dict[str, Any]], left_out: dict[str, str], assumed: str) -> None:
    """Print one JSON object, run by run, so that the whole study need not be in memory."""
    click.echo('{"runs": [', nl=False)
    for i, result in enumerate(results):
        click.echo((", " if i else "") + json.dumps(result), nl=False)
    click.echo(f'], "left_out": {json.dumps(left_out)}, "assumptions": {json.dumps(assumed)}}}')
