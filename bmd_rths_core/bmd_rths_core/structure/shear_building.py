"""Shear building: a chain of floor masses on story springs and dampers, any number of stories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.physical_bounds import LARGEST_FREQUENCY

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Modes:
    """Undamped modes of a shear building, lowest frequency first.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Natural frequencies ω [rad/s].
    damping_ratios : ndarray, shape (n,)
        ζᵢ = φᵢᵀ C φᵢ / (2 ωᵢ φᵢᵀ M φᵢ), the damping the mode has when the coupling between modes is neglected.
    effective_masses : ndarray, shape (n,)
        (φᵢᵀ M 1)² / (φᵢᵀ M φᵢ) [kg]; their sum is the total mass.
    shapes : ndarray, shape (n, n)
        Mode i is column i, normalised to unit modal mass.
    """

    frequencies: FloatArray
    damping_ratios: FloatArray
    effective_masses: FloatArray
    shapes: FloatArray


@dataclass(frozen=True)
class ShearBuilding:
    """A shear building with one horizontal degree of freedom a floor.

    Parameters
    ----------
    masses : tuple of float
        Floor masses from the bottom to the top [kg], each > 0.
    stiffnesses : tuple of float
        Story stiffnesses, entry i between floor i−1 and floor i [N/m], each > 0; floor −1 is the base.
    damping_coefficients : tuple of float
        Story damping coefficients [N s/m], each ≥ 0.

    Raises
    ------
    InputError
        The lists are empty or of different length, or a value is out of range.

    Notes
    -----
    Matrices of Eq. 2 of Chen et al. (2020), for any number of stories.
    """

    masses: tuple[float, ...]
    stiffnesses: tuple[float, ...]
    damping_coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the lists."""
        lengths = len(self.masses), len(self.stiffnesses), len(self.damping_coefficients)
        if lengths[0] == 0 or len(set(lengths)) != 1:
            raise InputError(
                "masses, stiffnesses and damping_coefficients need one entry a story each; "
                f"they have {lengths[0]}, {lengths[1]} and {lengths[2]} entries"
            )
        for name, values, lowest in (
            ("masses", self.masses, "> 0 kg"),
            ("stiffnesses", self.stiffnesses, "> 0 N/m"),
            ("damping_coefficients", self.damping_coefficients, ">= 0 N s/m"),
        ):
            for i, value in enumerate(values):
                if not np.isfinite(value) or value < 0.0 or (value == 0.0 and lowest[1] == " "):
                    raise InputError(f"{name}[{i}]: {value:g} is not allowed; {lowest} is required")

    @property
    def stories(self) -> int:
        """Number of stories n."""
        return len(self.masses)

    @property
    def mass_matrix(self) -> FloatArray:
        """M [kg], shape (n, n)."""
        return np.diag(np.asarray(self.masses, dtype=float))

    @property
    def stiffness_matrix(self) -> FloatArray:
        """K [N/m], shape (n, n)."""
        return _chain(self.stiffnesses)

    @property
    def damping_matrix(self) -> FloatArray:
        """C [N s/m], shape (n, n)."""
        return _chain(self.damping_coefficients)

    @property
    def total_mass(self) -> float:
        """Sum of the floor masses [kg]."""
        return float(sum(self.masses))

    def stacked_on(self, lower: ShearBuilding) -> ShearBuilding:
        """Return the building that has this one standing on the roof of another.

        Parameters
        ----------
        lower : ShearBuilding
            The lower part, for example the numerical substructure.

        Returns
        -------
        ShearBuilding
            The unpartitioned building of Eq. 3.
        """
        return ShearBuilding(
            lower.masses + self.masses,
            lower.stiffnesses + self.stiffnesses,
            lower.damping_coefficients + self.damping_coefficients,
        )

    def scaled(self, factor: float) -> ShearBuilding:
        """Return the building with all masses, stiffnesses and damping coefficients multiplied by one factor.

        Parameters
        ----------
        factor : float
            Factor > 0. Frequencies and damping ratios stay; every force is multiplied.

        Returns
        -------
        ShearBuilding
        """
        values = (self.masses, self.stiffnesses, self.damping_coefficients)
        return ShearBuilding(*(tuple(factor * entry for entry in entries) for entries in values))

    def modes(self) -> Modes:
        """Return the undamped modes.

        Returns
        -------
        Modes
            All n modes, lowest frequency first.
        """
        return modes_of(self.mass_matrix, self.damping_matrix, self.stiffness_matrix)

    def relative_motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the state space of the motion relative to the base, driven by the base acceleration (Eq. 5).

        The state is ``[u, u̇]`` relative to the base; the input is the absolute base acceleration; the output is the
        absolute acceleration of the floors, ``ü + a_base = −M⁻¹ (C u̇ + K u)``, which has no direct feedthrough.

        Returns
        -------
        a : ndarray, shape (2n, 2n)
        b : ndarray, shape (2n, 1)
        c : ndarray, shape (n, 2n)
        """
        n = self.stories
        inverse_mass = 1.0 / np.asarray(self.masses)[:, None]
        c = np.hstack((-inverse_mass * self.stiffness_matrix, -inverse_mass * self.damping_matrix))
        a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), c))
        b = np.concatenate((np.zeros(n), -np.ones(n)))[:, None]
        return a, b, c


def modes_of(mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> Modes:
    """Return the undamped modes of a building by its matrices.

    Parameters
    ----------
    mass, damping, stiffness : ndarray, shape (n, n)
        M [kg], C [N s/m] and K [N/m], K positive definite.

    Returns
    -------
    Modes
        All n modes, lowest frequency first.
    """
    from scipy.linalg import eigh  # as in `integration.discretisation`, not before it is needed

    squared, shapes = eigh(stiffness, mass)
    frequencies = np.sqrt(squared)
    modal_damping = np.einsum("ij,ik,kj->j", shapes, damping, shapes)
    participation = shapes.T @ mass @ np.ones(len(mass))
    return Modes(frequencies, modal_damping / (2.0 * frequencies), participation**2, shapes)


def stories(
    section: str,
    masses: tuple[float, ...],
    stiffnesses: tuple[float, ...],
    damping_coefficients: tuple[float, ...],
) -> ShearBuilding:
    """Return the shear building of a configuration section, naming the section when the values do not fit.

    Parameters
    ----------
    section : str
        Name of the section.
    masses, stiffnesses, damping_coefficients : tuple of float
        See `ShearBuilding`.

    Returns
    -------
    ShearBuilding

    Raises
    ------
    InputError
        See `ShearBuilding`, or a floor is faster than what is integrated exactly; the message starts with the section.
    """
    try:
        building = ShearBuilding(masses, stiffnesses, damping_coefficients)
    except InputError as error:
        raise InputError(f"{section}: {error}") from error
    for name, matrix, power in (
        ("stiffnesses", building.stiffness_matrix, 0.5),
        ("damping_coefficients", building.damping_matrix, 1.0),
    ):
        # Gershgorin: no eigenvalue of M⁻¹K is larger than the largest sum of a row
        rates = (np.abs(matrix).sum(axis=1) / np.asarray(masses)) ** power
        floor = int(np.argmax(rates))
        if rates[floor] > LARGEST_FREQUENCY:
            problem = f"floor {floor + 1} of {masses[floor]:g} kg moves at up to {rates[floor]:.3g} rad/s"
            raise InputError(f"{section}.{name}: {problem}; at most {LARGEST_FREQUENCY:g} rad/s is integrated exactly")
    return building


def mass_ratio(experimental_mass: float, numerical_mass: float) -> float:
    """Return the mass ratio ρ = m_E / (m_N + m_E) (Eq. 8).

    Parameters
    ----------
    experimental_mass, numerical_mass : float
        Effective modal masses of the dominant mode of the experimental and the numerical substructure [kg].

    Returns
    -------
    float
        ρ, between 0 and 1.
    """
    return experimental_mass / (numerical_mass + experimental_mass)


def _chain(coefficients: tuple[float, ...]) -> FloatArray:
    own = np.asarray(coefficients, dtype=float)
    above = np.append(own[1:], 0.0)
    return np.diag(own + above) - np.diag(own[1:], 1) - np.diag(own[1:], -1)
