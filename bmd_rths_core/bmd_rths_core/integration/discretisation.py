"""Exact discretisation of linear time-invariant systems ẋ = A x + B u.

"Exact" means that the discrete solution equals the continuous one at the sampling instants when the input really has
the assumed form between them: held (`zero_order_hold`) or linear (`first_order_hold`). Both come from one matrix
exponential (Van Loan, "Computing integrals involving the matrix exponential", IEEE TAC 23(3), 1978).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.scipy_loading import leave_for_later

FloatArray = NDArray[np.float64]

leave_for_later()


class DiscreteStateSpace(NamedTuple):
    """A stage of the loop as a linear system, x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], at rest before step 0.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    c : ndarray, shape (p, n)
    d : ndarray, shape (p, m)
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray


def zero_order_hold(a: FloatArray, b: FloatArray, time_step: float) -> tuple[FloatArray, FloatArray]:
    """Discretise with an input that is held over the step: x[k+1] = Φ x[k] + Γ u[k].

    Parameters
    ----------
    a : ndarray, shape (n, n)
        System matrix.
    b : ndarray, shape (n, m)
        Input matrix.
    time_step : float
        Δt [s].

    Returns
    -------
    phi : ndarray, shape (n, n)
    gamma : ndarray, shape (n, m)
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n] = a * time_step
    block[:n, n:] = b * time_step
    exponential = _exponential(block)
    return exponential[:n, :n].copy(), exponential[:n, n:].copy()


def first_order_hold(a: FloatArray, b: FloatArray, time_step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Discretise with an input that is linear over the step: x[k+1] = Φ x[k] + Γ₀ u[k] + Γ₁ u[k+1].

    Parameters
    ----------
    a : ndarray, shape (n, n)
        System matrix.
    b : ndarray, shape (n, m)
        Input matrix.
    time_step : float
        Δt [s].

    Returns
    -------
    phi : ndarray, shape (n, n)
    gamma_0, gamma_1 : ndarray, shape (n, m)
        Weights of the input at the beginning and at the end of the step.
    """
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n] = a * time_step
    block[:n, n : n + m] = b * time_step
    block[n : n + m, n + m :] = np.eye(m)
    exponential = _exponential(block)
    gamma_1 = exponential[:n, n + m :].copy()
    return exponential[:n, :n].copy(), exponential[:n, n : n + m] - gamma_1, gamma_1


def _exponential(matrix: FloatArray) -> FloatArray:
    from scipy.linalg import expm  # takes a quarter of a second; a node without a model does without

    return expm(matrix)  # type: ignore[no-any-return]
