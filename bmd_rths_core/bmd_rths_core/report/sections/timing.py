"""How long the steps took on the wall clock, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.plots.histories import plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLUE, VERMILION
from bmd_rths_core.report.document import Block, Paragraph, shown
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.wording import number

TITLE = "Timing"

CAPTION = (
    "On the wall clock of the recorder. Closure is the time from the desired acceleration of a step to its corrected "
    "shear; messages reach the recorder a little later than the nodes of the loop."
)


@dataclass(frozen=True)
class TimingFigure:
    """Closure and period of the steps.

    Parameters
    ----------
    timing : StepTiming
        When the messages of the steps reached the recorder.
    """

    timing: StepTiming

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 105.0

    def draw(self, figure: Canvas) -> None:
        """Draw how long the steps took, and when."""
        grid = grid_in_mm(figure, 2, 2, between=(LABELS + 5.0, 18.0))
        closures, periods, history = (figure.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
        deadline = 1e3 * self.timing.time_step
        for axes, values, label in (
            (closures, self.timing.closure_ms, "closure of a step [ms]"),
            (periods, self.timing.period_ms, "time between steps [ms]"),
        ):
            axes.hist(values, bins=80, log=True, color=BLUE)
            axes.axvline(deadline, color=VERMILION, linewidth=1.0, linestyle="--", label=f"Δt = {deadline:g} ms")
            axes.set(xlabel=label, ylabel="steps")
            axes.yaxis.set_major_formatter("{x:g}")  # powers would be formulas, which are not parsed
            axes.legend(ncols=1, **ABOVE)
        time = self.timing.steps * self.timing.time_step
        plot_history(history, time, self.timing.closure_ms, color=BLUE, linewidth=0.5, label="closure")
        history.axhline(deadline, color=VERMILION, linewidth=0.8, linestyle="--")
        missed = np.array(self.timing.missed_steps) * self.timing.time_step
        history.plot(
            missed, np.full(len(missed), deadline), "|", color=VERMILION, markersize=8.0, label="missed deadline"
        )
        history.legend(ncols=2, **ABOVE)
        history.set(xlabel="test time [s]", ylabel="closure [ms]")


def figure(run: ReportedRun) -> TimingFigure | str:
    """Return the figure of a run, or why there is none."""
    return run.timing if isinstance(run.timing, str) else TimingFigure(run.timing)


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    timing, found = run.record.timing, figure(run)
    if timing is None or isinstance(found, str):
        return [shown(found, CAPTION)]
    closure = ", ".join(f"{name} {number(value, 2)} ms" for name, value in timing.closure_ms.items())
    missed = f"{timing.missed_deadlines} of {run.record.steps} deadlines missed"
    return [Paragraph(f"{missed}; closure at the numerical substructure: {closure}."), shown(found, CAPTION)]
