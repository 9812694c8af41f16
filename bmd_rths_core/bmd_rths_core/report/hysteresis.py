"""Force and drift of every story: of the numerical ones as computed, of the specimen from its accelerometers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.numerical_motion import NumericalMotion
from bmd_rths_core.report.whole_samples import filled
from bmd_rths_core.structure.nonlinear_building import nonlinear_building

FloatArray = NDArray[np.float64]

#: High-pass of the drifts of the specimen, as a share of the first frequency of the whole building.
HIGH_PASS_SHARE = 0.25

#: Periods of that frequency a run has to last.
_PERIODS = 3.0


@dataclass(frozen=True)
class StoryLoop:
    """Force against drift of one story.

    Parameters
    ----------
    name : str
        Which story.
    drift, force : ndarray, shape (N,)
        [m, N].
    stiffness : float
        Configured initial stiffness [N/m].
    yield_drift : float
        Drift at first yield [m]; 0 for a story that cannot yield.
    """

    name: str
    drift: FloatArray
    force: FloatArray
    stiffness: float
    yield_drift: float = 0.0


@dataclass(frozen=True)
class Hysteresis:
    """The loops of all stories.

    Parameters
    ----------
    stories : tuple of StoryLoop
        From the ground up.
    """

    stories: tuple[StoryLoop, ...]


def numerical_loops(motion: NumericalMotion, config: Config) -> Hysteresis:
    """Return the loops of the numerical stories: restoring force without damping.

    Parameters
    ----------
    motion : NumericalMotion
        The numerical substructure.
    config : Config
        Its configuration.
    """
    stiffnesses = config.numerical_substructure.stiffnesses
    yields = config.nonlinear.yield_drifts if config.nonlinear.story_model != "linear" else (0.0,) * len(stiffnesses)
    stories = zip(motion.drifts.T, motion.story_forces.T, stiffnesses, yields, strict=True)
    return Hysteresis(tuple(StoryLoop(f"numerical story {i}", *story) for i, story in enumerate(stories, 1)))


def specimen_loops(record: RunRecord, config: Config) -> Hysteresis:
    """Return the loops of the stories of the specimen.

    Parameters
    ----------
    record : RunRecord
        The run, with accelerometers on the table and every floor.
    config : Config
        Its configuration.

    Returns
    -------
    Hysteresis
        The shear of a story is −Σ mᵢ aᵢ of the floors above it with configured masses and measured accelerations, with
        the sign of a restoring force, and includes damping. The drift is the difference of the accelerations above and
        below, integrated twice behind a high-pass at `high_pass_frequency`: what is slower, and any permanent drift,
        cannot be seen.

    Raises
    ------
    InputError
        The run is too short for the high-pass.
    """
    corner = high_pass_frequency(config)
    needed = _PERIODS * 2.0 * np.pi / corner
    if record.steps * record.time_step < needed:
        raise InputError(
            f"a run of {record.steps * record.time_step:g} s is too short for drifts of the specimen; "
            f"{needed:.3g} s and more are required"
        )
    floors = np.column_stack([filled(signal) for signal in record.floor_accelerations.T])
    motions = np.column_stack((filled(record.table_acceleration), floors))
    relative = np.diff(motions, axis=1)
    forces = -np.cumsum((floors * config.specimen.masses)[:, ::-1], axis=1)[:, ::-1]
    drifts = [twice_integrated(signal, record.time_step, corner) for signal in relative.T]
    stories = zip(drifts, forces.T, config.specimen.stiffnesses, strict=True)
    return Hysteresis(tuple(StoryLoop(f"specimen story {i}", *story) for i, story in enumerate(stories, 1)))


def high_pass_frequency(config: Config) -> float:
    """Return the corner of the high-pass of the drifts of the specimen [rad/s].

    Parameters
    ----------
    config : Config
        `HIGH_PASS_SHARE` of the first elastic frequency of its whole building.
    """
    lower = nonlinear_building(config.numerical_substructure.building(), config.nonlinear)
    return HIGH_PASS_SHARE * float(lower.below(config.specimen.building()).elastic_modes().frequencies[0])


def twice_integrated(acceleration: FloatArray, time_step: float, corner: float) -> FloatArray:
    """Return the displacement that belongs to an acceleration, without what is slow.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        [m/s²], zero before its first and after its last sample.
    time_step : float
        Δt [s].
    corner : float
        Frequency ω_c at which half is left [rad/s].

    Returns
    -------
    ndarray, shape (N,)
        The spectrum times −ω² / (ω⁴ + ω_c⁴): a twofold integration where ω is well above ω_c, without any phase [m].
    """
    padded = 2 * len(acceleration)
    frequencies = 2.0 * np.pi * np.fft.rfftfreq(padded, time_step)
    weight = -(frequencies**2) / (frequencies**4 + corner**4)
    return np.asarray(np.fft.irfft(weight * np.fft.rfft(acceleration, padded), padded)[: len(acceleration)])
