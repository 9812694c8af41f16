"""The report of the vRTHS benchmark problem: the criteria of every building and plant, and how the actuator follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.plots.layout import Canvas
from bmd_rths_core.plots.tracked_displacement import draw_tracked_displacement
from bmd_rths_core.report.document import Block, Document, Paragraph, Picture, Section, Table
from bmd_rths_core.vrths.criteria import CRITERIA, UNITS
from bmd_rths_core.vrths.problem import FORCE_LIMIT, TIME_STEP
from bmd_rths_core.vrths.study import NominalRun, Summary

FloatArray = NDArray[np.float64]

_DEFINITIONS = (
    "J1 lag of the measured behind the desired displacement of the actuator; J2 and J3 their difference, root mean "
    "square and peak; J4 and J5 the measured displacement against floor 1 of the building without partition; J6 and J7 "
    "(root mean square), J8 and J9 (peak) floors 2 and 3 of the numerical substructure against it. J2 holds the noise "
    "of the transducer, whose share stands beside it as floor."
)


@dataclass(frozen=True)
class TrackedDisplacement:
    """Desired and measured displacement of the actuator, and what they differ by.

    Parameters
    ----------
    time, desired, measured : ndarray, shape (N,)
        [s], [m].
    """

    time: FloatArray
    desired: FloatArray
    measured: FloatArray

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 90.0

    def draw(self, figure: Canvas) -> None:
        """Draw both, and their difference."""
        draw_tracked_displacement(figure, self.time, self.desired, self.measured)


def tracked_displacement(run: NominalRun) -> TrackedDisplacement:
    """Return the figure of a run."""
    time: FloatArray = TIME_STEP * np.arange(len(run.measured), dtype=np.float64)
    return TrackedDisplacement(time, run.displacement[:, 0], run.measured)


def criteria_rows(summaries: Sequence[Summary]) -> list[tuple[str, ...]]:
    """Return scheme, case, plants, noise floor and J1 to J9 of every row of the table.

    Parameters
    ----------
    summaries : sequence of Summary
        Of one motion.
    """
    rows = []
    for one in summaries:
        kinds: list[tuple[str, Mapping[str, float]]] = [("nominal", one.nominal)]
        if one.perturbed:
            kinds += [(f"mean of {one.perturbed}", one.mean), (f"worst of {one.perturbed}", one.worst)]
        for kind, values in kinds:
            floor = f"{one.noise_floor:.2f}" if kind == "nominal" else ""
            numbers = (f"{values[name]:.2f}" for name in CRITERIA)
            rows.append((one.scheme, str(one.case), kind, floor, *numbers))
    return rows


HEADER = ("scheme", "case", "plants", "floor [%]", *(f"{name} [{UNITS[name]}]" for name in CRITERIA))


def benchmark_report(summaries: Sequence[Summary], shown: Mapping[str, tuple[str, NominalRun]]) -> Document:
    """Return the report.

    Parameters
    ----------
    summaries : sequence of Summary
        Every building with every motion and scheme.
    shown : Mapping of str to (str, NominalRun)
        A run to show by the name of its motion, with its caption.
    """
    best = summaries[-1].scheme
    own = [one for one in summaries if one.scheme == best]
    largest = {name: max(max(one.nominal[name], one.worst.get(name, 0.0)) for one in own) for name in ("J2", "J4")}
    limited = sum(one.limited for one in own)
    plants = sum(1 + one.perturbed for one in own)
    at_limit = f" The actuator was at its force limit in {limited} of {plants} tests." if limited else ""
    sections = []
    for motion in dict.fromkeys(one.motion for one in summaries):
        of_motion = [one for one in summaries if one.motion == motion]
        blocks: list[Block] = [Table(HEADER, tuple(criteria_rows(of_motion)))]
        infeasible = dict.fromkeys(one.infeasible for one in of_motion if one.infeasible)
        blocks += [Paragraph(f"{problem}.") for problem in infeasible]
        if motion in shown:
            caption, run = shown[motion]
            blocks.append(Picture(tracked_displacement(run), caption))
        sections.append(Section(motion, tuple(blocks)))
    return Document(
        title="vRTHS benchmark problem",
        verdict=f"{best}: J2 at most {largest['J2']:.2f} % and J4 at most {largest['J4']:.2f} % over all buildings, "
        f"motions and plants.{at_limit}",
        good=not limited and all(np.isfinite(list(one.nominal.values())).all() for one in own),
        notes=(
            "Silva, Gomez, Maghareh, Dyke and Spencer (2020), Mechanical Systems and Signal Processing 135, 106381; "
            f"every motion at 0.4 of the record, 4096 Hz, the force of the actuator at most {FORCE_LIMIT:g} N.",
        ),
        sections=(Section("Criteria", (Paragraph(_DEFINITIONS),)), *sections),
    )
