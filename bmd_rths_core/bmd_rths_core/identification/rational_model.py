"""Transfer functions with one denominator in factors, times a pure delay: what is identified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray


@dataclass(frozen=True)
class RationalModel:
    """m transfer functions with one denominator, times a pure delay; coefficients belong to s / scale.

    Parameters
    ----------
    scale : float
        Frequency that s is divided by [rad/s].
    quadratics : ndarray, shape (q, 2)
        a₁ and a₀ of the factors s² + a₁ s + a₀ of the denominator.
    linears : ndarray, shape (0,) or (1,)
        a₀ of the factor s + a₀ of the denominator, when the order is odd.
    numerators : ndarray, shape (d + 1, m)
        Coefficients of s⁰ to s^d.
    delay : float
        Pure delay [s].
    """

    scale: float
    quadratics: FloatArray
    linears: FloatArray
    numerators: FloatArray
    delay: float

    @property
    def order(self) -> int:
        """Number of poles."""
        return 2 * len(self.quadratics) + len(self.linears)

    @property
    def degree(self) -> int:
        """Degree of the numerators."""
        return len(self.numerators) - 1

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        return self.order + self.numerators.size + (self.delay > 0.0)

    @property
    def poles(self) -> ComplexArray:
        """Poles [rad/s], shape (order,), both of each complex pair."""
        pairs = [np.roots([1.0, *factor]) for factor in self.quadratics]
        return np.asarray(self.scale * np.concatenate((*pairs, -self.linears)), dtype=complex)

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Return the frequency responses.

        Parameters
        ----------
        frequencies : ndarray, shape (n,)
            ω [rad/s].

        Returns
        -------
        ndarray of complex, shape (n, m)
        """
        s = 1j * frequencies / self.scale
        above: ComplexArray = np.zeros((len(s), self.numerators.shape[1]), dtype=complex)
        for coefficients in self.numerators[::-1]:  # a complex power costs as much as all the rest
            above = above * s[:, None] + coefficients
        denominator = np.prod(denominator_factors(s, self.quadratics, self.linears), axis=0)
        delayed = np.exp(-s * self.scale * self.delay) / denominator
        return np.asarray(above * delayed[:, None])


def denominator_factors(s: NDArray[Any], quadratics: FloatArray, linears: FloatArray) -> ComplexArray:
    """Return the values of the factors of a denominator.

    Parameters
    ----------
    s : ndarray of complex, shape (n,)
        Scaled s.
    quadratics, linears
        See `RationalModel`.

    Returns
    -------
    ndarray of complex, shape (factors, n)
    """
    return np.asarray([*(s**2 + a1 * s + a0 for a1, a0 in quadratics), *(s + a0 for a0 in linears)])
