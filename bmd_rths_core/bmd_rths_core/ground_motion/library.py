"""Find a ground motion by name or by path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.at2 import read_at2
from bmd_rths_core.ground_motion.csv_reader import read_csv
from bmd_rths_core.ground_motion.motion import GroundMotion

# The extension in lower case. A new format is a new module with one reader, and one line here.
_READERS: dict[str, Callable[[Path], GroundMotion]] = {".at2": read_at2, ".csv": read_csv}

# Records in the public domain; each is data/<name>.csv in this package.
_SHIPPED = ("el_centro_1940_ns",)


def shipped_records() -> tuple[str, ...]:
    """Return the names of the records that come with this package."""
    return _SHIPPED


def read_ground_motion(reference: str | Path) -> GroundMotion:
    """Read a shipped record by its name, or a file by its path; the extension chooses the reader.

    Parameters
    ----------
    reference : str or Path
        One of `shipped_records`, or the path of a file ending in ``.at2`` or ``.csv``, in either case of letters.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The reference is neither, or the file cannot be read or understood.
    """
    if str(reference) in _SHIPPED:
        data = resources.files("bmd_rths_core") / "data" / f"{reference}.csv"
        with resources.as_file(data) as path:
            return replace(read_csv(path), source="shipped")
    path = Path(reference)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        read = f"a file ending in {', '.join(_READERS)} or a shipped record ({', '.join(_SHIPPED)})"
        raise InputError(f"{str(reference)!r} is not a ground motion that can be read; {read} is required")
    return reader(path)
