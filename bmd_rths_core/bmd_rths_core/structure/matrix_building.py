"""Building by its matrices, for example a condensed finite-element model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.physical_bounds import LARGEST_FREQUENCY
from bmd_rths_core.structure.linear_building import LinearBuilding

FloatArray = NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]

#: Difference of a matrix to its transpose, over its largest entry, that is rounding of whoever wrote it.
_ASYMMETRY = 1e-6
#: Negative eigenvalue, over the largest one, that is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class MatrixBuilding(LinearBuilding):
    """A building by symmetric matrices, rows of them from the bottom to the top.

    Parameters
    ----------
    mass, damping, stiffness : tuple of tuple of float
        M [kg] and K [N/m], positive definite, and C [N s/m].
    """

    mass: Rows
    damping: Rows
    stiffness: Rows

    @property
    def masses(self) -> tuple[float, ...]:  # type: ignore[override]
        """M 1 [kg]."""
        return tuple(self.mass_matrix.sum(axis=1).tolist())

    @property
    def mass_matrix(self) -> FloatArray:
        """M [kg], shape (n, n)."""
        return np.array(self.mass)

    @property
    def stiffness_matrix(self) -> FloatArray:
        """K [N/m], shape (n, n)."""
        return np.array(self.stiffness)

    @property
    def damping_matrix(self) -> FloatArray:
        """C [N s/m], shape (n, n)."""
        return np.array(self.damping)

    def with_factors(self, mass: float = 1.0, stiffness: float = 1.0, damping: float = 1.0) -> MatrixBuilding:
        """Return the building with each of its matrices multiplied by a factor.

        Parameters
        ----------
        mass, stiffness, damping : float
            Factors > 0.
        """
        factors = (mass, self.mass_matrix), (damping, self.damping_matrix), (stiffness, self.stiffness_matrix)
        return MatrixBuilding(*(rows_of(factor * matrix) for factor, matrix in factors))

    def stacked_on(self, lower: LinearBuilding) -> MatrixBuilding:
        """Return the building that has this one standing on the roof of another.

        Parameters
        ----------
        lower : LinearBuilding
            The lower part.
        """
        return stacked(self, lower)

    def relative_motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the state space of the motion relative to the base, driven by the base acceleration."""
        n = self.stories
        c = -_solved(self.mass_matrix, np.hstack((self.stiffness_matrix, self.damping_matrix)))
        a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), c))
        b = np.concatenate((np.zeros(n), -np.ones(n)))[:, None]
        return a, b, c

    @property
    def interface_mass(self) -> float:
        """Force on the roof over its acceleration from rest [kg]."""
        return 1.0 / float(self._by_roof()[-1])

    def interface_shares(self) -> FloatArray:
        """Return the accelerations of the floors under a force on the roof, over that of the roof."""
        by_roof = self._by_roof()
        return np.asarray(by_roof / by_roof[-1])

    def interface_restoring(self) -> FloatArray:
        """Return the row of the restoring force at the roof."""
        return np.asarray(self.interface_shares() @ np.hstack((self.stiffness_matrix, self.damping_matrix)))

    def _by_roof(self) -> FloatArray:
        return _solved(self.mass_matrix, np.eye(self.stories)[-1])


def matrix_building(section: str, mass: ArrayLike, damping: ArrayLike, stiffness: ArrayLike) -> MatrixBuilding:
    """Return a building by its matrices, naming the section when they are not those of a building.

    Parameters
    ----------
    section : str
        Name of the section.
    mass, damping, stiffness : array_like, shape (n, n)
        M [kg], C [N s/m] and K [N/m].

    Raises
    ------
    InputError
        They are not symmetric, M or K is not positive definite, C takes no energy, or a mode is faster than what is
        integrated exactly.
    """
    m = _symmetric(f"{section}.mass_matrix", mass)
    k = _symmetric(f"{section}.stiffness_matrix", stiffness)
    c = _symmetric(f"{section}.damping_matrix", damping)
    for name, matrix, lowest in (("mass", m, _ROUNDING), ("stiffness", k, 0.0), ("damping", c, -_ROUNDING)):
        values = np.linalg.eigvalsh(matrix)
        if values[0] < lowest * values[-1] or (name != "damping" and values[0] <= 0.0):
            wanted = "no energy may come from it" if name == "damping" else "it has to be positive definite"
            raise InputError(f"{section}.{name}_matrix: smallest eigenvalue {values[0]:.3g}; {wanted}")
    if (m.sum(axis=1) <= 0.0).any():
        raise InputError(f"{section}.mass_matrix: a row adds up to {m.sum(axis=1).min():.3g} kg; > 0 kg is required")
    building = MatrixBuilding(rows_of(m), rows_of(c), rows_of(k))
    highest = float(building.modes().frequencies[-1])
    if highest > LARGEST_FREQUENCY:
        raise InputError(
            f"{section}.stiffness_matrix: a mode of {highest:.3g} rad/s; at most {LARGEST_FREQUENCY:g} rad/s is "
            "integrated exactly; condense the model to fewer degrees of freedom"
        )
    return building


def stacked(upper: LinearBuilding, lower: LinearBuilding) -> MatrixBuilding:
    """Return a building on the roof of another, u of all floors relative to the ground.

    Parameters
    ----------
    upper, lower : LinearBuilding
        K of the upper one acts on u − 1 u_roof, and what it takes from there acts on the roof.
    """
    below, above = lower.stories, upper.stories

    def coupled(lower_matrix: FloatArray, upper_matrix: FloatArray) -> FloatArray:
        whole = np.zeros((below + above, below + above))
        whole[:below, :below], whole[below:, below:] = lower_matrix, upper_matrix
        of_roof = upper_matrix.sum(axis=1)
        whole[below - 1, below - 1] += of_roof.sum()
        whole[below - 1, below:] = whole[below:, below - 1] = -of_roof
        return whole

    mass = np.zeros((below + above, below + above))
    mass[:below, :below], mass[below:, below:] = lower.mass_matrix, upper.mass_matrix
    damping = coupled(lower.damping_matrix, upper.damping_matrix)
    stiffness = coupled(lower.stiffness_matrix, upper.stiffness_matrix)
    return MatrixBuilding(rows_of(mass), rows_of(damping), rows_of(stiffness))


def rows_of(matrix: FloatArray) -> Rows:
    """Return a matrix as tuples."""
    return tuple(tuple(row) for row in matrix.tolist())


def _symmetric(name: str, values: ArrayLike) -> FloatArray:
    matrix = np.asarray(values, dtype=float)
    largest = float(np.abs(matrix).max(initial=0.0))
    i, j = np.unravel_index(int(np.argmax(np.abs(matrix - matrix.T))), matrix.shape)
    if abs(matrix[i, j] - matrix[j, i]) > _ASYMMETRY * largest:
        raise InputError(
            f"{name}: entries {i + 1},{j + 1} and {j + 1},{i + 1} are {matrix[i, j]:g} and {matrix[j, i]:g}; "
            "a symmetric matrix is required"
        )
    return np.asarray(0.5 * (matrix + matrix.T))


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
