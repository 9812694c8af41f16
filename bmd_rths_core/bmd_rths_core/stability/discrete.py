"""Stability of the loop as it runs: the eigenvalues of all its stages, closed, from one step to the next.

Nothing is idealised: the first-order hold of both loads, the command shaper, the zero-order hold and the fractional
delay of the table, the estimator, the force correction and the step between shear and feedback are the matrices of the
stages themselves (their ``state_space()``).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.assembly import (
    make_command_shaper,
    make_force_correction,
    make_numerical_substructure,
    make_shear_estimator,
    make_table_controller,
)
from bmd_rths_core.config import Config
from bmd_rths_core.discretisation import DiscreteStateSpace
from bmd_rths_core.errors import InputError
from bmd_rths_core.shear_building import mass_ratio
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, StabilityMargin, StableInterval
from bmd_rths_core.stability.models import first_effective_mass
from bmd_rths_core.table.simulated import SimulatedTable

FloatArray = NDArray[np.float64]

#: Mass ratios at which the spectral radius is looked at before it is bisected.
SCAN_POINTS = 400
#: A stable interval ends where its ends are known to this ratio [1].
_TOLERANCE = 1e-12


@dataclass(frozen=True)
class ClosedLoop:
    """The assembled loop, x[k+1] = A x[k] + B a_g[k], y[k] = C x[k] + D a_g[k].

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n,)
    c : ndarray, shape (p, n)
    d : ndarray, shape (p,)
    outputs : tuple of str
        Names of the p outputs, those of `RunRecord`; floors are ``floor_1`` and so on.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    outputs: tuple[str, ...]

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of the eigenvalues; the loop is stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.a)).max())

    def simulate(self, ground_acceleration: FloatArray) -> dict[str, FloatArray]:
        """Run the linear system from rest.

        Parameters
        ----------
        ground_acceleration : ndarray, shape (N,)
            a_g at the steps [m/s²]; the first should be 0, see `NumericalSubstructure.state_space`.

        Returns
        -------
        dict of str to ndarray, shape (N,)
            The outputs by name.
        """
        state = np.zeros(len(self.a))
        rows = np.empty((len(ground_acceleration), len(self.outputs)))
        for k, acceleration in enumerate(ground_acceleration.tolist()):
            rows[k] = self.c @ state + self.d * acceleration
            state = self.a @ state + self.b * acceleration
        return {name: rows[:, i] for i, name in enumerate(self.outputs)}


def closed_loop(config: Config) -> ClosedLoop:
    """Assemble the loop of a configuration, with the simulated table.

    Parameters
    ----------
    config : Config
        The whole configuration; noise and limits do not matter here.

    Returns
    -------
    ClosedLoop

    Raises
    ------
    InputError
        The configured table is not the simulated one.

    Notes
    -----
    A yielding numerical substructure is taken as linear about rest, with its own integration.
    """
    table = make_table_controller(config)
    if not isinstance(table, SimulatedTable):
        raise InputError(f"table.controller: {config.table.controller} has no model; simulated is required")
    stages = {
        "numerical": make_numerical_substructure(config).state_space(),
        "shaper": make_command_shaper(config).state_space(),
        "table": table.state_space(),
        "estimator": make_shear_estimator(config).state_space(),
        "correction": make_force_correction(config).state_space(),
    }
    # A signal is a row: what it takes of the state of the loop and, last, of the ground acceleration. The first state
    # is the shear fed back, the others are those of the stages.
    size = 1 + sum(len(stage.a) for stage in stages.values())
    feedback, ground = np.eye(1, size + 1), np.eye(1, size + 1, size)
    own, begin = {}, 1
    for name, stage in stages.items():
        own[name] = np.eye(len(stage.a), size + 1, begin)
        begin += len(stage.a)
    following: dict[str, FloatArray] = {}

    def run(name: str, *inputs: FloatArray) -> FloatArray:
        stage: DiscreteStateSpace = stages[name]
        signals = np.vstack(inputs)
        following[name] = stage.a @ own[name] + stage.b @ signals
        return stage.c @ own[name] + stage.d @ signals

    response = run("numerical", ground, feedback)
    command = run("shaper", response[:1])
    sensors = run("table", command)
    shear = run("estimator", sensors)
    corrected = run("correction", response[1:], shear)
    transition = np.vstack((corrected, *(following[name] for name in stages)))
    output = np.vstack((response, command, sensors, shear, corrected))
    floors = tuple(f"floor_{i + 1}" for i in range(len(config.specimen.masses)))
    return ClosedLoop(
        a=transition[:, :-1],
        b=transition[:, -1],
        c=output[:, :-1],
        d=output[:, -1],
        outputs=(
            *("desired_acceleration", "required_force", "command", "table_acceleration"),
            *(*floors, "base_shear", "interface_force", "corrected_force"),
        ),
    )


