"""Story springs: force against drift, linear or with hysteresis, and the stories of a building made of them.

All springs are rate-independent: the force follows from the path of the drift, not from its velocity. An explicit
integration visits every drift once, so that asking for a force also moves the spring there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Distance from its limit at which the hysteretic part of a Bouc-Wen spring counts as saturated, as a share of it.
_SATURATED = 1e-12


class StorySpring(Protocol):
    """What a story spring can do.

    Attributes
    ----------
    initial_stiffness : float
        Slope of the force at rest [N/m].
    highest_stiffness : float
        Largest slope anywhere on any path [N/m].
    """

    initial_stiffness: float
    highest_stiffness: float

    def reset(self) -> None:
        """Return to the virgin state."""

    def force(self, drift: float) -> float:
        """Move the spring straight from the last drift to another one and return its force.

        Parameters
        ----------
        drift : float
            Story drift [m].

        Returns
        -------
        float
            Force [N].
        """


class LinearSpring:
    """Linear elastic story spring.

    Parameters
    ----------
    stiffness : float
        k [N/m].
    """

    def __init__(self, stiffness: float) -> None:
        self.initial_stiffness = self.highest_stiffness = stiffness

    def reset(self) -> None:
        """Nothing to forget."""

    def force(self, drift: float) -> float:
        """Return the force."""
        return self.initial_stiffness * drift


class BilinearSpring:
    """Bilinear story spring with kinematic hardening; elastic-perfectly-plastic without hardening.

    Parameters
    ----------
    stiffness : float
        Initial stiffness k [N/m].
    yield_drift : float
        Drift at first yield u_y [m].
    post_yield_ratio : float
        Stiffness after yield as a share α of the initial one, 0 to 1; 0 is elastic-perfectly-plastic.

    Notes
    -----
    The force is α k u + (1 − α) k (u − u_p) with the plastic drift u_p, that moves so that |u − u_p| ≤ u_y. This return
    mapping is exact for any path that is straight between the drifts (Simo and Hughes 1998, Computational Inelasticity,
    section 1.2).
    """

    def __init__(self, stiffness: float, yield_drift: float, post_yield_ratio: float) -> None:
        self.initial_stiffness = self.highest_stiffness = stiffness
        self._hardening = post_yield_ratio * stiffness
        self._softening = stiffness - self._hardening
        self._yield_drift = yield_drift
        self._plastic_drift = 0.0

    def reset(self) -> None:
        """Return to the virgin state."""
        self._plastic_drift = 0.0

    def force(self, drift: float) -> float:
        """Move to a drift and return the force."""
        elastic = drift - self._plastic_drift
        if elastic > self._yield_drift:
            elastic = self._yield_drift
            self._plastic_drift = drift - elastic
        elif elastic < -self._yield_drift:
            elastic = -self._yield_drift
            self._plastic_drift = drift - elastic
        return self._hardening * drift + self._softening * elastic


class BoucWenSpring:
    """Bouc-Wen story spring: smooth hysteresis.

    Parameters
    ----------
    stiffness : float
        k [N/m]; with A = 1 the initial stiffness.
    yield_drift : float
        Reference drift u_y [m]; with A = 1 and β + γ = 1 the drift where the initial and the final slope meet.
    post_yield_ratio : float
        α, 0 to 1.
    a, beta, gamma : float
        Shape of the loop, dimensionless; A > 0 and −β < γ ≤ β, so that z is bounded and the spring dissipates (Erlicher
        and Point 2004, Comptes Rendus Mécanique 332).
    n : float
        Sharpness of the yield point, ≥ 1; large values approach the bilinear spring.

    Notes
    -----
    The force is α k u + (1 − α) k u_y z with u_y dz/du = A − |z|ⁿ (β sign(z du) + γ) (Wen 1976, Journal of the
    Engineering Mechanics Division ASCE 102). The equation depends on the path only. It is integrated by the classical
    Runge-Kutta method in sub-steps of the drift that are short against its stiffest part, and stops at saturation, so
    that the work of a step is bounded and z never passes its limit (A / (β + γ))^(1/n).
    """

    def __init__(
        self,
        stiffness: float,
        yield_drift: float,
        post_yield_ratio: float,
        a: float = 1.0,
        beta: float = 0.5,
        gamma: float = 0.5,
        n: float = 2.0,
    ) -> None:
        hysteretic = (1.0 - post_yield_ratio) * stiffness
        self._elastic = post_yield_ratio * stiffness
        self._limit_force_per_z = hysteretic * yield_drift
        self._yield_drift = yield_drift
        self._a, self._loading, self._unloading, self._n = a, beta + gamma, beta - gamma, n
        self._limit = (a / (beta + gamma)) ** (1.0 / n)
        self._longest = 0.5 * self._limit / (n * a)
        self.initial_stiffness = self._elastic + hysteretic * a
        # Unloading from saturation is the steepest: A + (β − γ) zⁿ with zⁿ = A / (β + γ).
        self.highest_stiffness = self._elastic + hysteretic * a * 2.0 * beta / (beta + gamma)
        self.reset()

    def reset(self) -> None:
        """Return to the virgin state."""
        self._z = 0.0
        self._drift = 0.0

    def force(self, drift: float) -> float:
        """Move to a drift and return the force."""
        path = (drift - self._drift) / self._yield_drift
        direction = 1.0 if path >= 0.0 else -1.0
        remaining = abs(path)
        y = direction * self._z  # grows along the path, whatever its sense
        saturated = self._limit * (1.0 - _SATURATED)
        while remaining > 0.0 and y < saturated:
            h = min(remaining, self._longest)
            slope_1 = self._slope(y)
            slope_2 = self._slope(y + 0.5 * h * slope_1)
            slope_3 = self._slope(y + 0.5 * h * slope_2)
            slope_4 = self._slope(y + h * slope_3)
            y = min(y + h / 6.0 * (slope_1 + 2.0 * (slope_2 + slope_3) + slope_4), self._limit)
            remaining -= h
        self._z = direction * y
        self._drift = drift
        return self._elastic * drift + self._limit_force_per_z * self._z

    def _slope(self, y: float) -> float:
        if y >= 0.0:
            return self._a - self._loading * math.pow(y, self._n)
        return self._a + self._unloading * math.pow(-y, self._n)


class StorySprings:
    """The springs of all stories of a building, with P-Delta.

    Parameters
    ----------
    springs : sequence of StorySpring
        From the ground up.
    geometric_stiffnesses : sequence of float
        Gravity load carried by each story over its height, P / h [N/m]. The story shear is the force of the spring
        less P / h times the drift (linearised P-Delta).
    """

    def __init__(self, springs: Sequence[StorySpring], geometric_stiffnesses: Sequence[float]) -> None:
        self._springs = tuple(springs)
        self._stories = tuple(zip(self._springs, geometric_stiffnesses, strict=True))
        self._floor_forces = np.zeros(len(self._springs))

    def reset(self) -> None:
        """Return every spring to the virgin state."""
        for spring in self._springs:
            spring.reset()

    def floor_forces(self, displacements: FloatArray) -> FloatArray:
        """Move the stories to a displaced shape and return the restoring forces.

        Parameters
        ----------
        displacements : ndarray, shape (n,)
            Displacements of the floors relative to the ground [m].

        Returns
        -------
        ndarray, shape (n,)
            r, the forces against the motion of the floors [N]; the array is used again by the next call.
        """
        forces = self._floor_forces
        floor, below = -1, 0.0
        for displacement, (spring, geometric) in zip(displacements.tolist(), self._stories, strict=True):
            drift = displacement - below
            shear = spring.force(drift) - geometric * drift
            if floor >= 0:
                forces[floor] -= shear
            floor += 1
            forces[floor] = shear
            below = displacement
        return forces
