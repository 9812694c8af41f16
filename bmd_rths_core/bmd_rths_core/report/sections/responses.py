"""Acceleration of every floor in a run and in the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.benchmark_criteria import peak_error_percent
from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.numerical_motion import NumericalMotion
from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import Canvas, grid_in_mm, legend_on_top
from bmd_rths_core.plots.style import BLACK, ORANGE
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, Table, shown
from bmd_rths_core.report.reported_run import CloseUp, ReportedRun, part
from bmd_rths_core.report.wording import number

FloatArray = NDArray[np.float64]

TITLE = "Response of the floors"

CAPTION = (
    "Absolute acceleration of every floor. The reference is the building without partition under the recorded ground "
    "motion. On the right is what is shaded on the left."
)

#: How the curves of a run and of the reference are drawn.
RUN: dict[str, Any] = {"color": ORANGE, "linewidth": 1.4, "label": "run"}
REFERENCE: dict[str, Any] = {"color": BLACK, "linewidth": 0.6, "label": "reference: building without partition"}

#: How the reference is drawn where single cycles are seen: its dashes tell it from the run without colour.
DASHED: dict[str, Any] = {"linewidth": 0.9, "linestyle": (0, (4, 1.5))}


@dataclass(frozen=True)
class FloorResponse:
    """One floor.

    Parameters
    ----------
    name : str
        Which floor, and whether it was computed or measured.
    time : ndarray, shape (N,)
        [s].
    run, reference : ndarray, shape (N,)
        Absolute acceleration [m/s²].
    rmse_percent, peak_error_percent : float
        Eq. 12, and the largest error over the largest reference [%].
    """

    name: str
    time: FloatArray
    run: FloatArray
    reference: FloatArray
    rmse_percent: float
    peak_error_percent: float

    @property
    def peaks(self) -> tuple[float, float]:
        """Largest absolute acceleration of run and reference [m/s²]."""
        return peak(self.run), peak(self.reference)


@dataclass(frozen=True)
class FloorResponses:
    """All floors of the building.

    Parameters
    ----------
    floors : tuple of FloorResponse
        From the ground up.
    close_up : CloseUp
        What is shown on the right.
    """

    floors: tuple[FloorResponse, ...]
    close_up: CloseUp

    @property
    def height(self) -> float:
        """Height [mm]."""
        return min(20.0 + 32.0 * len(self.floors), 250.0)

    def draw(self, figure: Canvas) -> None:
        """Draw every floor, top floor first: the whole run on the left, a part of it on the right."""
        grid = grid_in_mm(figure, len(self.floors), 2, top=11.0, between=(7.0, 12.0))
        rows = grid.subplots(squeeze=False, sharex="col", sharey="row")
        for (whole, zoom), floor in zip(rows, reversed(self.floors), strict=True):
            for values, look, dashes in ((floor.run, RUN, {}), (floor.reference, REFERENCE, DASHED)):
                plot_history(whole, floor.time, values, **look)
                plot_history(zoom, *between(floor.time, values, self.close_up.limits), **{**look, **dashes})
            whole.set_xlim(0.0, floor.time[-1])
            whole.axvspan(*self.close_up.limits, color="0.93", linewidth=0.0)
            whole.set_title(f"{floor.name}: RMSE {_percent(floor.rmse_percent)}", loc="left")
            zoom.set_title(f"peak error {_percent(floor.peak_error_percent)}", loc="left")
            whole.set_ylabel("[m/s²]")
        rows[-1, 0].set_xlabel("time [s]")
        rows[-1, 1].set(xlabel=f"time [s], {self.close_up.name}", xlim=self.close_up.limits)
        legend_on_top(figure, rows[0, 1], 2)


def floor_responses(
    record: RunRecord, reference: FloatArray, motion: NumericalMotion, close_up: CloseUp
) -> FloorResponses:
    """Return the responses of all floors.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building [m/s²].
    motion : NumericalMotion
        The numerical substructure.
    close_up : CloseUp
        What is shown closely.

    Returns
    -------
    FloorResponses
        Without errors for a run that a limit ended. The interface is the recorded desired acceleration; sensors stand
        at the end of the step they were read at.
    """
    lower = motion.accelerations.shape[1]
    floors = [
        _floor(f"numerical floor {i + 1} (computed)", record.time, motion.accelerations[:, i], reference[:, i])
        for i in range(lower - 1)
    ]
    interface = record.desired_acceleration, reference[:, lower - 1]
    floors.append(_floor("interface (computed)", record.time, *interface))
    floors += [
        _floor(f"specimen floor {i + 1} (measured)", record.sensor_time[:-1], measured, reference[1:, lower + i])
        for i, measured in enumerate(record.floor_accelerations[:-1].T)
    ]
    if not record.stable:
        floors = [replace(floor, rmse_percent=np.nan, peak_error_percent=np.nan) for floor in floors]
    return FloorResponses(tuple(floors), close_up)


def _floor(name: str, time: FloatArray, run: FloatArray, reference: FloatArray) -> FloorResponse:
    errors = rmse_percent(reference, run), peak_error_percent(reference, run)
    return FloorResponse(name, time, run, reference, *errors)


def _percent(value: float) -> str:
    return f"{value:.1f} %" if np.isfinite(value) else "–"


def figure(run: ReportedRun) -> FloorResponses | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_history, lambda: floor_responses(run.record, run.analysis.reference, run.motion, run.closely))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    found = figure(run)
    table = [] if isinstance(found, str) else [floors_table(found)]
    return [*table, shown(found, CAPTION)]


def floors_table(responses: FloorResponses) -> Table:
    """Return errors and peaks of every floor, top floor first."""
    rows = tuple(
        (
            floor.name,
            number(floor.rmse_percent, 2),
            number(floor.peak_error_percent, 2),
            *(number(value, 3) for value in floor.peaks),
        )
        for floor in reversed(responses.floors)
    )
    return Table(("floor", "RMSE [%]", "peak error [%]", "peak [m/s²]", "reference [m/s²]"), rows)
