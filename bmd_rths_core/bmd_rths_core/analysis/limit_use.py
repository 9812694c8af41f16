"""How near a run is to each of its limits, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.live_signals import GrowingColumns
from bmd_rths_core.integration.linear_simulation import running_mean
from bmd_rths_core.safety.config import SafetyConfig

FloatArray = NDArray[np.float64]


class WatchedLimit(NamedTuple):
    """One limit of the supervisor that can be followed with what is recorded at every step.

    Parameters
    ----------
    name : str
        Name of the limit in the section `safety`, without ``_limit``.
    words : str
        What it limits.
    unit : str
        SI unit.
    """

    name: str
    words: str
    unit: str


#: Limits that are followed; the stability indicator is told by the numerical substructure instead.
WATCHED = (
    WatchedLimit("displacement", "displacement", "m"),
    WatchedLimit("velocity", "velocity", "m/s"),
    WatchedLimit("acceleration", "command", "m/s²"),
    WatchedLimit("increment", "change of command", "m/s²"),
    WatchedLimit("tracking", "tracking error", "m/s²"),
    WatchedLimit("force", "actuator force", "N"),
)


class LimitUse(NamedTuple):
    """How much of a limit is used.

    Parameters
    ----------
    limit : float
        The limit.
    now : float
        Largest absolute value within the last moments; NaN when nothing was recorded.
    peak : float
        Largest absolute value so far.
    """

    limit: float
    now: float
    peak: float


class LimitWatch:
    """Follow the quantities that are limited.

    Displacement, velocity (central difference over two steps) and force are those of the sensors of the table, as
    `table_peaks` has them; increment and tracking error are those of `supervised_peaks`, the command is that of the
    command shaper. A value that was not recorded is left out.

    Parameters
    ----------
    safety : SafetyConfig
        Limits, and the time constant of the tracking error.
    time_step : float
        Δt [s].
    """

    def __init__(self, safety: SafetyConfig, time_step: float) -> None:
        self._limits = {watched.name: float(getattr(safety, f"{watched.name}_limit")) for watched in WATCHED}
        self._time_step = time_step
        self._mean = running_mean(time_step, safety.tracking_time, 1)
        self._columns = GrowingColumns()
        self._done = 0

    def advance(self, signals: Mapping[str, FloatArray], steps: int) -> None:
        """Follow the steps that are complete by now.

        Parameters
        ----------
        signals : Mapping of str to ndarray
            From the first step on, as `RunRecord.signals` has them.
        steps : int
            Number of steps that are complete.
        """
        begin = self._done
        if steps <= begin:
            return
        part = slice(begin, steps)
        displacement, command = signals["table_displacement"], signals["command"]
        earlier = slice(max(begin - 1, 0), steps - 1)
        applied = signals["applied_command"][earlier]
        before = np.where(np.isfinite(applied), applied, command[earlier])
        if begin == 0:  # from rest
            before = np.append(0.0, before)
        # The velocity of a step needs the displacement of the one after it: that of the step before `begin` is due now.
        first = max(begin - 2, 0)
        velocity = (displacement[first + 2 : steps] - displacement[first : steps - 2]) / (2.0 * self._time_step)
        if len(velocity):
            self._columns.extend("velocity", first + 1, np.abs(velocity))
        self._columns.extend("displacement", begin, np.abs(displacement[part]))
        self._columns.extend("acceleration", begin, np.abs(command[part]))
        self._columns.extend("increment", begin, np.abs(command[part] - before))
        self._columns.extend("force", begin, np.abs(signals["actuator_force"][part]))
        self._columns.extend("tracking", begin, self._tracking(signals, part))
        self._done = steps

    def _tracking(self, signals: Mapping[str, FloatArray], part: slice) -> FloatArray:
        """Return the root of the running mean square; a step without both signals keeps the last mean."""
        error = signals["applied_command"][part] - signals["table_acceleration"][part]
        known = np.isfinite(error)
        found = np.full(len(error), np.nan)
        if known.any():
            found[known] = np.sqrt(self._mean.advance(error[known, None] ** 2)[0, 0])
        return found

    def use(self, steps: int, recent: float) -> dict[str, LimitUse]:
        """Return how much of each limit is used after some steps.

        Parameters
        ----------
        steps : int
            Number of steps that count.
        recent : float
            Length of the last moments [s].
        """
        last = max(1, round(recent / self._time_step))
        begin = max(0, steps - last)
        return {
            name: LimitUse(limit, _largest(self._columns[name][begin:steps]), _largest(self._columns[name][:steps]))
            for name, limit in self._limits.items()
        }


def _largest(values: FloatArray) -> float:
    return float(np.fmax.reduce(values, initial=np.nan))
