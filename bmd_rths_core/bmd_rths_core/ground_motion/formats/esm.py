"""Reader of ASCII files of the Engineering Strong-Motion database, Europe."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.ground_motion.formats.header import Header
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import named_quantity, quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

# "SAMPLING_INTERVAL_S: 0.005000"
_ENTRY = re.compile(r"\s*([A-Za-z][A-Za-z0-9_/^]*)\s*:(.*)")
# "BASELINE NOT REMOVED", "uncorrected", "none", "raw"
_NOT_CORRECTED = re.compile(r"\bnot\b|\buncorrected\b|\bunprocessed\b|^no(?:ne)?$|^raw\b", re.IGNORECASE)


def read_esm(path: str | Path) -> GroundMotion:
    """Read an ESM ASCII file (header DYNA 1.2): one component of acceleration, one value in a line.

    ITACA files have the same header. Nothing is corrected. (Luzi et al. 2016, Seismol. Res. Lett. 87(4); esm-db.eu.)

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it holds velocities or displacements, a line of the header or of the values is wrong,
        or there are more or fewer values than NDATA.
    """
    return ESM.read(path)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with("event_name:", "sampling_interval_s:")


def _channels(file: RecordFile) -> list[Channel]:
    header = Header(file, _ENTRY)
    line_number, kind = header.text("DATA_TYPE")
    if kind.upper() != "ACCELERATION":
        found = f"a {kind.lower()}, by " if named_quantity(kind) else ""
        raise file.error(line_number, f"{found}DATA_TYPE {quoted(kind)}; ACCELERATION is required")
    unit = header.unit("UNITS")
    values = np.array(file.numbers(header.first_line_behind))
    file.check_count(len(values), header.positive("NDATA"), "NDATA is")
    time_step = header.positive("SAMPLING_INTERVAL_S")
    return [Channel(header.text("STREAM")[1], time_step, values, unit, uncorrected=_uncorrected(header))]


def _uncorrected(header: Header) -> str:
    """Return where the header says that the record is not corrected, "" when it does not."""
    for key in ("BASELINE_CORRECTION", "PROCESSING", "DATA_TYPE"):
        line_number, text = header.entries.get(key, (0, ""))
        if _NOT_CORRECTED.search(text):
            return f"line {line_number}: {key} is {quoted(text)}"
    return ""


ESM = RecordFormat("ESM", (), _recognises, _channels)
