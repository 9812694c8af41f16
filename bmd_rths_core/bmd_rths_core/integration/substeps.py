"""Sub-steps: signals of an integration that is N times slower than the loop, predicted and then corrected.

While the integration computes its next target, the signals follow a polynomial through the last targets; from the
hand-over on they go over to the one that ends at the new target. Both are exact for polynomials of their order
(Nakashima and Masaoka 1999; Schellenberg, Mahin and Fenves 2009).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace

FloatArray = NDArray[np.float64]

#: Order of both polynomials; docs/decisions/0020 has the measurement.
ORDER = 3

#: Most sub-steps: at 1,024 Hz and with N Δt ω of 0.5, which docs/decisions/0020 advises, enough for modes below 4 Hz.
MOST_SUBSTEPS = 20

#: Shares of a step that hydraulic laboratories let its computation take: more than the first warns, the second refuses.
#: The part is that of the first in the second, for a hand-over that is earlier than at 80 %.
WARNED_SHARE, LARGEST_SHARE = 0.6, 0.8
WARNED_PART = 0.75


def hand_over(substeps: int) -> int:
    """Return the sub-step at which a target has to be there: the last one within 80 % of the integration step.

    Parameters
    ----------
    substeps : int
        N.
    """
    return 4 * substeps // 5


def longest_integration(substeps: int, time_step: float) -> float:
    """Return the time that an integration may take [s]: until the hand-over, or 80 % of a step without sub-steps.

    Parameters
    ----------
    substeps : int
        N.
    time_step : float
        Δt of the loop [s].
    """
    return time_step * (hand_over(substeps) if substeps > 1 else LARGEST_SHARE)


def substeps_for(duration: float, time_step: float, longest_step: float) -> int | None:
    """Return how few sub-steps leave an integration enough time; None where no allowed number does.

    Parameters
    ----------
    duration : float
        Of one integration [s].
    time_step : float
        Δt of the loop [s].
    longest_step : float
        Longest N Δt that is allowed [s].
    """
    allowed = (n for n in range(1, MOST_SUBSTEPS + 1) if n * time_step <= longest_step)
    return next((n for n in allowed if duration <= WARNED_PART * longest_integration(n, time_step)), None)


def lagrange(nodes: FloatArray, time: float) -> FloatArray:
    """Return the weights of values at some nodes that make their polynomial at a time.

    Parameters
    ----------
    nodes : ndarray, shape (p + 1,)
        Times of the values, all different.
    time : float
        Where the polynomial of order p is asked for.

    Returns
    -------
    ndarray, shape (p + 1,)
    """
    weights = np.ones(len(nodes))
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        weights[i] = np.prod((time - others) / (node - others))
    return weights


def substep_weights(substeps: int, order: int = ORDER) -> FloatArray:
    """Return what every sub-step takes of the target to come and of the last targets.

    Parameters
    ----------
    substeps : int
        N.
    order : int
        p.

    Returns
    -------
    ndarray, shape (N, p + 2)
        The target to come, of which nothing is taken before the hand-over, that of sub-step 0, and those before it.
        From the hand-over on the predicted value gives way to the corrected one, in equal parts up to the target: a
        compensator that differentiates would make much of a jump.
    """
    nodes, change = 1.0 - np.arange(order + 2.0), hand_over(substeps)
    weights = np.zeros((substeps, order + 2))
    for part, row in enumerate(weights):
        predicted = (substeps - part) / (substeps - change + 1) if part >= change else 1.0
        row[1:] += predicted * lagrange(nodes[1:], part / substeps)
        row[:-1] += (1.0 - predicted) * lagrange(nodes[:-1], part / substeps)
    return weights


def extrapolated_load(now: float, before: float) -> float:
    """Return the load at the end of an integration step, on the line through those at its beginning and one before.

    Parameters
    ----------
    now, before : float
        In any unit.
    """
    return 2.0 * now - before


def periodic_state_space(
    targets: DiscreteStateSpace, direct: FloatArray, substeps: int, order: int = ORDER
) -> list[DiscreteStateSpace]:
    """Return a sub-stepped integration as N linear systems, one a sub-step, which share their state.

    Parameters
    ----------
    targets : DiscreteStateSpace
        The integration from one target to the next: inputs another load and the force, outputs the n targets.
    direct : ndarray, shape (n, 2)
        What the newest inputs add to the outputs in every sub-step, beside the polynomials.
    substeps : int
        N.
    order : int
        p.

    Returns
    -------
    list of DiscreteStateSpace
        Their first input is the other load at the next target in sub-step 0, and of no account in the others. The state
        is that of the integration, the other load at the target that is due, the target to come as it is expected, the
        last p + 1 targets, and the force at the target before.
    """
    states, outputs = len(targets.a), len(targets.c)
    size = states + 1 + outputs * (order + 2) + 1
    rows = np.eye(size + 2)
    own, due, history = rows[:states], rows[states : states + 1], rows[states + 1 : size - 1]
    before, load, force = rows[size - 1 : size], rows[size : size + 1], rows[size + 1 :]
    loads = np.vstack((due, force))
    met, moved = targets.c @ own + targets.d @ loads, targets.a @ own + targets.b @ loads
    expected = np.vstack((load, extrapolated_load(1.0, 0.0) * force + extrapolated_load(0.0, 1.0) * before))
    coming = targets.c @ moved + targets.d @ expected
    begun = np.vstack((moved, load, coming, met, history[outputs:-outputs], force))
    systems = []
    for part, weights in enumerate(substep_weights(substeps, order)):
        following = begun if part == 0 else rows[:size]
        output = np.kron(weights, np.eye(outputs)) @ following[states + 1 : size - 1] + direct @ rows[size:]
        systems.append(DiscreteStateSpace(following[:, :size], following[:, size:], output[:, :size], output[:, size:]))
    return systems
