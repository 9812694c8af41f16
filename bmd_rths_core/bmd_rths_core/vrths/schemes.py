"""Every compensator of the benchmark problem by its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.errors import InputError
from bmd_rths_core.vrths.lqg import adaptive_lqg, fixed_lqg
from bmd_rths_core.vrths.shaped import DELAY, shaped_names, shaped_tracker
from bmd_rths_core.vrths.trackers import Tracker, VelocityLead

#: Makes a tracker of a building case and a number of lanes.
MakeTracker = Callable[[int, int], Tracker]

#: What the command runs by default: nothing, a classical lead, and the best.
DEFAULT_SCHEMES = ("uc", "velocity_lead", "lqg_adaptive")


def _velocity_lead(case: int, lanes: int) -> Tracker:
    return VelocityLead(DELAY)


def _shaped(case: int, lanes: int, name: str) -> Tracker:
    return shaped_tracker(name, lanes)


def schemes() -> Mapping[str, MakeTracker]:
    """Return what tracks a displacement: the shapers of shake tables, then those of this problem."""
    shaped: dict[str, MakeTracker] = {name: partial(_shaped, name=name) for name in shaped_names()}
    return {**shaped, "velocity_lead": _velocity_lead, "lqg": fixed_lqg, "lqg_adaptive": adaptive_lqg}


def make_tracker(name: str, case: int, lanes: int) -> Tracker:
    """Return a compensator by its name.

    Parameters
    ----------
    name : str
        One of `schemes`.
    case : int
        Building.
    lanes : int
        Number of plants.

    Raises
    ------
    InputError
        There is none, or it tracks no displacement.
    """
    known = schemes()
    if name in known:
        return known[name](case, lanes)
    if name in compensators():
        return shaped_tracker(name, lanes)  # which says why not
    raise InputError(f"scheme {name!r}: unknown; one of {', '.join(known)} is required")
