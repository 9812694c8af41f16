"""What is known about the run on this ROS domain, from what its nodes tell, as plain values."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, RECORDER, ROLES, TABLE_DRIVER

#: Counts of a node that are not zero when messages did not arrive as they should.
COUNTS = ("lost", "out_of_order", "malformed")

_TEST_TEXTS = ("clock", "outcome", "waiting_for", "trip")
_TEST_COUNTS = ("step", "steps", "missed_deadlines", "max_consecutive_misses", "late_ticks")
_CLOSURE = {name: f"closure_ms_{name}" for name in ("p50", "p99", "max")}
_MOTIONS = ("displacement", "acceleration", "force")


def take_snapshot(
    statuses: Mapping[str, NodeStatus], silence: Mapping[str, float], there: Iterable[str]
) -> dict[str, Any]:
    """Return the state of a run.

    Parameters
    ----------
    statuses : Mapping of str to NodeStatus
        Latest status by role.
    silence : Mapping of str to float
        How long ago each was told [s].
    there : iterable of str
        Roles whose nodes are on the domain, whether they have told anything or not.

    Returns
    -------
    dict
        The object of ``bmd-rths monitor --json``. What is not known is None or left out.
    """
    there = set(there)
    return {
        "nodes": {
            role: _node(statuses.get(role), silence.get(role), role in there)
            for role in ROLES
            if role in there or role in statuses
        },
        "test": _test(statuses.get(NUMERICAL_SUBSTRUCTURE)),
        "table": _table(statuses.get(TABLE_DRIVER)),
        "recording": _recording(statuses.get(RECORDER)),
    }


def _node(told: NodeStatus | None, silence: float | None, there: bool) -> dict[str, Any]:
    if told is None:
        return {"state": None, "message": "has told nothing yet", "there": there}
    counts = {name: number(told.values.get(name)) for name in COUNTS}
    return {"state": told.state, "message": told.message, "there": there, "told_s_ago": silence, **counts}


def _test(told: NodeStatus | None) -> dict[str, Any] | None:
    if told is None or "step" not in told.values:
        return None
    values = told.values
    return {
        **{name: number(values.get(name)) for name in _TEST_COUNTS},
        **{name: values.get(name, "") for name in _TEST_TEXTS},
        "closure_ms": {name: number(values.get(key)) for name, key in _CLOSURE.items()},
        "stability_indicator": number(values.get("stability_indicator")),
    }


def _table(told: NodeStatus | None) -> dict[str, Any] | None:
    if told is None or "supervisor" not in told.values:
        return None
    values = told.values
    return {
        "controller": values.get("controller"),
        "table": values.get("table"),
        "supervisor": values["supervisor"],
        "trips": [trip for trip in values.get("trips", "").split(" | ") if trip],
        **{
            name: {
                "now": number(values.get(name)),
                "peak": number(values.get(f"peak_{name}")),
                "limit": number(values.get(f"{name}_limit")),
            }
            for name in _MOTIONS
        },
    }


def _recording(told: NodeStatus | None) -> dict[str, Any] | None:
    if told is None or not told.values.get("bag"):
        return None
    bag = told.values["bag"]
    return {"bag": bag, "messages": number(told.values.get("messages")), "bytes": _size(Path(bag))}


def _size(bag: Path) -> int | None:
    """Return the size of a bag on this machine, None when it is on another one."""
    sizes = [file.stat().st_size for file in bag.glob("*.mcap")]
    return sum(sizes) if sizes else None


def number(text: str | None) -> float | int | None:
    """Return a number; None for what is none, because a node of somebody else may tell anything.

    Parameters
    ----------
    text : str or None
        What was told.
    """
    try:
        value = float(text or "nan")
    except ValueError:
        return None
    if not math.isfinite(value):
        return None
    return int(value) if value.is_integer() else value


def numbers(text: str | None) -> list[int]:
    """Return a list of numbers; an empty one for what is none.

    Parameters
    ----------
    text : str or None
        What was told, as JSON.
    """
    try:
        found = json.loads(text or "[]")
    except ValueError:
        return []
    whole = isinstance(found, list) and all(type(value) is int and value >= 0 for value in found)
    return found if whole else []
