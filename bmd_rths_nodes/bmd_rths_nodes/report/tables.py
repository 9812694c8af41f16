"""Tables of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.report.analysis import RunAnalysis
from bmd_rths_core.report.document import Table
from bmd_rths_core.report.responses import FloorResponses
from bmd_rths_core.report.run_report import RunReport
from bmd_rths_core.report.supervised_peaks import largest_increment, largest_tracking_error
from bmd_rths_nodes.report.wording import number, significant

_J = ("J1 tracking delay [ms]", "J2 tracking error [%]", "J3 peak tracking error [%]")


def rmse_table(analysis: RunAnalysis) -> Table:
    """Return the errors the paper states.

    Parameters
    ----------
    analysis : RunAnalysis
        The run.
    """
    errors = analysis.metrics.rmse_percent.items()
    rows = [(name.replace("_", " "), number(value if analysis.record.stable else None, 2)) for name, value in errors]
    return Table(("RMSE (Eq. 12)", "[%]"), tuple(rows))


def criteria_table(analyses: Mapping[str, RunAnalysis]) -> Table:
    """Return the criteria of the vRTHS benchmark, one column for each run.

    Parameters
    ----------
    analyses : Mapping of str to RunAnalysis
        The runs by the heading of their column, with the same number of floors.
    """
    count = len(next(iter(analyses.values())).criteria.response_error_percent)
    floors = ("interface", *(f"specimen floor {i}" for i in range(1, count)))
    names = [*_J, *(f"J{4 + i} error, {floor} [%]" for i, floor in enumerate(floors))]
    names += [f"J{4 + count + i} peak error, {floor} [%]" for i, floor in enumerate(floors)]
    columns = [analysis.told_criteria.values() for analysis in analyses.values()]
    rows = zip(names, *columns, strict=True)
    return Table(("criterion", *analyses), tuple((name, *(number(v, 2) for v in values)) for name, *values in rows))


def limits_table(report: RunReport) -> Table:
    """Return what was reached of each limit.

    Parameters
    ----------
    report : RunReport
        The run.
    """
    analysis = report.analysis
    peaks, safety = analysis.peaks, analysis.config.safety
    indicator = float("nan") if isinstance(report.energy, str) else report.energy.largest_indicator
    entries = (
        ("displacement [m]", peaks.displacement, "displacement"),
        ("velocity [m/s]", peaks.velocity, "velocity"),
        ("command [m/s²]", peak(analysis.record.command), "acceleration"),
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


def floors_table(responses: FloorResponses) -> Table:
    """Return errors and peaks of every floor, top floor first.

    Parameters
    ----------
    responses : FloorResponses
        The floors.
    """
    rows = tuple(
        (
            floor.name,
            number(floor.rmse_percent, 2),
            number(floor.peak_error_percent, 2),
            *(number(value, 3) for value in floor.peaks),
        )
        for floor in reversed(responses.floors)
    )
    return Table(("floor", "RMSE [%]", "peak error [%]", "peak [m/s²]", "reference [m/s²]"), rows)


def ductility_table(analysis: RunAnalysis, ductility: Sequence[float]) -> Table:
    """Return the ductility of the numerical stories.

    Parameters
    ----------
    analysis : RunAnalysis
        The run.
    ductility : sequence of float
        From the ground up.
    """
    pairs = zip(ductility, analysis.config.nonlinear.yield_drifts, strict=True)
    rows = tuple(
        (f"numerical story {i}", number(1e3 * value * drift, 3), number(1e3 * drift, 3), number(value, 2))
        for i, (value, drift) in enumerate(pairs, 1)
    )
    return Table(("story", "peak drift [mm]", "yield drift [mm]", "ductility [1]"), rows)


def comparison_table(analyses: Sequence[RunAnalysis]) -> Table:
    """Return the errors of several runs, one row for each, named after the folder of its bag.

    Parameters
    ----------
    analyses : sequence of RunAnalysis
        The runs.
    """
    rows = []
    for i, analysis in enumerate(analyses, 1):
        record, metrics = analysis.record, analysis.metrics
        known = record.stable
        errors = [number(value if known else None, 2) for value in metrics.rmse_percent.values()]
        label = f"{i}: {analysis.config.run.scheme}, {Path(record.source).name}"
        rows.append((label, record.outcome, *errors, number(metrics.tracking_delay_ms, 2)))
    names = ("substructure [%]", "control layer [%]", "superstructure [%]", "delay [ms]")
    return Table(("run", "outcome", *names), tuple(rows))
