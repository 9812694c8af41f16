"""The runs of one study as a tidy table: a row a run, a column a quantity, and a column for each varied parameter."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_core.export.text_cells import write_csv

#: Name of the file in the output folder.
STUDY_NAME = "study.csv"

_FIRST = ("motion", "event", "file", "component", "scheme")
_ENDING = ("stability", "outcome", "steps")
_ERRORS = ("substructure", "control_layer", "superstructure")
_PEAKS = ("peak_command", "peak_displacement", "peak_velocity", "peak_acceleration", "peak_force")
_LAST = ("verdict", "engine", "reason", "key")


def tidy_row(result: Mapping[str, Any], margins: Mapping[str, float | None]) -> dict[str, Any]:
    """Return a run as one row.

    Parameters
    ----------
    result : Mapping
        As `bmd_rths_core.campaign.study.FinishedRun` has it.
    margins : Mapping of str to float
        Margins of its loop by column; empty where none were asked for.

    Returns
    -------
    dict
        By column: text, numbers, and None for what is not known.
    """
    return {
        **{name: result[name] for name in _FIRST},
        **{name: _one_cell(value) for name, value in result["variation"].items()},
        **{name: result[name] for name in _ENDING},
        **{f"rmse_{name}_percent": result["rmse_percent"][name] for name in _ERRORS},
        **{f"rmse_true_{name}_percent": result["rmse_true_percent"][name] for name in _ERRORS},
        **{f"rmse_clean_{name}_percent": result["rmse_clean_percent"][name] for name in _ERRORS},
        **{f"capture_{name}": result["capture"][name] for name in ("substructure", "superstructure")},
        **{name: result[name] for name in ("tracking_error_percent", "tracking_delay_ms", "delay_ms")},
        **result["criteria"],
        **{name: result[name] for name in _PEAKS},
        **{f"peak_drift_{i}": value for i, value in enumerate(result["peak_drifts"], 1)},
        "spectral_radius": result["spectral_radius"],
        **margins,
        **{name: result[name] for name in _LAST},
    }


def _one_cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | tuple) else value


def write_study(rows: Sequence[Mapping[str, Any]], folder: Path) -> Path:
    """Write the rows of a study.

    Parameters
    ----------
    rows : sequence of Mapping
        See `tidy_row`; what one of them does not have is an empty cell.
    folder : Path
        The output folder.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        It cannot be written.
    """
    path = folder / STUDY_NAME
    columns = _in_order(rows)
    try:
        write_csv(path, columns, ([row.get(name) for name in columns] for row in rows))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path


def _in_order(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return all columns, in the order of the rows; those that a row has more stand behind their neighbours."""
    columns: list[str] = []
    for row in rows:
        at = 0
        for name in row:
            if name in columns:
                at = columns.index(name) + 1
            else:
                columns.insert(at, name)
                at += 1
    return columns
