"""Displacements and drifts of the building: peaks of every floor and story, in the run and in the reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.reference_motion import ReferenceMotion, reference_motion_of
from bmd_rths_core.analysis.specimen_shears import specimen_story_shears
from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.report.document import Block, Paragraph, Table
from bmd_rths_core.report.reported_run import ReportedRun, part
from bmd_rths_core.report.sections import hysteresis
from bmd_rths_core.report.wording import number

FloatArray = NDArray[np.float64]

TITLE = "Displacements and drifts"

CAPTION = (
    "Largest absolute values; displacements are relative to the ground, residual is the drift at the last step. Those "
    "of numerical stories are computed again from the recorded ground motion and shear; their shears are restoring "
    "forces. Drifts of the specimen are integrated twice from its accelerometers behind a high-pass, see Hysteresis, "
    "and its shears are masses times measured accelerations. The reference is the building without partition."
)


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    reference = part(run.no_history or run.no_forces, lambda: reference_motion_of(run.record, run.config))
    if isinstance(reference, str):
        return [Paragraph(f"Cannot be shown: {reference}.")]
    return [displacements_table(run, reference), drifts_table(run, reference), Paragraph(CAPTION)]


def displacements_table(run: ReportedRun, reference: ReferenceMotion) -> Table:
    """Return the peak displacement of every numerical floor, top floor first."""
    rows = []
    lower = run.motion.displacements.shape[1]
    for i in reversed(range(lower)):
        name = "interface" if i == lower - 1 else f"numerical floor {i + 1}"
        own, expected = peak(run.motion.displacements[:, i]), peak(reference.displacements[:, i])
        rows.append((name, *_millimetres(own, expected), _percent(own, expected)))
    return Table(("floor", "displacement [mm]", "reference [mm]", "difference [%]"), tuple(rows))


def drifts_table(run: ReportedRun, reference: ReferenceMotion) -> Table:
    """Return peak drift, residual drift and peak shear of every story, top story first."""
    motion, expected = run.motion, reference.drifts
    lower, upper = motion.drifts.shape[1], expected.shape[1] - motion.drifts.shape[1]
    loops = hysteresis.specimen_figure(run)
    shears = specimen_story_shears(run.record, run.config) if not run.no_floors else np.full((1, upper), np.nan)
    rows = []
    for i in reversed(range(upper)):
        own = float("nan") if isinstance(loops, str) else peak(loops.stories[i].drift)
        rows.append(_story(f"specimen story {i + 1}", own, expected[:, lower + i], None, shears[:, i]))
    for i in reversed(range(lower)):
        drift = motion.drifts[:, i]
        rows.append(_story(f"numerical story {i + 1}", peak(drift), expected[:, i], drift, motion.story_forces[:, i]))
    header = ("story", "drift [mm]", "reference [mm]", "difference [%]", "residual [mm]", "shear [kN]")
    return Table(header, tuple(rows))


def _story(name: str, own: float, expected: FloatArray, drift: FloatArray | None, force: FloatArray) -> tuple[str, ...]:
    residual = "" if drift is None or not len(drift) else number(1e3 * float(drift[-1]), 3)
    both = own, peak(expected)
    return name, *_millimetres(*both), _percent(*both), residual, number(1e-3 * peak(force), 2)


def _millimetres(*values: float) -> tuple[str, ...]:
    return tuple(number(1e3 * value, 3) for value in values)


def _percent(own: float, expected: float) -> str:
    return number(100.0 * (own - expected) / expected if expected > 0.0 else float("nan"), 1)
