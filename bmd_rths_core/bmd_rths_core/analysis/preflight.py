"""Pre-flight: a whole test is predicted in process, and judged, before the table moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import FloatArray
from bmd_rths_core.safety import Action
from bmd_rths_core.safety.displacement_command import stroke_trips
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess


@dataclass(frozen=True)
class Peaks:
    """Largest absolute values of a predicted test.

    Parameters
    ----------
    displacement : float
        Of the simulated table [m].
    velocity : float
        Integral of the commands [m/s].
    acceleration : float
        Command [m/s²].
    force : float
        Actuator of the simulated table [N].
    stability_indicator : float
        [1].
    """

    displacement: float
    velocity: float
    acceleration: float
    force: float
    stability_indicator: float


@dataclass(frozen=True)
class Preflight:
    """What is to be expected of a test.

    Parameters
    ----------
    verdict : str
        Sentence that sums up the stability analyses.
    peaks : Peaks
        Of the prediction, which ends where it passes a limit.
    problems : tuple of str
        Why the test should not be run; empty when it may be.
    """

    verdict: str
    peaks: Peaks
    problems: tuple[str, ...]

    @property
    def cleared(self) -> bool:
        """True when nothing speaks against the test."""
        return not self.problems


def predict_test(config: Config, motion: GroundMotion, progress: Callable[[int], None] | None = None) -> Preflight:
    """Predict a test with the identified models, and judge it.

    Parameters
    ----------
    config : Config
        The whole configuration. The table is that of the section ``simulated_table``, whichever controller is chosen;
        noise and limits are those of the test.
    motion : GroundMotion
        Ground motion with one sample a step.
    progress : callable, optional
        Called with the number of predicted steps now and then.

    Returns
    -------
    Preflight
        There is a problem when the stability analyses say no-go or cannot be made, when a limit is passed whose action
        is more than to indicate, and when the commands would ask a displacement-controlled table for more than the
        limits of displacement and velocity.
    """
    stable, verdict = _judged(config)
    loop = RthsLoop(config.changed(table__controller="simulated"), motion)
    record = loop.run(progress)
    trips = [trip for trip in loop.supervisor.trips if trip.action > Action.INDICATE]
    commands, time_step = record.command, config.run.time_step
    trips = trips or stroke_trips(commands, config.safety, time_step)
    problems = [] if stable else [verdict]
    if trips:
        trip = trips[0]
        problems.append(f"the prediction passes a limit after {trip.step * time_step:.3f} s: {trip}")
    peaks = Peaks(
        displacement=_peak(record.table_displacement),
        velocity=_peak(time_step * np.cumsum(commands)),
        acceleration=_peak(commands),
        force=_peak(record.actuator_force),
        stability_indicator=loop.stability_indicator.largest,
    )
    return Preflight(verdict, peaks, tuple(problems))


def _judged(config: Config) -> tuple[bool, str]:
    """Return whether the loop is stable, and a sentence that says so."""
    try:
        assessment = assess(config, AnalysisOptions())
    except InputError as error:
        return False, f"stability cannot be judged: {error}"
    return assessment.go, assessment.verdict_text


def _peak(values: FloatArray) -> float:
    """Return the largest absolute value, without those that were not measured."""
    return float(np.fmax.reduce(np.abs(values), initial=0.0))
