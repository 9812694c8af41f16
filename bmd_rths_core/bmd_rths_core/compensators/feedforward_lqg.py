"""Model-based feedforward with LQG feedback (Phillips and Spencer 2013, J. Struct. Eng. 139, 1205-1214)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.inverse import inverse_system
from bmd_rths_core.compensators.linear_shaper import LinearShaper
from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import POSITIVE_FACTOR, VARIANCE


@dataclass(frozen=True)
class FeedforwardLqgConfig:
    """How far the table is inverted, and what the feedback weighs."""

    SECTION: ClassVar[str] = "ff_lqg"

    low_pass_frequency: float = parameter(
        60.0,
        description="Frequency at which the Bessel low-pass of the inverse takes 3 dB; below half the rate of the loop",
        unit="Hz",
        source="tuned on the simulated table",
        lower=0.1,
        upper=5e3,
    )
    error: float = parameter(
        0.3,
        description="Error of the feedforward the observer assumes at the table, root mean square",
        unit="m/s2",
        source="tuned on the simulated table",
        **VARIANCE,
    )
    error_frequency: float = parameter(
        5.0,
        description="Frequency up to which that error has its power: the pole of the shaping filter",
        unit="Hz",
        source="tuned on the simulated table",
        lower=1e-3,
        upper=1e3,
    )
    command_weight: float = parameter(
        1.0,
        description="Weight of the command of the feedback relative to the error of the table",
        unit="1",
        source="tuned on the simulated table",
        **POSITIVE_FACTOR,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


def make_feedforward_lqg(known: Known) -> LinearShaper:
    """Return feedforward and feedback as one linear system.

    Parameters
    ----------
    known : Known
        With an identified table; its settings are a `FeedforwardLqgConfig`.

    Returns
    -------
    LinearShaper

    Raises
    ------
    InputError
        See `inverse.inverse_system`; or the Riccati equations have no solution.

    Notes
    -----
    The feedforward is Q(z) of `inverse`. What the table differs from the desired acceleration, y = a_t − a_N, is taken
    as the answer of the table to the command of the feedback plus an error w, white noise through a low-pass of first
    order: x⁺ = A x + B u, w⁺ = φ w + √(1 − φ²) σ n, y = C x + w. Kalman filter and linear-quadratic regulator of that
    system give u = −K x̂, as Phillips and Spencer have it for displacements.
    """
    from scipy.linalg import block_diag, solve_discrete_are  # not before it is needed

    settings: FeedforwardLqgConfig = known.settings
    forward = inverse_system(known, settings.low_pass_frequency, "ff_lqg")
    table = held_table(known, "ff_lqg")
    shaped = float(np.exp(-2.0 * np.pi * settings.error_frequency * known.time_step))
    a = block_diag(table.transition, [[shaped]])
    b = np.vstack((table.command, [[0.0]]))
    c = np.hstack((table.acceleration, [[1.0]]))
    process = np.zeros_like(a)
    process[-1, -1] = (1.0 - shaped**2) * settings.error**2
    noise, weight = np.array([[known.noise.acceleration**2]]), np.array([[settings.command_weight]])
    try:
        prior = solve_discrete_are(a.T, c.T, process, noise)
        cost = solve_discrete_are(a, b, c.T @ c, weight)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise InputError(f"ff_lqg: the Riccati equations have no solution for this table ({problem})") from problem
    kalman = prior @ c.T @ np.linalg.inv(c @ prior @ c.T + noise)
    gain = np.linalg.solve(weight + b.T @ cost @ b, b.T @ cost @ a)
    measured, bridged = (_assembled(forward, a, b, c, part * kalman, gain) for part in (1.0, 0.0))
    by_error = np.concatenate((np.zeros(len(forward.a)), b[:, 0]))
    return LinearShaper(measured, bridged, by_error, known.specimen.stories)


def _assembled(
    forward: DiscreteStateSpace,
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    kalman: np.ndarray,
    gain: np.ndarray,
) -> DiscreteStateSpace:
    """Return feedforward and feedback with the inputs desired and measured acceleration."""
    own, size = len(forward.a), len(a)
    rows = np.eye(own + size + 2)
    desired, measured = rows[own + size :][:1], rows[own + size :][1:]
    predicted = rows[own : own + size]
    estimate = predicted + kalman @ (measured - desired - c @ predicted)
    feedback = -gain @ estimate
    command = forward.c @ rows[:own] + forward.d @ desired + feedback
    following = np.vstack((forward.a @ rows[:own] + forward.b @ desired, a @ estimate + b @ feedback))
    n = own + size
    return DiscreteStateSpace(following[:, :n], following[:, n:], command[:, :n], command[:, n:])


COMPENSATORS = (
    Compensator(
        "ff_lqg",
        "Inverse of the identified table, and LQG feedback of what the table differs from the desired acceleration",
        "The identified table, without zeros in the right half-plane, and its accelerometer; takes no preview",
        shaper=make_feedforward_lqg,
        settings=FeedforwardLqgConfig,
    ),
)
