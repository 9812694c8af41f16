"""Reader of MATLAB files that hold arrays of time and acceleration."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.mat5 import DamagedMat, Variable, read_variables
from bmd_rths_core.ground_motion.formats.plausible_values import check_missing_marks
from bmd_rths_core.ground_motion.formats.record_file import MAX_BYTES, RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import ONLY
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

#: Largest deviation of a time from its place in equal steps, as a part of the time step; single precision needs it.
TIME_TOLERANCE = 1e-3

_TIME_STEPS = ("dt", "delta_t", "deltat", "time_step", "timestep")
_TIMES = ("t", "time")
# Names of a vector that is none of acceleration
_OTHERS = re.compile(r"vel|dis|disp|period|freq|sa$|psa|sv$|sd$", re.IGNORECASE)


def read_mat(path: str | Path, unit: str, component: str = ONLY) -> GroundMotion:
    """Read a MATLAB file of version 5 to 7.

    A real array of time [s] and acceleration, 2 × N or N × 2, is a component with the name of the variable. So is every
    real vector beside a scalar ``dt`` or a vector ``t`` or ``time`` of its length; without either the time step must be
    given. Other variables are passed over. The format states no unit. A file of version 7.3 is HDF5 and has to be
    saved with ``-v7``.

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
    try:
        variables = read_variables(file.content, MAX_BYTES)
    except DamagedMat as error:
        raise InputError(f"{file.path}: a damaged MATLAB file: {error}") from error
    passed = [variable.name for variable in variables if variable.kind == "object"]
    note = f"objects are passed over: {quoted(', '.join(passed))}" if passed else ""
    arrays = [variable for variable in variables if _holds_a_record(variable)]
    if arrays:
        return [_of_array(file, variable, note) for variable in arrays]
    channels = _of_vectors(file, variables, note)
    if not channels:
        there = ", ".join(f"{v.name} {'×'.join(map(str, v.shape))}" for v in variables) or "none"
        required = "no array of time and acceleration (2 × N or N × 2) and no vector"
        raise InputError(f"{file.path}: {required}; variables: {quoted(there)}")
    return channels


def _holds_a_record(variable: Variable) -> bool:
    shape = variable.shape
    return variable.kind in ("double", "single", "complex") and len(shape) == 2 and min(shape) == 2 and max(shape) > 2


def _of_array(file: RecordFile, variable: Variable, note: str) -> Channel:
    if variable.values is None:
        where = f"{file.path}: variable {quoted(variable.name)}"
        raise InputError(f"{where} is complex or cannot be read; a real array is required")
    time, values = variable.values if len(variable.values) == 2 else variable.values.T
    return _channel(file, variable.name, time, values, note)


def _of_vectors(file: RecordFile, variables: list[Variable], note: str) -> list[Channel]:
    """Return the vectors of acceleration, with the time step of a scalar or of a vector of time beside them."""
    vectors = {v.name: v.values.ravel() for v in variables if v.values is not None and _is_vector(v.shape)}
    scalars = {v.name: float(v.values.ravel()[0]) for v in variables if v.values is not None and v.values.size == 1}
    times = [name for name in vectors if name.lower() in _TIMES]
    steps = [name for name in scalars if name.lower() in _TIME_STEPS]
    channels = []
    for name, values in vectors.items():
        if name in times:
            continue
        if _OTHERS.match(name):
            raise InputError(
                f"{file.path}: variable {quoted(name)} may be no acceleration; only accelerations are read"
            )
        if len(times) == 1 and len(vectors[times[0]]) == len(values) and not steps:
            channels.append(_channel(file, name, vectors[times[0]], values, note))
            continue
        if len(steps) > 1:
            raise InputError(f"{file.path}: {quoted(', '.join(steps))} are all time steps; one is required")
        step = scalars[steps[0]] if steps else None
        _check_values(file, name, values)
        channels.append(Channel(name, step, values, None, note=note))
    return channels


def _is_vector(shape: tuple[int, ...]) -> bool:
    return len(shape) == 2 and min(shape) == 1 and max(shape) > 1


def _channel(file: RecordFile, name: str, time: NDArray[np.float64], values: NDArray[np.float64], note: str) -> Channel:
    where = f"{file.path}: variable {quoted(name)}"
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
    _check_values(file, name, values)
    return Channel(name, float(step), values, None, note=note)


def _check_values(file: RecordFile, name: str, values: NDArray[np.float64]) -> None:
    mark = check_missing_marks(values)
    if mark is not None:
        problem = f"{values[mark]:g} is a mark of a missing value: it does not fit the values beside it"
        raise InputError(f"{file.path}: variable {quoted(name)}: point {mark + 1}: {problem}")


MAT = RecordFormat("MAT", (".mat",), _recognises, _channels)
