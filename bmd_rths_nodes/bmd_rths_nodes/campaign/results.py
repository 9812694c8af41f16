"""The results of a campaign in a folder: a CSV file that grows run by run and survives being cut."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.campaign.file_lock import lock

#: Name of the file in the output folder.
CSV_NAME, PARQUET_NAME = "campaign.csv", "campaign.parquet"

_ERRORS = ("substructure", "control_layer", "superstructure")
#: Results that have several numbers, and the columns of each.
_SEVERAL = {
    "rmse_percent": {name: f"rmse_{name}_percent" for name in _ERRORS},
    "rmse_true_percent": {name: f"rmse_true_{name}_percent" for name in _ERRORS},
    "rmse_clean_percent": {name: f"rmse_clean_{name}_percent" for name in _ERRORS},
    "noise_floor_percent": {name: f"noise_floor_{name}_percent" for name in _ERRORS},
    "capture": {name: f"capture_{name}" for name in ("substructure", "superstructure")},
}
_NUMBERS = (
    *("tracking_delay_ms", "tracking_error_percent", "delay_ms"),
    *("spectral_radius", "peak_command", "peak_displacement", "peak_velocity", "peak_acceleration", "peak_force"),
)
#: Results that are written as JSON, because how many numbers they have differs from test to test.
_JSON = {"variation": dict, "criteria": dict, "peak_drifts": list}
_COLUMNS = (
    *("key", "motion", "event", "file", "component", "scheme", "variation"),
    *("stable", "stability", "outcome", "reason", "steps"),
    *(column for columns in _SEVERAL.values() for column in columns.values()),
    *(*_NUMBERS, "criteria", "peak_drifts", "verdict", "engine"),
)
_HEADER = (",".join(_COLUMNS) + "\n").encode()

#: What a cell begins with that programs of tables take for a formula, and the mark it is escaped with itself.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")


class CampaignResults:
    """One line for every finished run, found again by its key.

    Only keys and places of the lines are kept in memory. What is appended is on the disk before `append` returns; a
    last line without an end is what a killed study leaves, and is dropped.

    Parameters
    ----------
    folder : Path
        The output folder; it exists.

    Raises
    ------
    InputError
        The file is of something else, or another campaign writes it.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / CSV_NAME
        try:
            self._file = open(self.path, "a+b")  # noqa: SIM115  # closed by `close`
            lock(self._file)
        except BlockingIOError:
            raise InputError(f"{self.path}: another campaign writes it; another --output is required") from None
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from error
        self._places: dict[str, int] = {}
        self._take_up()

    def __contains__(self, key: object) -> bool:
        """Tell whether a run is finished."""
        return key in self._places

    def append(self, results: Iterable[Mapping[str, Any]]) -> None:
        """Write runs, on the disk.

        Parameters
        ----------
        results : iterable of Mapping
            As `bmd_rths_core.campaign.study.FinishedRun` has them.
        """
        self._file.seek(0, os.SEEK_END)
        for result in results:
            self._places[result["key"]] = self._file.tell()
            self._file.write(_line(result))
        self._file.flush()
        os.fsync(self._file.fileno())

    def read(self, key: str) -> dict[str, Any]:
        """Return a finished run.

        Parameters
        ----------
        key : str
            Its key.
        """
        self._file.seek(self._places[key])
        line = self._file.readline()
        try:
            return _result(next(csv.DictReader([line.decode()], _COLUMNS)))
        except (ValueError, TypeError, KeyError, StopIteration, csv.Error) as error:
            problem = " ".join(str(error).split()) or type(error).__name__
            shown = line[:60].decode("utf-8", "replace").rstrip()
            raise InputError(
                f"{self.path}: the line {shown!r}... is damaged: {problem}; another --output is required"
            ) from error

    def write_parquet(self) -> Path | None:
        """Write all lines as a Parquet file beside the CSV file too.

        Returns
        -------
        Path or None
            None when pyarrow is not installed.
        """
        try:
            from pyarrow import csv as arrow_csv
            from pyarrow import parquet
        except ModuleNotFoundError:
            return None
        path = self.path.with_name(PARQUET_NAME)
        parquet.write_table(arrow_csv.read_csv(self.path), path)
        return path

    def close(self) -> None:
        """Close the file for others."""
        self._file.close()

    def _take_up(self) -> None:
        """Find the lines of a study that has run here, and drop a last one that was cut."""
        self._file.seek(0)
        whole = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            if whole == 0 and line != _HEADER:
                raise InputError(f"{self.path}: line 1: not the columns of a campaign; another --output is required")
            if whole:
                self._places[line.partition(b",")[0].decode("utf-8", "replace")] = whole
            whole += len(line)
        self._file.truncate(whole)
        if whole == 0:
            self._file.write(_HEADER)
            self._file.flush()


def _line(result: Mapping[str, Any]) -> bytes:
    several = {column: result[of][name] for of, columns in _SEVERAL.items() for name, column in columns.items()}
    row = {**result, **several, **{name: json.dumps(result[name]) for name in _JSON}}
    text = io.StringIO()
    # A missing value is an empty cell; the shortest text that reads back as the same number is that of repr.
    cells = ("" if row[name] is None else row[name] for name in _COLUMNS)
    csv.writer(text, lineterminator="\n").writerow(
        [_escaped(cell) if isinstance(cell, str) else cell for cell in cells]
    )
    return text.getvalue().encode()


def _escaped(text: str) -> str:
    """Return a text that no program of tables takes for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _result(row: Mapping[str, str]) -> dict[str, Any]:
    if None in row:  # the key csv gives cells that are left over
        raise ValueError("more cells than columns")
    row = {
        name: text.removeprefix("'") if text is not None and text[1:].startswith(_FORMULA) and text[:1] == "'" else text
        for name, text in row.items()
    }
    return {
        **{name: row[name] for name in ("key", "motion")},
        "event": row["event"] or None,
        **{name: row[name] for name in ("file", "component", "scheme")},
        "variation": _json(row, "variation"),
        "stable": row["stable"] == "True",
        **{name: row[name] for name in ("stability", "outcome", "reason")},
        "steps": int(row["steps"]),
        **{of: {name: _number(row[column]) for name, column in columns.items()} for of, columns in _SEVERAL.items()},
        **{name: _number(row[name]) for name in _NUMBERS},
        **{name: _json(row, name) for name in ("criteria", "peak_drifts")},
        "verdict": row["verdict"],
        "engine": row["engine"],
    }


def _number(text: str) -> float | None:
    return float(text) if text else None


def _json(row: Mapping[str, str], name: str) -> Any:
    value = json.loads(row[name])
    if not isinstance(value, _JSON[name]):
        raise ValueError(f"{name}: {row[name]!r} is no {_JSON[name].__name__}")
    return value
