"""Stability of the loop as it runs: the eigenvalues of all its stages, closed, from one step to the next.

Nothing is idealised: the first-order hold of both loads, the command shaper, the zero-order hold and the fractional
delay of the table, the estimator, the force correction and the step between shear and feedback are the matrices of the
stages themselves (their ``state_space()``).
"""

from __future__ import annotations

import dataclasses
from itertools import takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_force_correction
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.linear_loop import ClosedLoop
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, StabilityMargin, StableInterval
from bmd_rths_core.stability.crossings import Cells, halved_towards, positive_real_crossings
from bmd_rths_core.stability.models import first_effective_mass
from bmd_rths_core.stability.unit_circle import transfer_function
from bmd_rths_core.structure.config import MATRICES, STORIES
from bmd_rths_core.structure.shear_building import mass_ratio

FloatArray = NDArray[np.float64]

_LOWEST, *_INNER, _HIGHEST = np.linspace(1e-6, np.pi, 129).tolist()
#: Angles of the unit circle to begin with [rad]; any give the same result. Below the first one inertia is too small for
#: anything to be critical. At z = −1 the function is real.
_FIRST_ANGLES = np.concatenate(
    (
        [_LOWEST],
        halved_towards(_LOWEST, _INNER[0])[:0:-1],
        _INNER[:-1],
        halved_towards(_HIGHEST, _INNER[-1]),
        [_HIGHEST],
    )
)
#: Critical ratios nearer to each other than this, relatively, count as one.
_SAME_RATIO = 1e-9
#: A share of the shear below this is none but for rounding.
_NO_SHARE = 1e-9


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
    scaled: dict[str, Any] = {
        name: tuple(factor * value for value in getattr(numerical, name)) for name in (*STORIES, *MATRICES)
    }
    loads = tuple(factor * load for load in config.nonlinear.gravity_loads)
    return dataclasses.replace(
        config,
        numerical_substructure=dataclasses.replace(numerical, **scaled),
        nonlinear=dataclasses.replace(config.nonlinear, gravity_loads=loads),
    )


def with_feedback_scale(config: Config, scale: float) -> Config:
    """Return a configuration with another share of the shear fed back.

    Parameters
    ----------
    config : Config
        The whole configuration.
    scale : float
        ``force_correction.feedback_scale``, > 0 and at most 1.

    Returns
    -------
    Config
    """
    correction = dataclasses.replace(config.force_correction, feedback_scale=scale)
    return dataclasses.replace(config, force_correction=correction)


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


def discrete_margin(
    config: Config, largest: float = LARGEST_MASS_RATIO, loop: ClosedLoop | None = None
) -> StabilityMargin:
    """Return the allowable mass ratio of the loop as it runs.

    Parameters
    ----------
    config : Config
        The whole configuration; its own mass ratio does not matter.
    largest : float
        Largest mass ratio to examine, between 0 and 1.
    loop : ClosedLoop, optional
        `closed_loop` of this configuration, where it has been assembled already.

    Returns
    -------
    StabilityMargin
        Critical frequencies are angles of the critical eigenvalue over Δt, at most π/Δt.

    Notes
    -----
    The share s of the shear that is fed back enters one row of the closed loop, A = A₀ + s e₁ cᵀ, and s stands to 1 as
    m_E/m_N to its value for the whole shear. So an eigenvalue e^{jθ} has 1 = s cᵀ (e^{jθ} − A₀)⁻¹ e₁, and every
    critical s is a crossing of the positive real axis by this transfer function, all of which `crossings` finds. Which
    of the intervals between them are stable is told by the eigenvalues in their middle.
    """
    if config.numerical_substructure.substeps > 1:
        raise InputError(
            f"numerical_substructure.substeps: {config.numerical_substructure.substeps}, with which the shear enters "
            "more than one row of the loop; substepped_margin is required"
        )
    open_loop, feedback = opened(config, closed_loop(config) if loop is None else loop)
    whole = configured_mass_ratio(with_feedback_scale(config, 1.0))
    highest = largest / (1.0 - largest) * (1.0 - whole) / whole
    shares, angles = _critical_shares(open_loop, feedback, highest)
    ends = np.concatenate(([0.0], shares, [highest]))
    middle = 0.5 * (ends[1:] + ends[:-1])
    entering = np.zeros_like(open_loop)
    entering[0] = feedback
    radii = np.abs(np.linalg.eigvals(open_loop + middle[:, None, None] * entering)).max(axis=-1)
    ratios = ends * whole / (1.0 - whole + ends * whole)
    ratios[-1] = largest
    frequencies = np.concatenate(([np.nan], angles / config.run.time_step, [np.nan]))
    intervals = _stable_intervals(ratios.tolist(), frequencies.tolist(), radii < 1.0)
    if not intervals or intervals[0].lower > 0.0:
        return StabilityMargin(0.0, np.nan, intervals)
    return StabilityMargin(intervals[0].upper, intervals[0].upper_frequency, intervals)


