"""Tell a diverging test before it is large: the power that the interface feeds into the numerical substructure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.trips import Action, Trip

FloatArray = NDArray[np.float64]


class StabilityIndicator:
    """Logarithm of the factor by which the interface has raised the energy of the numerical substructure.

    Parameters
    ----------
    config : SafetyConfig
        Limit, action, time constant and floor.
    masses : array_like, shape (n,)
        Floor masses of the numerical substructure [kg].
    damping_matrix : ndarray, shape (n, n)
        Its damping matrix [N s/m].
    time_step : float
        Δt [s].

    Attributes
    ----------
    value, largest : float
        The indicator now, and its largest value since the reset.

    Notes
    -----
    After Gálmez and Fermandois (2020, doi 10.3389/fbuil.2020.00134), who compare energies of the substructures, adapted
    to the acceleration interface. A passive specimen cannot feed power into the numerical substructure for long; the
    lag of the table can. With the shear fed back f and the velocity u̇ of the numerical substructure relative to the
    ground, the net power is f u̇ − u̇ᵀ C u̇, and the energy is u̇ᵀ M u̇, twice the mean kinetic energy of a vibration.
    All are taken of the second derivatives in time, so that the slow response to the ground motion does not hide the
    vibration that grows. With means over the time constant,

        growth rate = ⟨power⟩ / (⟨energy⟩ + floor),    indicator = ∫ growth rate dt, never below 0.

    The growth rate of a diverging mode is positive without end, that of a stable one on average negative. No
    displacement, stiffness or ground motion is needed, so that the springs may yield.
    """

    def __init__(
        self, config: SafetyConfig, masses: Sequence[float] | FloatArray, damping_matrix: FloatArray, time_step: float
    ) -> None:
        self._action = config.action("stability")
        self._limit = config.stability_limit
        self._time_step = time_step
        self._share = min(1.0, time_step / config.stability_time)
        self._masses = np.asarray(masses, dtype=np.float64)
        self._damping = damping_matrix
        self._floor = float(self._masses.sum()) * config.stability_floor**2
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._displacements = [np.zeros(len(self._masses)) for _ in range(3)]
        self._forces = (0.0, 0.0, 0.0)
        self._power = self._energy = 0.0
        self.value = self.largest = 0.0
        self._tripped = False

    def step(self, step: int, feedback_force: float, displacements: FloatArray) -> Trip | None:
        """Update the indicator.

        Parameters
        ----------
        step : int
            Step index.
        feedback_force : float
            Shear fed back that acts at this step [N].
        displacements : ndarray, shape (n,)
            Displacements of the numerical substructure relative to the ground at this step [m].

        Returns
        -------
        Trip or None
            The first time the limit is passed.
        """
        if self._action is Action.IGNORE:
            return None
        dt = self._time_step
        u1, u2, u3 = self._displacements
        f1, f2, f3 = self._forces
        jerk = (displacements - u3 + 3.0 * (u2 - u1)) / dt**3
        force = 0.5 * (feedback_force - f1 - f2 + f3) / dt**2  # mean of this and the last second difference
        u3[:] = displacements
        self._displacements = [u3, u1, u2]
        self._forces = (feedback_force, f1, f2)
        with np.errstate(over="ignore"):  # of a shear that is absurd; the supervisor refuses what follows from it
            power = force * float(jerk[-1]) - float(jerk @ self._damping @ jerk)
            energy = float(jerk @ (self._masses * jerk))
        self._power += self._share * (power - self._power)
        self._energy += self._share * (energy - self._energy)
        self.value = max(0.0, self.value + dt * self._power / (self._energy + self._floor))
        self.largest = max(self.largest, self.value)
        if self.value <= self._limit or self._tripped:
            return None
        self._tripped = True
        return Trip("safety.stability_limit", "1", "stability indicator", self.value, self._limit, step, self._action)
