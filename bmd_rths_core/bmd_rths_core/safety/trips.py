"""What happens when a limit is passed, and the record of it."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple


class Action(IntEnum):
    """What a passed limit does, the mildest first."""

    IGNORE = 0  # the limit is not looked at
    INDICATE = 1  # recorded, the test goes on
    HOLD = 2  # the table is braked and stays where it comes to rest
    RAMP = 3  # the table is braked and brought back to zero displacement
    EMERGENCY_STOP = 4  # no further command; the table controller stops the table by its own means


#: Names of the actions in the configuration. ("off" would be a flag in YAML.)
ACTION_NAMES = tuple(action.name.lower() for action in Action)

_WORDS = {
    Action.IGNORE: "",
    Action.INDICATE: "indicated",
    Action.HOLD: "hold",
    Action.RAMP: "ramp to rest",
    Action.EMERGENCY_STOP: "emergency stop",
}


class Trip(NamedTuple):
    """A limit that was passed.

    Parameters
    ----------
    limit : str
        Full name of the parameter.
    unit : str
        Unit of value and limit.
    quantity : str
        Which value passed it, in words.
    value : float
        The value.
    allowed : float
        The limit; NaN where only a finite value is allowed.
    step : int
        Step index: of the command that was not passed on, or of the measurement.
    action : Action
        What it does.
    """

    limit: str
    unit: str
    quantity: str
    value: float
    allowed: float
    step: int
    action: Action

    def __str__(self) -> str:
        """Return the story in one line."""
        what = _WORDS[self.action]
        if math.isnan(self.allowed):
            return f"{self.limit}: {self.quantity} at step {self.step} is {self.value}, not finite; {what}"
        return (
            f"{self.limit} [{self.unit}] passed at step {self.step}: "
            f"{self.quantity} {self.value:.6g}, allowed is {self.allowed:.6g}; {what}"
        )
