"""What a fault of the campaign came to, and what has to hold after every fault."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from bmd_rths_core.config import Config
from bmd_rths_core.table.emulated.true_motion import TrueMotion

#: Velocity below which a table that its controller has let go counts as standing [m/s].
STANDING = 2e-3

#: Longest time from the end of a test to rest [s]: a ramp of the supervisor from within its default limits takes 2.8 s,
#: the return of the virtual controller, should it have to follow, 10 / ω = 1.7 s, and its watchdog waits before.
RAMP_TIME = 5.0


class Outcome(NamedTuple):
    """A fault and what it came to.

    Parameters
    ----------
    kind : str
        Kind of the fault.
    fault : str
        The fault, in words.
    ended : str
        How the test ended.
    reason : str
        Why, as it was told.
    wrong : tuple of str
        What should have held and did not; empty when all is well.
    peaks : TrueMotion
        Largest true motion of the table.
    rest_time : float
        From the end of the test until the table was at rest [s]; NaN where it was not taken.
    """

    kind: str
    fault: str
    ended: str
    reason: str
    wrong: tuple[str, ...]
    peaks: TrueMotion
    rest_time: float = math.nan

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        rest_time = None if math.isnan(self.rest_time) else round(self.rest_time, 3)
        return {**self._asdict(), "wrong": list(self.wrong), "peaks": self.peaks._asdict(), "rest_time": rest_time}


def wrong_motion(config: Config, motion: TrueMotion, peaks: TrueMotion) -> list[str]:
    """Return what a table should not have done: passed a hard limit by more than a step, or not come to rest.

    Parameters
    ----------
    config : Config
        Configuration with the hard limits, those of the virtual controller.
    motion, peaks : TrueMotion
        Last motion of the table, and its peaks.
    """
    hard, step = config.virtual_controller, config.run.time_step
    allowed = {
        "displacement": hard.displacement_limit + step * peaks.velocity,
        "velocity": hard.velocity_limit + step * peaks.acceleration,
        "acceleration": hard.acceleration_limit + config.safety.increment_limit,
        "force": hard.force_limit + config.safety.increment_limit * config.servo_hydraulic.platen_mass,
    }
    wrong = [
        f"{name} reached {getattr(peaks, name):.4g}, allowed is {limit:.4g}"
        for name, limit in allowed.items()
        if not getattr(peaks, name) <= limit
    ]
    if not abs(motion.velocity) <= STANDING:
        wrong.append(f"not at rest: {motion.velocity:.3g} m/s")
    return wrong


def summary(outcomes: Iterable[Outcome]) -> dict[str, Mapping[str, int]]:
    """Return how often each kind of fault came to each end; "wrong" where something did not hold.

    Parameters
    ----------
    outcomes : iterable of Outcome
        The outcomes.
    """
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for outcome in outcomes:
        table[outcome.kind][outcome.ended] += 1
        table[outcome.kind]["wrong"] += bool(outcome.wrong)
    return table
