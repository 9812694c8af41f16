"""The numbers a run is judged by, computed once for results and report."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.benchmark_criteria import BenchmarkCriteria, benchmark_criteria
from bmd_rths_core.analysis.capture import UNKNOWN, captures, is_cheap
from bmd_rths_core.analysis.metrics import RunMetrics, compare, reference_of
from bmd_rths_core.analysis.missing_rows import NOTHING_TOLD, MissingRows, missing_rows
from bmd_rths_core.analysis.numerical_motion import ductility, numerical_motion
from bmd_rths_core.analysis.quality import RunQuality, run_quality
from bmd_rths_core.analysis.table_peaks import TablePeaks, table_peaks, table_peaks_to_rest
from bmd_rths_core.analysis.true_building import true_references_of
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RunAnalysis:
    """A run, its reference and its errors.

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    config : Config
        Its configuration.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building, with the nominal specimen [m/s²].
    true_reference : ndarray, shape (N, n)
        The same with the true specimen [m/s²]; NaN where it is not known.
    metrics : RunMetrics
        Errors of Eq. 12, against the nominal building.
    quality : RunQuality
        Errors against the true building, capture, tracking and verdict.
    criteria : BenchmarkCriteria
        Those of the vRTHS benchmark.
    peaks : TablePeaks
        Largest motion of the table in the test.
    peaks_to_rest : TablePeaks
        The same with the way to rest, where that was recorded.
    ductility : tuple of float, optional
        Peak drift over yield drift of every numerical story; None when none can yield.
    gaps : MissingRows
        What is missing in the record, and what that may have changed.
    """

    record: RunRecord
    config: Config
    reference: FloatArray
    true_reference: FloatArray
    metrics: RunMetrics
    quality: RunQuality
    criteria: BenchmarkCriteria
    peaks: TablePeaks
    peaks_to_rest: TablePeaks
    ductility: tuple[float, ...] | None
    gaps: MissingRows

    @property
    def told_criteria(self) -> dict[str, float | None]:
        """The criteria by ``J1``, ``J2`` and so on; of a run that a limit ended the delay J1 alone means anything."""
        return self.criteria.told(self.record.stable)

    @property
    def lower(self) -> int:
        """Number of stories of the numerical substructure."""
        return len(self.config.numerical_substructure.masses)


def analysed(record: RunRecord, capture: bool | None = None) -> RunAnalysis:
    """Compare a run with the reference that its own configuration describes.

    Parameters
    ----------
    record : RunRecord
        The run; of any length, with any gaps.
    capture : bool, optional
        Compute the capture, by two more runs of the simulated table; by default where the matrices of the loop give it
        in a fraction of a second. Only of a run that came to its end.

    Raises
    ------
    InputError
        Its configuration is not one of this version.
    """
    config = config_from_mapping(record.configuration)
    lower = len(config.numerical_substructure.masses)
    # The simulated table and its noise are known, but not those of whatever else moved the table.
    known = config.changed(table__controller=record.controller)
    reference = reference_of(record, config)
    ground = filled(record.ground_acceleration)
    (true_reference,) = true_references_of([ground], known, [reference])
    gaps = missing_rows(record, lambda with_gaps: _numbers(with_gaps, known)) if record.stable else NOTHING_TOLD
    metrics, judged = compare(record, reference, lower), record
    if gaps.too_many:
        metrics, true_reference = metrics.unknown(), np.full_like(true_reference, np.nan)
        judged = replace(record, table_acceleration=np.full(record.steps, np.nan))
    wanted = record.outcome == "finished" and (is_cheap(known) if capture is None else capture)
    follows = captures(known, [ground])[0] if wanted else UNKNOWN
    yields = config.nonlinear.story_model != "linear"
    return RunAnalysis(
        record,
        config,
        reference,
        true_reference,
        metrics,
        run_quality(judged, known, true_reference, follows),
        benchmark_criteria(record, reference, lower),
        table_peaks(record),
        table_peaks_to_rest(record),
        ductility(numerical_motion(record, config), config) if yields else None,
        gaps,
    )


def _numbers(record: RunRecord, config: Config) -> dict[str, float]:
    """Return the numbers that gaps in a record change, by the names they are told under."""
    reference = reference_of(record, config)
    (true,) = true_references_of([filled(record.ground_acceleration)], config, [reference])
    metrics = compare(record, reference, len(config.numerical_substructure.masses))
    quality = run_quality(record, config, true)
    errors = {"rmse_percent": metrics.rmse_percent, "rmse_true_percent": quality.rmse_true_percent}
    return {
        **{f"{name}.{place}": error for name, by_place in errors.items() for place, error in by_place.items()},
        "tracking_delay_ms": metrics.tracking_delay_ms,
        "tracking_error_percent": quality.tracking.error_percent,
        "delay_ms": quality.tracking.delay_ms,
    }
