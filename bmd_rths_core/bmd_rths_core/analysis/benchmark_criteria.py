"""Evaluation criteria of the benchmark problem for virtual real-time hybrid simulation, for accelerations.

Silva, Gomez, Maghareh, Dyke and Spencer (2020), Benchmark control problem for real-time hybrid simulation, Mechanical
Systems and Signal Processing 135, 106381. There the quantities are displacements; the interface of a shake table is an
acceleration, so that here x is the desired acceleration of the interface and y the achieved one of the table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import rmse_percent, tracking_delay
from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class BenchmarkCriteria:
    """The criteria J₁ to J₃ of the tracking, and those of the responses of n floors.

    Parameters
    ----------
    tracking_delay_ms : float
        J₁ = arg max_τ Σ x(t − τ) y(t) [ms], positive when y is late; between the samples.
    tracking_error_percent : float
        J₂ = √(Σ (y − x)² / Σ x²) · 100 [%].
    peak_tracking_error_percent : float
        J₃ = max |y − x| / max |x| · 100 [%].
    response_error_percent : tuple of float
        J₄ to J₃₊ₙ = √(Σ (aᵢ − rᵢ)² / Σ rᵢ²) · 100 [%] of the interface and the measured floors from the table up, with
        the reference r. It is Eq. 12 of Chen et al. (2020).
    peak_response_error_percent : tuple of float
        J₄₊ₙ to J₃₊₂ₙ = max |aᵢ − rᵢ| / max |rᵢ| · 100 [%] of the same floors.
    """

    tracking_delay_ms: float
    tracking_error_percent: float
    peak_tracking_error_percent: float
    response_error_percent: tuple[float, ...]
    peak_response_error_percent: tuple[float, ...]

    def by_symbol(self) -> dict[str, float]:
        """Return the criteria by ``J1``, ``J2`` and so on."""
        values = (
            self.tracking_delay_ms,
            self.tracking_error_percent,
            self.peak_tracking_error_percent,
            *self.response_error_percent,
            *self.peak_response_error_percent,
        )
        return {f"J{i}": value for i, value in enumerate(values, 1)}

    def told(self, stable: bool) -> dict[str, float | None]:
        """Return the criteria by symbol; of a run that a limit ended the delay J₁ alone means anything.

        Parameters
        ----------
        stable : bool
            False for a run that a limit ended.
        """
        return {symbol: value if stable or symbol == "J1" else None for symbol, value in self.by_symbol().items()}


def peak_error_percent(reference: FloatArray, response: FloatArray) -> float:
    """Return the largest error over the largest reference, max |a − r| / max |r| · 100 [%].

    Parameters
    ----------
    reference, response : ndarray, shape (N,)
        r and a at the same times. Samples where one of them is NaN are left out.

    Returns
    -------
    float
        NaN when the reference is zero or nothing is left.
    """
    valid = np.isfinite(reference) & np.isfinite(response)
    largest = float(np.max(np.abs(reference[valid]), initial=0.0))
    if largest == 0.0:
        return float("nan")
    return 100.0 * float(np.max(np.abs(response[valid] - reference[valid]))) / largest


def benchmark_criteria(record: RunRecord, reference: FloatArray, lower: int) -> BenchmarkCriteria:
    """Return the criteria of a run.

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
    BenchmarkCriteria
        Sensors are compared at the end of the step they were read at. NaN where nothing can be compared.
    """
    desired, achieved = record.desired_acceleration[1:], record.table_acceleration[:-1]
    known = np.isfinite(desired)
    upper = reference.shape[1] - lower
    measured = record.floor_accelerations
    if not measured.size:  # nothing was measured at all
        measured = np.full((record.steps, upper), np.nan)
    pairs = [(reference[:, lower - 1], record.desired_acceleration)]
    pairs += [(reference[1:, lower + floor], measured[:-1, floor]) for floor in range(upper)]
    return BenchmarkCriteria(
        tracking_delay_ms=1e3 * tracking_delay(desired, achieved, record.time_step),
        tracking_error_percent=rmse_percent(desired[known], achieved[known]),
        peak_tracking_error_percent=peak_error_percent(desired, achieved),
        response_error_percent=tuple(rmse_percent(*pair) for pair in pairs),
        peak_response_error_percent=tuple(peak_error_percent(*pair) for pair in pairs),
    )
