"""The report of one run."""

from __future__ import annotations

from bmd_rths_core.analysis.verdict import GREEN
from bmd_rths_core.report.document import Document, Section
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections import SECTIONS
from bmd_rths_core.report.wording import LARGEST_DEVIATION, assumption, problems, results, verdict


def run_report(run: ReportedRun) -> Document:
    """Return the report of one run.

    Parameters
    ----------
    run : ReportedRun
        What it is about.
    """
    analysis, record = run.analysis, run.record
    wrong = problems(analysis, run.motion.deviation_percent)
    return Document(
        title=f"{record.motion.get('name', 'unknown motion')}, {run.config.run.scheme}",
        verdict=verdict(analysis),
        good=analysis.quality.judgement.verdict == GREEN and run.motion.deviation_percent <= LARGEST_DEVIATION,
        notes=tuple(note for note in (results(analysis), *wrong, assumption(analysis)) if note),
        sections=tuple(Section(section.TITLE, tuple(section.blocks(run))) for section in SECTIONS),
    )
