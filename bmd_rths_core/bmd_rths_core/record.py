"""Everything that is known about one run, whether it was simulated or read from a bag."""

from __future__ import annotations

import functools
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.rest_record import REST_SIGNALS, RestRecord
from bmd_rths_core.signals import SIGNALS
from bmd_rths_core.version import __version__

FloatArray = NDArray[np.float64]

#: How a run can end. "cut" is a recording without an end: the recorder was killed.
OUTCOMES = ("finished", "stopped", "limit", "failed", "cut")

#: Largest share of late steps of a run that kept its time. A miss holds the shear for one more Δt, so that a share p
#: lengthens the mean delay of the feedback by p·Δt. A delay τ is a negative damping k·τ (Horiuchi et al. 1999,
#: Earthquake Engng Struct. Dyn. 28, 1121-1141): up to here that of the delay of one Δt, which the loop has anyway,
#: grows by 1 %.
LARGEST_LATE_SHARE = 0.01


@dataclass(frozen=True)
class TimingStatistics:
    """Deadlines and closure times of a run against the wall clock.

    Parameters
    ----------
    missed_deadlines : int
        Steps whose shear had not arrived at the next tick.
    max_consecutive_misses : int
        Longest run of misses in a row.
    missed_steps : tuple of int
        Indices of the steps that missed.
    late_ticks : int
        Ticks that came more than half a time step late, so that the schedule was moved.
    closure_ms : Mapping of str to float
        ``p50``, ``p99`` and ``max`` of the time from the publication of the desired acceleration to the arrival of
        the corrected shear of the same step [ms].
    closure_counts : tuple of int
        How many of these times fell into each of so many equal parts of the time step; empty where it is not known.
    slow_integrations : int
        Integrations of a numerical substructure with sub-steps that took more than 60 % of theirs.
    """

    missed_deadlines: int
    max_consecutive_misses: int
    missed_steps: tuple[int, ...]
    late_ticks: int
    closure_ms: Mapping[str, float]
    closure_counts: tuple[int, ...] = ()
    slow_integrations: int = 0