def _stable_intervals(
    ratios: list[float], frequencies: list[float], stable: NDArray[np.bool_]
) -> tuple[StableInterval, ...]:
    """Join neighbouring stable intervals: what is between them touches the unit circle without crossing it."""
    intervals: list[StableInterval] = []
    for k in np.flatnonzero(stable).tolist():
        lower, lower_frequency = ratios[k], frequencies[k]
        if intervals and intervals[-1].upper == lower:
            lower, _, lower_frequency, _ = intervals.pop()
        intervals.append(StableInterval(lower, ratios[k + 1], lower_frequency, frequencies[k + 1]))
    return tuple(intervals)


def opened(config: Config, loop: ClosedLoop) -> tuple[FloatArray, FloatArray]:
    """Return A₀, the loop with no shear fed back, and cᵀ, what of its state the whole shear is.

    Parameters
    ----------
    config : Config
        The whole configuration.
    loop : ClosedLoop
        Its loop.
    """
    system, outputs = loop.system, loop.outputs
    shear = make_force_correction(config).state_space().d[0, 1] * system.c[outputs.index("interface_force")]
    open_loop = system.a.copy()
    open_loop[0] -= shear
    return open_loop, shear / config.force_correction.feedback_scale


def _critical_shares(open_loop: FloatArray, feedback: FloatArray, highest: float) -> tuple[FloatArray, FloatArray]:
    """Return all shares of the shear below a limit for which an eigenvalue is on the unit circle, and its angle."""
    # A shear that is constant or rises steadily accelerates nothing: two zeros at z = 1.
    function = transfer_function(open_loop, np.eye(len(open_loop))[0], feedback, (1.0, 2))

    def response(theta: FloatArray, loop: NDArray[np.intp]) -> NDArray[np.complex128]:
        return function.response(np.exp(1j * theta))

    def variation(theta: FloatArray, loop: NDArray[np.intp]) -> FloatArray:
        return function.phase_variation(theta)

    # Where inertia is too small for any share up to the highest to be critical, nothing is searched.
    too_low = takewhile(lambda theta: highest * function.gain_bound(theta) < 1.0, _FIRST_ANGLES)
    theta = _FIRST_ANGLES[max(0, len(list(too_low)) - 1) :]
    first = np.zeros(len(theta) - 1, dtype=np.intp)
    value, varied = response(theta, first), variation(theta, first)
    cells = Cells(first, theta[:-1], theta[1:], value[:-1], value[1:], varied[:-1], varied[1:])
    crossings = positive_real_crossings(response, variation, cells)
    # At z = −1 the function is real; no crossing is needed to be critical there.
    values = np.append(crossings.value, value[-1].real)
    angles = np.append(crossings.frequency, np.pi)
    reached = values * highest > 1.0
    shares, angles = 1.0 / values[reached], angles[reached]
    order = np.argsort(shares)
    shares, angles = shares[order], angles[order]
    apart = np.diff(shares, prepend=0.0) > np.maximum(_SAME_RATIO * shares, _NO_SHARE)
    return shares[apart], angles[apart]


def _fed_back_mass(config: Config) -> float:
    return config.force_correction.feedback_scale * first_effective_mass(config.specimen.building())
