"""``bmd-rths motions``: list the ground motions in a folder."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.table import Table
from rich.text import Text

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import ConfigChoice, record_options
from bmd_rths_nodes.cli.options import json_option, printable, progress_bar

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.ground_motion.catalogue import CatalogueEntry

#: Most characters of a line of the table.
_WIDTH = 250

#: Columns of the table: key of the object of ``--json``, heading, format.
_COLUMNS = (
    ("time_step_s", "Δt [s]", "g"),
    ("points", "points", "d"),
    ("duration_s", "length [s]", ".2f"),
    ("pga_m_s2", "PGA [m/s²]", ".4f"),
    ("pgv_m_s", "PGV [m/s]", ".3f"),
    ("dominant_frequency_hz", "f [Hz]", ".2f"),
    ("significant_duration_s", "D5-95 [s]", ".2f"),
)


#: Those of a configuration, with --as-run.
_AS_RUN = (
    ("scale_factor", "scale", ".4g"),
    ("as_run_pga_m_s2", "PGA run", ".3g"),
    ("as_run_pgv_m_s", "PGV run", ".3g"),
    ("as_run_pgd_m", "PGD run [m]", ".3g"),
    ("as_run_last_displacement_m", "left [m]", ".2g"),
)


@click.command(epilog="Example: bmd-rths motions records --json")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@record_options
@click.option("--as-run", metavar="CONFIG", help="Tell also how a configuration scales each: factor, PGA, PGV, PGD.")
@json_option
def motions(
    folder: Path, dt: float | None, unit: str | None, columns: str | None, as_run: str | None, as_json: bool
) -> int:
    """List the ground motions below a folder, and what is wrong with the other files.

    f is the frequency of the peak of the power spectral density of the acceleration (Welch, segments of 10 s), D5-95
    the significant duration. PGV is integrated from rest without any correction.
    """
    from bmd_rths_core.ground_motion.catalogue import catalogue, record_files
    from bmd_rths_core.ground_motion.config import GroundMotionConfig
    from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, Stated

    asked = GroundMotionConfig(
        unit=unit or FROM_FILE, record_time_step=dt or 0.0, columns=columns or FROM_FILE
    )  # checks them
    config = None if as_run is None else ConfigChoice(as_run).resolve()
    stated = Stated(unit=asked.unit, time_step=asked.record_time_step, columns=asked.columns)
    paths = record_files(folder)
    records: list[dict[str, Any]] = []
    not_read: list[dict[str, str]] = []
    with progress_bar(TextColumn("{task.description}"), BarColumn()) as progress:
        for path in progress.track(paths, description="reading"):
            name = path.name if path == folder else path.relative_to(folder).as_posix()
            try:
                records += [
                    {"file": name, **_plain(entry), **_as_run(entry, config)} for entry in catalogue(path, stated)
                ]
            except InputError as error:
                not_read.append({"file": name, "problem": str(error).removeprefix(f"{path}: ")})
    if as_json:
        click.echo(json.dumps({"records": records, "not_read": not_read}))
    else:
        _show(records, not_read)
        if not records:
            click.echo(f"no ground motion was found in {folder}")
    return 0


def _as_run(entry: CatalogueEntry, config: Config | None) -> dict[str, Any]:
    """Return how a configuration scales a record; nothing without one, None where it cannot be run with it."""
    if config is None:
        return {}
    from bmd_rths_core.ground_motion.as_run import as_run

    keys = ("scale_factor", "as_run_pga_m_s2", "as_run_pgv_m_s", "as_run_pgd_m", "as_run_last_displacement_m")
    try:
        if not entry.states_unit:
            raise InputError("no unit")
        ran = as_run(entry.motion, config.ground_motion, config.run.time_step)
    except InputError:
        return dict.fromkeys(keys)
    peaks = ran.scaled
    values = (ran.scale_factor, peaks.acceleration, peaks.velocity, peaks.displacement, peaks.last_displacement)
    return dict(zip(keys, values, strict=True))


def _plain(entry: CatalogueEntry) -> dict[str, Any]:
    """Return the properties of a record as plain values; those that need an unknown unit are None."""
    motion, measures = entry.motion, entry.intensity
    plain = {
        "format": entry.format,
        "component": entry.component,
        "states_unit": entry.states_unit,
        "note": entry.note,
        "time_step_s": motion.time_step,
        "points": motion.steps,
        "duration_s": motion.duration,
        "pga_m_s2": measures.peak_acceleration if entry.states_unit else None,
        "pgv_m_s": measures.peak_velocity if entry.states_unit else None,
        "arias_intensity_m_s": measures.arias_intensity if entry.states_unit else None,
        "dominant_frequency_hz": measures.dominant_frequency,
        "significant_duration_s": measures.significant_duration,
    }
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in plain.items()
    }


def _show(records: list[dict[str, Any]], not_read: list[dict[str, str]]) -> None:
    if records:
        _show_records(records)
    for file, note in dict.fromkeys((record["file"], record["note"]) for record in records if record["note"]):
        click.echo(f"note: {printable(file)}: {note}")
    for entry in not_read:
        click.echo(f"not read: {printable(entry['file'])}: {entry['problem']}")


def _show_records(records: list[dict[str, Any]]) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in ("file", "format", "component"):
        table.add_column(heading, no_wrap=True)
    columns = (*_COLUMNS, *_AS_RUN) if "scale_factor" in records[0] else _COLUMNS
    for _, heading, _ in columns:
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for record in records:
        cells = ("unknown" if record[key] is None else format(record[key], form) for key, _, form in columns)
        table.add_row(Text(printable(record["file"])), record["format"], Text(printable(record["component"])), *cells)
    # As wide as it needs to be: a terminal folds long lines, a pipe keeps them.
    Console(width=_WIDTH).print(table)
    if not all(record["states_unit"] for record in records):
        click.echo("unknown: the file states no unit; ground_motion.unit has to give it")
