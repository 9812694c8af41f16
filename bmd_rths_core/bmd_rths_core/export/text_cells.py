"""Cells of a table for programs of tables: text that they would run is marked, numbers stay as they are."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

#: What a cell of text begins with that a program of tables takes for a formula, and the mark it is escaped with.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")


def cell(value: Any) -> str:
    """Return a value as the cell of a CSV file.

    Parameters
    ----------
    value : Any
        A float in as many digits as give it back, nothing for NaN; text is marked with ``'`` where a program of tables
        would run it.
    """
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_FORMULA) else value
    if value is None or value != value:
        return ""
    return repr(float(value)) if isinstance(value, float) else str(value)


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file in UTF-8 with one line of names.

    Parameters
    ----------
    path : Path
        The file.
    header : sequence of str
        Names of the columns.
    rows : iterable of iterable
        See `cell`.
    """
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([cell(name) for name in header])
        writer.writerows([cell(value) for value in row] for row in rows)
