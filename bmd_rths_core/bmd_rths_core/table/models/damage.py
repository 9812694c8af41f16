"""A specimen whose stories yield on a simulated table: table and specimen advanced together in sub-steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import first_order_hold, zero_order_hold
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.structure.story_springs import BilinearSpring
from bmd_rths_core.table.models.plant import Plant

FloatArray = NDArray[np.float64]

#: Sub-steps of a step, as many as those of the reference that a test is compared with.
SUBSTEPS = 10


class StoryForces(NamedTuple):
    """How the force of a story enters table and specimen.

    Parameters
    ----------
    drift : ndarray, shape (n, m)
        Rows of the story drifts [m] over the state of the plant.
    state : ndarray, shape (m, n)
        What a force that a story lacks adds to the rate of the state, per N.
    output : ndarray, shape (n + 2, n)
        What it adds to the outputs of the plant, per N.
    """

    drift: FloatArray
    state: FloatArray
    output: FloatArray


def story_forces(plant: Callable[[ShearBuilding], Plant], specimen: ShearBuilding) -> StoryForces:
    """Return how the force of each story enters a plant.

    Parameters
    ----------
    plant : callable
        Makes table and specimen, whose matrices are linear in the stiffness of each story.
    specimen : ShearBuilding
        n floors.

    Notes
    -----
    A story of twice its stiffness has the force k more at a drift of 1, so that the difference of the two plants at
    that drift is the effect of this force, on the table too.
    """
    n, own = specimen.stories, plant(specimen)
    begin = len(own.a) - 2 - 2 * n
    drift, state, output = np.zeros((n, len(own.a))), np.zeros((len(own.a), n)), np.zeros((n + 2, n))
    for j, stiffness in enumerate(specimen.stiffnesses):
        drift[j, begin + j] = 1.0
        if j:
            drift[j, begin + j - 1] = -1.0
        stiffnesses = list(specimen.stiffnesses)
        stiffnesses[j] *= 2.0
        stiffer = plant(ShearBuilding(specimen.masses, tuple(stiffnesses), specimen.damping_coefficients))
        shape = np.zeros(len(own.a))
        shape[begin + j : begin + n] = 1.0
        state[:, j] = (own.a - stiffer.a) @ shape / stiffness
        output[:, j] = (own.output - stiffer.output) @ shape / stiffness
    return StoryForces(drift, state, output)


class YieldingPlant:
    """Advance a plant whose stories are bilinear, from rest.

    Parameters
    ----------
    plant : callable
        Makes table and specimen.
    specimen : ShearBuilding
        Its initial stiffness, n floors.
    springs : sequence of BilinearSpring
        From the table up.
    time_step : float
        Δt [s].
    fraction : float
        Part of a step in which the older of two commands acts.

    Attributes
    ----------
    state : ndarray, shape (m,)
        Of the plant.

    Notes
    -----
    Pseudo-force method, as `analysis.reference.nonlinear_reference_response` has it: the plant with its initial
    stiffness is propagated exactly, and the forces that the stories lack are loads that are linear over a sub-step,
    extrapolated and then corrected once.
    """

    def __init__(
        self,
        plant: Callable[[ShearBuilding], Plant],
        specimen: ShearBuilding,
        springs: tuple[BilinearSpring, ...],
        time_step: float,
        fraction: float,
    ) -> None:
        self._plant, self._forces = plant(specimen), story_forces(plant, specimen)
        self._stiffness, self._springs = np.asarray(specimen.stiffnesses), springs
        parts = [(fraction, 0), (1.0 - fraction, 1)] if fraction > 0.0 else [(1.0, 1)]
        self._parts = [(self._discrete(share * time_step), command) for share, command in parts]
        self.reset()

    def _discrete(self, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return [Φ, Γ, Γ₀, Γ₁] of a sub-step and Γ₁."""
        step = duration / SUBSTEPS
        phi, before, now = first_order_hold(self._plant.a, self._forces.state, step)
        _, command = zero_order_hold(self._plant.a, self._plant.b, step)
        return np.hstack((phi, command, before, now)), now

    def reset(self) -> None:
        """Return to rest and to virgin stories."""
        self.state = np.zeros(len(self._plant.a))
        self._lacking = self._last = np.zeros(len(self._springs))
        for spring in self._springs:
            spring.reset()

    def step(self, older: float, newer: float) -> FloatArray:
        """Return the outputs of the plant at the end of a step.

        Parameters
        ----------
        older, newer : float
            Commands in the first and in the second part of the step [m/s²].
        """
        for (propagate, correct), command in self._parts:
            held = np.array([(older, newer)[command]])
            for _ in range(SUBSTEPS):
                extrapolated = 2.0 * self._lacking - self._last
                state = propagate @ np.concatenate((self.state, held, self._lacking, extrapolated))
                drifts = self._forces.drift @ state
                pairs = zip(self._springs, drifts.tolist(), strict=True)
                self._last = self._lacking
                self._lacking = self._stiffness * drifts - [spring.force(drift) for spring, drift in pairs]
                self.state = state + correct @ (self._lacking - extrapolated)
        plant = self._plant
        return np.asarray(plant.output @ self.state + plant.feedthrough * newer + self._forces.output @ self._lacking)
