"""Damping matrices of a shear building from modal damping ratios: Rayleigh and modal damping."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.shear_building import ShearBuilding

FloatArray = NDArray[np.float64]


def rayleigh_coefficients(frequencies: Sequence[float], ratios: Sequence[float]) -> tuple[float, float]:
    """Return α and β of C = α M + β K for two target damping ratios.

    Parameters
    ----------
    frequencies : sequence of two float
        Natural frequencies [rad/s], different from each other.
    ratios : sequence of two float
        Damping ratio at each of them.

    Returns
    -------
    alpha : float
        Coefficient of the mass matrix [1/s].
    beta : float
        Coefficient of the stiffness matrix [s].

    Notes
    -----
    Solves ζ = α / (2 ω) + β ω / 2 at both frequencies (Chopra, Dynamics of Structures, section 11.4.1).
    """
    (first, second), (at_first, at_second) = frequencies, ratios
    difference = second**2 - first**2
    alpha = 2.0 * first * second * (at_first * second - at_second * first) / difference
    beta = 2.0 * (at_second * second - at_first * first) / difference
    return alpha, beta


def rayleigh_damping(building: ShearBuilding, alpha: float, beta: float) -> FloatArray:
    """Return the Rayleigh damping matrix.

    Parameters
    ----------
    building : ShearBuilding
        The building; its own damping coefficients are not used.
    alpha : float
        Coefficient of the mass matrix [1/s].
    beta : float
        Coefficient of the initial stiffness matrix [s].

    Returns
    -------
    ndarray, shape (n, n)
        C = α M + β K [N s/m].

    Raises
    ------
    InputError
        A mode of the building would be damped negatively.
    """
    frequencies = building.modes().frequencies
    ratios = alpha / (2.0 * frequencies) + beta * frequencies / 2.0
    if ratios.min() < -1e-12:  # a target of zero may be missed by rounding
        mode = int(np.argmin(ratios)) + 1
        raise InputError(f"Rayleigh damping gives mode {mode} a ratio of {ratios.min():.4g}; >= 0 is required")
    return alpha * building.mass_matrix + beta * building.stiffness_matrix


def modal_damping(building: ShearBuilding, ratios: Sequence[float]) -> FloatArray:
    """Return the damping matrix that gives every mode its own damping ratio and couples none.

    Parameters
    ----------
    building : ShearBuilding
        The building; its own damping coefficients are not used.
    ratios : sequence of float
        Damping ratio of each mode, lowest frequency first, n entries.

    Returns
    -------
    ndarray, shape (n, n)
        C = M Φ diag(2 ζ ω) Φᵀ M with modes Φ of unit modal mass [N s/m] (Chopra, section 11.4.3).
    """
    modes = building.modes()
    weighted = building.mass_matrix @ modes.shapes
    damping: FloatArray = weighted @ np.diag(2.0 * np.asarray(ratios) * modes.frequencies) @ weighted.T
    return damping
