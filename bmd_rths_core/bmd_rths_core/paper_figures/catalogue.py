"""Every figure by its number."""

from __future__ import annotations

from collections.abc import Callable

from bmd_rths_core.config import Config
from bmd_rths_core.paper_figures.margins import MarginFigure, figure_7, figure_8, figure_11
from bmd_rths_core.paper_figures.table_response import TableResponse, figure_6, figure_10
from bmd_rths_core.paper_figures.time_history import TimeHistory, figure_13

FigureData = MarginFigure | TableResponse | TimeHistory
Progress = Callable[[float], None] | None

_WITHOUT_RUN: dict[int, Callable[[Config], FigureData]] = {7: figure_7, 8: figure_8, 11: figure_11}
_WITH_RUN: dict[int, Callable[[Config, Progress], FigureData]] = {6: figure_6, 10: figure_10, 13: figure_13}


def figure_data(number: int, config: Config, progress: Progress = None) -> FigureData:
    """Compute what a figure shows.

    Parameters
    ----------
    number : int
        One of `systems.FIGURES`.
    config : Config
        The system the figure is about.
    progress : callable, optional
        Called with the finished share of the work, from 0 to 1, by figures that need a run of the simulated table.

    Returns
    -------
    MarginFigure, TableResponse or TimeHistory

    Raises
    ------
    InputError
        Something is wrong with the configuration.
    """
    if number in _WITHOUT_RUN:
        return _WITHOUT_RUN[number](config)
    return _WITH_RUN[number](config, progress)
