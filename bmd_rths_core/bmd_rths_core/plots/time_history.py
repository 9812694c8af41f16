"""Drawing of the acceleration of the superstructure (Figure 13)."""

from __future__ import annotations

from matplotlib.figure import Figure

from bmd_rths_core.paper_figures.time_history import PAPER_RMSE, TimeHistory
from bmd_rths_core.plots.style import BLACK, ORANGE, legend_below, new_figure


def draw_time_history(data: TimeHistory) -> Figure:
    """Draw the whole history and, below it, the strong motion."""
    figure = new_figure(110.0, f"Figure {data.number}. {data.title}: {data.motion}\n{_note(data)}")
    whole, zoom = figure.subplots(2, 1, sharey=True)
    for axes in (whole, zoom):
        axes.plot(data.time, data.rths, color=ORANGE, linewidth=1.5, label="RTHS, PLC + FC, simulated table")
        axes.plot(data.time, data.benchmark, color=BLACK, linewidth=0.6, label="benchmark: building without partition")
        axes.set_ylabel("acceleration [m/s²]")
    begin, end = data.strong_motion
    whole.axvspan(begin, end, color="0.93", linewidth=0.0)
    whole.set(xlim=(0.0, data.time[-1]), title="(a) whole record, strong motion shaded")
    longest = f"the {end - begin:.3g} s in which the mean square of the benchmark is largest"
    zoom.set(xlim=(begin, end), title=f"(b) strong motion: {longest}")
    for axes in (whole, zoom):
        axes.set_xlabel("time [s]")
    legend_below(figure, whole, columns=2)
    return figure


def _note(data: TimeHistory) -> str:
    paper = f"paper: {PAPER_RMSE:g} %, Table 3" if data.is_parkfield else "the paper's figure shows Parkfield"
    stopped = f"\nthe test was stopped: {data.stopped}" if data.stopped else ""
    return f"RMSE (Eq. 12) {data.rmse_percent:.2f} %; {paper}{stopped}"
