"""Results of a run, as JSON and as a table."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

from bmd_rths_msgs_py.topics import NAMESPACE

if TYPE_CHECKING:
    from bmd_rths_core.analysis.run_analysis import RunAnalysis


#: Why a run of some `RunRecord.stability` has no errors.
_NOT_COMPUTED = {
    "unstable": "not computed, the loop was unstable",
    "limit": "not computed, a limit ended the test",
    "no data": "no data",
}


def result_of(analysis: RunAnalysis) -> dict[str, Any]:
    """Return the result of a run as plain values.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.

    Returns
    -------
    dict
        The object of ``--json``. Errors of a run that a limit ended are None.
    """
    from bmd_rths_core.analysis.quality import told_quality
    from bmd_rths_core.report.wording import assumption

    record, metrics = analysis.record, analysis.metrics
    result = {
        "scheme": record.configuration["run"]["scheme"],
        "table": record.controller,
        "assumptions": assumption(analysis) if record.controller in ("simulated", "unknown") else "",
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
        **told_quality(analysis.quality, record.stable),
        "benchmark_criteria": analysis.told_criteria,
        "table_peaks": analysis.peaks._asdict(),
        "table_peaks_to_rest": analysis.peaks_to_rest._asdict(),
        "way_to_rest_steps": 0 if record.way_to_rest is None else record.way_to_rest.steps,
        "missing_values": metrics.missing_values,
        "missing_share": analysis.gaps.share,
        "may_have_changed": dict(analysis.gaps.changes) or None,
    }
    if record.namespace not in ("", NAMESPACE):
        result["namespace"] = record.namespace
    if analysis.ductility is not None:
        result["ductility"] = list(analysis.ductility)
    if record.timing is not None:
        result["missed_deadlines"] = record.timing.missed_deadlines
        result["max_consecutive_misses"] = record.timing.max_consecutive_misses
        result["late_ticks"] = record.timing.late_ticks
        result["slow_integrations"] = record.timing.slow_integrations
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
    if result["stable"]:
        for label, of in _QUALITY.items():
            table.add_row(label, ", ".join(_of_place(name, value) for name, value in result[of].items()))
    table.add_row("tracking error of the table", _number(result["tracking_error_percent"], "%"))
    table.add_row("delay, amplitude (FEI)", _evaluation(result))
    table.add_row("tracking delay of the table", _number(result["tracking_delay_ms"], "ms"))
    table.add_row("peaks of the table", _table_peaks(result["table_peaks"]))
    if result["table_peaks_to_rest"] != result["table_peaks"]:
        table.add_row("with the way to rest", _table_peaks(result["table_peaks_to_rest"]))
    if "ductility" in result:
        table.add_row("ductility, ground up", ", ".join(_number(value, "").strip() for value in result["ductility"]))
    extent = f" ({result['duration_s']:g} s, not the whole ground motion; every number holds for that alone)"
    table.add_row("steps", f"{result['steps']}{'' if result['outcome'] == 'finished' else extent}")
    if result["missing_values"]:
        table.add_row("values not recorded", _missing(result))
    if "closure_ms" in result:
        closure = ", ".join(f"{name} {_number(value, 'ms')}" for name, value in result["closure_ms"].items())
        table.add_row("missed deadlines", str(result["missed_deadlines"]))
        table.add_row("steps that began late", str(result["late_ticks"]))
        table.add_row("closure of a step", closure)
        if result["slow_integrations"]:
            table.add_row("integrations that took too long", str(result["slow_integrations"]))
    if "namespace" in result:
        table.add_row("namespace", result["namespace"])
    table.add_row("verdict", Text(result["verdict"], style=_COLOURS[result["verdict"]]))
    Console(soft_wrap=True).print(table)
    for reason in result["verdict_reasons"]:
        click.echo(reason)
    if result["assumptions"]:
        click.echo(result["assumptions"])
    if "bag" in result:
        click.echo(f"bag: {result['bag']}")


#: What is told of interface and floors, beside the errors against the nominal building.
_QUALITY = {
    "RMSE, true building": "rmse_true_percent",
    "the same without noise": "rmse_clean_percent",
    "noise of the sensors": "noise_floor_percent",
    "capture": "capture",
}
_COLOURS = {"green": "bold green", "red": "bold red", "unjudged": "bold yellow"}


def _of_place(name: str, value: float | None) -> str:
    return f"{name.replace('_', ' ')} {'–' if value is None else format(value, '.2f')}"


def _evaluation(result: dict[str, Any]) -> str:
    at = f" at {_number(result['frequency_hz'], 'Hz')}" if result["frequency_hz"] is not None else ""
    return f"{_number(result['delay_ms'], 'ms')}, {_number(result['amplitude'], '').strip()}{at}"


def _table_peaks(peaks: dict[str, float | None]) -> str:
    """Return the line of the peaks of the shake table."""
    parts = (("displacement", 1e3, "mm"), ("velocity", 1e3, "mm/s"), ("acceleration", 1.0, "m/s²"))
    return ", ".join(
        _number(None if (value := peaks[name]) is None else scale * value, unit) for name, scale, unit in parts
    )


def _missing(result: dict[str, Any]) -> str:
    """Return what is missing, and what that means for the numbers."""
    from bmd_rths_core.analysis.missing_rows import LARGEST_SHARE
    from bmd_rths_core.report.wording import changes_in_words

    if result["missing_share"] > LARGEST_SHARE:
        share = 100.0 * result["missing_share"]
        return f"{result['missing_values']}; a signal lacks {share:.1f} % of its steps: errors and delay are not given"
    if result["may_have_changed"] is None:
        return str(result["missing_values"])
    changes = {name: math.nan if value is None else value for name, value in result["may_have_changed"].items()}
    return f"{result['missing_values']}; they may have changed {changes_in_words(changes)}"


def _number(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{value:.2f} {unit}"


def without_nan(value: Any) -> Any:
    """Return a value with None in place of NaN, which JSON does not have.

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
