"""``bmd-rths stability``: go or no-go before a test."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.table import Table

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.options import json_option, progress_bar
from bmd_rths_nodes.cli.results import without_nan

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.stability.analysed_loops import AnalysisOptions
    from bmd_rths_core.stability.assessment import Analysis, Assessment
    from bmd_rths_core.stability.confirmation import Confirmation
    from bmd_rths_core.stability.continuous import MarginCurve
    from bmd_rths_core.stability.loop_elements import MeasuredResponse
    from bmd_rths_core.stability.sensitivity import ChangedParameter, ParameterSensitivity

#: Longest pure delay of --table [ms], that of simulated_table.command_delay.
_LONGEST_DELAY = 1000.0
#: Points of the sweep that the printed table has; ``--json`` has all.
_SHOWN_POINTS = 8

_COLUMNS = ("continuous\nEqs. 7 and 8", "complete\nall modes, one step", "discrete\nas it is run")
#: Narrowest output; a terminal that is narrower wraps [characters].
_WIDTH = 116


@click.command(epilog="Example: bmd-rths stability config/eight_story_bmd.yaml --scheme uc --modes identified")
@configured("scheme")
@click.option(
    "--table",
    default="identified",
    metavar="identified|perfect|delay:MS|FILE",
    help="Table: the simulated one of the configuration, a perfect one, a pure delay in ms, that of a model that "
    "`bmd-rths identify` wrote (YAML), or a measured frequency response (CSV with frequency_hz, magnitude, phase_deg). "
    "Nothing but the table is replaced; --model takes specimen and delay constant of a model too.",
)
@click.option(
    "--modes",
    default="all",
    metavar="identified|N|all",
    help="Modes of the specimen in Eqs. 7 and 8: the identified first one, the first N, or all. The two other analyses "
    "always have all.",
)
@click.option(
    "--feedback-delay",
    type=click.IntRange(0, 1000),
    default=0,
    metavar="STEPS",
    help="Delay of the shear in Eqs. 7 and 8. The two other analyses have the one step of the loop.",
)
@click.option("--sweep", "with_sweep", is_flag=True, help="Allowable mass ratio over the numerical frequency.")
@click.option(
    "--sensitivity/--no-sensitivity",
    "with_sensitivity",
    default=True,
    show_default=True,
    help="Change every parameter 10 %.",
)
@json_option
def stability(
    choice: ConfigChoice,
    table: str,
    modes: str,
    feedback_delay: int,
    with_sweep: bool,
    with_sensitivity: bool,
    as_json: bool,
) -> int:
    """Tell whether the loop of a configuration is stable: go or no-go before a test.

    Three analyses stand side by side: Eqs. 7 and 8 of the paper, the same with all modes and the delay of the loop,
    and the eigenvalues of the loop as it is run, confirmed in the time domain. The exit status is 0 for both verdicts.
    """
    from bmd_rths_core.stability.analysed_loops import AnalysisOptions, has_continuous_loops, refuse_substeps, sweep
    from bmd_rths_core.stability.assessment import assess
    from bmd_rths_core.stability.confirmation import confirm

    resolved, measured = _with_table(choice.resolve(), table)
    not_fitted = ""
    if measured is not None:
        resolved, not_fitted = _with_fit(resolved, table)
    chosen = int(modes) if modes.removeprefix("-").isdecimal() else modes
    options = AnalysisOptions(chosen, feedback_delay, measured, not_fitted)
    assessment = assess(resolved, options)
    confirmation = None if assessment.discrete is None else confirm(resolved, assessment.discrete.margin)
    if with_sweep and not has_continuous_loops(resolved):
        refuse_substeps(resolved)
        raise InputError(f"--sweep: only for the schemes of the paper; {resolved.run.scheme} has no transfer function")
    curve = sweep(resolved, options) if with_sweep else None
    entries = _sensitivity(resolved, options) if with_sensitivity else []
    if as_json:
        result = _as_mapping(assessment, confirmation)
        result["sensitivity"] = [_entry(entry) for entry in entries] if with_sensitivity else None
        result.update(scheme=resolved.run.scheme, table=table, modes=modes, feedback_delay_steps=feedback_delay)
        if curve is not None:
            result["sweep"] = {
                "numerical_frequency_rad_s": curve.frequencies.tolist(),
                "allowable_mass_ratio": curve.allowable_mass_ratios.tolist(),
                "critical_frequency_rad_s": curve.critical_frequencies.tolist(),
            }
        click.echo(json.dumps(without_nan(result)))
        return 0
    console = Console()
    console.width = max(console.width, _WIDTH)
    click.echo(assessment.verdict_text)
    if resolved.nonlinear.story_model != "linear":
        click.echo(
            f"The stories are {resolved.nonlinear.story_model}: this is their elastic range, small motion about rest."
        )
    if (substeps := resolved.numerical_substructure.substeps) > 1:
        click.echo(f"The numerical substructure takes {substeps} steps for one of its own, which discrete alone knows.")
    _show_analyses(console, assessment, confirmation)
    if measured is not None:
        click.echo(
            f"The table is known up to {measured.frequencies[-1] / math.tau:.4g} Hz; beyond nothing was examined."
        )
        if not not_fitted:
            click.echo(f"Discrete is of its fit, with an error of {100.0 * resolved.simulated_table.fit_error:.3g} %.")
    if curve is not None:
        _show_sweep(console, curve)
    if entries:
        _show_sensitivity(console, entries)
    return 0


def _with_table(config: Config, table: str) -> tuple[Config, MeasuredResponse | None]:
    """Return the configuration with the table of ``--table``, or its measured frequency response."""
    kind, colon, delay = table.partition(":")
    if table == "identified":
        return config, None
    if table == "perfect":
        return config.changed(simulated_table__dynamics="perfect", simulated_table__command_delay=0.0), None
    if kind == "delay" and colon:
        try:
            milliseconds = float(delay)
        except ValueError:
            milliseconds = -1.0
        if not 0.0 <= milliseconds <= _LONGEST_DELAY:
            raise InputError(f"--table {table}: {delay!r} is not allowed; a delay from 0 to 1000 ms is required")
        changes = {"simulated_table__dynamics": "perfect", "simulated_table__command_delay": milliseconds * 1e-3}
        return config.changed(**changes), None
    if table.endswith((".yaml", ".yml")):
        return dataclasses.replace(config, simulated_table=config.merged(table).simulated_table), None
    if not (table.endswith(".csv") or Path(table).is_file()):
        raise InputError(f"--table {table}: unknown; identified, perfect, delay:MS, a YAML or a CSV file is required")
    from bmd_rths_core.stability.response_file import read_frequency_response

    return config, read_frequency_response(table)


def _with_fit(config: Config, table: str) -> tuple[Config, str]:
    """Return the configuration with the fit of a measured response, or why there is none."""
    from bmd_rths_core.identification.measured_table import with_fitted_table

    measured = {"simulated_table__dynamics": "measured", "simulated_table__frequency_response": table}
    try:
        return with_fitted_table(config.changed(**measured)), ""
    except InputError as error:
        return config, str(error)


def _sensitivity(config: Config, options: AnalysisOptions) -> list[ParameterSensitivity]:
    from bmd_rths_core.stability.sensitivity import sensitivity

    with progress_bar(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %")
    ) as progress:
        task = progress.add_task("sensitivity", total=1.0)
        return sensitivity(config, options, lambda done: progress.update(task, completed=done))


def _as_mapping(assessment: Assessment, confirmation: Confirmation | None) -> dict[str, Any]:
    """Return the object of ``--json`` without the options."""
    discrete = None
    if assessment.discrete is not None and confirmation is not None:
        discrete = {
            **_analysis(assessment.discrete),
            "spectral_radius": assessment.discrete.spectral_radius,
            "growth_per_step_below": confirmation.growth_below,
            "growth_per_step_above": confirmation.growth_above,
            "confirmed": confirmation.confirmed,
        }
    first = assessment.continuous or assessment.discrete
    headline = dict.fromkeys(("allowable_mass_ratio", "critical_frequency_rad_s", "stable"))
    return {
        "mass_ratio": assessment.mass_ratio,
        "whole_mass_ratio": assessment.whole_mass_ratio,
        **(headline if first is None else {key: _analysis(first)[key] for key in headline}),
        "verdict": _verdict(assessment),
        "verdict_text": assessment.verdict_text,
        "largest_feedback_scale": assessment.largest_feedback_scale,
        "continuous": None if assessment.continuous is None else _analysis(assessment.continuous),
        "continuous_complete": (
            None if assessment.continuous_complete is None else _analysis(assessment.continuous_complete)
        ),
        "discrete": discrete,
        "discrete_reason": assessment.discrete_reason or None,
    }


def _analysis(analysis: Analysis) -> dict[str, Any]:
    return {
        "allowable_mass_ratio": analysis.margin.allowable_mass_ratio,
        "critical_frequency_rad_s": analysis.margin.critical_frequency,
        "stable": analysis.stable,
        "stable_intervals": [[interval.lower, interval.upper] for interval in analysis.margin.stable_intervals],
    }


def _verdict(assessment: Assessment) -> str:
    return "go" if assessment.go else "no-go"


def _entry(entry: ParameterSensitivity) -> dict[str, Any]:
    return {
        "parameter": entry.parameter,
        "value": entry.value,
        "effect": entry.effect,
        "decreased": _changed(entry.decreased),
        "increased": _changed(entry.increased),
    }


def _changed(changed: ChangedParameter) -> dict[str, Any]:
    assessment = changed.assessment
    if assessment is None:
        return {"value": changed.value, "not_allowed": changed.problem}
    return {
        "value": changed.value,
        "mass_ratio": assessment.mass_ratio,
        "allowable_mass_ratio": {name: a.margin.allowable_mass_ratio for name, a in assessment.analyses.items()},
        "verdict": _verdict(assessment),
        "flips_verdict": changed.flips_verdict,
    }


def _show_analyses(console: Console, assessment: Assessment, confirmation: Confirmation | None) -> None:
    table = Table(title=f"mass ratio {assessment.mass_ratio:.4f}", title_justify="left", title_style="bold")
    table.add_column()
    for title in _COLUMNS:
        table.add_column(title)
    analyses = [assessment.continuous, assessment.continuous_complete, assessment.discrete]
    not_made = ("not applicable", "not applicable", "not made")
    verdicts = (_stable(analysis, word) for analysis, word in zip(analyses, not_made, strict=True))
    table.add_row("verdict", *verdicts)
    table.add_row("allowable mass ratio", *(_ratio(a) for a in analyses))
    table.add_row("critical frequency", *("" if a is None else _hertz(a.margin.critical_frequency) for a in analyses))
    table.add_row("stable mass ratios", *("" if a is None else _intervals(a) for a in analyses))
    if assessment.discrete is not None and confirmation is not None:
        table.add_row("spectral radius", "", "", f"{assessment.discrete.spectral_radius:.6f}")
        growths = f"{_growth(confirmation.growth_below)}, {_growth(confirmation.growth_above)}"
        table.add_row("growth at 0.99, 1.01 of it", "", "", growths)
        words = {True: "yes", False: "NO", None: "no margin"}
        table.add_row("confirmed by simulation", "", "", words[confirmation.confirmed])
    console.print(table)
    if assessment.discrete_reason:
        click.echo(f"No discrete analysis: {assessment.discrete_reason}.")


def _show_sweep(console: Console, curve: MarginCurve) -> None:
    table = Table(title="allowable mass ratio over the numerical frequency", title_justify="left", title_style="bold")
    for title in ("numerical substructure", "allowable mass ratio", "critical frequency"):
        table.add_column(title, justify="right")
    last = len(curve.frequencies) - 1
    for k in (round(i * last / (_SHOWN_POINTS - 1)) for i in range(_SHOWN_POINTS)):
        ratio = f"{curve.allowable_mass_ratios[k]:.4f}"
        table.add_row(_hertz(curve.frequencies[k]), ratio, _hertz(curve.critical_frequencies[k]))
    console.print(table)


def _show_sensitivity(console: Console, entries: list[ParameterSensitivity]) -> None:
    table = Table(
        title="allowable mass ratios with one parameter changed by 10 %: continuous, complete, discrete; effect is the "
        "largest change of a margin",
        title_justify="left",
        title_style="bold",
    )
    for title in ("parameter", "value", "-10 %", "+10 %", "effect"):
        table.add_column(title, justify="left" if title == "parameter" else "right")
    for entry in entries:
        changes = (_change(change) for change in (entry.decreased, entry.increased))
        table.add_row(
            entry.parameter.replace("[", r"\["), f"{entry.value:.6g}", *changes, f"{100.0 * entry.effect:.1f} %"
        )
    console.print(table)


def _change(changed: ChangedParameter) -> str:
    if changed.assessment is None:
        return "not allowed"
    ratios = " ".join(f"{a.margin.allowable_mass_ratio:.3f}" for a in changed.assessment.analyses.values())
    return f"{ratios} {_verdict(changed.assessment).upper()}!" if changed.flips_verdict else ratios


def _stable(analysis: Analysis | None, not_made: str) -> str:
    return not_made if analysis is None else "stable" if analysis.stable else "UNSTABLE"


def _ratio(analysis: Analysis | None) -> str:
    return "" if analysis is None else f"{analysis.margin.allowable_mass_ratio:.4f}"


def _hertz(frequency: float) -> str:
    return "none" if math.isnan(frequency) else f"{frequency / math.tau:.2f} Hz"


def _intervals(analysis: Analysis) -> str:
    return ", ".join(f"{i.lower:.3f} to {i.upper:.3f}" for i in analysis.margin.stable_intervals) or "none"


def _growth(growth: float) -> str:
    return "none" if math.isnan(growth) else f"{growth:.6f}"
