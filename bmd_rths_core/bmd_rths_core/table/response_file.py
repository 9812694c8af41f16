"""Reader of a measured frequency response: a CSV file with frequency, magnitude, phase and, if known, coherence."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import read_file
from bmd_rths_core.ground_motion.formats.units import quoted

FloatArray = NDArray[np.float64]

COLUMNS = ("frequency_hz", "magnitude", "phase_deg")
COHERENCE = "coherence"


class ResponseFile(NamedTuple):
    """A measured frequency response, achieved from commanded acceleration.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω > 0 [rad/s], ascending.
    response : ndarray of complex, shape (n,)
        A lag is a negative phase.
    coherence : ndarray, shape (n,), or None
        γ² between 0 and 1; None where the file has none.
    """

    frequencies: FloatArray
    response: NDArray[np.complex128]
    coherence: FloatArray | None


def read_response(path: str | Path) -> ResponseFile:
    """Read a measured frequency response, for example of the table with the specimen on it.

    Lines that begin with ``#`` are comments. The first other line names the columns ``frequency_hz``, ``magnitude``,
    ``phase_deg`` and, if it is there, ``coherence``, in any order; other columns are passed over.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    InputError
        The file cannot be read; a column is missing or named twice; a value is not a finite number; a magnitude is not
        positive; a coherence is not between 0 and 1; or the frequencies, two at least, do not rise from above 0.
    """
    file = read_file(path)
    rows = [(n, line) for n, line in enumerate(file.lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if len(rows) < 3:
        raise InputError(f"{path}: {len(rows)} rows; the header {','.join(COLUMNS)} and two rows are required")
    header_line, header = rows.pop(0)
    names = _cells(header)
    for column in COLUMNS:
        if names.count(column) != 1:
            problem = f"{names.count(column)} columns {column} in {quoted(header)}"
            raise file.error(header_line, f"{problem}; one is required, as in '{','.join(COLUMNS)}'")
    columns = (*COLUMNS, COHERENCE) if COHERENCE in names else COLUMNS
    values = np.empty((len(rows), len(columns)))
    for row, (line_number, line) in enumerate(rows):
        cells = _cells(line)
        if len(cells) != len(names):
            raise file.error(line_number, f"{len(cells)} cells in {quoted(line)}; the header has {len(names)}")
        values[row] = [file.number(line_number, cells[names.index(column)]) for column in columns]
        frequency, magnitude = values[row, :2]
        before = values[row - 1, 0] if row else 0.0
        if frequency <= before:
            raise file.error(line_number, f"frequency_hz {frequency:g} is not allowed; > {before:g} Hz is required")
        if magnitude <= 0.0:
            raise file.error(line_number, f"magnitude {magnitude:g} is not allowed; > 0 is required")
        if len(columns) > len(COLUMNS) and not 0.0 <= values[row, 3] <= 1.0:
            raise file.error(line_number, f"coherence {values[row, 3]:g} is not allowed; >= 0 and <= 1 is required")
    frequency, magnitude, phase = values.T[:3]
    response = magnitude * np.exp(1j * np.radians(phase))
    return ResponseFile(2.0 * np.pi * frequency, response, values[:, 3] if len(columns) > len(COLUMNS) else None)


def _cells(line: str) -> list[str]:
    return [cell.strip(' \t"') for cell in line.split(",")]
