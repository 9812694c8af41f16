"""Metrics of a run against the reference: RMSE per floor (Eq. 12) and tracking delay of the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.missing_rows import EVERY_STEP
from bmd_rths_core.analysis.reference import nonlinear_reference_response, reference_responses
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.record import RunRecord
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.nonlinear_building import nonlinear_building

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RunMetrics:
    """What a run is judged by.

    Parameters
    ----------
    rmse_percent : dict of str to float
        Eq. 12 for ``substructure`` (the interface, as the numerical substructure computes it), ``control_layer`` (the
        lowest measured floor) and ``superstructure`` (the highest) [%]. NaN where nothing can be compared.
    floor_rmse_percent : tuple of float
        Eq. 12 for every measured floor from the table up [%].
    tracking_delay_ms : float
        Delay from the desired to the achieved table acceleration [ms].
    missing_values : int
        Values that were not recorded and are left out of the metrics.
    """

    rmse_percent: dict[str, float]
    floor_rmse_percent: tuple[float, ...]
    tracking_delay_ms: float
    missing_values: int

    def unknown(self) -> RunMetrics:
        """Return the same of a record that lacks too much for errors and delay to be worth giving."""
        nan = float("nan")
        floors = (nan,) * len(self.floor_rmse_percent)
        return RunMetrics(dict.fromkeys(self.rmse_percent, nan), floors, nan, self.missing_values)


def rmse_percent(reference: FloatArray, response: FloatArray) -> float:
    """Return the relative root-mean-square error of Eq. 12.

    Parameters
    ----------
    reference, response : ndarray, shape (N,)
        Response of the reference and of the run at the same times; samples where the run has NaN are left out.

    Returns
    -------
    float
        √(Σ (reference − response)² / Σ reference²) · 100 [%]; NaN when the reference is zero or nothing is left.
    """
    valid = np.isfinite(response)
    power = float(np.sum(reference[valid] ** 2))
    if power == 0.0:
        return float("nan")
    return 100.0 * float(np.sqrt(np.sum((reference[valid] - response[valid]) ** 2) / power))


def tracking_delay(desired: FloatArray, achieved: FloatArray, time_step: float, longest: float = 0.2) -> float:
    """Return the delay at which the achieved signal resembles the desired one most.

    The delay maximises the cross-correlation; a parabola through its three highest samples places the maximum between
    the steps.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        Signals sampled at the same times; NaN counts as zero.
    time_step : float
        Δt [s].
    longest : float
        Largest delay looked for [s].

    Returns
    -------
    float
        Delay of `achieved` behind `desired` [s]; NaN when one of them is zero or has less than three samples.
    """
    desired, achieved = np.nan_to_num(desired), np.nan_to_num(achieved)
    if len(desired) < 3 or not desired.any() or not achieved.any():
        return float("nan")
    lags = min(round(longest / time_step), len(desired) - 2)
    padded = 1 << (len(desired) + lags + 1).bit_length()  # the correlation by Fourier transform is circular
    circular = np.fft.irfft(np.fft.rfft(achieved, padded) * np.conj(np.fft.rfft(desired, padded)), padded)
    correlation = np.roll(circular, lags + 1)[: 2 * lags + 3]
    peak = int(np.argmax(correlation[1:-1])) + 1
    before, top, after = correlation[peak - 1 : peak + 2]
    curvature = before - 2.0 * top + after
    fraction = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float((peak - 1 - lags + fraction) * time_step)


def run_metrics(record: RunRecord) -> RunMetrics:
    """Compare a run with the reference that its own configuration describes.

    Parameters
    ----------
    record : RunRecord
        The run. The ground motion is the recorded one.

    Returns
    -------
    RunMetrics
        Sensors are compared at the end of the step they were read at.
    """
    config = config_from_mapping(record.configuration)
    return compare(record, reference_of(record, config), len(config.numerical_substructure.masses))


def compare(record: RunRecord, reference: FloatArray, lower: int) -> RunMetrics:
    """Compare a run with a reference.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building at the steps [m/s²].
    lower : int
        Stories of the numerical substructure.

    Returns
    -------
    RunMetrics
        Sensors are compared at the end of the step they were read at.
    """
    upper = reference.shape[1] - lower
    at_interface = rmse_percent(reference[:, lower - 1], record.desired_acceleration)
    measured = record.floor_accelerations
    if not measured.size:  # nothing was measured at all
        measured = np.full((record.steps, upper), np.nan)
    floors = tuple(rmse_percent(reference[1:, lower + i], measured[:-1, i]) for i in range(upper))
    delay = tracking_delay(record.desired_acceleration[1:], record.table_acceleration[:-1], record.time_step)
    missing = sum(int(np.isnan(signal).sum()) for name, signal in record.signals().items() if name in EVERY_STEP)
    return RunMetrics(
        rmse_percent={"substructure": at_interface, "control_layer": floors[0], "superstructure": floors[-1]},
        floor_rmse_percent=floors,
        tracking_delay_ms=1e3 * delay,
        missing_values=missing,
    )


def reference_of(record: RunRecord, config: Config) -> FloatArray:
    """Return the reference response to the ground motion of a run.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    config : Config
        Its configuration.

    Returns
    -------
    ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building at the steps [m/s²].

    Notes
    -----
    Ground acceleration that is missing is bridged by straight lines. With a feedback scale below 1 the loop is another
    building, whose upper part has that share of its mass, stiffness and damping; the reference is that building.
    """
    return references_of([filled(record.ground_acceleration)], config)[0]


def references_of(
    ground_accelerations: Sequence[FloatArray], config: Config, specimen: LinearBuilding | None = None
) -> list[FloatArray]:
    """Return the reference responses of a configuration to some ground motions.

    Parameters
    ----------
    ground_accelerations : sequence of ndarray, each of shape (N,)
        a_g at the steps [m/s²].
    config : Config
        The whole configuration.
    specimen : LinearBuilding, optional
        Upper part of the building; by default the nominal specimen.

    Returns
    -------
    list of ndarray, each of shape (N, n)
        As `reference_of` has it.
    """
    upper = (specimen or config.specimen.building()).scaled(config.force_correction.feedback_scale)
    if config.nonlinear.linear_chain or config.nonlinear.integration == "exact":
        whole = upper.stacked_on(config.elastic_substructure())
        return reference_responses(whole, ground_accelerations, config.run.time_step)
    building = nonlinear_building(config.numerical_substructure.building(), config.nonlinear).below(upper)
    return [nonlinear_reference_response(building, g, config.run.time_step) for g in ground_accelerations]
