"""Timing of a run on the wall clock, as the recorder saw it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StepTiming:
    """When the messages of the steps reached the recorder.

    Parameters
    ----------
    steps : ndarray, shape (N,)
        Indices of the steps whose desired acceleration and corrected shear both reached it.
    begun, closed : ndarray, shape (N,)
        When they did, from the first of them [s].
    time_step : float
        Δt, the deadline [s].
    missed_steps : tuple of int
        Steps that missed their deadline, as the numerical substructure counted.
    """

    steps: FloatArray
    begun: FloatArray
    closed: FloatArray
    time_step: float
    missed_steps: tuple[int, ...] = ()

    @property
    def closure_ms(self) -> FloatArray:
        """Time from the desired acceleration to the corrected shear, at the recorder [ms]."""
        return 1e3 * (self.closed - self.begun)

    @property
    def period_ms(self) -> FloatArray:
        """Time between the beginnings of neighbouring steps, at the recorder [ms]."""
        following = np.diff(self.steps) == 1
        return np.asarray(1e3 * np.diff(self.begun)[following])

    def closure_histogram(self, bins: int = 40) -> tuple[list[float], list[int], int]:
        """Count the steps by their closure.

        Parameters
        ----------
        bins : int
            Number of bins up to twice the deadline.

        Returns
        -------
        edges_ms : list of float
            Lower edges of the bins [ms].
        counts : list of int
            Steps in each.
        beyond : int
            Steps that took longer than twice the deadline.
        """
        closure, end = self.closure_ms, 2e3 * self.time_step
        counts, edges = np.histogram(np.clip(closure, 0.0, None), bins=bins, range=(0.0, end))
        return edges[:-1].tolist(), counts.tolist(), int(np.count_nonzero(closure > end))
