"""Adaptive time series (Chae, Kazemibidokhti and Ricles 2013, Earthquake Engng Struct. Dyn. 42, 1697-1715)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.adaptation import (
    AdaptiveShaper,
    Limits,
    Sample,
    adaptive_parameters,
    change_parameter,
    quiet_parameter,
    rate_parameter,
)
from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.parameters import check_parameters, parameter

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class AdaptiveTimeSeriesConfig:
    """Band, memory and bounds of the adaptation."""

    SECTION: ClassVar[str] = "ats"

    lower_frequency: float = adaptive_parameters("lower_frequency")
    upper_frequency: float = adaptive_parameters("upper_frequency")
    memory: float = parameter(
        2.0,
        description="Length of the window whose commands and accelerations the coefficients fit",
        unit="s",
        source="Chae et al. 2013: 1 s for displacements; accelerations have more noise",
        lower=0.01,
        upper=60.0,
    )
    quiet_acceleration: float = quiet_parameter()
    largest_change: float = change_parameter()
    largest_rate: float = rate_parameter()

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


class MovingLeastSquares:
    """The coefficients that fit the commands of the last seconds, A = (XᵀX)⁻¹ Xᵀ U (Chae et al. 2013).

    Parameters
    ----------
    steps : int
        Length of the window.
    quiet : float
        Motion in the window, root mean square, below which the coefficients stay [m/s²].
    """

    def __init__(self, steps: int, quiet: float) -> None:
        self._window = np.zeros((steps, 4))
        self._quiet = steps * quiet**2
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._window[:] = 0.0
        self._count = 0

    def wanted(self, sample: Sample, factors: FloatArray) -> FloatArray:
        """Return the fit, or the coefficients as they are where the window is quiet or not full.

        Parameters
        ----------
        sample : Sample
            What this step tells.
        factors : ndarray, shape (3,)
            Coefficients of this step, relative to those of the identified table.
        """
        window = self._window
        row = window[self._count % len(window)]
        row[:3], row[3] = sample
        self._count += 1
        if self._count < len(window):
            return factors
        products = window.T @ window
        if products[0, 0] <= self._quiet:
            return factors
        try:
            return np.asarray(np.linalg.solve(products[:3, :3], products[:3, 3]))
        except np.linalg.LinAlgError:  # one frequency only: nothing to tell three coefficients apart
            return factors


def make_adaptive_time_series(known: Known) -> AdaptiveShaper:
    """Return the adaptive time series, with the coefficients of the identified table to begin with."""
    settings: AdaptiveTimeSeriesConfig = known.settings
    rule = MovingLeastSquares(max(4, round(settings.memory / known.time_step)), settings.quiet_acceleration)
    band = settings.lower_frequency, settings.upper_frequency
    limits = Limits(*band, settings.largest_change, settings.largest_rate)
    return AdaptiveShaper(known, limits, "ats", rule)


COMPENSATORS = (
    Compensator(
        "ats",
        "Adaptive time series of second order: the inverse of the table, fitted to the last seconds",
        "The identified table, which has to lag, and its accelerometer; takes no preview",
        shaper=make_adaptive_time_series,
        settings=AdaptiveTimeSeriesConfig,
    ),
)
