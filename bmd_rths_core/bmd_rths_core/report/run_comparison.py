"""Several runs beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.report.analysis import RunAnalysis
from bmd_rths_core.report.responses import FloorResponses
from bmd_rths_core.report.run_report import RunReport

FloatArray = NDArray[np.float64]

#: More curves than this in one figure cannot be told apart.
MOST_CURVES = 4

#: Length of the time in which runs are laid over each other [s].
WINDOW = 5.0


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


def comparisons(reports: Sequence[RunReport]) -> list[Comparison]:
    """Return the runs that can be laid over each other, as groups.

    Parameters
    ----------
    reports : sequence of RunReport
        Their place in the sequence, from 1, is the number in the label.

    Returns
    -------
    list of Comparison
        Runs with the same ground acceleration and reference where both have run; at most `MOST_CURVES` of each group.
    """
    groups: list[list[tuple[int, RunReport, FloorResponses]]] = []
    for number, report in enumerate(reports, 1):
        if isinstance(report.responses, str):
            continue
        entry = (number, report, report.responses)
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
                OverlaidRun(f"run {number}: {report.analysis.config.run.scheme}", responses)
                for number, report, responses in group[:MOST_CURVES]
            ),
            window=_window(group[0][2]),
            left_out=len(group[MOST_CURVES:]),
        )
        for group in groups
        if len(group) > 1
    ]


def _window(responses: FloorResponses) -> tuple[float, float]:
    top = responses.floors[-1]
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
