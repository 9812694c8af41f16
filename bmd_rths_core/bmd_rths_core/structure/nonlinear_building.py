"""Non-linear numerical substructure: its parameters, and the building they describe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.explicit_integration import SystemMatrices
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import DAMPING_RATIO, DRIFT, FACTOR, LENGTH, POSITIVE_FACTOR, WEIGHT
from bmd_rths_core.structure.damping import check_length, damping_of_ratios
from bmd_rths_core.structure.linear_building import LinearBuilding, Modes, modes_of
from bmd_rths_core.structure.matrix_building import MatrixBuilding, rows_of
from bmd_rths_core.structure.shear_building import ShearBuilding, chain_of
from bmd_rths_core.structure.story_springs import BilinearSpring, BoucWenSpring, LinearSpring, StorySpring, StorySprings

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class NonlinearConfig:
    """Story springs, damping, P-Delta and integration of the numerical substructure; linear and exact by default."""

    SECTION: ClassVar[str] = "nonlinear"

    story_model: str = parameter(
        "linear",
        description="Story springs; elastic-perfectly-plastic is bilinear with a post_yield_ratio of 0",
        choices=("linear", "bilinear", "bouc_wen"),
    )
    yield_drifts: tuple[float, ...] = parameter(
        (),
        description="Story drift at first yield, one a story, for bilinear and bouc_wen; the yield force is this times "
        "the stiffness of the story",
        unit="m",
        **DRIFT,
    )
    post_yield_ratio: float = parameter(
        0.05,
        description="Stiffness after yield over initial stiffness",
        unit="1",
        source="assumed",
        lower=0.0,
        upper=1.0,
    )
    bouc_wen_a: float = parameter(
        1.0, description="A of the Bouc-Wen model", unit="1", source="Wen 1976", **POSITIVE_FACTOR
    )
    bouc_wen_beta: float = parameter(
        0.5,
        description="beta of the Bouc-Wen model",
        unit="1",
        source="assumed: A = beta + gamma makes the yield drift that of the bilinear model",
        **POSITIVE_FACTOR,
    )
    bouc_wen_gamma: float = parameter(
        0.5,
        description="gamma of the Bouc-Wen model, -beta < gamma <= beta",
        unit="1",
        source="assumed, as beta",
        **FACTOR,
    )
    bouc_wen_n: float = parameter(
        2.0, description="Sharpness n of the Bouc-Wen model", unit="1", source="assumed", lower=1.0, upper=50.0
    )
    damping: str = parameter(
        "coefficients",
        description="Viscous damping: that of numerical_substructure (its coefficients or its own damping), or from "
        "damping_ratios and initial stiffness",
        choices=("coefficients", "rayleigh", "modal"),
    )
    damping_ratios: tuple[float, ...] = parameter(
        (),
        description="Damping ratios: of the two rayleigh_modes for rayleigh; one for all modes or one a mode for modal",
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
    gravity_loads: tuple[float, ...] = parameter(
        (),
        description="Gravity load each story carries, the building above the interface included, for P-Delta; none for "
        "no P-Delta",
        unit="N",
        **WEIGHT,
    )
    story_heights: tuple[float, ...] = parameter(
        (), description="Story heights, one for each of gravity_loads", unit="m", **LENGTH
    )
    integration: str = parameter(
        "exact",
        description="Integration: exact (linear only), Chen-Ricles, Kolay-Ricles, or Newmark with gamma 1/2 and beta 0",
        source="Chen and Ricles 2008; Kolay and Ricles 2014; Newmark 1959",
        choices=("exact", "cr", "kr_alpha", "newmark_explicit"),
    )
    rho_infinity: float = parameter(
        0.75,
        description="Spectral radius of kr_alpha at infinite frequency; 1 has no numerical damping",
        unit="1",
        source="assumed, range of Kolay and Ricles 2014",
        lower=0.0,
        upper=1.0,
    )

    def __post_init__(self) -> None:
        """Check the values that need no other section."""
        check_parameters(self)
        if self.integration == "exact" and self.story_model != "linear":
            raise InputError(
                f"nonlinear.integration: exact is for story_model linear; for {self.story_model} one of cr, kr_alpha, "
                "newmark_explicit is required"
            )
        if not -self.bouc_wen_beta < self.bouc_wen_gamma <= self.bouc_wen_beta:
            raise InputError(
                f"nonlinear.bouc_wen_gamma: {self.bouc_wen_gamma:g} is not allowed; "
                f"> {-self.bouc_wen_beta:g} and <= {self.bouc_wen_beta:g}, the value of bouc_wen_beta, is required"
            )

    @property
    def linear_chain(self) -> bool:
        """True when the stories are those of `ShearBuilding`: linear, with their own dampers, without P-Delta."""
        return self.story_model == "linear" and self.damping == "coefficients" and not self.gravity_loads


@dataclass(frozen=True)
class NonlinearBuilding:
    """Shear building with any springs, a full damping matrix and P-Delta.

    Parameters
    ----------
    masses : ndarray, shape (n,)
        Floor masses from the ground up [kg].
    damping_matrix : ndarray, shape (n, n)
        C [N s/m].
    initial_stiffness_matrix : ndarray, shape (n, n)
        Tangent stiffness at rest, P-Delta included [N/m].
    highest_stiffness_matrix : ndarray, shape (n, n)
        That of stories at their highest tangent, P-Delta included [N/m].
    springs : tuple of StorySpring
        From the ground up; they carry the state of the building.
    geometric_stiffnesses : tuple of float
        P / h of each story [N/m].
    """

    masses: FloatArray
    damping_matrix: FloatArray
    initial_stiffness_matrix: FloatArray
    highest_stiffness_matrix: FloatArray
    springs: tuple[StorySpring, ...]
    geometric_stiffnesses: tuple[float, ...]

    def system(self) -> SystemMatrices:
        """Return the matrices an explicit integration is tuned to."""
        return SystemMatrices(np.diag(self.masses), self.damping_matrix, self.highest_stiffness_matrix)

    def elastic_modes(self) -> Modes:
        """Return the undamped modes of small motion about rest."""
        return modes_of(np.diag(self.masses), self.damping_matrix, self.initial_stiffness_matrix)

    def stories(self) -> StorySprings:
        """Return the stories as one restoring force."""
        return StorySprings(self.springs, self.geometric_stiffnesses)

    def below(self, upper: LinearBuilding, springs: tuple[StorySpring, ...] | None = None) -> NonlinearBuilding:
        """Return the building that has another one standing on its roof.

        Parameters
        ----------
        upper : ShearBuilding
            The upper part, for example the experimental substructure.
        springs : tuple of StorySpring, optional
            Its stories, with the stiffness of `upper` as their highest; linear by default.

        Returns
        -------
        NonlinearBuilding
            The unpartitioned building of Eq. 3. It shares the springs, and so their state, with this one.
        """
        chain = chain_of(upper, "nonlinear.story_model over the specimen")
        lower, n = len(self.masses), len(self.masses) + upper.stories

        def stacked(own: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
            matrix = np.zeros((n, n))
            matrix[:lower, :lower] = own
            for floor, coefficient in enumerate(coefficients, lower):
                matrix[floor - 1 : floor + 1, floor - 1 : floor + 1] += coefficient * _STORY
            return matrix

        return NonlinearBuilding(
            np.concatenate((self.masses, upper.masses)),
            stacked(self.damping_matrix, chain.damping_coefficients),
            stacked(self.initial_stiffness_matrix, chain.stiffnesses),
            stacked(self.highest_stiffness_matrix, chain.stiffnesses),
            self.springs + (springs or tuple(LinearSpring(stiffness) for stiffness in chain.stiffnesses)),
            self.geometric_stiffnesses + (0.0,) * upper.stories,
        )


#: What one story contributes to the matrix of the floors below and above it.
_STORY = np.array([[1.0, -1.0], [-1.0, 1.0]])


def elastic_building(building: LinearBuilding, config: NonlinearConfig) -> LinearBuilding:
    """Return the numerical substructure as far as it is linear: for small motion about rest, with P-Delta and damping.

    Parameters
    ----------
    building : LinearBuilding
        As the section numerical_substructure describes it.
    config : NonlinearConfig
        Springs, damping and P-Delta.

    Returns
    -------
    LinearBuilding
        The given one, where `config` adds nothing to it.

    Raises
    ------
    InputError
        See `nonlinear_building`; or what is given by matrices shall have stories.
    """
    if config.linear_chain:
        return building
    if isinstance(building, ShearBuilding):
        elastic = nonlinear_building(building, config)
        mass, damping = np.diag(elastic.masses), elastic.damping_matrix
        return MatrixBuilding(rows_of(mass), rows_of(damping), rows_of(elastic.initial_stiffness_matrix))
    if config.story_model != "linear" or config.gravity_loads:
        raise InputError(
            "nonlinear: numerical_substructure has matrices; story_model linear and no gravity_loads are required"
        )
    damping = _damping_matrix(building, config)
    return MatrixBuilding(rows_of(building.mass_matrix), rows_of(damping), rows_of(building.stiffness_matrix))


def nonlinear_building(building: LinearBuilding, config: NonlinearConfig) -> NonlinearBuilding:
    """Return the building that has the stories of a configuration, in their virgin state.

    Parameters
    ----------
    building : ShearBuilding
        Masses, initial stiffnesses and damping coefficients.
    config : NonlinearConfig
        Springs, damping and P-Delta.

    Returns
    -------
    NonlinearBuilding

    Raises
    ------
    InputError
        A list does not have one entry a story, the gravity loads buckle a story, or damping would be negative.
    """
    if not isinstance(building, ShearBuilding):
        raise InputError("nonlinear: stories are required, numerical_substructure has matrices")
    springs = _springs(building, config)
    geometric = _geometric_stiffnesses(building, config)
    for story, (spring, load) in enumerate(zip(springs, geometric, strict=True)):
        if load >= spring.initial_stiffness:
            raise InputError(
                f"nonlinear.gravity_loads: story {story + 1} buckles; load over height is {load:g} N/m, "
                f"< {spring.initial_stiffness:g} N/m, its initial stiffness, is required"
            )

    def matrix(stiffnesses: list[float]) -> FloatArray:
        net = tuple(k - g for k, g in zip(stiffnesses, geometric, strict=True))
        return ShearBuilding(building.masses, net, building.damping_coefficients).stiffness_matrix

    return NonlinearBuilding(
        np.asarray(building.masses),
        _damping_matrix(building, config),
        matrix([spring.initial_stiffness for spring in springs]),
        matrix([spring.highest_stiffness for spring in springs]),
        springs,
        geometric,
    )


def _springs(building: ShearBuilding, config: NonlinearConfig) -> tuple[StorySpring, ...]:
    if config.story_model == "linear":
        return tuple(LinearSpring(k) for k in building.stiffnesses)
    check_length(NonlinearConfig.SECTION, "yield_drifts", config.yield_drifts, building.stories, "one a story")
    pairs = zip(building.stiffnesses, config.yield_drifts, strict=True)
    if config.story_model == "bilinear":
        return tuple(BilinearSpring(k, drift, config.post_yield_ratio) for k, drift in pairs)
    shape = config.bouc_wen_a, config.bouc_wen_beta, config.bouc_wen_gamma, config.bouc_wen_n
    return tuple(BoucWenSpring(k, drift, config.post_yield_ratio, *shape) for k, drift in pairs)


def _geometric_stiffnesses(building: ShearBuilding, config: NonlinearConfig) -> tuple[float, ...]:
    if not config.gravity_loads:
        return (0.0,) * building.stories
    check_length(NonlinearConfig.SECTION, "gravity_loads", config.gravity_loads, building.stories, "one a story")
    check_length(NonlinearConfig.SECTION, "story_heights", config.story_heights, building.stories, "one a story")
    return tuple(load / height for load, height in zip(config.gravity_loads, config.story_heights, strict=True))


def _damping_matrix(building: LinearBuilding, config: NonlinearConfig) -> FloatArray:
    if config.damping == "coefficients":
        return building.damping_matrix
    return damping_of_ratios(config.SECTION, building, config.damping, config.damping_ratios, config.rayleigh_modes)
