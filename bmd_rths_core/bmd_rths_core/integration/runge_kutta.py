"""The classical Runge-Kutta method of fourth order with a fixed step, for linear systems ẋ = A x + B u, as matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class RungeKuttaStep(NamedTuple):
    """x[k+1] = Φ x[k] + Γ₀ u[k] + Γ₁ u[k+1] for an input that is linear over the step.

    A held input acts by Γ₀ + Γ₁.

    Parameters
    ----------
    phi : ndarray, shape (n, n)
    gamma_0, gamma_1 : ndarray, shape (n, m)
    stages : ndarray, shape (4, n, n + m)
        Where the method evaluates the system in a step with a held input: of state and input.
    """

    phi: FloatArray
    gamma_0: FloatArray
    gamma_1: FloatArray
    stages: FloatArray


def runge_kutta_4(a: FloatArray, b: FloatArray, time_step: float) -> RungeKuttaStep:
    """Return one step of the method as matrices.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    time_step : float
        Δt [s].
    """
    n, m = b.shape
    own, begin, end = np.hsplit(np.eye(n, n + 2 * m), [n]), np.zeros((m, n + 2 * m)), np.zeros((m, n + 2 * m))
    state = np.hstack(own)
    begin[:, n : n + m] = np.eye(m)
    end[:, n + m :] = np.eye(m)
    stages, slope, slopes = [], np.zeros_like(state), []
    for share, load in ((0.0, begin), (0.5, 0.5 * (begin + end)), (0.5, 0.5 * (begin + end)), (1.0, end)):
        stages.append(state + share * time_step * slope)
        slope = a @ stages[-1] + b @ load
        slopes.append(slope)
    after = state + time_step / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
    held = np.array([np.hstack((stage[:, :n], stage[:, n : n + m] + stage[:, n + m :])) for stage in stages])
    return RungeKuttaStep(after[:, :n], after[:, n : n + m], after[:, n + m :], held)


def stage_responses(a: FloatArray, b: FloatArray, time_step: float) -> tuple[FloatArray, FloatArray]:
    """Return what a load that acts at one of the four evaluations alone makes of the step.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n,)
        How the load acts.
    time_step : float
        Δt [s].

    Returns
    -------
    stages : ndarray, shape (4, n, 4)
        The state at each evaluation, per load at each evaluation.
    after : ndarray, shape (n, 4)
        The state after the step.
    """
    loads, slope, slopes, stages = np.eye(4), np.zeros((len(a), 4)), [], []
    for i, share in enumerate((0.0, 0.5, 0.5, 1.0)):
        stages.append(share * time_step * slope)
        slope = a @ stages[-1] + np.outer(b, loads[i])
        slopes.append(slope)
    return np.array(stages), time_step / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
