"""Forces at the interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]

#: Length of the time in which curves that nearly agree can be told apart [s].
CLOSE = 2.0


@dataclass(frozen=True)
class InterfaceForces:
    """Shear at the interface and what was unbalanced.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    required, estimated, fed_back : ndarray, shape (N,)
        Left side of Eq. 4, estimate from the sensors, and the shear that was fed back [N].
    measured : ndarray, shape (N,)
        Of load cells, NaN where there are none [N].
    unbalanced : ndarray, shape (N,)
        f_c of Eq. 11, required less estimated [N].
    feedback_scale : float
        Share of the shear that is fed back; estimate and measurement are multiplied by it.
    strong_motion : tuple of float
        Begin and end [s].
    """

    time: FloatArray
    required: FloatArray
    estimated: FloatArray
    fed_back: FloatArray
    measured: FloatArray
    unbalanced: FloatArray
    feedback_scale: float
    strong_motion: tuple[float, float]

    @property
    def largest(self) -> tuple[float, float]:
        """Begin and end of the `CLOSE` s around the largest shear that was fed back or required [s]."""
        size = np.fmax(np.abs(self.fed_back), np.abs(self.required))
        middle = float(self.time[np.nanargmax(size)]) if np.isfinite(size).any() else 0.0
        begin = max(0.0, min(middle, float(self.time[-1]) - 0.5 * CLOSE) - 0.5 * CLOSE)
        return begin, begin + CLOSE


def interface_forces(record: RunRecord, feedback_scale: float, strong_motion: tuple[float, float]) -> InterfaceForces:
    """Return the forces of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    feedback_scale : float
        Share of the shear that is fed back.
    strong_motion : tuple of float
        Begin and end [s].
    """
    estimated = feedback_scale * record.interface_force
    return InterfaceForces(
        record.time,
        record.required_force,
        estimated,
        record.corrected_force,
        feedback_scale * record.base_shear,
        record.required_force - estimated,
        feedback_scale,
        strong_motion,
    )
