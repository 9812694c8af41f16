"""The quality of a run: errors against the true building, noise floor, capture, tracking, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.capture import UNKNOWN, Capture
from bmd_rths_core.analysis.clean_motion import CleanMotion, clean_motion
from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.tracking_quality import TrackingQuality, tracking_quality
from bmd_rths_core.analysis.true_building import true_specimen
from bmd_rths_core.analysis.verdict import Judgement, judge
from bmd_rths_core.config import Config
from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]

KEYS = ("substructure", "control_layer", "superstructure")


@dataclass(frozen=True)
class RunQuality:
    """Errors have the keys of `RunMetrics.rmse_percent`: interface, lowest and highest floor; NaN where not known.

    Parameters
    ----------
    specimen : str, optional
        Where the true specimen is known from: ``"simulated"`` or ``"identified"``; None where it is not known.
    clean : CleanMotion
        Table and floors without noise.
    rmse_true_percent : dict of str to float
        Eq. 12 against the building with the true specimen, floors as measured [%].
    rmse_clean_percent : dict of str to float
        The same of the floors without noise [%].
    noise_floor_percent : dict of str to float
        Noise of the sensor over the response of the true building [%]; the interface has none.
    excess_percent : dict of str to float
        What of the true error the noise does not explain, √(true² − floor²) [%].
    capture : Capture
        Share of a change of the specimen that the result follows.
    tracking : TrackingQuality
        How the table follows.
    judgement : Judgement
        The verdict.
    """

    specimen: str | None
    clean: CleanMotion
    rmse_true_percent: dict[str, float]
    rmse_clean_percent: dict[str, float]
    noise_floor_percent: dict[str, float]
    excess_percent: dict[str, float]
    capture: Capture
    tracking: TrackingQuality
    judgement: Judgement


def run_quality(record: RunRecord, config: Config, reference: FloatArray, capture: Capture = UNKNOWN) -> RunQuality:
    """Judge a run.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    config : Config
        Its configuration.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the true building [m/s²]; NaN where it is not known.
    capture : Capture
        Where it was computed.
    """
    lower = len(config.numerical_substructure.masses)
    clean = clean_motion(record, config)
    measured = record.floor_accelerations if record.floor_accelerations.size else np.full_like(clean.floors, np.nan)
    top = reference.shape[1] - lower - 1
    errors, cleaned, floors = {}, {}, {}
    for name, floor in zip(KEYS, (None, 0, top), strict=True):
        if floor is None:
            errors[name] = cleaned[name] = rmse_percent(reference[:, lower - 1], record.desired_acceleration)
            floors[name] = float("nan")
            continue
        true = reference[1:, lower + floor]
        errors[name], cleaned[name] = (rmse_percent(true, motion[:-1, floor]) for motion in (measured, clean.floors))
        floors[name] = rmse_percent(true, true + clean.noise)
    desired, achieved = record.desired_acceleration[1:], clean.table[:-1]
    left = clean.noise if clean.origin == "estimated" else 0.0
    tracking = tracking_quality(desired, achieved, record.time_step, left)
    known = true_specimen(config)
    return RunQuality(
        specimen=None if known is None else known.origin,
        clean=clean,
        rmse_true_percent=errors,
        rmse_clean_percent=cleaned,
        noise_floor_percent=floors,
        excess_percent={name: _excess(errors[name], floors[name]) for name in KEYS},
        capture=capture,
        tracking=tracking,
        judgement=judge(record, tracking.error_percent, tracking.delay_ms, capture, config.verdict),
    )


def told_quality(quality: RunQuality, stable: bool) -> dict[str, object]:
    """Return what is told about the quality of a run, as plain values.

    Parameters
    ----------
    quality : RunQuality
        Of the run.
    stable : bool
        No limit ended the run; otherwise its errors and its capture are None.
    """
    tracking = quality.tracking
    errors = ("rmse_true_percent", "rmse_clean_percent", "noise_floor_percent", "excess_percent")
    told: dict[str, object] = {name: getattr(quality, name) if stable else dict.fromkeys(KEYS) for name in errors}
    capture = quality.capture._asdict()
    return {
        **told,
        "true_specimen": quality.specimen,
        "clean_floors": quality.clean.origin,
        "capture": capture if stable else dict.fromkeys(capture),
        "tracking_error_percent": tracking.error_percent,
        "delay_ms": tracking.delay_ms,
        "amplitude": tracking.amplitude,
        "frequency_hz": tracking.frequency_hz,
        "tracking_indicator": tracking.indicator,
        "spectrum_out_percent": tracking.spectrum_out_percent,
        "peak_ratio": tracking.peak_ratio,
        "verdict": quality.judgement.verdict,
        "verdict_reasons": list(quality.judgement.reasons),
    }


def _excess(error: float, floor: float) -> float:
    return (
        float(np.sqrt(max(0.0, error**2 - (floor if np.isfinite(floor) else 0.0) ** 2)))
        if np.isfinite(error)
        else error
    )
