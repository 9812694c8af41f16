"""Why a way to rest has ended before its end, in words."""

from __future__ import annotations

from bmd_rths_core.loop.states import Outcome
from bmd_rths_core.safety import Action, SafetySupervisor

#: What is told where the driver has left the rest of the way to the table controller.
GIVEN_UP = "commands came so late that no way led to rest; the table controller was asked to stop the table"


def early_end(supervisor: SafetySupervisor, late: float) -> tuple[Outcome, str] | None:
    """Return outcome and reason where the supervisor has ended a way to rest by itself; None where it led to rest.

    Parameters
    ----------
    supervisor : SafetySupervisor
        Has no further command for a table that moves.
    late : float
        How much longer than Δt the last command was held [s].
    """
    if supervisor.given_up:
        return Outcome.FAILED, GIVEN_UP
    if not supervisor.emergency:
        return None
    trip = next((trip for trip in supervisor.trips if trip.action is Action.EMERGENCY_STOP), None)
    if trip is not None:
        return Outcome.LIMIT, str(trip)
    told = f"the last command was held for {late:.3g} s too long; where it has led the table is not known"
    return Outcome.FAILED, told
