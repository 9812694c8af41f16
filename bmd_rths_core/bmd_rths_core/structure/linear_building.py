"""What every linear building is to the rest of the project: three matrices, one horizontal motion a floor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Modes:
    """Undamped modes of a building, lowest frequency first.

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


class LinearBuilding(ABC):
    """A linear building: M ü + C u̇ + K u = −M 1 a_base, u relative to the base, floors from the bottom to the top.

    Attributes
    ----------
    masses : tuple of float
        M 1, the inertia of each floor when all move together [kg]; the floor masses of a shear building.
    """

    masses: tuple[float, ...]

    @property
    @abstractmethod
    def mass_matrix(self) -> FloatArray:
        """M [kg], shape (n, n)."""

    @property
    @abstractmethod
    def stiffness_matrix(self) -> FloatArray:
        """K [N/m], shape (n, n)."""

    @property
    @abstractmethod
    def damping_matrix(self) -> FloatArray:
        """C [N s/m], shape (n, n)."""

    @abstractmethod
    def with_factors(self, mass: float = 1.0, stiffness: float = 1.0, damping: float = 1.0) -> LinearBuilding:
        """Return the building with each of its matrices multiplied by a factor.

        Parameters
        ----------
        mass, stiffness, damping : float
            Factors > 0.
        """

    @abstractmethod
    def stacked_on(self, lower: LinearBuilding) -> LinearBuilding:
        """Return the building that has this one standing on the roof of another.

        Parameters
        ----------
        lower : LinearBuilding
            The lower part, for example the numerical substructure.

        Returns
        -------
        LinearBuilding
            The unpartitioned building of Eq. 3.
        """

    @abstractmethod
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

    @property
    @abstractmethod
    def interface_mass(self) -> float:
        """Force on the roof over its acceleration from rest, 1 / (M⁻¹)ₙₙ [kg]; the mass of the roof of a chain."""

    @abstractmethod
    def interface_shares(self) -> FloatArray:
        """Return the accelerations of the floors under a force on the roof, over that of the roof, shape (n,)."""

    @abstractmethod
    def interface_restoring(self) -> FloatArray:
        """Return the row of the restoring force at the roof: its acceleration is (f − row · [u, u̇]) / mass."""

    @property
    def stories(self) -> int:
        """Number of floors n."""
        return len(self.masses)

    @property
    def total_mass(self) -> float:
        """Sum of the masses of all floors [kg]."""
        return float(sum(self.masses))

    def scaled(self, factor: float) -> LinearBuilding:
        """Return the building with mass, stiffness and damping multiplied by one factor.

        Parameters
        ----------
        factor : float
            Factor > 0. Frequencies and damping ratios stay; every force is multiplied.
        """
        return self.with_factors(factor, factor, factor)

    def modes(self) -> Modes:
        """Return the undamped modes.

        Returns
        -------
        Modes
            All n modes, lowest frequency first.
        """
        return self._modes

    @cached_property
    def _modes(self) -> Modes:
        modes = modes_of(self.mass_matrix, self.damping_matrix, self.stiffness_matrix)
        for array in vars(modes).values():
            array.setflags(write=False)
        return modes


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
