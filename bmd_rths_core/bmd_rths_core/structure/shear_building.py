"""Shear building: a chain of floor masses on story springs and dampers, any number of stories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.physical_bounds import LARGEST_FREQUENCY
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.matrix_building import MatrixBuilding, Rows, rows_of, stacked

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ShearBuilding(LinearBuilding):
    """A shear building with one horizontal degree of freedom a floor.

    Parameters
    ----------
    masses : tuple of float
        Floor masses from the bottom to the top [kg], each > 0.
    stiffnesses : tuple of float
        Story stiffnesses, entry i between floor i−1 and floor i [N/m], each > 0; floor −1 is the base.
    damping_coefficients : tuple of float
        Story damping coefficients [N s/m], each ≥ 0.
    damping : tuple of tuple of float, optional
        C in place of that of the coefficients [N s/m], shape (n, n).

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
    damping: Rows | None = None

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
        return _chain(self.damping_coefficients) if self.damping is None else np.array(self.damping)

    def stacked_on(self, lower: LinearBuilding) -> ShearBuilding | MatrixBuilding:
        """Return the building that has this one standing on the roof of another.

        Parameters
        ----------
        lower : LinearBuilding
            The lower part.
        """
        if not isinstance(lower, ShearBuilding) or self.damping is not None or lower.damping is not None:
            return stacked(self, lower)
        return ShearBuilding(
            lower.masses + self.masses,
            lower.stiffnesses + self.stiffnesses,
            lower.damping_coefficients + self.damping_coefficients,
        )

    def with_factors(self, mass: float = 1.0, stiffness: float = 1.0, damping: float = 1.0) -> ShearBuilding:
        """Return the building with masses, stiffnesses and damping multiplied by a factor each.

        Parameters
        ----------
        mass, stiffness, damping : float
            Factors > 0.
        """
        return ShearBuilding(
            tuple(mass * entry for entry in self.masses),
            tuple(stiffness * entry for entry in self.stiffnesses),
            tuple(damping * entry for entry in self.damping_coefficients),
            None if self.damping is None else rows_of(damping * self.damping_matrix),
        )

    @property
    def interface_mass(self) -> float:
        """Mass of the roof [kg]."""
        return self.masses[-1]

    def interface_shares(self) -> FloatArray:
        """Return the accelerations of the floors under a force on the roof: that of the roof alone."""
        return np.asarray(np.eye(self.stories)[-1])

    def interface_restoring(self) -> FloatArray:
        """Return the row of the restoring force at the roof."""
        return np.hstack((self.stiffness_matrix[-1], self.damping_matrix[-1]))

    def relative_motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the state space of the motion relative to the base, driven by the base acceleration (Eq. 5)."""
        n = self.stories
        inverse_mass = 1.0 / np.asarray(self.masses)[:, None]
        c = np.hstack((-inverse_mass * self.stiffness_matrix, -inverse_mass * self.damping_matrix))
        a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), c))
        b = np.concatenate((np.zeros(n), -np.ones(n)))[:, None]
        return a, b, c


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


def chain_of(building: LinearBuilding, asked: str) -> ShearBuilding:
    """Return a building as stories with a damper each, for what cannot do with less.

    Parameters
    ----------
    building : LinearBuilding
        Any building.
    asked : str
        Parameter that asks for stories, for the message.

    Raises
    ------
    InputError
        It is given by matrices, or its damping by ratios.
    """
    if not isinstance(building, ShearBuilding) or building.damping is not None:
        raise InputError(
            f"{asked}: it works on stories; masses, stiffnesses and damping_coefficients are required, no matrices and "
            "no damping ratios"
        )
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
