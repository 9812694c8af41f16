"""Parameters of older versions: what they are called now, and what their values are in the unit of today."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bmd_rths_core.errors import InputError

#: Counts of time steps that have become times. Another rate of the loop is then no other limit.
STEPS_TO_SECONDS = {
    "run.max_consecutive_misses": "run.longest_miss_time",
    "command_shaper.alpha": "command_shaper.lead_time",
    "safety.stale_shear_limit": "safety.stale_shear_time",
    "safety.stale_controller_limit": "safety.stale_controller_time",
    "safety.stuck_limit": "safety.stuck_time",
}


def refuse_renamed(mapping: Mapping[str, Any], default_time_step: float) -> None:
    """Raise one line when a configuration has a parameter under its old name.

    Parameters
    ----------
    mapping : Mapping
        Section name to parameter name to value, as a person gave it.
    default_time_step : float
        Δt where the configuration has none [s].

    Raises
    ------
    InputError
        With the new name, and the value in its unit.
    """
    for old, new, value in _found(mapping):
        converted = _in_seconds(value, _time_step(mapping, default_time_step))
        raise InputError(f"{old} is now {new}, in seconds" + (f"; {converted[1]}" if converted else ""))


def convert_renamed(mapping: Mapping[str, Any], default_time_step: float) -> tuple[dict[str, Any], list[str]]:
    """Return the configuration that a recording of an older version has, under the names of today.

    Parameters
    ----------
    mapping : Mapping
        Section name to parameter name to value, as recorded. Anything else in it is passed on as it is.
    default_time_step : float
        Δt where the configuration has none [s].

    Returns
    -------
    converted : dict
        The configuration.
    changes : list of str
        What was converted, one line each.

    Raises
    ------
    InputError
        An old parameter has a value that is no number, or stands beside its new one.
    """
    converted, changes = dict(mapping), []
    for old, new, value in _found(mapping):
        seconds = _in_seconds(value, _time_step(mapping, default_time_step))
        (section, _, old_key), new_key = old.partition("."), new.partition(".")[2]
        if seconds is None:
            raise InputError(f"{old}: {value!r} is not a number; a number of steps is required")
        if new_key in mapping[section]:
            raise InputError(f"{old}: stands beside {new}; only one of them is allowed")
        # The new parameter takes the place of the old one.
        converted[section] = {
            (new_key if key == old_key else key): (seconds[0] if key == old_key else entry)
            for key, entry in converted[section].items()
        }
        changes.append(f"{old} is now {new}; {seconds[1]}")
    return converted, changes


def _found(mapping: Mapping[str, Any]) -> list[tuple[str, str, Any]]:
    """Return old name, new name and value of each renamed parameter that is there."""
    found = []
    for old, new in STEPS_TO_SECONDS.items():
        section, _, key = old.partition(".")
        values = mapping.get(section)
        if isinstance(values, Mapping) and key in values:
            found.append((old, new, values[key]))
    return found


def _time_step(mapping: Mapping[str, Any], default: float) -> float:
    run = mapping.get("run")
    given: Any = run.get("time_step") if isinstance(run, Mapping) else None
    return float(given) if _is_number(given) and given > 0.0 else default


def _in_seconds(steps: Any, time_step: float) -> tuple[float, str] | None:
    """Return a number of steps in seconds, and how that is told."""
    if not _is_number(steps):
        return None
    seconds = float(f"{steps * time_step:.12g}")
    return seconds, f"{steps:.12g} steps of {time_step:.12g} s are {seconds:.12g} s"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
