"""What is missing in a record, and what that may have changed in the numbers a run is judged by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.record import RunRecord

#: Signals that every step of a complete recording has; sensors a laboratory lacks are NaN by design.
EVERY_STEP = (
    "ground_acceleration",
    "desired_acceleration",
    "required_force",
    "command",
    "applied_command",
    "table_acceleration",
    "floor_accelerations",
    "interface_force",
    "corrected_force",
)

#: Errors are not given of a record in which one signal lacks more than this share of its steps (assumed).
LARGEST_SHARE = 0.1

#: The same gaps are made at so many other places, and what that changes at most is told.
PLACES = 8


@dataclass(frozen=True)
class MissingRows:
    """What is missing in a record.

    Parameters
    ----------
    share : float
        Largest share of the steps that a signal lacks. A signal that is not there at all was not measured.
    changes : Mapping of str to float
        By the name of a number, what the same gaps at other places of the record change in it at most; empty where
        nothing is missing, and where too much is.
    """

    share: float
    changes: Mapping[str, float]

    @property
    def too_many(self) -> bool:
        """True when the numbers are not worth giving."""
        return self.share > LARGEST_SHARE


#: Of a record whose errors are not given anyway.
NOTHING_TOLD = MissingRows(0.0, {})


def missing_rows(record: RunRecord, numbers: Callable[[RunRecord], Mapping[str, float]]) -> MissingRows:
    """Return what a record lacks and what that may have changed.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    numbers : callable
        Computes the numbers of a record, by name.

    Notes
    -----
    What was lost is not known, so that there is no bound without an assumption. This one is that other steps of the
    same record are alike: its gaps are made again at `PLACES` other places, evenly moved around, in addition to those
    that are there, and the numbers computed anew.
    """
    gaps = {name: gap for name in EVERY_STEP if (gap := _gap(getattr(record, name))).any()}
    share = max((float(gap.mean(axis=0).max()) for gap in gaps.values()), default=0.0)
    if not gaps or share > LARGEST_SHARE:
        return MissingRows(share, {})
    known = numbers(record)
    changes = dict.fromkeys(known, 0.0)
    for place in range(1, PLACES + 1):
        shift = place * record.steps // (PLACES + 1)
        moved: dict[str, Any] = {
            name: np.where(np.roll(gap, shift, axis=0), np.nan, getattr(record, name)) for name, gap in gaps.items()
        }
        for name, value in numbers(replace(record, **moved)).items():
            changes[name] = max(changes[name], abs(value - known[name]))
    return MissingRows(share, changes)


def _gap(signal: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where a signal is missing, nowhere in a column that has no value at all."""
    missing = np.isnan(signal)
    return missing & ~missing.all(axis=0)
