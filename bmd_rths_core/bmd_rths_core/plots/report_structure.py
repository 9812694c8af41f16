"""Figures of a report: hysteresis of the stories, energy and stability indicator."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from bmd_rths_core.plots.histories import plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, grid_in_mm, legend_on_top
from bmd_rths_core.plots.style import BLACK, BLUE, GREEN, ORANGE, VERMILION
from bmd_rths_core.report.energy import EnergyHistory
from bmd_rths_core.report.hysteresis import Hysteresis, StoryLoop

#: Stories beside each other.
STORIES_IN_A_ROW = 3


def draw_hysteresis(figure: Figure | SubFigure, data: Hysteresis) -> None:
    """Draw force against drift of every story.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : Hysteresis
        What it shows.
    """
    rows = -(-len(data.stories) // STORIES_IN_A_ROW)
    grid = grid_in_mm(figure, rows, STORIES_IN_A_ROW, between=(LABELS + 5.0, 18.0))
    for i, story in enumerate(data.stories):
        _draw_story(figure.add_subplot(grid[divmod(i, STORIES_IN_A_ROW)]), story)


def _draw_story(axes: Axes, story: StoryLoop) -> None:
    drift, force = 1e3 * story.drift, story.force / 1e3
    axes.plot(drift, force, color=BLUE, linewidth=0.5, rasterized=True)
    largest = float(np.max(np.abs(drift), initial=0.0))
    if story.yield_drift:
        largest = min(largest, 1e3 * story.yield_drift)
        for sign in (-1.0, 1.0):
            axes.axvline(sign * 1e3 * story.yield_drift, color=VERMILION, linewidth=0.6, linestyle=":")
    ends = np.array([-largest, largest])
    axes.plot(ends, story.stiffness * ends / 1e6, color=BLACK, linewidth=0.6, linestyle="--")
    axes.set(title=story.name, xlabel="drift [mm]", ylabel="force [kN]")


def draw_energy(figure: Figure | SubFigure, data: EnergyHistory) -> None:
    """Draw the energies of the numerical substructure, and the stability indicator below.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : EnergyHistory
        What it shows.
    """
    grid = grid_in_mm(figure, 2, height_ratios=(2, 1), between=(7.0, 0.0))
    energies, indicator = grid.subplots(squeeze=False, sharex=True)[:, 0]
    curves = (
        (data.ground_input, "input by the ground", BLACK, "-"),
        (data.interface, "brought by the interface", VERMILION, (0, (5, 2))),
        (data.dampers, "dampers", GREEN, "-"),
        (data.kinetic, "kinetic", ORANGE, "-"),
        (data.springs, "springs", BLUE, (0, (3, 1.5))),
    )
    for values, label, color, dashes in curves:
        width = 1.6 if label == "kinetic" else 0.8  # the springs lie over it where energy goes to and fro
        plot_history(energies, data.time, values, color=color, linestyle=dashes, linewidth=width, label=label)
    legend_on_top(figure, energies, 5)
    energies.set_ylabel("energy [J]")
    largest = f"stability indicator, at most {data.largest_indicator:.3g}"
    plot_history(indicator, data.time, data.indicator, color=BLACK, linewidth=0.8, label=largest, clip_on=False)
    limit = f"limit {data.indicator_limit:g}"
    indicator.axhline(data.indicator_limit, color=VERMILION, linewidth=0.8, linestyle="--", label=limit)
    indicator.legend(ncols=2, **ABOVE)
    highest = max(1.3 * data.indicator_limit, 1.05 * float(np.nanmax(data.indicator, initial=0.0)))
    indicator.set(ylabel="indicator [1]", xlabel="time [s]", ylim=(0.0, highest), xlim=(0.0, data.time[-1]))
