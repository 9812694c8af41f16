"""What the compensator adapted in the course of the test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.loop.adaptation import adapted_over_time
from bmd_rths_core.plots.layout import Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLUE
from bmd_rths_core.report.document import Block, Paragraph, Table, shown
from bmd_rths_core.report.reported_run import ReportedRun, part
from bmd_rths_core.report.wording import number

FloatArray = NDArray[np.float64]

TITLE = "Adaptation"

CAPTION = "What the compensator adapted, as it was used in each step: computed again from the record."


@dataclass(frozen=True)
class AdaptedOverTime:
    """Adapted values over time.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    values : dict of str to ndarray, shape (N,)
        By name.
    """

    time: FloatArray
    values: dict[str, FloatArray]

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 20.0 + 22.0 * len(self.values)

    def draw(self, figure: Canvas) -> None:
        """Draw one below the other."""
        rows = grid_in_mm(figure, len(self.values), between=(4.0, 0.0)).subplots(sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, self.values.items(), strict=True):
            axes.plot(self.time, values, color=BLUE, linewidth=0.8)
            axes.set_ylabel(name.replace("_", "\n"))
            axes.margins(y=0.2)
        rows[-1].set(xlabel="time [s]", xlim=(0.0, self.time[-1]))


def figure(run: ReportedRun) -> AdaptedOverTime | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_floors, lambda: _over_time(run))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    drawn = figure(run)
    if isinstance(drawn, str):
        return [shown(drawn, CAPTION)]
    if not drawn.values:
        return [Paragraph(f"{run.config.run.scheme} adapts nothing.")]
    return [_table(drawn), shown(drawn, CAPTION)]


def _table(drawn: AdaptedOverTime) -> Table:
    rows = tuple(
        (name.replace("_", " "), *(number(value, 4) for value in (own[0], own.min(), own.max(), own[-1])))
        for name, own in drawn.values.items()
    )
    return Table(("", "at the begin", "least", "largest", "at the end"), rows)


def _over_time(run: ReportedRun) -> AdaptedOverTime:
    return AdaptedOverTime(run.record.time, adapted_over_time(run.config, run.record))
