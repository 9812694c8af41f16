"""What the supervisor does, and how severe it is."""

from __future__ import annotations

from enum import Enum

from bmd_rths_core.safety.trips import Action


class State(Enum):
    """What the supervisor does, the mildest first."""

    NORMAL = "normal"  # commands are passed on
    INDICATING = "indicating"  # so they are, but a limit was passed that is only indicated
    HOLDING = "holding"  # the table is braked, and then stays where it is
    RAMPING = "ramping"  # the table is on its way to rest at zero displacement
    STOPPED = "stopped"  # nothing is passed on


#: What each action makes the supervisor do.
STATE_OF = dict(zip(Action, State, strict=True))

SEVERITY = {state: severity for severity, state in enumerate(State)}
