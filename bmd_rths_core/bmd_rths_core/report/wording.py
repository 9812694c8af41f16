"""Texts of a report: numbers, outcomes, problems."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bmd_rths_core.analysis.assumptions import assumptions
from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.analysis.verdict import GREEN, RED, UNJUDGED
from bmd_rths_core.record import LARGEST_LATE_SHARE, RunRecord

_OUTCOMES = {
    "finished": "Finished: the whole ground motion was run.",
    "stopped": "Stopped by the operator",
    "limit": "Ended by a limit",
    "failed": "Failed",
    "cut": "Cut: the recording has no end",
}

_VERDICTS = {GREEN: "Good.", RED: "Not good.", UNJUDGED: "Not judged."}

#: Difference of the numerical substructure computed again that rounding and sensors do not explain [%].
LARGEST_DEVIATION = 0.1


def number(value: float | None, digits: int = 1) -> str:
    """Return a number with some digits behind the point; a dash when it is not known."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def significant(value: float) -> str:
    """Return a number with three significant digits, or as a whole number; a dash when it is not known."""
    if not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def verdict(analysis: RunAnalysis) -> str:
    """Return a sentence that says whether a test is good, and how it ended."""
    record = analysis.record
    ended = ending(record)
    return f"{_VERDICTS[analysis.quality.judgement.verdict]} {ended}" if record.outcome == "finished" else ended


def ending(record: RunRecord) -> str:
    """Return a sentence that says how a test ended."""
    words = _OUTCOMES[record.outcome]
    if record.outcome == "finished":
        return words if record.kept_time is not False else f"{words[:-1]}, but not in real time: {lateness(record)}."
    if record.outcome == "stopped" and record.reason.endswith("stopped by the operator"):
        return f"{words}."
    return f"{words}: {record.reason}"


def lateness(record: RunRecord) -> str:
    """Return how many steps of a run were late.

    Parameters
    ----------
    record : RunRecord
        The run.
    """
    timing, share = record.timing, record.late_share
    if timing is None or share is None:
        return "no clock was kept"
    return (
        f"{timing.missed_deadlines} of {record.steps} deadlines were missed and {timing.late_ticks} steps began late, "
        f"{100.0 * share:.1f} % where {100.0 * LARGEST_LATE_SHARE:g} % is allowed"
    )


def results(analysis: RunAnalysis) -> str:
    """Return what a test came to, in one sentence; empty when nothing can be said."""
    metrics, timing, parts = analysis.metrics, analysis.record.timing, []
    errors = metrics.rmse_percent.items()
    if analysis.record.stable and any(math.isfinite(value) for _, value in errors):
        listed = ", ".join(f"{name.replace('_', ' ')} {number(value)} %" for name, value in errors)
        parts.append(f"RMSE against the building without partition: {listed}")
    if math.isfinite(metrics.tracking_delay_ms):
        parts.append(f"the table is {number(metrics.tracking_delay_ms)} ms late")
    true = analysis.quality.rmse_true_percent
    if analysis.record.stable and any(math.isfinite(value) for value in true.values()):
        listed = ", ".join(f"{name.replace('_', ' ')} {number(value)} %" for name, value in true.items())
        parts.append(f"RMSE against the building with the {analysis.quality.specimen} specimen: {listed}")
    if timing is not None and not analysis.config.run.lockstep:
        parts.append(f"{timing.missed_deadlines} deadlines missed")
    sentence = "; ".join(parts)
    return f"{sentence[0].upper()}{sentence[1:]}." if sentence else ""


def changes_in_words(changes: Mapping[str, float]) -> str:
    """Return what gaps may have changed, as one text.

    Parameters
    ----------
    changes : Mapping of str to float
        See `MissingRows`.
    """
    errors = [value for name, value in changes.items() if name.startswith("rmse_") and np.isfinite(value)]
    delays = [changes[name] for name in ("tracking_delay_ms", "delay_ms") if np.isfinite(changes[name])]
    points = f"an RMSE by {max(errors):.2g} points" if errors else ""
    delay = f"the delay by {max(delays):.2g} ms" if delays else ""
    return " and ".join(text for text in (points, delay) if text) or "what is given by an amount that is not known"


def problems(analysis: RunAnalysis, deviation_percent: float) -> list[str]:
    """Return the problems of a test, a sentence each.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.
    deviation_percent : float
        Of the numerical substructure computed again [%].
    """
    record = analysis.record
    found: list[str] = []
    if record.outcome == "finished":
        found += analysis.quality.judgement.reasons
    if record.outcome != "finished":
        duration = record.steps * record.time_step
        what = "Errors and peaks" if record.stable else "Peaks"
        found.append(f"Recorded is a run of {duration:g} s only (steps: {record.steps}). {what} hold for that alone.")
    if not record.stable:
        found.append("The errors are left out: the motion up to a limit says nothing about the rest of the test.")
    if analysis.metrics.missing_values:
        found.append(
            f"{analysis.metrics.missing_values} values were not recorded. They are left out of the errors; in spectra, "
            "energies and hysteresis straight lines bridge them."
        )
        if analysis.gaps.too_many:
            found.append(
                f"Errors and delay are not given: a signal lacks {100.0 * analysis.gaps.share:.1f} % of its steps."
            )
        elif analysis.gaps.changes:
            found.append(f"What is missing may have changed {changes_in_words(analysis.gaps.changes)}.")
    timing = record.timing
    if timing is not None and timing.missed_deadlines:
        led = "" if record.stable else " This may have led to the limit."
        found.append(
            f"{timing.missed_deadlines} of {record.steps} deadlines were missed, at most "
            f"{timing.max_consecutive_misses} in a row; the last shear was held.{led}"
        )
    if timing is not None and timing.late_ticks:
        found.append(f"{timing.late_ticks} steps began more than Δt/2 late, and the schedule was moved.")
    if timing is not None and timing.slow_integrations:
        found.append(
            f"{timing.slow_integrations} integrations of the numerical substructure took more than 60 % of their steps."
        )
    if analysis.config.run.preflight == "override":
        found.append("The pre-flight was overridden: the test was run against its prediction.")
    if deviation_percent > LARGEST_DEVIATION:
        found.append(
            f"The numerical substructure, computed again from the record, differs by {deviation_percent:.2g} % of the "
            "peak from what is recorded: its drifts and energies below are not exact."
        )
    return found


def assumption(analysis: RunAnalysis) -> str:
    """Return what table the results come from, and what is assumed of it.

    Parameters
    ----------
    analysis : RunAnalysis
        The run.
    """
    table, controller = analysis.config.table, analysis.record.controller
    if controller == "unknown" and analysis.record.outcome == "cut":
        return "What moved the table is not known: the recording has no end."
    if controller == "unknown":
        return "The table was moved by a driver of somebody else, which did not tell what it is."
    address = f", {table.address}" if controller == table.controller else ""
    return assumptions(analysis.config, controller) or f"Table controller: {controller}{address}."
