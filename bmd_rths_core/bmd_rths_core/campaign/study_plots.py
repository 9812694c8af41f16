"""What the plots of a study show: errors over a parameter, by scheme, and over two parameters."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: The errors that are drawn, and what they are called.
ERRORS = {"substructure": "substructure", "superstructure": "superstructure"}


@dataclass(frozen=True)
class ErrorsOverParameter:
    """Errors over one varied parameter.

    Parameters
    ----------
    parameter : str
        ``section.key``.
    values : ndarray, shape (V,)
        Its values, rising.
    errors : Mapping of (str, str) to list of ndarray
        By error and scheme, for each value the RMSE of the stable runs [%].
    ended : Mapping of str to list of int
        By scheme, for each value how many runs were not stable.
    """

    parameter: str
    values: FloatArray
    errors: Mapping[tuple[str, str], list[FloatArray]]
    ended: Mapping[str, list[int]]


@dataclass(frozen=True)
class ErrorsByScheme:
    """Errors of all runs of each scheme.

    Parameters
    ----------
    errors : Mapping of (str, str) to ndarray
        By error and scheme, the RMSE of the stable runs [%].
    ended : Mapping of str to int
        By scheme, how many runs were not stable.
    """

    errors: Mapping[tuple[str, str], FloatArray]
    ended: Mapping[str, int]


@dataclass(frozen=True)
class ErrorMap:
    """Mean error of one scheme over two varied parameters.

    Parameters
    ----------
    parameters : tuple of str
        Of the columns and of the rows.
    values : tuple of ndarray
        Their values, rising: shapes (V,) and (W,).
    scheme : str
        The scheme.
    means : Mapping of str to ndarray, shape (W, V)
        By error, the mean RMSE of the stable runs [%]; NaN where none was.
    ended : ndarray, shape (W, V)
        Share of runs that were not stable.
    """

    parameters: tuple[str, str]
    values: tuple[FloatArray, FloatArray]
    scheme: str
    means: Mapping[str, FloatArray]
    ended: FloatArray


StudyPlot = ErrorsOverParameter | ErrorsByScheme | ErrorMap


def study_plots(results: Sequence[Mapping[str, Any]], vary: Mapping[str, Sequence[object]]) -> dict[str, StudyPlot]:
    """Return the plots of a study.

    Parameters
    ----------
    results : sequence of Mapping
        Its runs, as `bmd_rths_core.campaign.study.FinishedRun` has them.
    vary : Mapping of str to sequence
        Values of every parameter that was varied. Those that are numbers have plots.

    Returns
    -------
    dict of str to StudyPlot
        By name of its file: one of the schemes, one a parameter, and one a scheme and pair of parameters.
    """
    schemes = list(dict.fromkeys(result["scheme"] for result in results))
    numbers = {name: np.unique(np.array(values, float)) for name, values in vary.items() if _are_numbers(values)}
    plots: dict[str, StudyPlot] = {"schemes": _by_scheme(results, schemes)}
    for name, values in numbers.items():
        plots[f"over_{name}"] = _over(results, schemes, name, values)
    for (first, second), scheme in itertools.product(itertools.combinations(numbers, 2), schemes):
        pair = (first, second)
        plots[f"map_{first}_{second}_{scheme}"] = _map(results, scheme, pair, (numbers[first], numbers[second]))
    return plots


def _are_numbers(values: Sequence[object]) -> bool:
    """Tell whether values can stand on an axis: two at least."""
    return len(set(map(str, values))) > 1 and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    )


def _errors(runs: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    """Return an error of the stable runs that came to their end."""
    stable = [run for run in runs if run["stability"] == "stable" and run["outcome"] == "finished"]
    return np.array([e for run in stable if (e := run["rmse_percent"][name]) is not None], dtype=np.float64)


def _ended(runs: Sequence[Mapping[str, Any]]) -> int:
    return sum(run["stability"] != "stable" for run in runs)


def _by_scheme(results: Sequence[Mapping[str, Any]], schemes: Sequence[str]) -> ErrorsByScheme:
    own = {scheme: [run for run in results if run["scheme"] == scheme] for scheme in schemes}
    errors = {(name, scheme): _errors(own[scheme], name) for name in ERRORS for scheme in schemes}
    return ErrorsByScheme(errors, {scheme: _ended(runs) for scheme, runs in own.items()})


def _over(
    results: Sequence[Mapping[str, Any]], schemes: Sequence[str], parameter: str, values: FloatArray
) -> ErrorsOverParameter:
    own = {
        scheme: [
            [run for run in results if run["scheme"] == scheme and run["variation"][parameter] == value]
            for value in values
        ]
        for scheme in schemes
    }
    errors = {(name, s): [_errors(runs, name) for runs in own[s]] for name in ERRORS for s in schemes}
    return ErrorsOverParameter(parameter, values, errors, {s: [_ended(runs) for runs in own[s]] for s in schemes})


def _map(
    results: Sequence[Mapping[str, Any]],
    scheme: str,
    parameters: tuple[str, str],
    values: tuple[FloatArray, FloatArray],
) -> ErrorMap:
    shape = len(values[1]), len(values[0])
    means = {name: np.full(shape, np.nan) for name in ERRORS}
    ended = np.zeros(shape)
    own = [run for run in results if run["scheme"] == scheme]
    for row, column in np.ndindex(*shape):
        wanted = (values[0][column], values[1][row])
        runs = [run for run in own if tuple(run["variation"][name] for name in parameters) == wanted]
        ended[row, column] = _ended(runs) / len(runs) if runs else np.nan
        for name, mean in means.items():
            found = _errors(runs, name)
            if found.size:
                mean[row, column] = np.mean(found)
    return ErrorMap(parameters, values, scheme, means, ended)