@dataclass(frozen=True)
class RunRecord:
    """One run: the signals of every step and the story around them.

    Row k of every signal belongs to step k; `signals.SIGNALS` describes each. Signals of the controller belong to test
    time ``k·Δt``, sensors are read at the end of the step, at ``(k + 1)·Δt`` (see `sensor_time`). A value that was not
    measured or not recorded is NaN.

    Parameters
    ----------
    time_step : float
        Δt [s].
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²].
    desired_acceleration : ndarray, shape (N,)
        Absolute interface acceleration of the numerical substructure [m/s²].
    required_force : ndarray, shape (N,)
        Left side of Eq. 4 at the interface, m(ü+ü_g) + c u̇ + k u [N].
    command : ndarray, shape (N,)
        Acceleration command of the command shaper [m/s²].
    applied_command : ndarray, shape (N,)
        Acceleration command the table controller says it applied [m/s²].
    table_acceleration : ndarray, shape (N,)
        Measured absolute acceleration of the table [m/s²].
    table_displacement : ndarray, shape (N,)
        Measured displacement of the table [m].
    actuator_force : ndarray, shape (N,)
        Measured force of the actuator [N].
    base_shear : ndarray, shape (N,)
        Interface shear from load cells [N].
    floor_accelerations : ndarray, shape (N, n)
        Measured absolute acceleration of the floors of the experimental substructure [m/s²].
    interface_force : ndarray, shape (N,)
        Estimated interface shear f = −Σ mᵢ aᵢ [N].
    corrected_force : ndarray, shape (N,)
        Shear fed back to the numerical substructure [N].
    configuration : Mapping
        Resolved configuration, as nested plain values.
    motion : Mapping
        ``name``, ``sha256`` and ``source`` of the ground motion.
    versions : Mapping
        Versions of this project, its libraries, Python and ROS.
    outcome : str
        One of `OUTCOMES`.
    reason : str
        Sentence that says why the run ended.
    timing : TimingStatistics, optional
        None for a run in process, and when a recording has no end.
    told_controller : str, optional
        Controller of the table as its driver told it, empty when it told none: a driver of somebody else. None where
        nobody was asked: a run in process, and a recording without an end.
    source : str
        ``"in process"`` or the path of the bag.
    way_to_rest : RestRecord, optional
        What followed the last step. None where there was nothing: the controller stopped the table, or nobody recorded
        it, as in older bags.
    namespace : str
        Where the topics of a bag stand, for example ``"/rths"``; empty for a run in process.
    """

    time_step: float
    ground_acceleration: FloatArray
    desired_acceleration: FloatArray
    required_force: FloatArray
    command: FloatArray
    applied_command: FloatArray
    table_acceleration: FloatArray
    table_displacement: FloatArray
    actuator_force: FloatArray
    base_shear: FloatArray
    floor_accelerations: FloatArray
    interface_force: FloatArray
    corrected_force: FloatArray
    configuration: Mapping[str, Any]
    motion: Mapping[str, Any]
    versions: Mapping[str, str] = field(default_factory=dict)
    outcome: str = "finished"
    reason: str = ""
    timing: TimingStatistics | None = None
    told_controller: str | None = None
    source: str = "in process"
    way_to_rest: RestRecord | None = None
    namespace: str = ""

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return len(self.desired_acceleration)

    @property
    def time(self) -> FloatArray:
        """Test time of the controller's signals [s], shape (N,)."""
        return self.time_step * np.arange(self.steps, dtype=np.float64)

    @property
    def sensor_time(self) -> FloatArray:
        """Test time of the sensors [s], shape (N,): the end of each step."""
        return self.time_step * np.arange(1, self.steps + 1, dtype=np.float64)

    @property
    def stable(self) -> bool:
        """True when no limit was passed in what was recorded."""
        return self.outcome != "limit"

    @property
    def stability(self) -> str:
        """What the run says about its loop: stable, unstable, limit (another one was passed), failed, or no data."""
        if not np.isfinite(self.desired_acceleration).any():
            return "no data"
        if self.outcome == "limit":
            return "unstable" if "safety.stability_limit" in self.reason else "limit"
        return "failed" if self.outcome == "failed" else "stable"

    @property
    def late_share(self) -> float | None:
        """Share of steps that missed their deadline, or began late if those are more; None when no clock was kept."""
        if self.timing is None or not self.steps:
            return None
        return max(self.timing.missed_deadlines, self.timing.late_ticks) / self.steps

    @property
    def kept_time(self) -> bool | None:
        """True when the run kept real time (`LARGEST_LATE_SHARE`); None when no clock was kept."""
        return None if self.late_share is None else self.late_share <= LARGEST_LATE_SHARE

    @property
    def controller(self) -> str:
        """Controller of the table: as its driver told it, or else as it is configured; of a cut recording unknown."""
        if self.told_controller is None:
            if self.outcome == "cut":
                return "unknown"
            return str(self.configuration["table"]["controller"])
        return self.told_controller or "unknown"

    def signals(self) -> dict[str, FloatArray]:
        """Return every recorded signal by name."""
        return {signal.name: getattr(self, signal.name) for signal in SIGNALS}

    def continued(self, name: str) -> FloatArray:
        """Return a signal of the table with the way to rest behind it: row k belongs to step k.

        Parameters
        ----------
        name : str
            One of `rest_record.REST_SIGNALS`.

        Returns
        -------
        ndarray, shape (N + M,) or less
            Of a step that both have, the command that the supervisor refused say, the way to rest is what happened.
        """
        if name not in REST_SIGNALS:
            raise ValueError(f"{name!r} is no signal of the way to rest; one of {', '.join(REST_SIGNALS)} is required")
        values: FloatArray = getattr(self, name)
        rest = self.way_to_rest
        if rest is None:
            return values
        whole = np.full((max(self.steps, rest.first_step + rest.steps), *values.shape[1:]), np.nan)
        whole[: self.steps] = values
        whole[rest.first_step : rest.first_step + rest.steps] = getattr(rest, name)
        return whole

    def same_signals(self, other: RunRecord) -> bool:
        """Tell whether every signal equals that of another record bit for bit (a NaN equals a NaN).

        Parameters
        ----------
        other : RunRecord
            The other record, of any length.
        """
        mine, theirs = self.signals(), other.signals()
        return all(np.array_equal(mine[name], theirs[name], equal_nan=True) for name in mine)


def empty_signals(steps: int, floors: int) -> dict[str, FloatArray]:
    """Return the signals of a `RunRecord` with nothing recorded yet.

    Parameters
    ----------
    steps : int
        Number of steps N.
    floors : int
        Number of measured floors n.

    Returns
    -------
    dict of str to ndarray
        NaN everywhere, shape (N,), and (N, n) for ``floor_accelerations``.
    """
    return {signal.name: np.full((steps, floors) if signal.per_floor else steps, np.nan) for signal in SIGNALS}


def provenance(configuration: Mapping[str, Any], motion: GroundMotion) -> dict[str, Any]:
    """Return the fields of a `RunRecord` that say where its numbers come from.

    Parameters
    ----------
    configuration : Mapping
        Resolved configuration, as nested plain values.
    motion : GroundMotion
        The ground motion of the run.

    Returns
    -------
    dict
        ``configuration``, ``motion`` and ``versions``.
    """
    return {
        "configuration": configuration,
        "motion": {"name": motion.name, "sha256": motion.sha256, "source": motion.source},
        "versions": dict(software_versions()),
    }


@functools.cache
def software_versions() -> Mapping[str, str]:
    """Return the versions of this project and what it computes with; to look them up takes longer than many a run."""
    return {
        "bmd_rths": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "filterpy")},
    }
