"""Damping matrices of a building from modal damping ratios: Rayleigh and modal damping."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.linear_building import LinearBuilding

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


def rayleigh_damping(building: LinearBuilding, alpha: float, beta: float) -> FloatArray:
    """Return the Rayleigh damping matrix.

    Parameters
    ----------
    building : LinearBuilding
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


def modal_damping(building: LinearBuilding, ratios: Sequence[float]) -> FloatArray:
    """Return the damping matrix that gives every mode its own damping ratio and couples none.

    Parameters
    ----------
    building : LinearBuilding
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


def damping_of_ratios(
    section: str, building: LinearBuilding, kind: str, ratios: Sequence[float], rayleigh_modes: Sequence[float]
) -> FloatArray:
    """Return the damping matrix that a configuration section asks for by damping ratios.

    Parameters
    ----------
    section : str
        Name of the section, for the message.
    building : LinearBuilding
        Mass and initial stiffness; its own damping is not used.
    kind : str
        ``"modal"`` or ``"rayleigh"``.
    ratios : sequence of float
        Modal: one for all modes or one a mode. Rayleigh: one for each of two modes.
    rayleigh_modes : sequence of float
        The two modes, counted from 1.

    Returns
    -------
    ndarray, shape (n, n)
        C [N s/m].

    Raises
    ------
    InputError
        The lists do not fit the building, or a mode would be damped negatively.
    """
    n = building.stories
    if kind == "modal":
        if len(ratios) != 1:
            check_length(section, "damping_ratios", ratios, n, "one for all modes or one a mode")
        return modal_damping(building, tuple(ratios) * n if len(ratios) == 1 else ratios)
    check_length(section, "damping_ratios", ratios, 2, "one for each of rayleigh_modes")
    modes = sorted({int(mode) for mode in rayleigh_modes if mode == int(mode) and mode <= n})
    if len(rayleigh_modes) != 2 or len(modes) != 2:
        given = ", ".join(f"{mode:g}" for mode in rayleigh_modes)
        raise InputError(
            f"{section}.rayleigh_modes: [{given}] is not allowed; "
            f"two different whole numbers from 1 to {n}, the number of stories, are required"
        )
    frequencies = building.modes().frequencies
    targets = [float(frequencies[int(mode) - 1]) for mode in rayleigh_modes]
    try:
        return rayleigh_damping(building, *rayleigh_coefficients(targets, ratios))
    except InputError as error:
        raise InputError(f"{section}.damping_ratios: {error}") from error


def check_length(section: str, name: str, values: Sequence[float], needed: int, meaning: str) -> None:
    """Raise one line unless a list of a section has as many entries as are needed.

    Parameters
    ----------
    section, name : str
        Of the list.
    values : sequence of float
        The list.
    needed : int
        Number of entries.
    meaning : str
        What they stand for.
    """
    if len(values) != needed:
        raise InputError(f"{section}.{name}: {len(values)} values; {needed} are required, {meaning}")
