"""Drawing of the allowable mass ratio over the frequency of the numerical substructure (Figures 7, 8 and 11)."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bmd_rths_core.paper_figures.margins import MarginFigure, MarginPanel
from bmd_rths_core.plots.style import LINES, MARKERS, legend_below, new_figure


def draw_margins(data: MarginFigure) -> Figure:
    """Draw a margin figure: one panel for each model of the experimental substructure.

    Parameters
    ----------
    data : MarginFigure
        What it shows.

    Returns
    -------
    Figure
        The grey below a curve is where its loop is stable; it is darker where several are.
    """
    darker = ", darker where several of the loops are" if len(data.panels[0].curves) > 1 else ""
    figure = new_figure(85.0, f"Figure {data.number}. {data.title}\nwhite: unstable; grey: stable{darker}")
    axes = figure.subplots(1, len(data.panels), sharex=True, sharey=True)
    for letter, panel, own in zip("ab", data.panels, axes, strict=True):
        _draw_panel(own, panel, data)
        own.set_title(f"({letter}) experimental substructure: {panel.title}")
    axes[0].set_ylabel("mass ratio (Eq. 8) [1]")
    legend_below(figure, axes[0], columns=2, between=0.06)
    return figure


def _draw_panel(axes: Axes, panel: MarginPanel, data: MarginFigure) -> None:
    for line, (label, curve, _) in zip(LINES, panel.curves, strict=False):
        axes.fill_between(curve.frequencies, curve.allowable_mass_ratios, color="0.5", alpha=0.2, linewidth=0.0)
        axes.plot(curve.frequencies, curve.allowable_mass_ratios, label=f"margin, {label}", **line)
    frequency = data.system.frequency
    axes.axvline(frequency, color="0.3", linewidth=0.6, linestyle=":")
    axes.text(frequency, 0.97, f" system: {frequency:g} rad/s", verticalalignment="top")
    for marker, mark in zip(MARKERS, data.marks, strict=False):
        axes.plot(frequency, mark.mass_ratio, f"{marker}k", markerfacecolor="white", zorder=5, label=mark.label)
    axes.set(xlim=(0.0, data.highest), ylim=(0.0, 1.0), xlabel="frequency of the numerical substructure [rad/s]")
