"""``bmd-rths benchmark``: the benchmark problem of the field, and how the compensators do on it."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.campaign import usable_cores
from bmd_rths_nodes.cli.options import check_writable, json_option, log, progress_bar

if TYPE_CHECKING:
    from bmd_rths_core.ground_motion.motion import GroundMotion
    from bmd_rths_core.vrths.study import BenchmarkPiece, FinishedPiece, NominalRun, Summary

#: As `bmd_rths_core.ground_motion` has them, which needs numpy: help does without, and a test compares.
FROM_FILE = "from_file"
UNITS = (FROM_FILE, "g", "m/s2", "cm/s2", "gal")

#: Folder with the records that are no part of this project, where it has those of the problem, and units not stated.
FOLDER_VARIABLE = "BMD_RTHS_GROUND_MOTIONS"
_RECORDS = {
    "el_centro": ("El_Centro/RSN6_IMPVALL.I_I-ELC180*", FROM_FILE),
    "kobe": ("Kobe/RSN1106_KOBE_KJM000*", FROM_FILE),
    "morgan_hill": ("Morgan_Hill/MorganAccelNoScaling*", "m/s2"),
}
_CHIRP, _SHIPPED = "chirp", "el_centro_1940_ns"

#: Characters of a row of the table.
_WIDTH = 120


@click.group(epilog="Example: bmd-rths benchmark vrths --plants 20")
def benchmark() -> None:
    """Run a benchmark problem of the field."""


@benchmark.command(epilog="Example: bmd-rths benchmark vrths --schemes uc,lqg_adaptive --motion kobe.AT2 --json")
@click.option("--schemes", metavar="NAMES", help="Compensators, by commas. [default: uc,velocity_lead,lqg_adaptive]")
@click.option("--cases", default="1,2,3,4", show_default=True, metavar="NUMBERS", help="Buildings, by commas.")
@click.option(
    "--motion",
    "motions",
    multiple=True,
    metavar="FILE|NAME",
    help=f"Record, taken at 0.4; repeatable: a file, a shipped record, {_CHIRP}, or {', '.join(_RECORDS)} of the "
    f"folder in {FOLDER_VARIABLE}.  [default: {_SHIPPED}]",
)
@click.option("--unit", type=click.Choice(UNITS), default=FROM_FILE, help="Of a file that does not state it.")
@click.option("--plants", type=click.IntRange(min=0), default=20, show_default=True, help="Perturbed plants.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of plants and noise.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes. [default: one for every core]")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default="benchmark",
    show_default=True,
    help="Folder of report.html, vrths.json and a bag of every nominal plant.",
)
@json_option
def vrths(
    schemes: str | None,
    cases: str,
    motions: tuple[str, ...],
    unit: str,
    plants: int,
    seed: int,
    jobs: int | None,
    output: Path,
    as_json: bool,
) -> int:
    """Run the vRTHS benchmark problem: four buildings, the nominal plant and perturbed ones, J1 to J9.

    Silva, Gomez, Maghareh, Dyke and Spencer (2020), MSSP 135, 106381. J1 is in ms, J2 to J9 are in percent.
    """
    from bmd_rths_core.vrths.criteria import UNITS
    from bmd_rths_core.vrths.problem import INTENSITY
    from bmd_rths_core.vrths.schemes import DEFAULT_SCHEMES, make_tracker
    from bmd_rths_core.vrths.study import pieces, summarise
    from bmd_rths_nodes.cli.report_file import check_report_file

    numbers = _cases(cases)
    names = list(DEFAULT_SCHEMES) if schemes is None else [name.strip() for name in schemes.split(",")]
    names = list(dict.fromkeys(names))
    for name in names:
        make_tracker(name, numbers[0], 1)  # refuses what tracks no displacement, before the work begins
    records = [_record(reference, unit) for reference in dict.fromkeys(motions or (_SHIPPED,))]
    called = [record.name for record in records]
    if twice := {name for name in called if called.count(name) > 1}:
        raise InputError(f"--motion: two records are called {min(twice)!r}; one of each name is required")
    check_writable(output)
    bags = output / "bags"
    check_writable(bags)
    check_report_file(output / "report.html")
    from bmd_rths_core.report.benchmark_report import benchmark_report  # now that matplotlib is known to be there
    from bmd_rths_core.report.html import page_of

    work = list(pieces(numbers, records, names, plants, seed))
    runs_of, shown = _run(work, bags.absolute(), jobs or min(usable_cores(), len(work)))
    summaries = [summarise(runs) for runs in runs_of]
    for problem in dict.fromkeys(one.infeasible for one in summaries if one.infeasible):
        log(f"warning: {problem}")
    text = json.dumps(
        {
            "runs": [{key: _finite(value) for key, value in run.items()} for runs in runs_of for run in runs],
            "units": UNITS,
            "plants": plants,
            "seed": seed,
            "intensity": INTENSITY,
        }
    )
    report = output / "report.html"
    try:
        (output / "vrths.json").write_text(text + "\n", encoding="utf-8")
        report.write_text(page_of(benchmark_report(summaries, shown)), encoding="utf-8")
    except OSError as error:
        raise InputError(f"--output {output}: cannot be written: {error.strerror}") from error
    if as_json:
        click.echo(text)
    else:
        _show(summaries)
        click.echo(f"report: {report}; runs: {output / 'vrths.json'}; bags: {bags}")
    return 0


def _finite(value: Any) -> Any:
    """Return a number, or None for one that JSON does not have."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cases(text: str) -> list[int]:
    from bmd_rths_core.vrths.problem import CASES

    parts = [part.strip() for part in text.split(",")]
    known = {str(case): case for case in CASES}
    for part in parts:
        if part not in known:
            raise InputError(f"--cases {text}: {part!r} is not a building; some of {','.join(known)} are required")
    return list(dict.fromkeys(known[part] for part in parts))


