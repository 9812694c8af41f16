"""Figures of a report: responses of the floors, of one run or of several."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure, SubFigure

from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import grid_in_mm, legend_on_top
from bmd_rths_core.plots.style import BLACK, BLUE, GREEN, LINES, ORANGE, VERMILION
from bmd_rths_core.report.responses import FloorResponses
from bmd_rths_core.report.run_comparison import Comparison
from bmd_rths_core.report.tracking import FloorTransfer

#: What is less coherent may leave the figure: noise has no amplification.
_COHERENT = 0.3

#: Colours of runs laid over each other, told apart in grey by their dashes.
_RUNS: tuple[dict[str, Any], ...] = tuple(
    {"color": color, "linestyle": line["linestyle"], "linewidth": 0.9}
    for color, line in zip((VERMILION, BLUE, GREEN, ORANGE), (*LINES, LINES[0]), strict=True)
)


def draw_responses(figure: Figure | SubFigure, data: FloorResponses) -> None:
    """Draw every floor, top floor first: the whole run on the left, the strong motion on the right.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : FloorResponses
        What it shows.
    """
    grid = grid_in_mm(figure, len(data.floors), 2, top=11.0, between=(7.0, 12.0))
    rows = grid.subplots(squeeze=False, sharex="col", sharey="row")
    for (whole, zoom), floor in zip(rows, reversed(data.floors), strict=True):
        for axes, window in ((whole, None), (zoom, data.strong_motion)):
            for values, look in ((floor.run, _RUN), (floor.reference, _REFERENCE)):
                curve = (floor.time, values) if window is None else between(floor.time, values, window)
                plot_history(axes, *curve, **look)
        whole.set_xlim(0.0, floor.time[-1])
        whole.axvspan(*data.strong_motion, color="0.93", linewidth=0.0)
        whole.set_title(f"{floor.name}: RMSE {_percent(floor.rmse_percent)}", loc="left")
        zoom.set_title(f"peak error {_percent(floor.peak_error_percent)}", loc="left")
        whole.set_ylabel("[m/s²]")
    rows[-1, 0].set_xlabel("time [s], strong motion shaded")
    rows[-1, 1].set(xlabel="time [s], strong motion", xlim=data.strong_motion)
    legend_on_top(figure, rows[0, 0], 2)


def draw_comparison(figure: Figure | SubFigure, data: Comparison) -> None:
    """Draw the top floor and the interface of several runs over the reference, where the response is largest.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : Comparison
        What it shows.
    """
    first = data.runs[0].responses
    rows = grid_in_mm(figure, 2, top=15.0, between=(8.0, 0.0)).subplots(squeeze=False, sharex=True)[:, 0]
    interface = next(i for i, floor in enumerate(first.floors) if floor.name.startswith("interface"))
    for axes, place in zip(rows, (len(first.floors) - 1, interface), strict=True):
        reference = first.floors[place]
        plot_history(
            axes, *between(reference.time, reference.reference, data.window), **_REFERENCE | {"linewidth": 1.0}
        )
        for run, look in zip(data.runs, _RUNS, strict=False):
            floor = next((f for f in run.responses.floors if f.name == reference.name), None)
            if floor is not None:
                plot_history(axes, *between(floor.time, floor.run, data.window), label=run.label, **look)
        axes.set_title(reference.name, loc="left")
        axes.set_ylabel("[m/s²]")
    rows[-1].set(xlabel="time [s]", xlim=data.window)
    legend_on_top(figure, rows[0], 3)


def draw_transfer(figure: Figure | SubFigure, data: FloorTransfer) -> None:
    """Draw the amplification from the ground to the floors, top floor first.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : FloorTransfer
        What it shows.
    """
    grid = grid_in_mm(figure, len(data.names), top=11.0, between=(7.0, 0.0))
    rows = grid.subplots(squeeze=False, sharex=True)[:, 0]
    hertz = data.run.frequencies / (2.0 * np.pi)
    for axes, floor in zip(rows, reversed(range(len(data.names))), strict=True):
        for response, look in ((data.run, _RUN), (data.reference, _REFERENCE)):
            axes.semilogy(hertz, np.maximum(np.abs(response.response[:, floor]), 1e-3), **look)
        coherent = data.run.coherence[:, floor] >= _COHERENT
        run = np.abs(data.run.response[coherent, floor])
        shown = np.maximum(np.append(np.abs(data.reference.response[:, floor]), run), 1e-3)
        axes.set(ylabel="[1]", ylim=(0.5 * shown.min(), 2.0 * shown.max()))
        axes.yaxis.set_major_formatter("{x:g}")  # powers would be formulas, which are not parsed
        axes.yaxis.set_minor_formatter("")
        axes.set_title(f"{data.names[floor]} over ground", loc="left")
    rows[-1].set(xlabel="frequency [Hz]", xlim=(0.0, hertz[-1]))
    legend_on_top(figure, rows[0], 2)


_RUN: dict[str, Any] = {"color": ORANGE, "linewidth": 1.4, "label": "run"}
_REFERENCE: dict[str, Any] = {"color": BLACK, "linewidth": 0.6, "label": "reference: building without partition"}


def _percent(value: float) -> str:
    return f"{value:.1f} %" if np.isfinite(value) else "–"
