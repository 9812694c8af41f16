"""Results of a run, as JSON and as a table for a person."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from bmd_rths_core.analysis.run_analysis import RunAnalysis


#: Why a run of some `RunRecord.stability` has no errors.
_NOT_COMPUTED = {
    "unstable": "not computed, the loop was unstable",
    "limit": "not computed, a limit ended the test",
    "no data": "no data",
}


def result_of(analysis: RunAnalysis) -> dict[str, Any]:
    """Return everything a command tells about a run, as plain values.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.

    Returns
    -------
    dict
        The object of ``--json``. Errors of a run that a limit ended are None.
    """
    from bmd_rths_core.analysis.assumptions import assumptions

    record, metrics = analysis.record, analysis.metrics
    result = {
        "scheme": record.configuration["run"]["scheme"],
        "table": record.controller,
        "assumptions": assumptions(analysis.config, record.controller),
        "motion": record.motion["name"],
        "steps": record.steps,
        "duration_s": record.steps * record.time_step,
        "stable": None if record.stability == "no data" else record.stable,
        "stability": record.stability,
        "outcome": record.outcome,
        "reason": record.reason,
        "rmse_percent": metrics.rmse_percent if record.stable else dict.fromkeys(metrics.rmse_percent),
        "floor_rmse_percent": list(metrics.floor_rmse_percent) if record.stable else None,
        "tracking_delay_ms": metrics.tracking_delay_ms,
        "benchmark_criteria": analysis.told_criteria,
        "table_peaks": analysis.peaks._asdict(),
        "missing_values": metrics.missing_values,
    }
    if analysis.ductility is not None:
        result["ductility"] = list(analysis.ductility)
    if record.timing is not None:
        result["missed_deadlines"] = record.timing.missed_deadlines
        result["max_consecutive_misses"] = record.timing.max_consecutive_misses
        result["late_ticks"] = record.timing.late_ticks
        result["late_share"] = record.late_share
        result["kept_time"] = record.kept_time
        result["closure_ms"] = dict(record.timing.closure_ms)
    return {key: without_nan(value) for key, value in result.items()}


def show(result: dict[str, Any], as_json: bool) -> None:
    """Print a result on standard output.

    Parameters
    ----------
    result : dict
        See `result_of`; may have a ``bag`` besides.
    as_json : bool
        As one JSON object, or as a table.
    """
    if as_json:
        click.echo(json.dumps(result))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    outcome = result["outcome"] if result.get("kept_time") is not False else f"{result['outcome']}, not in real time"
    title = f"{result['motion']}, {result['scheme']}: {outcome} ({result['reason']})"
    table = Table(title=Text(title), title_justify="left", show_header=False, title_style="bold")
    for floor, value in result["rmse_percent"].items():
        table.add_row(
            f"RMSE {floor.replace('_', ' ')}",
            _NOT_COMPUTED.get(result["stability"]) or _number(value, "%"),
        )
    table.add_row("tracking delay of the table", _number(result["tracking_delay_ms"], "ms"))
    table.add_row("peaks of the table", _table_peaks(result["table_peaks"]))
    if "ductility" in result:
        table.add_row("ductility, ground up", ", ".join(_number(value, "").strip() for value in result["ductility"]))
    extent = f" ({result['duration_s']:g} s, not the whole ground motion; every number holds for that alone)"
    table.add_row("steps", f"{result['steps']}{'' if result['outcome'] == 'finished' else extent}")
    if result["missing_values"]:
        table.add_row("values not recorded", str(result["missing_values"]))
    if "closure_ms" in result:
        closure = ", ".join(f"{name} {_number(value, 'ms')}" for name, value in result["closure_ms"].items())
        table.add_row("missed deadlines", str(result["missed_deadlines"]))
        table.add_row("steps that began late", str(result["late_ticks"]))
        table.add_row("closure of a step", closure)
    Console(soft_wrap=True).print(table)
    if result["assumptions"]:
        click.echo(result["assumptions"])
    if "bag" in result:
        click.echo(f"bag: {result['bag']}")


def _table_peaks(peaks: dict[str, float | None]) -> str:
    """Return a text of the peaks of the table's motion."""
    parts = (("displacement", 1e3, "mm"), ("velocity", 1e3, "mm/s"), ("acceleration", 1.0, "m/s²"))
    return ", ".join(
        _number(None if (value := peaks[name]) is None else scale * value, unit) for name, scale, unit in parts
    )


def _number(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{value:.2f} {unit}"


def without_nan(value: Any) -> Any:
    """Return a value for JSON, which has no NaN: what could not be computed is null.

    Parameters
    ----------
    value : Any
        Plain values, in mappings and lists of any depth.
    """
    if isinstance(value, dict):
        return {key: without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [without_nan(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