def with_mass_ratio(config: Config, ratio: float) -> Config:
    """Return a configuration with another mass ratio; the numerical substructure keeps frequencies and damping ratios.

    Parameters
    ----------
    config : Config
        The whole configuration.
    ratio : float
        ρ as `configured_mass_ratio` has it, > 0 and < 1.

    Returns
    -------
    Config
        Masses, stiffnesses, damping coefficients and gravity loads of the numerical substructure are multiplied by one
        factor.

    Raises
    ------
    InputError
        The ratio is not between 0 and 1.
    """
    if not 0.0 < ratio < 1.0:
        raise InputError(f"mass ratio: {ratio:g} is not allowed; > 0 and < 1 is required")
    numerical = config.numerical_substructure
    factor = _fed_back_mass(config) * (1.0 - ratio) / ratio / first_effective_mass(numerical.building())
    scaled = {
        name: tuple(factor * value for value in getattr(numerical, name))
        for name in ("masses", "stiffnesses", "damping_coefficients")
    }
    loads = tuple(factor * load for load in config.nonlinear.gravity_loads)
    return dataclasses.replace(
        config,
        numerical_substructure=dataclasses.replace(numerical, **scaled),
        nonlinear=dataclasses.replace(config.nonlinear, gravity_loads=loads),
    )


def configured_mass_ratio(config: Config) -> float:
    """Return the mass ratio of a configuration (Eq. 8).

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    float
        ρ with first effective modal masses; that of the experimental substructure counts as far as its shear is fed
        back (``force_correction.feedback_scale``).
    """
    return mass_ratio(_fed_back_mass(config), first_effective_mass(config.numerical_substructure.building()))


def discrete_margin(config: Config, largest: float = LARGEST_MASS_RATIO, points: int = SCAN_POINTS) -> StabilityMargin:
    """Return the allowable mass ratio of the loop as it runs.

    Parameters
    ----------
    config : Config
        The whole configuration; its own mass ratio does not matter.
    largest : float
        Largest mass ratio to examine, between 0 and 1.
    points : int
        Mass ratios to scan, half of them evenly spaced and half by powers. An interval of stability or instability
        that lies between two of them is missed; everything else is bisected.

    Returns
    -------
    StabilityMargin
        Critical frequencies are angles of the critical eigenvalue over Δt, at most π/Δt.

    Notes
    -----
    Only the shear that drives the numerical substructure is divided by its mass, so that the matrix of the closed loop
    is A₀ + (m_E/m_N) A₁; two assemblies give both.
    """
    one, two = (closed_loop(with_mass_ratio(config, ratio)).a for ratio in (0.5, 2.0 / 3.0))  # m_E/m_N = 1 and 2
    change = two - one

    def critical(ratio: float | FloatArray) -> tuple[FloatArray, FloatArray]:
        gain = np.asarray(ratio / (1.0 - ratio))[..., None, None]
        eigenvalues = np.linalg.eigvals(one + (gain - 1.0) * change)
        worst = np.take_along_axis(eigenvalues, np.abs(eigenvalues).argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return np.abs(worst), np.abs(np.angle(worst)) / config.run.time_step

    def end(lower: float, upper: float, stable_below: bool) -> tuple[float, float]:
        while upper - lower > _TOLERANCE:
            middle = 0.5 * (lower + upper)
            radius, _ = critical(middle)
            lower, upper = (middle, upper) if (radius < 1.0) == stable_below else (lower, middle)
        return lower if stable_below else upper, float(critical(lower if stable_below else upper)[1])

    half = points // 2
    scan = np.union1d(np.linspace(largest / half, largest, half), np.geomspace(1e-4, largest, half))
    stable = critical(scan)[0] < 1.0
    intervals = []
    lower, lower_frequency = 0.0, np.nan
    for k in range(1, len(scan)):
        if stable[k] == stable[k - 1]:
            continue
        ratio, frequency = end(float(scan[k - 1]), float(scan[k]), bool(stable[k - 1]))
        if stable[k]:
            lower, lower_frequency = ratio, frequency
        else:
            intervals.append(StableInterval(lower, ratio, lower_frequency, frequency))
    if stable[-1]:
        intervals.append(StableInterval(lower, largest, lower_frequency, np.nan))
    if not stable[0]:
        return StabilityMargin(0.0, np.nan, tuple(intervals))
    return StabilityMargin(intervals[0].upper, intervals[0].upper_frequency, tuple(intervals))


def _fed_back_mass(config: Config) -> float:
    return config.force_correction.feedback_scale * first_effective_mass(config.specimen.building())
