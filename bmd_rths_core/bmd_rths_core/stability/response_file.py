"""A measured frequency response of the table as an element of the loop."""

from __future__ import annotations

from pathlib import Path

from bmd_rths_core.stability.loop_elements import MeasuredResponse
from bmd_rths_core.table.response_file import read_response


def read_frequency_response(path: str | Path) -> MeasuredResponse:
    """Read a measured frequency response, for example of the table with the specimen on it.

    Parameters
    ----------
    path : str or Path
        See `bmd_rths_core.table.response_file.read_response`.

    Returns
    -------
    MeasuredResponse
        Achieved from commanded acceleration. A lag is a negative phase.

    Raises
    ------
    InputError
        See there.
    """
    measured = read_response(path)
    return MeasuredResponse(measured.frequencies, measured.response)
