"""Reference: the unpartitioned building under the same earthquake, the benchmark of the paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.discretisation import first_order_hold
from bmd_rths_core.shear_building import ShearBuilding

FloatArray = NDArray[np.float64]


def reference_response(building: ShearBuilding, ground_acceleration: FloatArray, time_step: float) -> FloatArray:
    """Return the absolute floor accelerations of a building on the ground.

    Parameters
    ----------
    building : ShearBuilding
        The whole building, n floors (Eqs. 1 and 2).
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²], linear between the steps.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N, n)
        ü + ü_g at the steps, exact for a piecewise-linear ground motion, from rest at step 0 [m/s²].
    """
    a, b, c = building.relative_motion()
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step)
    state = np.zeros(len(a))
    response = np.empty((len(ground_acceleration), building.stories))
    response[0] = c @ state
    for k in range(1, len(ground_acceleration)):
        state = phi @ state + gamma_0[:, 0] * ground_acceleration[k - 1] + gamma_1[:, 0] * ground_acceleration[k]
        response[k] = c @ state
    return response
