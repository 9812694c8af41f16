"""Drawings of a study: errors over a parameter, box plots of the schemes, maps of two parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bmd_rths_core.campaign.study_plots import ERRORS, ErrorMap, ErrorsByScheme, ErrorsOverParameter, StudyPlot
from bmd_rths_core.plots.style import BLACK, CURVES, legend_below, new_figure, style, write

FloatArray = NDArray[np.float64]

#: Formats of the plots: for a page, and to be changed.
STUDY_FORMATS = ("pdf", "svg")


def write_study_plots(plots: Mapping[str, StudyPlot], folder: Path) -> list[Path]:
    """Draw the plots of a study into files.

    Parameters
    ----------
    plots : Mapping of str to StudyPlot
        By name of the file.
    folder : Path
        Where they go; it has to exist.

    Returns
    -------
    list of Path
        The files. The same data give the same bytes.
    """
    paths = []
    for name, data in plots.items():
        with style():
            paths += write(draw_study_plot(data), folder / name, STUDY_FORMATS)
    return paths


def draw_study_plot(data: StudyPlot) -> Figure:
    """Draw a plot of a study in the present style of matplotlib.

    Parameters
    ----------
    data : ErrorsOverParameter, ErrorsByScheme or ErrorMap
        What it shows.
    """
    if isinstance(data, ErrorsOverParameter):
        return _draw_over(data)
    if isinstance(data, ErrorsByScheme):
        return _draw_schemes(data)
    return _draw_map(data)


def _draw_over(data: ErrorsOverParameter) -> Figure:
    """Draw means, with the range of all runs, and crosses above where runs were not stable."""
    note = "mean and range of the stable runs; a cross: not every run was stable"
    figure = new_figure(80.0, f"Error over {data.parameter}\n{note}")
    panels = figure.subplots(1, len(ERRORS), sharex=True)
    schemes = list(data.ended)
    for axes, name in zip(panels, ERRORS, strict=True):
        for look, scheme in zip(_looks(len(schemes)), schemes, strict=True):
            found = data.errors[name, scheme]
            mean, low, high = (_each(found, of) for of in (np.mean, np.min, np.max))
            axes.fill_between(data.values, low, high, color=look["color"], alpha=0.12, linewidth=0.0)
            axes.plot(data.values, mean, label=scheme, **look)
        axes.use_sticky_edges = False  # the first and the last point need room
        _mark_ended(axes, data, schemes)
        axes.set(title=ERRORS[name], xlabel=data.parameter, ylabel="RMSE [%]")
        axes.set_ylim(bottom=0.0)
    legend_below(figure, panels[0], columns=min(len(schemes), 5), between=0.06)
    return figure


def _mark_ended(axes: Axes, data: ErrorsOverParameter, schemes: list[str]) -> None:
    """Mark above the axes where runs of a scheme were not stable."""
    for row, (look, scheme) in enumerate(zip(_looks(len(schemes)), schemes, strict=True)):
        where = data.values[np.array(data.ended[scheme]) > 0]
        height = np.full(len(where), 0.97 - 0.045 * row)
        axes.plot(where, height, "x", color=look["color"], transform=axes.get_xaxis_transform(), markersize=4.0)


def _draw_schemes(data: ErrorsByScheme) -> Figure:
    """Draw a box a scheme: quartiles, median, whiskers over 1.5 boxes, every other run a point."""
    note = "stable runs: quartiles, median, whiskers of at most 1.5 boxes, other runs as points; n: stable + others"
    figure = new_figure(80.0, f"Errors by scheme\n{note}")
    panels = figure.subplots(1, len(ERRORS))
    schemes = list(data.ended)
    for axes, name in zip(panels, ERRORS, strict=True):
        values = [data.errors[name, scheme] for scheme in schemes]
        places = np.arange(1, len(schemes) + 1)
        line = {"color": BLACK, "linewidth": 0.8}
        axes.boxplot(
            [v if v.size else [np.nan] for v in values],
            positions=places,
            boxprops=line,
            whiskerprops=line,
            capprops=line,
            medianprops={"color": CURVES[1]["color"], "linewidth": 1.4},
            flierprops={"marker": "o", "markersize": 2.5, "markeredgewidth": 0.5},
        )
        labels = [_counted(scheme, len(v), data.ended[scheme]) for scheme, v in zip(schemes, values, strict=True)]
        axes.set_xticks(places, labels)
        axes.set(title=ERRORS[name], ylabel="RMSE [%]")
        axes.set_ylim(bottom=0.0)
    figure.set_layout_engine("constrained")
    return figure


def _counted(scheme: str, stable: int, ended: int) -> str:
    return f"{scheme}\nn = {stable}" + (f" + {ended}" if ended else "")


def _draw_map(data: ErrorMap) -> Figure:
    """Draw the mean error as colour; hatched where no run was stable, a cross where some were not."""
    note = "colour: mean of the stable runs; hatched: none was stable; a cross: not every run was"
    figure = new_figure(85.0, f"Error of {data.scheme} over two parameters\n{note}")
    figure.set_layout_engine("constrained")  # before there are colour bars
    panels = figure.subplots(1, len(ERRORS), sharey=True)
    columns, rows = data.values
    for axes, name in zip(panels, ERRORS, strict=True):
        means = np.ma.masked_invalid(data.means[name])
        mesh = axes.imshow(means, origin="lower", aspect="auto", cmap="viridis_r", interpolation="nearest")
        for row, column in np.argwhere(np.isnan(data.means[name])):
            axes.fill_between(
                (column - 0.5, column + 0.5), row - 0.5, row + 0.5, facecolor="none", edgecolor="0.5", hatch="///"
            )
        some = np.argwhere((data.ended > 0.0) & ~np.isnan(data.means[name]))
        axes.plot(some[:, 1], some[:, 0], "x", color="white", markersize=4.0)
        axes.set_xticks(range(len(columns)), [f"{value:g}" for value in columns])
        axes.set_yticks(range(len(rows)), [f"{value:g}" for value in rows])
        axes.set(title=ERRORS[name], xlabel=data.parameters[0])
        figure.colorbar(mesh, ax=axes, label="RMSE [%]")
    panels[0].set_ylabel(data.parameters[1])
    return figure


def _looks(count: int) -> list[dict[str, object]]:
    return [dict(CURVES[i % len(CURVES)]) for i in range(count)]


def _each(values: list[FloatArray], of: object) -> FloatArray:
    """Return a number of each array; NaN of an empty one."""
    return np.array([of(v) if v.size else np.nan for v in values])  # type: ignore[operator]
