"""How long the steps took on the wall clock, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.plots.histories import plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLUE, VERMILION
from bmd_rths_core.report.document import Block, Paragraph, Table, shown
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.wording import number

TITLE = "Timing"

CAPTION = (
    "Closure is the time from the desired acceleration of a step to its corrected shear, by the clock of the numerical "
    "substructure. The other times are those of the messages at the recorder; nodes that share a process send them "
    "when the step is over."
)

_SENT, _PERIOD = "first to last message [ms]", "time between steps [ms]"


@dataclass(frozen=True)
class TimingFigure:
    """Closure and period of the steps.

    Parameters
    ----------
    timing : StepTiming
        When the messages of the steps reached the recorder.
    counts : tuple of int
        Steps by their closure, in equal parts of the time step; empty when a recording does not tell.
    """

    timing: StepTiming
    counts: tuple[int, ...] = ()

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 105.0

    def draw(self, figure: Canvas) -> None:
        """Draw how long the steps took, and when."""
        grid = grid_in_mm(figure, 2, 2, between=(LABELS + 5.0, 18.0))
        closures, periods, history = (figure.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
        deadline = 1e3 * self.timing.time_step
        if self.counts:
            edges = np.linspace(0.0, deadline, len(self.counts) + 1).tolist()
            closures.hist(edges[:-1], bins=edges, weights=self.counts, log=True, color=BLUE)
            closures.set(xlabel="closure of a step [ms]")
        else:
            closures.hist(self.timing.chain_ms, bins=80, log=True, color=BLUE)
            closures.set(xlabel=_SENT)
        periods.hist(self.timing.period_ms, bins=80, log=True, color=BLUE)
        periods.set(xlabel=_PERIOD)
        for axes in (closures, periods):
            axes.axvline(deadline, color=VERMILION, linewidth=1.0, linestyle="--", label=f"Δt = {deadline:g} ms")
            axes.set(ylabel="steps")
            axes.yaxis.set_major_formatter("{x:g}")  # powers would be formulas, which are not parsed
            axes.legend(ncols=1, **ABOVE)
        time = self.timing.steps * self.timing.time_step
        if self.timing.hops_ms:
            plot_history(history, time, self.timing.chain_ms, color=BLUE, linewidth=0.5, label="a step")
            history.set(ylabel=_SENT)
        else:
            following = time[1:][np.diff(self.timing.steps) == 1]
            plot_history(history, following, self.timing.period_ms, color=BLUE, linewidth=0.5, label="a step")
            history.set(ylabel=_PERIOD)
        history.axhline(deadline, color=VERMILION, linewidth=0.8, linestyle="--")
        missed = np.array(self.timing.missed_steps) * self.timing.time_step
        history.plot(
            missed, np.full(len(missed), deadline), "|", color=VERMILION, markersize=8.0, label="missed deadline"
        )
        history.legend(ncols=2, **ABOVE)
        history.set(xlabel="test time [s]")


def figure(run: ReportedRun) -> TimingFigure | str:
    """Return the figure of a run, or why there is none."""
    told = run.record.timing
    return run.timing if isinstance(run.timing, str) else TimingFigure(run.timing, told.closure_counts if told else ())


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    timing, found = run.record.timing, figure(run)
    if timing is None or isinstance(found, str):
        return [shown(found, CAPTION)]
    closure = ", ".join(f"{name} {number(value, 2)} ms" for name, value in timing.closure_ms.items())
    missed = f"{timing.missed_deadlines} of {run.record.steps} deadlines missed"
    told = Paragraph(f"{missed}; closure at the numerical substructure: {closure}.")
    return [told, *_hops(found.timing), shown(found, CAPTION)]


def _hops(timing: StepTiming) -> list[Block]:
    """Return what a step waits for, message by message."""
    rows = []
    for name, times in timing.hops_ms.items():
        if len(times):
            p50, p99 = np.percentile(times, [50, 99])
            rows.append((name.replace("_", " "), number(p50, 2), number(p99, 2), number(times.max(), 2)))
    return [Table(("after the message before [ms]", "p50", "p99", "largest"), tuple(rows))] if rows else []
