"""What was reached of each limit of the supervisor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.supervised_peaks import largest_increment, largest_tracking_error
from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.report.document import Block, Paragraph, Table
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections.energy import figure as energy_figure
from bmd_rths_core.report.wording import number, significant

TITLE = "Limits"

CAPTION = (
    "Reached is what was recorded, on the way to rest too; the supervisor judges displacement and velocity ahead as "
    "well, until the table could be at rest. It also ends a test when commands or measurements stop coming, or a "
    "sensor is lost or stuck."
)


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [limits_table(run), Paragraph(CAPTION)]


def limits_table(run: ReportedRun) -> Table:
    """Return what was reached of each limit."""
    analysis = run.analysis
    peaks, safety = analysis.peaks_to_rest, analysis.config.safety
    energy = energy_figure(run)
    indicator = float("nan") if isinstance(energy, str) else energy.largest_indicator
    entries = (
        ("displacement [m]", peaks.displacement, "displacement"),
        ("velocity [m/s]", peaks.velocity, "velocity"),
        ("command [m/s²]", peak(_commands(run)), "acceleration"),
        ("change of the command in a step [m/s²]", largest_increment(analysis.record), "increment"),
        ("tracking error, running RMS [m/s²]", largest_tracking_error(analysis.record, safety), "tracking"),
        ("force [N]", peaks.force, "force"),
        ("stability indicator [1]", indicator, "stability"),
    )
    rows = []
    for name, value, limit_name in entries:
        limit = getattr(safety, f"{limit_name}_limit")
        share = f"{number(100.0 * value / limit)} %"
        action = safety.action(limit_name).name.lower().replace("_", " ")
        rows.append((name, significant(value), significant(limit), share, action))
    rows.append(("acceleration of the table [m/s²]", significant(peaks.acceleration), "none", "", ""))
    return Table(("largest absolute value", "reached", "limit", "share", "action"), tuple(rows))


def _commands(run: ReportedRun) -> NDArray[np.float64]:
    """Return every command, those of the way to rest and the one that was refused too [m/s²]."""
    rest = run.record.way_to_rest
    return run.record.command if rest is None else np.append(run.record.command, rest.command)
