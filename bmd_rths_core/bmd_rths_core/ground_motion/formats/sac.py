"""Reader of binary SAC files, which seismologists keep one trace in."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.plausible_values import check_missing_marks
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import ONLY
from bmd_rths_core.ground_motion.motion import GroundMotion

_HEADER_BYTES = 632
# Words of 4 bytes in the header: step, version, points, kind of file, quantity, whether the steps are equal
_DELTA, _VERSION, _NPTS, _IFTYPE, _IDEP, _LEVEN = 0, 76, 79, 85, 86, 105
_TIME_SERIES = 1
_QUANTITIES = {6: "displacement", 7: "velocity"}
# Component name, 8 characters
_KCMPNM = 600


def read_sac(path: str | Path, unit: str) -> GroundMotion:
    """Read a binary SAC file of version 6 or 7: one trace at equal steps.

    The unit must be given: SAC has nm/s² in its manual and counts or m/s² in most files. (SAC User's Manual, IRIS.)

    Parameters
    ----------
    path : str or Path
        The file.
    unit : str
        Unit of the accelerations: ``"g"``, ``"m/s2"``, ``"cm/s2"`` or ``"gal"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it holds something else than accelerations at equal steps, or it is cut off.
    """
    return SAC.read(path, ONLY, unit)


def _order(content: bytes) -> str:
    """Return the byte order, "" for what is no SAC file."""
    if len(content) < _HEADER_BYTES:
        return ""
    return next((order for order in "<>" if struct.unpack_from(f"{order}i", content, 4 * _VERSION)[0] in (6, 7)), "")


def _recognises(file: RecordFile) -> bool:
    order = _order(file.content)
    if not order:
        return False
    (points,) = struct.unpack_from(f"{order}i", file.content, 4 * _NPTS)
    (kind,) = struct.unpack_from(f"{order}i", file.content, 4 * _IFTYPE)
    return bool(points > 0 and 0 <= kind < 100)


def _channels(file: RecordFile) -> list[Channel]:
    order = _order(file.content)
    if not order:
        raise InputError(f"{file.path}: not a binary SAC file of version 6 or 7")
    words = struct.unpack_from(f"{order}158i", file.content)
    (delta,) = struct.unpack_from(f"{order}f", file.content, 4 * _DELTA)
    points, quantity = words[_NPTS], words[_IDEP]
    if quantity in _QUANTITIES:
        raise InputError(f"{file.path}: a {_QUANTITIES[quantity]}, by its header (IDEP); an acceleration is required")
    if words[_IFTYPE] != _TIME_SERIES or words[_LEVEN] != 1:
        raise InputError(f"{file.path}: no time series at equal steps, by its header (IFTYPE, LEVEN)")
    required = _HEADER_BYTES + 4 * points
    behind = len(file.content) - required
    if points < 1 or behind not in (0, 22 * 8):  # version 7 has 22 numbers of double precision at its end
        raise InputError(f"{file.path}: {len(file.content)} bytes; {points} points need {required}")
    values = np.frombuffer(file.content, f"{order}f4", points, _HEADER_BYTES).astype(np.float64)
    mark = check_missing_marks(values)
    if mark is not None:
        raise InputError(f"{file.path}: point {mark + 1}: {values[mark]:g} is a mark of a missing value")
    name = file.content[_KCMPNM : _KCMPNM + 8].decode("ascii", "replace").strip(" \0")
    # A step of single precision: 0.005 is 0.004999999888.
    return [Channel("" if name.startswith("-12345") else name, float(f"{delta:.6g}"), values, None)]


SAC = RecordFormat("SAC", (".sac",), _recognises, _channels)
