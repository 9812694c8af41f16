"""The numbers a run is judged by, computed once for results and report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.benchmark_criteria import BenchmarkCriteria, benchmark_criteria
from bmd_rths_core.analysis.metrics import RunMetrics, compare, reference_of
from bmd_rths_core.analysis.numerical_motion import ductility, numerical_motion
from bmd_rths_core.analysis.table_peaks import TablePeaks, table_peaks
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
        Absolute acceleration of every floor of the whole building [m/s²].
    metrics : RunMetrics
        Errors of Eq. 12.
    criteria : BenchmarkCriteria
        Those of the vRTHS benchmark.
    peaks : TablePeaks
        Largest motion of the table.
    ductility : tuple of float, optional
        Peak drift over yield drift of every numerical story; None when none can yield.
    """

    record: RunRecord
    config: Config
    reference: FloatArray
    metrics: RunMetrics
    criteria: BenchmarkCriteria
    peaks: TablePeaks
    ductility: tuple[float, ...] | None

    @property
    def told_criteria(self) -> dict[str, float | None]:
        """The criteria by ``J1``, ``J2`` and so on; of a run that a limit ended the delay J1 alone means anything."""
        known = self.criteria.by_symbol()
        return {symbol: value if self.record.stable or symbol == "J1" else None for symbol, value in known.items()}

    @property
    def lower(self) -> int:
        """Number of stories of the numerical substructure."""
        return len(self.config.numerical_substructure.masses)


def analysed(record: RunRecord) -> RunAnalysis:
    """Compare a run with the reference that its own configuration describes.

    Parameters
    ----------
    record : RunRecord
        The run; of any length, with any gaps.

    Raises
    ------
    InputError
        Its configuration is not one of this version.
    """
    config = config_from_mapping(record.configuration)
    lower = len(config.numerical_substructure.masses)
    reference = reference_of(record, config)
    yields = config.nonlinear.story_model != "linear"
    return RunAnalysis(
        record,
        config,
        reference,
        compare(record, reference, lower),
        benchmark_criteria(record, reference, lower),
        table_peaks(record),
        ductility(numerical_motion(record, config), config) if yields else None,
    )
