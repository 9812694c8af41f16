"""``bmd-rths robustness``: compensators on tables and specimens that are not quite what was identified."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import click

from bmd_rths_nodes.cli.configuration import RECORD_OPTIONS, ConfigChoice, configured
from bmd_rths_nodes.cli.options import check_writable, json_option, log


@click.command(epilog="Example: bmd-rths robustness config/simplified_bmd.yaml --model model.yaml --plants 500")
@configured("motion", *RECORD_OPTIONS)
@click.option("--schemes", metavar="NAMES", help="Compensators, by commas. [default: that of the configuration]")
@click.option("--plants", type=click.IntRange(min=1), default=100, show_default=True, help="How many are drawn.")
@click.option("--share", default=0.1, show_default=True, help="Uniform ± share of everything that is drawn.")
@click.option("--identified-deviations", is_flag=True, help="Draw from those of the identified model instead.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of the drawing.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes on this machine.")
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on instead (pip install distributed).")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default="robustness",
    show_default=True,
    help="Folder of the results; what it holds already is not run again.",
)
@json_option
def robustness(
    choice: ConfigChoice,
    schemes: str | None,
    plants: int,
    share: float,
    identified_deviations: bool,
    seed: int,
    jobs: int | None,
    scheduler: str | None,
    output: Path,
    as_json: bool,
) -> int:
    """Run a test on many drawn plants: poles, gain, stiffness, damping and noise ± a share, delay ± a step.

    A third of the plants have a further mode at 25 Hz. No model that the loop knows changes with them. Tells error,
    capture, spectral radius and peaks of every compensator; each run is a line of campaign.csv in --output.
    """
    from bmd_rths_core.campaign.motions import CampaignMotion
    from bmd_rths_core.campaign.robustness import RobustnessStudy, distributions
    from bmd_rths_core.errors import InputError
    from bmd_rths_core.ground_motion.library import read_ground_motion
    from bmd_rths_nodes.campaign.pool import CampaignStopped
    from bmd_rths_nodes.campaign.results import CampaignResults
    from bmd_rths_nodes.cli.campaign import run_study, scheme_names

    if jobs is not None and scheduler is not None:
        raise InputError("--jobs, --scheduler: only one of them is possible")
    config = choice.resolve().changed(table__controller="simulated")
    names = [config.run.scheme] if schemes is None else scheme_names(schemes)
    asked = config.ground_motion
    filtered = asked.high_pass_frequency > 0.0
    read = read_ground_motion(
        asked.record,
        asked.component,
        asked.unit,
        time_step=asked.record_time_step,
        columns=asked.columns,
        high_pass=filtered,
    )
    motion = CampaignMotion(asked.record, asked.component, asked.unit, read, asked.record_time_step, asked.columns)
    study = RobustnessStudy(config, [motion], names, plants, share, seed, identified=identified_deviations)
    check_writable(output)
    with contextlib.closing(CampaignResults(output)) as results:
        try:
            keys, done = run_study(study, results, None, jobs, scheduler)
        except CampaignStopped as stop:
            log(f"{stop}; what is finished stays, the same command goes on where it was")
            return 1
        if done:
            log(f"{done} of {len(keys)} runs were in {results.path} already")
        told = distributions(results.read(key) for key in keys)
    if as_json:
        about = {"plants": plants, "share": share, "seed": seed, "motion": read.name, "results": str(results.path)}
        click.echo(json.dumps({**about, "schemes": told}))
    else:
        _show(told, f"{read.name}: {plants} plants, ± {100.0 * share:g} %")
        click.echo(f"results: {results.path}")
    return 0


#: Measure, title and format.
_COLUMNS = {
    "substructure_percent": ("substructure [%]", ".1f"),
    "superstructure_clean_percent": ("superstructure, clean [%]", ".1f"),
    "capture_substructure": ("capture, substructure", ".2f"),
    "capture_superstructure": ("capture, superstructure", ".2f"),
    "spectral_radius": ("spectral radius", ".4f"),
    "peak_command": ("command [m/s²]", ".2f"),
    "peak_displacement": ("displacement [m]", ".4f"),
}


def _show(told: dict[str, dict[str, Any]], title: str) -> None:
    from rich.console import Console
    from rich.table import Table

    from bmd_rths_core.campaign.robustness import BAD_ENDS

    table = Table(title=f"{title}; median, p95, worst", title_justify="left", title_style="bold")
    table.add_column("")
    for scheme, summary in told.items():
        ends = [f"{summary[word]} {word}" for word in BAD_ENDS if summary[word]] or ["none unstable"]
        table.add_column(f"{scheme}, of {summary['runs']} {', '.join(ends)}", justify="right")
    for name, (label, digits) in _COLUMNS.items():
        table.add_row(label, *(_cell(summary[name], digits) for summary in told.values()))
    Console(soft_wrap=True).print(table)


def _cell(summary: dict[str, float | None], digits: str) -> str:
    values = (summary[name] for name in ("median", "p95", "worst"))
    return ", ".join("–" if value is None else format(value, digits) for value in values)
