"""Runs laid over each other: the figure of a report of several runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import Canvas, grid_in_mm, legend_on_top
from bmd_rths_core.plots.style import BLUE, GREEN, LINES, ORANGE, VERMILION
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections import responses
from bmd_rths_core.report.sections.responses import REFERENCE, FloorResponses

FloatArray = NDArray[np.float64]

#: More curves than this in one figure cannot be told apart.
MOST_CURVES = 4

#: Length of the time in which runs are laid over each other [s].
WINDOW = 5.0


#: Colours of runs laid over each other, told apart in grey by their dashes.
_RUNS: tuple[dict[str, Any], ...] = tuple(
    {"color": color, "linestyle": line["linestyle"], "linewidth": 0.9}
    for color, line in zip((VERMILION, BLUE, GREEN, ORANGE), (*LINES, LINES[0]), strict=True)
)


@dataclass(frozen=True)
class OverlaidRun:
    """The responses of one run.

    Parameters
    ----------
    label : str
        Its number and scheme.
    responses : FloorResponses
        All floors.
    """

    label: str
    responses: FloorResponses


@dataclass(frozen=True)
class Comparison:
    """Runs with the same ground motion and the same reference.

    Parameters
    ----------
    motion : str
        Name of the ground motion.
    runs : tuple of OverlaidRun
        The runs.
    window : tuple of float
        Begin and end of what is shown, around the largest response of the reference [s].
    left_out : int
        Runs that belong here and are not shown.
    """

    motion: str
    runs: tuple[OverlaidRun, ...]
    window: tuple[float, float]
    left_out: int

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 105.0

    def draw(self, figure: Canvas) -> None:
        """Draw the top floor and the interface of several runs over the reference, where the response is largest."""
        first = self.runs[0].responses
        rows = grid_in_mm(figure, 2, top=15.0, between=(8.0, 0.0)).subplots(squeeze=False, sharex=True)[:, 0]
        interface = next(i for i, floor in enumerate(first.floors) if floor.name.startswith("interface"))
        for axes, place in zip(rows, (len(first.floors) - 1, interface), strict=True):
            reference = first.floors[place]
            plot_history(
                axes, *between(reference.time, reference.reference, self.window), **REFERENCE | {"linewidth": 1.0}
            )
            for run, look in zip(self.runs, _RUNS, strict=False):
                floor = next((f for f in run.responses.floors if f.name == reference.name), None)
                if floor is not None:
                    plot_history(axes, *between(floor.time, floor.run, self.window), label=run.label, **look)
            axes.set_title(reference.name, loc="left")
            axes.set_ylabel("[m/s²]")
        rows[-1].set(xlabel="time [s]", xlim=self.window)
        legend_on_top(figure, rows[0], 3)


def comparisons(reports: Sequence[ReportedRun]) -> list[Comparison]:
    """Return the runs that can be laid over each other, as groups.

    Parameters
    ----------
    reports : sequence of ReportedRun
        Their place in the sequence, from 1, is the number in the label.

    Returns
    -------
    list of Comparison
        Runs with the same ground acceleration and reference where both have run; at most `MOST_CURVES` of each group.
    """
    groups: list[list[tuple[int, ReportedRun, FloorResponses]]] = []
    for number, report in enumerate(reports, 1):
        found = responses.figure(report)
        if isinstance(found, str):
            continue
        entry = (number, report, found)
        for group in groups:
            if _same_reference(group[0][1].analysis, report.analysis):
                group.append(entry)
                break
        else:
            groups.append([entry])
    return [
        Comparison(
            group[0][1].analysis.record.motion.get("name", "unknown"),
            tuple(
                OverlaidRun(f"run {number}: {report.config.run.scheme}", floors)
                for number, report, floors in group[:MOST_CURVES]
            ),
            window=group[0][1].window or _window(group[0][2]),
            left_out=len(group[MOST_CURVES:]),
        )
        for group in groups
        if len(group) > 1
    ]


def _window(floors: FloorResponses) -> tuple[float, float]:
    top = floors.floors[-1]
    middle = float(top.time[np.argmax(np.abs(top.reference))])
    begin = max(0.0, min(middle, float(top.time[-1]) - 0.5 * WINDOW) - 0.5 * WINDOW)
    return begin, begin + WINDOW


def _same_reference(one: RunAnalysis, other: RunAnalysis) -> bool:
    sections = ("numerical_substructure", "nonlinear", "specimen")
    if any(getattr(one.config, name) != getattr(other.config, name) for name in sections):
        return False
    if one.config.force_correction.feedback_scale != other.config.force_correction.feedback_scale:
        return False
    steps = min(one.record.steps, other.record.steps)
    ground, other_ground = (analysis.record.ground_acceleration[:steps] for analysis in (one, other))
    return one.record.time_step == other.record.time_step and np.array_equal(ground, other_ground, equal_nan=True)
