"""Where the numbers of a run come from."""

from __future__ import annotations

from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.config import dump_config
from bmd_rths_core.ground_motion.as_run import peaks_of
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.report.document import Block, Folded, Paragraph
from bmd_rths_core.report.reported_run import ReportedRun

TITLE = "Provenance"


def _as_run(run: ReportedRun) -> list[Block]:
    """Return what the loop was shaken with, and what it was scaled to."""
    ground, asked = run.record.ground_acceleration, run.config.ground_motion.peak_acceleration
    if len(ground) < 2:
        return []
    peaks = peaks_of(GroundMotion("as run", run.record.time_step, filled(ground), "recorded", "0" * 64))
    scaled = f"scaled to a peak of {asked:g} m/s²" if asked else "not scaled"
    return [
        Paragraph(
            f"As it was run ({scaled}): PGA {peaks.acceleration:.3g} m/s², PGV {peaks.velocity:.3g} m/s, "
            f"PGD {1e3 * peaks.displacement:.3g} mm; at the end {1e3 * peaks.last_displacement:.3g} mm are left."
        )
    ]


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
        *_as_run(run),
        Paragraph(f"Sensors: {run.config.sensors.identities}; calibrated on: {run.config.sensors.calibrated_on}."),
        Paragraph(f"Versions: {versions or 'unknown'}."),
        Folded("Configuration", dump_config(run.config)),
    ]
