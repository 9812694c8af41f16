"""The motion of table and floors without the noise of the sensors: exact where it is simulated, else estimated."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.true_building import true_specimen
from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_calibration
from bmd_rths_core.record import RunRecord
from bmd_rths_core.stages.shear_estimator import steady_state_filter
from bmd_rths_core.table.models.sensors import noise_streams

FloatArray = NDArray[np.float64]


class CleanMotion(NamedTuple):
    """Accelerations at the end of the steps.

    Parameters
    ----------
    table : ndarray, shape (N,)
        Of the table [m/s²]; as measured where it is not simulated.
    floors : ndarray, shape (N, n)
        Of the floors of the specimen [m/s²].
    noise : float
        Root mean square of what was taken away of every accelerometer, or is assumed to be in it [m/s²].
    origin : str
        ``"simulated"`` or ``"estimated"``.
    """

    table: FloatArray
    floors: FloatArray
    noise: float
    origin: str


def clean_motion(record: RunRecord, config: Config) -> CleanMotion:
    """Return the accelerations of a run without noise.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    config : Config
        Its configuration.

    Returns
    -------
    CleanMotion
        Of a simulated table exact to rounding: the noise follows from the seed. Quantisation stays in. Of another table
        the floors are those of the Kalman filter of the section shear_estimator, with the identified specimen.
    """
    stories = len(config.specimen.masses)
    measured = record.floor_accelerations
    if not measured.size:
        measured = np.full((record.steps, stories), np.nan)
    as_simulated = config.table.controller == "simulated" and make_calibration(config).is_identity
    if as_simulated and measured.shape[1] == stories:
        sensors = config.simulated_table
        noise = noise_streams(config.run.seed)[0].standard_normal((record.steps, stories + 2))
        noise *= sensors.acceleration_noise
        total = float(np.hypot(sensors.acceleration_noise, sensors.acceleration_resolution / np.sqrt(12.0)))
        return CleanMotion(record.table_acceleration - noise[:, 0], measured - noise[:, 1:-1], total, "simulated")
    noise_level = config.identified_model.acceleration_noise
    floors = _estimated(record.table_acceleration, measured, config) if measured.shape[1] == stories else measured
    return CleanMotion(record.table_acceleration, floors, noise_level, "estimated")


def _estimated(table: FloatArray, floors: FloatArray, config: Config) -> FloatArray:
    """Filter the floors; a step whose sensors are not known is bridged by the model."""
    known = true_specimen(config)
    specimen = config.specimen.building() if known is None else known.building
    settings = dataclasses.replace(config.shear_estimator, sensor_noise=config.identified_model.acceleration_noise)
    steady = steady_state_filter(settings, specimen, config.run.time_step)
    state, before, estimate = np.zeros(len(steady.transition)), 0.0, np.empty_like(floors)
    for step, (base, measured) in enumerate(zip(table.tolist(), floors, strict=True)):
        now = base if np.isfinite(base) else before
        state = steady.transition @ state + steady.input_matrix @ (before, now)
        innovation = measured - steady.measurement @ state
        state += steady.gain @ np.where(np.isfinite(innovation), innovation, 0.0)
        estimate[step] = steady.measurement @ state
        before = now
    return estimate
