"""Timing of a run on the wall clock, by its messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StepTiming:
    """When the messages of the steps were sent, or, where a recording does not tell, when they reached the recorder.

    Parameters
    ----------
    steps : ndarray, shape (N,)
        Indices of the steps whose desired acceleration and corrected shear were both recorded.
    begun, closed : ndarray, shape (N,)
        When these two were, from the first of them [s].
    time_step : float
        Δt, the deadline [s].
    missed_steps : tuple of int
        Steps that missed their deadline, as the numerical substructure counted.
    hops_ms : Mapping of str to ndarray, shape (M,)
        For each message of a step in its order, named as its topic, the time since the one before [ms]. Empty
        where the nodes of the loop share a process: they send nothing before the step is over.
    """

    steps: FloatArray
    begun: FloatArray
    closed: FloatArray
    time_step: float
    missed_steps: tuple[int, ...] = ()
    hops_ms: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def chain_ms(self) -> FloatArray:
        """Time from the desired acceleration to the corrected shear of a step [ms]: closure, but for the last hop."""
        return 1e3 * (self.closed - self.begun)

    @property
    def period_ms(self) -> FloatArray:
        """Time between the beginnings of neighbouring steps [ms]."""
        following = np.diff(self.steps) == 1
        return np.asarray(1e3 * np.diff(self.begun)[following])
