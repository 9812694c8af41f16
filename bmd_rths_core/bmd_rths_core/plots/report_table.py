"""Figures of a report: how the table followed, forces at the interface, and timing."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE, ORANGE, VERMILION
from bmd_rths_core.report.forces import InterfaceForces
from bmd_rths_core.report.timing import StepTiming
from bmd_rths_core.report.tracking import TableFrequencies, TrackingHistory

FloatArray = NDArray[np.float64]


def draw_tracking(figure: Figure | SubFigure, data: TrackingHistory) -> None:
    """Draw desired and achieved acceleration, their difference, the synchronisation plot and the delay over time.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : TrackingHistory
        What it shows.
    """
    grid = grid_in_mm(figure, 3, 2, between=(LABELS + 5.0, 18.0), width_ratios=(2.0, 1.0))
    history, error = grid[:2, 0].subgridspec(2, 1, hspace=0.12).subplots(sharex=True, squeeze=False)[:, 0]
    delay = figure.add_subplot(grid[2, 0])
    synchronisation = figure.add_subplot(grid[:2, 1])
    window = data.strong_motion
    plot_history(history, *between(data.time, data.achieved, window), color=ORANGE, linewidth=1.4, label="achieved")
    plot_history(history, *between(data.time, data.desired, window), color=BLACK, linewidth=0.6, label="desired")
    difference = data.achieved - data.desired
    plot_history(error, *between(data.time, difference, window), color=VERMILION, linewidth=0.7)
    history.legend(ncols=2, **ABOVE)
    history.set(ylabel="[m/s²]", xlim=window)
    error.set(ylabel="error [m/s²]", xlim=window, xlabel="time [s], strong motion")
    synchronisation.plot(data.desired, data.achieved, color=BLUE, linewidth=0.3, rasterized=True)
    _diagonal(synchronisation)
    synchronisation.set(xlabel="desired [m/s²]", ylabel="achieved [m/s²]", title="synchronisation")
    delay.plot(data.delay_time, data.delay_ms, "o", color=BLUE, markersize=2.5, label="windows of 2 s")
    if np.isfinite(data.overall_delay_ms):
        delay.axhline(data.overall_delay_ms, color=BLACK, linewidth=0.8, label=f"all: {data.overall_delay_ms:.2f} ms")
    delay.legend(ncols=2, **ABOVE)
    delay.margins(y=0.2)  # no point is cut at an edge
    delay.set(xlabel="time [s], whole run", ylabel="delay [ms]", xlim=(0.0, data.time[-1]))


def draw_frequencies(figure: Figure | SubFigure, data: TableFrequencies) -> None:
    """Draw magnitude, phase and coherence; what is less coherent is paler.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : TableFrequencies
        What it shows.
    """
    grid = grid_in_mm(figure, 3, height_ratios=(2, 2, 1))
    magnitude, phase, coherence = grid.subplots(squeeze=False, sharex=True)[:, 0]
    found = data.response
    hertz = found.frequencies / (2.0 * np.pi)
    shade = [to_rgba(BLUE, alpha) for alpha in np.clip(found.coherence, 0.02, 1.0) ** 2]
    magnitude.scatter(hertz, 20.0 * np.log10(np.maximum(np.abs(found.response), 1e-3)), s=5.0, c=shade)
    phase.scatter(hertz, np.degrees(np.angle(found.response)), s=5.0, c=shade)
    coherence.plot(hertz, found.coherence, color=BLACK, linewidth=0.8)
    for axes, label in ((magnitude, "magnitude [dB]"), (phase, "phase [°]")):
        axes.axhline(0.0, color="0.5", linewidth=0.6)
        axes.set_ylabel(label)
    phase.set(ylim=(-180.0, 180.0), yticks=range(-180, 181, 90))
    coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlim=(0.0, hertz[-1]), xlabel="frequency [Hz]")


def draw_forces(figure: Figure | SubFigure, data: InterfaceForces) -> None:
    """Draw the shears in the strong motion and around the largest, and the unbalanced force over the whole run.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : InterfaceForces
        What it shows.
    """
    shears, zoom, unbalanced = grid_in_mm(figure, 3, between=(LABELS, 0.0)).subplots(squeeze=False)[:, 0]
    scaled = f", times {data.feedback_scale:g}" if data.feedback_scale != 1.0 else ""
    curves: tuple[tuple[FloatArray, str, dict[str, Any]], ...] = (
        (data.measured, f"load cells{scaled}", {"color": "0.7", "linewidth": 1.8}),
        (data.estimated, f"estimated (Eq. 6){scaled}", {"color": ORANGE, "linewidth": 1.3}),
        (data.required, "required (Eq. 4)", {"color": BLACK, "linewidth": 0.6}),
        (data.fed_back, "fed back", {"color": BLUE, "linewidth": 0.6, "linestyle": (0, (5, 2))}),
    )
    for values, label, look in curves:
        if np.isfinite(values).any():
            for axes, window in ((shears, data.strong_motion), (zoom, data.largest)):
                plot_history(axes, *between(data.time, values / 1e3, window), label=label, **look)
    plot_history(unbalanced, data.time, data.unbalanced / 1e3, color=VERMILION, linewidth=0.6)
    shears.legend(ncols=4, **ABOVE)
    shears.set(ylabel="shear [kN]", xlim=data.strong_motion, xlabel="time [s], strong motion")
    shears.axvspan(*data.largest, color="0.93", linewidth=0.0)
    zoom.set(ylabel="shear [kN]", xlim=data.largest, xlabel="time [s], around the largest shear, shaded above")
    unbalanced.axvspan(*data.strong_motion, color="0.93", linewidth=0.0)
    unbalanced.set(ylabel="unbalanced [kN]", xlim=(0.0, data.time[-1]), xlabel="time [s], strong motion shaded")


def draw_timing(figure: Figure | SubFigure, data: StepTiming) -> None:
    """Draw how long the steps took, and when.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : StepTiming
        What it shows.
    """
    grid = grid_in_mm(figure, 2, 2, between=(LABELS + 5.0, 18.0))
    closures, periods, history = (figure.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
    deadline = 1e3 * data.time_step
    for axes, values, label in (
        (closures, data.closure_ms, "closure of a step [ms]"),
        (periods, data.period_ms, "time between steps [ms]"),
    ):
        axes.hist(values, bins=80, log=True, color=BLUE)
        axes.axvline(deadline, color=VERMILION, linewidth=1.0, linestyle="--", label=f"Δt = {deadline:g} ms")
        axes.set(xlabel=label, ylabel="steps")
        axes.yaxis.set_major_formatter("{x:g}")  # powers would be formulas, which are not parsed
        axes.legend(ncols=1, **ABOVE)
    time = data.steps * data.time_step
    plot_history(history, time, data.closure_ms, color=BLUE, linewidth=0.5, label="closure")
    history.axhline(deadline, color=VERMILION, linewidth=0.8, linestyle="--")
    missed = np.array(data.missed_steps) * data.time_step
    history.plot(missed, np.full(len(missed), deadline), "|", color=VERMILION, markersize=8.0, label="missed deadline")
    history.legend(ncols=2, **ABOVE)
    history.set(xlabel="test time [s]", ylabel="closure [ms]")


def _diagonal(axes: Axes) -> None:
    lowest, highest = min(axes.get_xlim()[0], axes.get_ylim()[0]), max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([lowest, highest], [lowest, highest], color=BLACK, linewidth=0.6)
    axes.set(xlim=(lowest, highest), ylim=(lowest, highest), aspect="equal")