def _record(reference: str, unit: str) -> GroundMotion:
    """Return a record at the rate and the intensity of the problem."""
    from bmd_rths_core.ground_motion.library import read_ground_motion
    from bmd_rths_core.vrths.study import benchmark_motion, chirp

    if reference == _CHIRP:
        return benchmark_motion(chirp())
    if reference in _RECORDS and not os.path.exists(reference):
        path, unit = _of_folder(reference)
        return benchmark_motion(read_ground_motion(path, unit=unit))
    return benchmark_motion(read_ground_motion(reference, unit=unit))


def _of_folder(name: str) -> tuple[Path, str]:
    """Return the file of a record of the problem, and its unit."""
    folder, (pattern, unit) = os.environ.get(FOLDER_VARIABLE, ""), _RECORDS[name]
    if not folder:
        raise InputError(f"--motion {name}: {FOLDER_VARIABLE} is not set; a folder with {pattern} is required")
    found = sorted(Path(folder).glob(pattern))
    if not found:
        raise InputError(f"--motion {name}: {folder} has no {pattern}")
    return found[0], unit


@dataclass(frozen=True)
class _Runner:
    """Run a piece and write the bag of its nominal plant."""

    bags: Path

    def __call__(self, piece: BenchmarkPiece) -> FinishedPiece:
        """Return what the piece gave."""
        from bmd_rths_core.vrths.study import run_piece
        from bmd_rths_msgs_py.vrths_bag import write_benchmark_run

        finished = run_piece(piece)
        directory = self.bags / f"{piece.motion.name}_{piece.scheme}_case_{piece.case}"
        with tempfile.TemporaryDirectory(prefix=".", dir=self.bags) as partial:
            written = write_benchmark_run(finished, Path(partial) / directory.name)
            shutil.rmtree(directory, ignore_errors=True)
            os.replace(written, directory)
        return finished


def _run(
    work: Sequence[BenchmarkPiece], bags: Path, jobs: int
) -> tuple[list[list[dict[str, Any]]], dict[str, tuple[str, NominalRun]]]:
    """Run all pieces; return the runs of each, in order, and of every motion the last nominal plant, to be shown."""
    from concurrent.futures.process import BrokenProcessPool

    from bmd_rths_nodes.campaign import pool

    run, order = _Runner(bags), {(p.motion.name, p.scheme, p.case): i for i, p in enumerate(work)}
    last = {p.motion.name: i for i, p in enumerate(work)}
    done: dict[int, list[dict[str, Any]]] = {}
    shown: dict[str, tuple[str, NominalRun]] = {}
    with progress_bar() as progress:
        task = progress.add_task("buildings, motions and schemes", total=len(work))
        results = pool.in_process(iter(work), run) if jobs == 1 else pool.in_processes(iter(work), run, jobs)
        try:
            for piece, runs, nominal in results:
                name = piece.motion.name
                place = order[name, piece.scheme, piece.case]
                done[place] = runs
                if place == last[name]:
                    caption = f"Actuator of the nominal plant, {piece.scheme}, building {piece.case}, {name}."
                    shown[name] = (caption, nominal)
                progress.advance(task)
        except BrokenProcessPool as error:
            raise InputError("benchmark: a process was killed; fewer --jobs need less memory") from error
    return [done[i] for i in range(len(work))], shown


def _show(summaries: Sequence[Summary]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from bmd_rths_core.report.benchmark_report import HEADER, criteria_rows

    console = Console(soft_wrap=True)
    console.width = max(console.width, _WIDTH)  # in a file too, no number is cut
    for motion, scheme in dict.fromkeys((one.motion, one.scheme) for one in summaries):
        table = Table(
            title=escape(f"{scheme}, {motion} at 0.4 of the record"), title_justify="left", title_style="bold"
        )
        for i, label in enumerate(HEADER[1:]):
            table.add_column(escape(label), justify="left" if i == 1 else "right")
        for row in criteria_rows([one for one in summaries if (one.motion, one.scheme) == (motion, scheme)]):
            table.add_row(*row[1:])
        console.print(table)
