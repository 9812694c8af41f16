"""Reader of JSON ground motions of the NHERI SimCenter."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.plausible_values import check_missing_marks
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import (
    UNITS_READ,
    listed,
    named_quantity,
    other_quantity,
    quoted,
    unit_factor,
)
from bmd_rths_core.ground_motion.motion import GroundMotion

#: How a file spells seconds.
TIME_UNITS = ("s", "sec", "secs", "second", "seconds")


def read_simcenter(path: str | Path, component: str, unit: str) -> GroundMotion:
    """Read a SimCenter JSON file: ``dT`` in s, and a list ``data_x``, ``data_y`` or ``data_z`` for each component.

    Where a key such as ``unit`` states the unit, it is used; without one it must be given. ``PGA_x`` and the like are
    not used: they can be those of other processing. (Files of github.com/NHERI-SimCenter/R2DExamples.)

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
    return file.head.startswith("{") and re.search(r'"data_[xyz]"\s*:', file.text) is not None


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
    unit = _unit(file, data)
    channels = []
    for key in keys:
        if not isinstance(data[key], list):
            raise InputError(f"{file.path}: {key} is no list; a list of numbers is required")
        values = np.array([_number(file, f"{key}[{i}]", value) for i, value in enumerate(data[key])])
        mark = check_missing_marks(values)
        if mark is not None:
            problem = f"{values[mark]:g} is a mark of a missing value: it does not fit the values beside it"
            raise InputError(f"{file.path}: {key}[{mark}]: {problem}")
        channels.append(Channel(key.removeprefix("data_"), time_step, values, unit))
    return channels


def _unit(file: RecordFile, data: dict[str, Any]) -> float | None:
    """Return the unit in m/s² that a key of the file states; None without one."""
    factors = {}
    for key, value in data.items():
        words = key.lower()
        if re.search(r"factor|scale|scaling", words) and value not in (1, 1.0, "1"):
            problem = f"a factor on the values, {key} {quoted(str(value))}; values in their unit itself are required"
            raise InputError(f"{file.path}: {problem}")
        says_quantity = "quantity" in words or words in ("type", "datatype", "data_type")
        if says_quantity and (quantity := named_quantity(str(value))):
            raise InputError(f"{file.path}: a {quantity}, by {key}; an acceleration is required")
        if "unit" not in words:
            continue
        if re.search(r"time|dt", words):
            if str(value).strip().lower() not in TIME_UNITS:
                raise InputError(f"{file.path}: {key} is {quoted(str(value))}; s is required")
            continue
        factor = unit_factor(value) if isinstance(value, str) else None
        if factor is None:
            known = other_quantity(value) if isinstance(value, str) else ""
            found = f"a {known}, by {key} {quoted(value)}" if known else f"{key} is {quoted(str(value))}"
            raise InputError(f"{file.path}: {found}; an acceleration in {UNITS_READ} is required")
        factors[key] = factor
    if len(set(factors.values())) > 1:
        raise InputError(f"{file.path}: {listed(list(factors))} state different units; one is required")
    return next(iter(factors.values()), None)


def _number(file: RecordFile, where: str, value: Any) -> float:
    try:
        number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{file.path}: {where} is {quoted(str(value))}; a finite number is required")
    return number


SIMCENTER = RecordFormat("SimCenter JSON", (".json",), _recognises, _channels)
