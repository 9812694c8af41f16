"""Transfer functions in z by their roots, on the unit circle: gain, phase, and how far the phase can have moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Where a transfer function is evaluated to find its gain: outside the unit circle.
_REFERENCE_POINT = 1.7 + 0.3j


@dataclass(frozen=True)
class DiscreteRational:
    """A rational transfer function in z by its zeros, poles and gain: g Π(z − zᵢ) / Π(z − pᵢ).

    Parameters
    ----------
    zeros : ndarray, shape (n_z,)
        Zeros, complex.
    poles : ndarray, shape (n_p,)
        Poles, complex.
    gain : float
        g.
    """

    zeros: ComplexArray
    poles: ComplexArray
    gain: float

    def response(self, z: ComplexArray) -> ComplexArray:
        """Return the value at points of the plane.

        Parameters
        ----------
        z : ndarray of complex
            Points; e^{jω Δt} for the frequency response.
        """
        point, n = np.asarray(z)[..., None], min(len(self.zeros), len(self.poles))
        # One zero with one pole at a time: no overflow, however many there are.
        pairs = np.prod((point - self.zeros[:n]) / (point - self.poles[:n]), axis=-1)
        rest = np.prod(point - self.zeros[n:], axis=-1) / np.prod(point - self.poles[n:], axis=-1)
        return np.asarray(self.gain * pairs * rest)

    def gain_bound(self, theta: float) -> float:
        """Return an upper bound of the gain from z = 1 to e^{jθ}; infinite where a pole is as near as that.

        Parameters
        ----------
        theta : float
            θ ≥ 0 [rad].
        """
        farthest, nearest = np.abs(1.0 - self.zeros) + theta, np.abs(1.0 - self.poles) - theta
        if not np.min(nearest, initial=np.inf) > 0.0:
            return np.inf
        return float(np.abs(self.gain) * np.exp(np.sum(np.log(farthest)) - np.sum(np.log(nearest))))

    def phase_variation(self, theta: FloatArray) -> FloatArray:
        """Return the sum of the variations of the phase of every root on the unit circle, from θ = 0 on [rad].

        Parameters
        ----------
        theta : ndarray
            θ = ω Δt ≥ 0 [rad].

        Notes
        -----
        The phase of e^{jθ} − r rises with θ for a root inside the circle. For one outside it swings between ±A,
        A = asin(1/|r|), with turning points where cos(θ − arg r) = 1/|r|.
        """
        angle, total = np.asarray(theta)[..., None], np.zeros(np.shape(theta))
        for of, roots, at_zero in self._variations:
            total = total + (of(angle, roots) - at_zero).sum(axis=-1)
        return total

    @cached_property
    def _variations(self) -> list[tuple[Callable[[FloatArray, ComplexArray], FloatArray], ComplexArray, FloatArray]]:
        """How the phase varies, which roots do so, and from where; for the roots inside the circle and outside."""
        roots = np.concatenate((self.zeros, self.poles))
        inside = np.abs(roots) <= 1.0
        parts = ((_rising_phase, roots[inside]), (_swinging_variation, roots[~inside]))
        return [(of, some, of(np.zeros(1), some)) for of, some in parts if len(some)]


def transfer_function(
    a: FloatArray, b: FloatArray, c: FloatArray, multiple_zero: tuple[complex, int]
) -> DiscreteRational:
    """Return c (z I − A)⁻¹ b by its roots.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b, c : ndarray, shape (n,)
    multiple_zero : tuple of complex and int
        A zero that is known, and its multiplicity. Rounding would scatter it, by 1e-4 and more.

    Returns
    -------
    DiscreteRational
        Poles are the eigenvalues, zeros those of the pencil of Rosenbrock, in which numbers far outside the circle
        stand for zeros at infinity.
    """
    n = len(a)
    pencil = np.block([[a, b[:, None]], [c[None, :], np.zeros((1, 1))]])
    # Every state has a unit of its own; without balance the zeros would have few digits.
    balanced, _ = scipy.linalg.matrix_balance(pencil, permute=False)
    alpha, beta = scipy.linalg.eigvals(balanced, np.diag(np.append(np.ones(n), 0.0)), homogeneous_eigvals=True)
    zeros = alpha[beta != 0.0] / beta[beta != 0.0]
    known, multiplicity = multiple_zero
    zeros[np.argsort(np.abs(zeros - known))[:multiplicity]] = known
    unscaled = DiscreteRational(zeros, np.linalg.eigvals(a).astype(complex), 1.0)
    value = c @ np.linalg.solve(_REFERENCE_POINT * np.eye(n) - a, b.astype(complex))
    gain = value / unscaled.response(np.asarray(_REFERENCE_POINT))
    return DiscreteRational(zeros, unscaled.poles, float(gain.real))


def _rising_phase(theta: FloatArray, roots: ComplexArray) -> FloatArray:
    return np.asarray(theta + np.angle(1.0 - roots * np.exp(-1j * theta)))


def _swinging_variation(theta: FloatArray, roots: ComplexArray) -> FloatArray:
    modulus = np.abs(roots)
    amplitude, turning_point = np.arcsin(1.0 / modulus), np.arccos(1.0 / modulus)
    periods, beta = np.divmod(theta - np.angle(roots) + np.pi, 2.0 * np.pi)
    beta = beta - np.pi
    swing = np.angle(1.0 - np.exp(1j * beta) / modulus)
    within = np.where(
        np.abs(beta) < turning_point, 2.0 * amplitude - swing, np.where(beta < 0.0, swing, 4.0 * amplitude + swing)
    )
    return np.asarray(4.0 * amplitude * periods + within)
