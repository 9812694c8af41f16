"""The numbers a run is judged by, computed once for results and report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.benchmark_criteria import BenchmarkCriteria, benchmark_criteria
from bmd_rths_core.analysis.capture import UNKNOWN, captures, is_cheap
from bmd_rths_core.analysis.metrics import RunMetrics, compare, reference_of
from bmd_rths_core.analysis.numerical_motion import ductility, numerical_motion
from bmd_rths_core.analysis.quality import RunQuality, run_quality
from bmd_rths_core.analysis.table_peaks import TablePeaks, table_peaks, table_peaks_to_rest
from bmd_rths_core.analysis.true_building import true_references_of
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
    reference = reference_of(record, config)
    ground = np.nan_to_num(record.ground_acceleration)
    (true_reference,) = true_references_of([ground], config, [reference])
    wanted = record.outcome == "finished" and (is_cheap(config) if capture is None else capture)
    follows = captures(config, [ground])[0] if wanted else UNKNOWN
    yields = config.nonlinear.story_model != "linear"
    return RunAnalysis(
        record,
        config,
        reference,
        true_reference,
        compare(record, reference, lower),
        run_quality(record, config, true_reference, follows),
        benchmark_criteria(record, reference, lower),
        table_peaks(record),
        table_peaks_to_rest(record),
        ductility(numerical_motion(record, config), config) if yields else None,
    )
