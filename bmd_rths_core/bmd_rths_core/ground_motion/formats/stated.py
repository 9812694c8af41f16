"""What a person says of a file of ground motion that does not say it itself."""

from __future__ import annotations

from dataclasses import dataclass

#: The component of a file that has only one.
ONLY = "only"

#: The unit of a file that states it.
FROM_FILE = "from_file"


@dataclass(frozen=True)
class Stated:
    """What a person says of a file.

    Parameters
    ----------
    component : str
        Name of the component wanted, `ONLY` for a file with one.
    unit : str
        Unit of a file that states none, `FROM_FILE` for all others.
    time_step : float
        Time step of a file that states none [s], 0 for all others.
    columns : str
        What the columns of a file of numbers are, with commas between, see `number_columns`; `FROM_FILE` for others.
    high_pass : bool
        The baseline is corrected afterwards, so that a record whose baseline is not may be read.
    """

    component: str = ONLY
    unit: str = FROM_FILE
    time_step: float = 0.0
    columns: str = FROM_FILE
    high_pass: bool = False
