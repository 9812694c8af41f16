"""Where the numbers of a run come from."""

from __future__ import annotations

from bmd_rths_core.config import dump_config
from bmd_rths_core.report.document import Block, Folded, Paragraph
from bmd_rths_core.report.reported_run import ReportedRun

TITLE = "Provenance"


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    record = run.record
    motion, versions = record.motion, ", ".join(f"{name} {version}" for name, version in record.versions.items())
    return [
        Paragraph(f"Ended: {record.outcome} ({record.reason})."),
        Paragraph(f"Bag: {record.source}."),
        Paragraph(
            f"Ground motion: {motion.get('name', 'unknown')}, from {motion.get('source', 'unknown')}, "
            f"SHA-256 {motion.get('sha256', 'unknown')}."
        ),
        Paragraph(f"Versions: {versions or 'unknown'}."),
        Folded("Configuration", dump_config(run.config)),
    ]
