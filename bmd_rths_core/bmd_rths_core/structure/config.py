"""Parameters of a building: by stories or by matrices, with damping as coefficients, modal ratios or Rayleigh."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import DAMPING, DAMPING_RATIO, MASS, STIFFNESS
from bmd_rths_core.structure.damping import damping_of_ratios
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.matrix_building import matrix_building, rows_of
from bmd_rths_core.structure.matrix_file import read_matrices
from bmd_rths_core.structure.shear_building import ShearBuilding, stories

FloatArray = NDArray[np.float64]

#: Parameters that take the place of stories, and the stories they take the place of.
MATRICES = ("mass_matrix", "stiffness_matrix", "damping_matrix")
STORIES = ("masses", "stiffnesses", "damping_coefficients")

#: Path of a file that there is none of.
NO_FILE = "none"

#: Difference of masses and row sums of M that is rounding.
_SAME_MASS = 1e-6


def _matrix(description: str, unit: str, largest: float) -> tuple[float, ...]:
    matrix: tuple[float, ...] = parameter(
        (), description=description, unit=unit, source="filled in from matrices", lower=-largest, upper=largest
    )
    return matrix


@dataclass(frozen=True)
class BuildingConfig:
    """A building, floors from the bottom to the top. Where matrices are given, ``masses`` are their row sums."""

    SECTION: ClassVar[str]

    masses: tuple[float, ...] = parameter((), description="Floor masses", unit="kg", **MASS)
    stiffnesses: tuple[float, ...] = parameter((), description="Story stiffnesses", unit="N/m", **STIFFNESS)
    damping_coefficients: tuple[float, ...] = parameter(
        (), description="Story damping coefficients", unit="N s/m", **DAMPING
    )
    damping: str = parameter(
        "coefficients",
        description="Viscous damping: damping_coefficients (or C of the matrices), or from damping_ratios and initial "
        "stiffness, which make damping_coefficients of no account",
        choices=("coefficients", "modal", "rayleigh"),
    )
    damping_ratios: tuple[float, ...] = parameter(
        (),
        description="Damping ratios: one for all modes or one a mode for modal, of the two rayleigh_modes for rayleigh",
        unit="1",
        **DAMPING_RATIO,
    )
    rayleigh_modes: tuple[float, ...] = parameter(
        (1.0, 2.0),
        description="The two modes whose damping ratios rayleigh meets, from 1",
        unit="1",
        lower=1.0,
        upper=1000.0,
    )
    matrices: str = parameter(
        NO_FILE,
        description="File (CSV, NPZ, MAT) with matrices M, K and C in place of stories, one horizontal degree of "
        "freedom a floor from the bottom to the top; none for stories",
    )
    mass_matrix: tuple[float, ...] = _matrix("M, row by row; empty for stories", "kg", 1e8)
    stiffness_matrix: tuple[float, ...] = _matrix("K, row by row; empty for stories", "N/m", 1e12)
    damping_matrix: tuple[float, ...] = _matrix("C, row by row; empty where damping is of ratios", "N s/m", 1e10)

    def __post_init__(self) -> None:
        """Check the values; read the matrices of a file."""
        if not self.matrices:
            raise InputError(f"{self.SECTION}.matrices: empty; a file, or {NO_FILE} for stories, is required")
        if self.matrices != NO_FILE and not self.stiffness_matrix:
            self._read()
        if self.stiffness_matrix:
            self._replace_stories()
        check_parameters(self)
        self.building()

    def building(self) -> LinearBuilding:
        """Return the building.

        Raises
        ------
        InputError
            The parameters do not fit each other.
        """
        return self._building

    @cached_property
    def _building(self) -> LinearBuilding:
        if self.stiffness_matrix:
            return self._by_matrices()
        if self.damping == "coefficients":
            return stories(self.SECTION, self.masses, self.stiffnesses, self.damping_coefficients)
        bare = stories(self.SECTION, self.masses, self.stiffnesses, (0.0,) * len(self.masses))
        return ShearBuilding(bare.masses, bare.stiffnesses, bare.damping_coefficients, rows_of(self._of_ratios(bare)))

    def _by_matrices(self) -> LinearBuilding:
        mass, stiffness = self._square("mass_matrix"), self._square("stiffness_matrix")
        bare = matrix_building(self.SECTION, mass, np.zeros_like(mass), stiffness)
        if self.damping == "coefficients":
            if not self.damping_matrix:
                raise InputError(
                    f"{self.SECTION}.damping: coefficients, but there is no matrix C; a C in "
                    f"{'damping_matrix' if self.matrices == NO_FILE else self.matrices}, "
                    "or damping modal or rayleigh with damping_ratios, is required"
                )
            return matrix_building(self.SECTION, mass, self._square("damping_matrix"), stiffness)
        return matrix_building(self.SECTION, mass, self._of_ratios(bare), stiffness)

    def _of_ratios(self, bare: LinearBuilding) -> FloatArray:
        return damping_of_ratios(self.SECTION, bare, self.damping, self.damping_ratios, self.rayleigh_modes)

    def _read(self) -> None:
        try:
            found = read_matrices(self.matrices)
        except InputError as error:
            raise InputError(f"{self.SECTION}.matrices: {error}") from error
        for key, name in (("mass_matrix", "M"), ("stiffness_matrix", "K"), ("damping_matrix", "C")):
            matrix = found.get(name)
            object.__setattr__(self, key, () if matrix is None else tuple(matrix.ravel().tolist()))

    def _replace_stories(self) -> None:
        defaults = {f.name: f.default for f in fields(self)}
        for key in STORIES[1:]:
            if getattr(self, key) not in ((), defaults[key]):
                raise InputError(f"{self.SECTION}.{key}: beside matrices; stories or matrices are required, not both")
            object.__setattr__(self, key, ())
        sums = tuple(self._square("mass_matrix").sum(axis=1).tolist())
        close = len(self.masses) == len(sums) and np.allclose(self.masses, sums, rtol=_SAME_MASS, atol=0.0)
        if not close and self.masses not in ((), defaults["masses"]):
            raise InputError(f"{self.SECTION}.masses: beside matrices leave them out, they are the row sums of M")
        object.__setattr__(self, "masses", sums)

    def _square(self, key: str) -> FloatArray:
        values = np.asarray(getattr(self, key), dtype=float)
        n = round(float(np.sqrt(len(self.stiffness_matrix))))
        if len(values) != n * n or not n:
            raise InputError(
                f"{self.SECTION}.{key}: {len(values)} entries; {n * n} are required, as many as stiffness_matrix has"
            )
        return values.reshape(n, n)
