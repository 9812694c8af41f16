"""The errors of a run: Eq. 12 of the paper, and the criteria of the vRTHS benchmark."""

from __future__ import annotations

from collections.abc import Mapping

from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.report.document import Block, Paragraph, Table
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.wording import number

TITLE = "Errors"

#: Where the criteria come from.
CRITERIA = (
    "Criteria of the benchmark problem of Silva, Gomez, Maghareh, Dyke and Spencer (2020), for accelerations: J1 to J3 "
    "compare the table with the desired acceleration, the others the floors with the reference. 100 % is an error as "
    "large as the signal itself. Tracking errors contain the noise of the accelerometer on the table."
)

_J = ("J1 tracking delay [ms]", "J2 tracking error [%]", "J3 peak tracking error [%]")


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [rmse_table(run.analysis), Paragraph(CRITERIA), criteria_table({"value": run.analysis})]


def rmse_table(analysis: RunAnalysis) -> Table:
    """Return the errors the paper states."""
    errors = analysis.metrics.rmse_percent.items()
    rows = [(name.replace("_", " "), number(value if analysis.record.stable else None, 2)) for name, value in errors]
    return Table(("RMSE (Eq. 12)", "[%]"), tuple(rows))


def criteria_table(analyses: Mapping[str, RunAnalysis]) -> Table:
    """Return the criteria of the vRTHS benchmark, one column for each run."""
    count = len(next(iter(analyses.values())).criteria.response_error_percent)
    floors = ("interface", *(f"specimen floor {i}" for i in range(1, count)))
    names = [*_J, *(f"J{4 + i} error, {floor} [%]" for i, floor in enumerate(floors))]
    names += [f"J{4 + count + i} peak error, {floor} [%]" for i, floor in enumerate(floors)]
    columns = [analysis.told_criteria.values() for analysis in analyses.values()]
    rows = zip(names, *columns, strict=True)
    return Table(("criterion", *analyses), tuple((name, *(number(v, 2) for v in values)) for name, *values in rows))
