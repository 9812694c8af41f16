"""Reader of MATLAB files that hold arrays of time and acceleration."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import ONLY, Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

#: Largest deviation of a time from its place in equal steps, as a part of the time step; single precision needs it.
TIME_TOLERANCE = 1e-3


def read_mat(path: str | Path, unit: str, component: str = ONLY) -> GroundMotion:
    """Read a MATLAB file of version 5 to 7: a real array of time [s] and acceleration, 2 × N or N × 2.

    Each such array is a component with the name of the variable; other variables are passed over. The format states
    no unit. A file of version 7.3 is HDF5 and has to be saved with ``-v7``.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : str
        Unit of the accelerations: ``"g"``, ``"m/s2"``, ``"cm/s2"`` or ``"gal"``.
    component : str
        Name of the variable; ``"only"`` where there is one.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such variable, a number is not finite, or a time does not run from 0 in equal
        steps.
    """
    return MAT.read(path, component, unit)


def _recognises(file: RecordFile) -> bool:
    return re.match(rb"MATLAB [57]\.", file.content) is not None


def _channels(file: RecordFile) -> list[Channel]:
    if file.content.startswith(b"MATLAB 7.3"):
        raise InputError(f"{file.path}: a MATLAB file of version 7.3; version 7 is required: save it with '-v7'")
    if not _recognises(file):
        raise InputError(f"{file.path}: not a MATLAB file of version 5 to 7")
    import scipy.io  # takes 0.1 s, which every node and command would pay for at its start

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a variable that is there twice is a warning
            found = scipy.io.whosmat(io.BytesIO(file.content))
            names = [name for name, shape, kind in found if _holds_a_record(shape, kind)]
            variables = scipy.io.loadmat(io.BytesIO(file.content), variable_names=names) if names else {}
    except Exception as error:  # of a damaged file scipy raises what it happens to run into
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file.path}: a damaged MATLAB file: {problem}") from error
    if not names:
        there = ", ".join(f"{name} {'×'.join(map(str, shape))}" for name, shape, _ in found) or "none"
        raise InputError(f"{file.path}: no array of time and acceleration (2 × N or N × 2); variables: {quoted(there)}")
    return [_channel(file, name, variables.get(name)) for name in names]


def _holds_a_record(shape: tuple[int, ...], kind: str) -> bool:
    return kind in ("double", "single") and len(shape) == 2 and min(shape) == 2 and max(shape) > 2


def _channel(file: RecordFile, name: str, array: NDArray[np.float64] | None) -> Channel:
    where = f"{file.path}: variable {quoted(name)}"
    if array is None or not np.isrealobj(array):
        raise InputError(f"{where} is complex or cannot be read; a real array is required")
    time, values = (array if len(array) == 2 else array.T).astype(np.float64)
    bad = np.flatnonzero(~(np.isfinite(time) & np.isfinite(values)))
    if bad.size:
        raise InputError(
            f"{where}: point {bad[0] + 1} is {time[bad[0]]}, {values[bad[0]]}; finite numbers are required"
        )
    step = time[-1] / (time.size - 1)
    wrong = np.flatnonzero(~(np.abs(time - np.arange(time.size) * step) <= TIME_TOLERANCE * step))
    if wrong.size or step <= 0.0:
        point = int(wrong[0]) if wrong.size else 0
        raise InputError(f"{where}: time of point {point + 1} is {time[point]:g} s; equal steps from 0 are required")
    return Channel(name, float(step), values, None)


MAT = RecordFormat("MAT", (".mat",), _recognises, _channels)
