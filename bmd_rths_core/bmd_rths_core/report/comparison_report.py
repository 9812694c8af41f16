"""The report of several runs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.analysis.verdict import GREEN
from bmd_rths_core.report.document import Block, Document, Paragraph, Picture, Section, Table
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections.comparison import comparisons
from bmd_rths_core.report.sections.errors import CRITERIA, criteria_table
from bmd_rths_core.report.wording import assumption, number, problems

#: Columns of runs that fit beside each other.
_COLUMNS = 6

_OVERLAY = "Top floor and interface where the response is largest, over the building without partition (black line)."
_NOTHING_IN_COMMON = "No two of the runs have the same building and ground motion, so that nothing can be overlaid."


def comparison_report(reports: Sequence[ReportedRun]) -> Document:
    """Return the report of several runs.

    Parameters
    ----------
    reports : sequence of ReportedRun
        What it shows.
    """
    analyses = [report.analysis for report in reports]
    wrong = _by_run([problems(report.analysis, report.motion.deviation_percent) for report in reports])
    assumed = _by_run([[assumption(analysis)] for analysis in analyses])
    finished = sum(analysis.record.outcome == "finished" for analysis in analyses)
    good = sum(analysis.quality.judgement.verdict == GREEN for analysis in analyses)
    return Document(
        title=f"Comparison of {len(reports)} runs",
        verdict=f"{finished} of {len(reports)} runs have finished, {good} are good.",
        good=not wrong,
        notes=(),  # so many lines would stand before the first number
        sections=(
            Section("Errors", (Paragraph("RMSE of Eq. 12; none for runs that a limit ended."), *_errors(reports))),
            Section("Notes", tuple(Paragraph(note) for note in (*wrong, *assumed))),
            Section("Responses", tuple(_overlays(reports))),
            Section("Bags", tuple(Paragraph(_bag(i, run)) for i, run in enumerate(analyses, 1))),
        ),
    )


def _by_run(said: Sequence[Sequence[str]]) -> list[str]:
    """Return every sentence once, after the numbers of the runs it is about."""
    runs: dict[str, list[int]] = {}
    for i, sentences in enumerate(said, 1):
        for sentence in sentences:
            runs.setdefault(sentence, []).append(i)
    return [
        f"Run{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}: {sentence}"
        for sentence, numbers in runs.items()
    ]


def _bag(number: int, analysis: RunAnalysis) -> str:
    motion = analysis.record.motion.get("name", "unknown")
    return f"Run {number}: {motion}, {analysis.config.run.scheme}; {analysis.record.source}."


def _errors(reports: Sequence[ReportedRun]) -> list[Block]:
    analyses = [report.analysis for report in reports]
    blocks: list[Block] = [comparison_table(analyses), Paragraph(CRITERIA)]
    columns = [(f"run {i}", analysis) for i, analysis in enumerate(analyses, 1)]
    for _, group in groupby(columns, key=lambda column: len(column[1].criteria.response_error_percent)):
        same_floors = list(group)
        for begin in range(0, len(same_floors), _COLUMNS):
            blocks.append(criteria_table(dict(same_floors[begin : begin + _COLUMNS])))
    return blocks


def _overlays(reports: Sequence[ReportedRun]) -> list[Block]:
    blocks: list[Block] = []
    for comparison in comparisons(reports):
        more = f" {comparison.left_out} more runs belong here." if comparison.left_out else ""
        blocks.append(Picture(comparison, f"{comparison.motion}. {_OVERLAY}{more}"))
    return blocks or [Paragraph(_NOTHING_IN_COMMON)]


def comparison_table(analyses: Sequence[RunAnalysis]) -> Table:
    """Return the errors of several runs, one row for each, named after the folder of its bag."""
    rows = []
    for i, analysis in enumerate(analyses, 1):
        record, metrics = analysis.record, analysis.metrics
        known = record.stable
        errors = [number(value if known else None, 2) for value in metrics.rmse_percent.values()]
        label = f"{i}: {analysis.config.run.scheme}, {Path(record.source).name}"
        rows.append((label, record.outcome, *errors, number(metrics.tracking_delay_ms, 2)))
    names = ("substructure [%]", "control layer [%]", "superstructure [%]", "delay [ms]")
    return Table(("run", "outcome", *names), tuple(rows))
