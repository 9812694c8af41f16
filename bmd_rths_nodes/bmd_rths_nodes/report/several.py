"""The report of several runs beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from bmd_rths_core.report.comparison import comparisons
from bmd_rths_core.report.document import Block, Document, Paragraph, Picture, Section
from bmd_rths_core.report.run_report import RunReport
from bmd_rths_nodes.report import tables
from bmd_rths_nodes.report.single import CRITERIA
from bmd_rths_nodes.report.wording import assumption, problems

#: Columns of runs that fit beside each other.
_COLUMNS = 6

_OVERLAY = "Top floor and interface where the response is largest, over the building without partition (black)."
_NOTHING_IN_COMMON = "No two of the runs have the same building and ground motion, so that nothing can be overlaid."


def comparison_report(reports: Sequence[RunReport]) -> Document:
    """Return the report of several runs.

    Parameters
    ----------
    reports : sequence of RunReport
        What it shows.
    """
    analyses = [report.analysis for report in reports]
    wrong = [
        f"Run {i}: {problem}"
        for i, report in enumerate(reports, 1)
        for problem in problems(report.analysis, report.motion.deviation_percent)
    ]
    finished = sum(analysis.record.outcome == "finished" for analysis in analyses)
    return Document(
        title=f"Comparison of {len(reports)} runs",
        verdict=f"{finished} of {len(reports)} runs have finished.",
        good=not wrong,
        notes=(*wrong, *dict.fromkeys(assumption(analysis) for analysis in analyses)),
        sections=(
            Section("Errors", (Paragraph("RMSE of Eq. 12; none for runs that a limit ended."), *_errors(reports))),
            Section("Responses", tuple(_overlays(reports))),
            Section("Bags", tuple(Paragraph(f"Run {i}: {run.record.source}.") for i, run in enumerate(analyses, 1))),
        ),
    )


def _errors(reports: Sequence[RunReport]) -> list[Block]:
    analyses = [report.analysis for report in reports]
    blocks: list[Block] = [tables.comparison_table(analyses), Paragraph(CRITERIA)]
    columns = [(f"run {i}", analysis) for i, analysis in enumerate(analyses, 1)]
    for _, group in groupby(columns, key=lambda column: len(column[1].criteria.response_error_percent)):
        same_floors = list(group)
        for begin in range(0, len(same_floors), _COLUMNS):
            blocks.append(tables.criteria_table(dict(same_floors[begin : begin + _COLUMNS])))
    return blocks


def _overlays(reports: Sequence[RunReport]) -> list[Block]:
    blocks: list[Block] = []
    for comparison in comparisons(reports):
        more = f" {comparison.left_out} more runs belong here." if comparison.left_out else ""
        blocks.append(Picture(comparison, f"{comparison.motion}. {_OVERLAY}{more}"))
    return blocks or [Paragraph(_NOTHING_IN_COMMON)]
