"""One recorded ground acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError

#: Standard acceleration of gravity [m/s²]; 3rd General Conference on Weights and Measures, 1901.
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)  # arrays have no single truth value, so == compares identity
class GroundMotion:
    """A ground acceleration at equal time steps, at rest before its first and after its last point.

    Parameters
    ----------
    name : str
        Name of the record: the file name without its extension.
    time_step : float
        Time between two points [s].
    acceleration : ndarray, shape (N,)
        Ground acceleration [m/s²], point i at time ``i * time_step``. A read-only copy is kept.
    source : str
        Path of the file, or ``"shipped"`` for a record that comes with this package.
    sha256 : str
        SHA-256 of the bytes of that file, in hexadecimal. Processing keeps it: it says where the motion comes from.

    Raises
    ------
    InputError
        The time step is not a finite number > 0, or the acceleration is not a vector of two or more finite numbers.
    """

    name: str
    time_step: float
    acceleration: NDArray[np.float64]
    source: str
    sha256: str

    def __post_init__(self) -> None:
        """Check the record and protect its points."""
        acceleration = np.array(self.acceleration, dtype=np.float64)
        acceleration.setflags(write=False)
        object.__setattr__(self, "acceleration", acceleration)
        where = f"ground motion {self.name!r} ({self.source})"
        if not (math.isfinite(self.time_step) and self.time_step > 0):
            raise InputError(f"{where}: time step {self.time_step:g} s; a finite number > 0 is required")
        if acceleration.ndim == 1 and acceleration.size < 2:
            found = "one point" if acceleration.size else "no point"
            raise InputError(f"{where}: {found} of acceleration; two or more are required")
        if acceleration.ndim != 1:
            raise InputError(f"{where}: acceleration of shape {acceleration.shape}; (N,) with N >= 2 is required")
        bad = np.flatnonzero(~np.isfinite(acceleration))
        if bad.size:
            raise InputError(f"{where}: acceleration[{bad[0]}] is {acceleration[bad[0]]}; a finite number is required")

    @property
    def steps(self) -> int:
        """Number of points N."""
        return self.acceleration.size

    @property
    def duration(self) -> float:
        """Time of the last point, ``(N - 1) * time_step`` [s]."""
        return (self.steps - 1) * self.time_step

    @property
    def peak(self) -> float:
        """Largest absolute acceleration [m/s²]."""
        return float(np.max(np.abs(self.acceleration)))
