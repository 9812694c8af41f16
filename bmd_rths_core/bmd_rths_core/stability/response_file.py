"""Reader of a measured frequency response: a CSV file with frequency, magnitude and phase."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import read_file
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.stability.loop_elements import MeasuredResponse

COLUMNS = ("frequency_hz", "magnitude", "phase_deg")


def read_frequency_response(path: str | Path) -> MeasuredResponse:
    """Read a measured frequency response, for example of the table with the specimen on it.

    Lines that begin with ``#`` are comments. The first other line names the columns ``frequency_hz``, ``magnitude``
    and ``phase_deg``, in any order; other columns are passed over.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    MeasuredResponse
        Achieved from commanded acceleration. A lag is a negative phase.

    Raises
    ------
    InputError
        The file cannot be read; a column is missing or named twice; a value is not a finite number; a magnitude is not
        positive; or the frequencies, two at least, do not rise from above 0.
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
    values = np.empty((len(rows), len(COLUMNS)))
    for row, (line_number, line) in enumerate(rows):
        cells = _cells(line)
        if len(cells) != len(names):
            raise file.error(line_number, f"{len(cells)} cells in {quoted(line)}; the header has {len(names)}")
        values[row] = [file.number(line_number, cells[names.index(column)]) for column in COLUMNS]
        frequency, magnitude, _ = values[row]
        before = values[row - 1, 0] if row else 0.0
        if frequency <= before:
            raise file.error(line_number, f"frequency_hz {frequency:g} is not allowed; > {before:g} Hz is required")
        if magnitude <= 0.0:
            raise file.error(line_number, f"magnitude {magnitude:g} is not allowed; > 0 is required")
    frequency, magnitude, phase = values.T
    return MeasuredResponse(2.0 * np.pi * frequency, magnitude * np.exp(1j * np.radians(phase)))


def _cells(line: str) -> list[str]:
    return [cell.strip(' \t"') for cell in line.split(",")]
