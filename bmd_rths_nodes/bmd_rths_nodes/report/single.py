"""The report of one run: what stands on it, in which order, with which words."""

from __future__ import annotations

from bmd_rths_core.config import dump_config
from bmd_rths_core.report.document import Block, Document, FigureData, Folded, Paragraph, Picture, Section
from bmd_rths_core.report.hysteresis import HIGH_PASS_SHARE
from bmd_rths_core.report.run_report import RunReport
from bmd_rths_core.report.timing import StepTiming
from bmd_rths_nodes.report import tables
from bmd_rths_nodes.report.wording import assumption, number, problems, results, verdict

#: Where the criteria come from.
CRITERIA = (
    "Criteria of the benchmark problem of Silva, Gomez, Maghareh, Dyke and Spencer (2020), for accelerations: J1 to J3 "
    "compare the table with the desired acceleration, the others the floors with the reference. 100 % is an error as "
    "large as the signal itself. Tracking errors contain the noise of the accelerometer on the table."
)

_LIMITS = (
    "Reached is what was recorded; the supervisor judges displacement and velocity ahead as well, until the table "
    "could be at rest. It also ends a test when commands or measurements stop coming, or a sensor is lost or stuck."
)
_RESPONSES = (
    "Absolute acceleration of every floor. The reference is the building without partition under the recorded ground "
    "motion. Strong motion is from 5 % to 95 % of the Arias intensity."
)
_TRACKING = (
    "Acceleration of the table against the desired one, both at the end of a step. The delay is that of the largest "
    "cross-correlation; windows with less than a tenth of the strongest motion are left out."
)
_FREQUENCIES = (
    "From the desired to the achieved acceleration. Each point is as dark as it is coherent: pale ones say nothing."
)
_FORCES = "Shear at the interface. Unbalanced is what Eq. 11 corrects, required less estimated."
_NUMERICAL = (
    "Numerical stories: restoring force of the springs, computed again from the recorded ground motion and shear. "
    "Dashed is the initial stiffness, dotted the yield drift."
)
_SPECIMEN = (
    "Specimen: the shear is the sum of mass times measured acceleration above the story, damping included; the drift "
    f"is integrated twice from accelerometers, behind a high-pass at {HIGH_PASS_SHARE:g} of the first frequency of the "
    "building. Slow and permanent drifts cannot be seen. Dashed is the configured stiffness."
)
_TRANSFER = "Amplification of the ground acceleration, estimated in the same way from the run and from the reference."
_ENERGY = (
    "Energies of the numerical substructure relative to the ground, and below the stability indicator: the logarithm "
    "of the factor by which the interface has raised the energy."
)
_TIMING = (
    "On the wall clock of the recorder. Closure is the time from the desired acceleration of a step to its corrected "
    "shear; messages reach the recorder a little later than the nodes of the loop."
)


def single_report(report: RunReport) -> Document:
    """Return the report of one run.

    Parameters
    ----------
    report : RunReport
        What it shows.
    """
    analysis = report.analysis
    record = analysis.record
    wrong = problems(analysis, report.motion.deviation_percent)
    errors: list[Block] = [tables.rmse_table(analysis), Paragraph(CRITERIA), tables.criteria_table({"value": analysis})]
    structure = _shown(report.numerical_stories, _NUMERICAL)
    if analysis.ductility is not None:
        structure.append(tables.ductility_table(analysis, analysis.ductility))
    responses = _shown(report.responses, _RESPONSES)
    if not isinstance(report.responses, str):
        responses.insert(0, tables.floors_table(report.responses))
    return Document(
        title=f"{record.motion.get('name', 'unknown motion')}, {analysis.config.run.scheme}",
        verdict=verdict(record),
        good=not wrong,
        notes=tuple(note for note in (results(analysis), *wrong, assumption(analysis)) if note),
        sections=(
            Section("Errors", tuple(errors)),
            Section("Limits", (tables.limits_table(report), Paragraph(_LIMITS))),
            Section("Response of the floors", tuple(responses)),
            Section("Tracking of the table", tuple(_shown(report.tracking, _TRACKING))),
            Section("Tracking over frequency", tuple(_shown(report.frequencies, _FREQUENCIES))),
            Section("Forces", tuple(_shown(report.forces, _FORCES))),
            Section("Hysteresis", (*structure, *_shown(report.specimen_stories, _SPECIMEN))),
            Section("Transfer functions", tuple(_shown(report.transfer, _TRANSFER))),
            Section("Energy and stability", tuple(_shown(report.energy, _ENERGY))),
            Section("Timing", tuple(_timing(report))),
            Section("Provenance", tuple(_provenance(report))),
        ),
    )


def _shown(data: FigureData | str, caption: str) -> list[Block]:
    """Return a figure, or why there is none."""
    return [Paragraph(f"Cannot be shown: {data}.") if isinstance(data, str) else Picture(data, caption)]


def _timing(report: RunReport) -> list[Block]:
    timing = report.analysis.record.timing
    blocks = _shown(report.timing, _TIMING)
    if timing is not None and isinstance(report.timing, StepTiming):
        closure = ", ".join(f"{name} {number(value, 2)} ms" for name, value in timing.closure_ms.items())
        missed = f"{timing.missed_deadlines} of {report.analysis.record.steps} deadlines missed"
        blocks.insert(0, Paragraph(f"{missed}; closure at the numerical substructure: {closure}."))
    return blocks


def _provenance(report: RunReport) -> list[Block]:
    record = report.analysis.record
    motion, versions = record.motion, ", ".join(f"{name} {version}" for name, version in record.versions.items())
    return [
        Paragraph(f"Ended: {record.outcome} ({record.reason})."),
        Paragraph(f"Bag: {record.source}."),
        Paragraph(
            f"Ground motion: {motion.get('name', 'unknown')}, from {motion.get('source', 'unknown')}, "
            f"SHA-256 {motion.get('sha256', 'unknown')}."
        ),
        Paragraph(f"Versions: {versions or 'unknown'}."),
        Folded("Configuration", dump_config(report.analysis.config)),
    ]
