"""``bmd-rths figures``: figures of the paper, drawn from the numbers of this project."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.table import Column, Table
from rich.text import Text

from bmd_rths_core.errors import InputError
from bmd_rths_core.plots import FORMATS
from bmd_rths_nodes.cli.configuration import ConfigChoice
from bmd_rths_nodes.cli.options import check_writable, json_option, log, progress_bar

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.paper_figures.catalogue import FigureData

    Writer = Callable[[FigureData, Path, Sequence[str]], list[Path]]
    Drawn = tuple[FigureData, list[Path]]

#: Configurations of the two systems of the paper, installed with this package.
_PAPER = ("eight_story_bmd", "simplified_bmd")

#: The figure that shows a test under an earthquake.
_TEST = 13

T = TypeVar("T")


@click.command(epilog="Example: bmd-rths figures config/simplified_bmd.yaml --only 10,11 --output figures")
@click.argument("configs", metavar="[CONFIG]...", nargs=-1)
@click.option("--output", type=click.Path(path_type=Path), default="figures", show_default=True, help="Folder.")
@click.option("--only", metavar="NUMBERS", help="Some of 6,7,8,10,11,13.")
@click.option("--motion", metavar="FILE", help="Ground-motion record of Figure 13.")
@click.option(
    "--format", "formats", default=",".join(FORMATS), show_default=True, help=f"Some of {', '.join(FORMATS)}."
)
@json_option
def figures(
    configs: tuple[str, ...], output: Path, only: str | None, motion: str | None, formats: str, as_json: bool
) -> int:
    """Draw Figures 6, 7, 8, 10, 11 and 13 of the paper, with the values the paper states marked on them.

    CONFIG is a configuration of a system of the paper; without any, both are taken as they are installed. Figures 6, 7
    and 8 show the 8-story system, 10, 11 and 13 the simplified one. --motion is the record of Figure 13, whose test
    is run in process with phase-lead compensation and force correction.
    """
    from bmd_rths_core.ground_motion.config import select_ground_motion
    from bmd_rths_core.paper_figures.time_history import TimeHistory

    wanted = _figures_of(configs or _PAPER, motion, only)
    if _TEST in wanted:
        select_ground_motion(wanted[_TEST].ground_motion, wanted[_TEST].run.time_step)  # a wrong record is told at once
    elif motion is not None:
        raise InputError(f"--motion {motion}: only Figure {_TEST} shows a ground motion, and it is not drawn")
    chosen = _choose("--format", formats, {name: name for name in FORMATS})
    write_figure = _writer()
    check_writable(output)
    drawn = _draw(wanted, lambda data: write_figure(data, output, chosen))
    _show(drawn, as_json)
    stopped = [data.stopped for data, _ in drawn if isinstance(data, TimeHistory) and data.stopped]
    for reason in stopped:
        log(f"Figure {_TEST}: the test was stopped: {reason}")
    return 1 if stopped else 0


def _figures_of(configs: Sequence[str], motion: str | None, only: str | None) -> dict[int, Config]:
    """Return the figures to draw and the configuration of each."""
    from bmd_rths_core.paper_figures.systems import system_of

    found: dict[int, Config] = {}
    for name in configs:
        config = ConfigChoice(name, motion=motion).resolve()
        try:
            system = system_of(config)
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
        if found.keys() & set(system.figures):
            raise InputError(f"{name}: second configuration of the {system.name}; one of each system is allowed")
        found |= dict.fromkeys(system.figures, config)
    if only is None:
        return dict(sorted(found.items()))
    return {number: found[number] for number in _choose("--only", only, {str(n): n for n in sorted(found)})}


def _choose(option: str, text: str, allowed: Mapping[str, T]) -> list[T]:
    """Return the entries of a list with commas."""
    chosen = []
    for name in (part.strip() for part in text.split(",")):
        if name not in allowed:
            raise InputError(
                f"{option} {text}: {name!r} is not possible here; some of {','.join(allowed)} are required"
            )
        chosen.append(allowed[name])
    return chosen


def _writer() -> Writer:
    """Import the drawing functions here, so that no other command waits for matplotlib or needs it."""
    try:
        from bmd_rths_core.plots.drawing import write_figure
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "matplotlib":
            raise
        raise InputError("matplotlib: not installed; figures require it (pip install matplotlib)") from error
    return write_figure


def _draw(wanted: Mapping[int, Config], write: Callable[[FigureData], list[Path]]) -> list[Drawn]:
    from bmd_rths_core.paper_figures.catalogue import figure_data

    drawn: list[Drawn] = []
    with progress_bar(TextColumn("{task.description}"), BarColumn()) as progress:
        task = progress.add_task("", total=len(wanted))
        for number, config in wanted.items():
            progress.update(task, description=f"Figure {number}", completed=len(drawn))
            data = figure_data(number, config, lambda share: progress.update(task, completed=len(drawn) + share))
            drawn.append((data, write(data)))
    return drawn


def _show(drawn: Sequence[Drawn], as_json: bool) -> None:
    if as_json:
        result = [
            {
                "number": data.number,
                "title": data.title,
                "files": [str(path) for path in paths],
                "comparisons": [
                    {**entry._asdict(), "value": entry.value if math.isfinite(entry.value) else None}
                    for entry in data.comparisons
                ],
            }
            for data, paths in drawn
        ]
        click.echo(json.dumps({"figures": result}))
        return
    table = Table("Figure", "quantity", Column("here", justify="right"), "paper")
    for data, _ in drawn:
        for quantity, value, unit, paper in data.comparisons:
            here = f"{value:.3f}" if unit == "1" else f"{value:.2f} {unit}"
            table.add_row(*(Text(cell) for cell in (str(data.number), quantity, here, paper)))
    Console(soft_wrap=True).print(table)
    for _, paths in drawn:
        click.echo(f"written: {' '.join(map(str, paths))}")
