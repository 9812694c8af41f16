"""Reader of JSON ground motions of the NHERI SimCenter."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion


def read_simcenter(path: str | Path, component: str, unit: str) -> GroundMotion:
    """Read a SimCenter JSON file: ``dT`` in s, and a list ``data_x``, ``data_y`` or ``data_z`` for each component.

    The format states no unit. ``PGA_x`` and the like are not used: they can be those of other processing. (Files of
    github.com/NHERI-SimCenter/R2DExamples.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        ``"x"``, ``"y"`` or ``"z"``.
    unit : str
        Unit of the accelerations: ``"g"``, ``"m/s2"``, ``"cm/s2"`` or ``"gal"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read or is no JSON, it has no such component, or a number is missing or not finite.
    """
    return SIMCENTER.read(path, component, unit)


def _recognises(file: RecordFile) -> bool:
    return file.content.lstrip().startswith(b"{") and re.search(rb'"data_[xyz]"\s*:', file.content) is not None


def _channels(file: RecordFile) -> list[Channel]:
    try:
        data = json.loads("\n".join(file.lines))
    except json.JSONDecodeError as error:
        raise file.error(error.lineno, f"no JSON: {error.msg}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file.path}: no JSON that can be read: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{file.path}: a JSON {type(data).__name__}; an object with dT and data_x is required")
    keys = [key for key in ("data_x", "data_y", "data_z") if key in data]
    if not keys:
        raise InputError(f"{file.path}: no data_x, data_y or data_z; a list of numbers is required")
    if "dT" not in data:
        raise InputError(f"{file.path}: no dT; the time step in s is required")
    time_step = _number(file, "dT", data["dT"])
    channels = []
    for key in keys:
        if not isinstance(data[key], list):
            raise InputError(f"{file.path}: {key} is no list; a list of numbers is required")
        values = np.array([_number(file, f"{key}[{i}]", value) for i, value in enumerate(data[key])])
        channels.append(Channel(key.removeprefix("data_"), time_step, values, None))
    return channels


def _number(file: RecordFile, where: str, value: Any) -> float:
    try:
        number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{file.path}: {where} is {quoted(str(value))}; a finite number is required")
    return number


SIMCENTER = RecordFormat("SimCenter JSON", (".json",), _recognises, _channels)
