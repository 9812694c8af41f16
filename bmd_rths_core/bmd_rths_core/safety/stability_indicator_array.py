"""`StabilityIndicator` of many runs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.linear_simulation import running_mean
from bmd_rths_core.safety.config import SafetyConfig

FloatArray = NDArray[np.float64]


class StabilityIndicatorArray:
    """The stability indicator as an array operation; equations and symbols as in `StabilityIndicator`.

    It has values only: no limit, no trip.

    Parameters
    ----------
    config : SafetyConfig
        Time constant and floor.
    masses : array_like, shape (n,)
        Floor masses of the numerical substructure [kg].
    damping_matrix : ndarray, shape (n, n)
        Its damping matrix [N s/m].
    time_step : float
        Δt [s].
    runs : int
        Number of runs m, all with the same numerical substructure.
    """

    def __init__(
        self,
        config: SafetyConfig,
        masses: Sequence[float] | FloatArray,
        damping_matrix: FloatArray,
        time_step: float,
        runs: int,
    ) -> None:
        self._masses, self._damping = np.asarray(masses, dtype=np.float64), damping_matrix
        self._time_step = time_step
        self._floor = float(self._masses.sum()) * config.stability_floor**2
        self._power = running_mean(time_step, config.stability_time, runs)
        self._energy = running_mean(time_step, config.stability_time, runs)
        self._displacements = np.zeros((runs, len(self._masses), 3))
        self._forces = np.zeros((runs, 4))
        self._value = np.zeros((runs, 1))

    def keep(self, runs: NDArray[np.bool_]) -> None:
        """Go on with some of the runs only.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            True for those that go on.
        """
        self._power.keep(runs)
        self._energy.keep(runs)
        self._displacements, self._forces = self._displacements[runs], self._forces[runs]
        self._value = self._value[runs]

    def advance(self, corrected_force: FloatArray, displacements: FloatArray) -> FloatArray:
        """Return the indicator at the next steps.

        Parameters
        ----------
        corrected_force : ndarray, shape (m, N)
            Shear fed back [N], which acts at the step after.
        displacements : ndarray, shape (m, n, N)
            Of the numerical substructure [m].

        Returns
        -------
        ndarray, shape (m, N)
        """
        step = self._time_step
        displacements = np.concatenate((self._displacements, displacements), axis=-1)
        forces = np.hstack((self._forces, corrected_force))
        self._displacements, self._forces = displacements[..., -3:], forces[:, -4:]
        jerk = np.diff(displacements, n=3, axis=-1) / step**3
        force = 0.5 * (forces[:, 3:-1] - forces[:, 2:-2] - forces[:, 1:-3] + forces[:, :-4]) / step**2
        power = force * jerk[:, -1] - np.sum(jerk * (self._damping @ jerk), axis=1)
        mean_power = self._power.advance(power.T)[:, 0]
        mean_energy = self._energy.advance((self._masses @ (jerk * jerk)).T)[:, 0]
        # max(0, …) at every step: the sum less the smallest that it has been, where that is negative.
        total = self._value + np.cumsum(step * mean_power / (mean_energy + self._floor), axis=-1)
        value = total - np.minimum(0.0, np.minimum.accumulate(total, axis=-1))
        self._value = value[:, -1:]
        return np.asarray(value)
