"""The loop of the benchmark problem: the conductor of every other test, with many plants side by side in lanes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.integration.runge_kutta import runge_kutta_4
from bmd_rths_core.loop.conductor import Begun, Conductor
from bmd_rths_core.loop.hosting import VirtualClock
from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.vrths.actuator import Actuator
from bmd_rths_core.vrths.problem import (
    NOMINAL,
    SPECIMEN_MASS,
    TIME_STEP,
    Building,
    PlantParameters,
    numerical_building,
    reference_building,
)
from bmd_rths_core.vrths.substructure import DisplacementSubstructure
from bmd_rths_core.vrths.trackers import Asked, Tracker

FloatArray = NDArray[np.float64]

#: How often `run_lanes` reports progress [steps].
PROGRESS_PERIOD = 4096


class LaneSignals(NamedTuple):
    """What happened, every signal at the steps k Δt.

    Parameters
    ----------
    displacement : ndarray, shape (N, 3, p)
        Of the floors of the numerical substructure; the first is the one that is asked for [m].
    measured : ndarray, shape (N, p)
        Displacement of the actuator as it is measured [m].
    command, force : ndarray, shape (N,)
        Of the first lane: commanded displacement [m], and measured force [N].
    limited : ndarray of bool, shape (p,)
        The force of the actuator was at its limit.
    """

    displacement: FloatArray
    measured: FloatArray
    command: FloatArray
    force: FloatArray
    limited: NDArray[np.bool_]


def run_lanes(
    case: int,
    plants: Sequence[PlantParameters],
    tracker: Tracker,
    ground: FloatArray,
    seeds: Sequence[int],
    progress: Callable[[int], None] | None = None,
) -> LaneSignals:
    """Run one building with some plants under a ground motion.

    Parameters
    ----------
    case : int
        Building.
    plants : sequence of PlantParameters
        p control plants.
    tracker : Tracker
        Compensator of all of them.
    ground : ndarray, shape (N,)
        a_g at the steps [m/s²].
    seeds : sequence of int
        Of the noise of each plant.
    progress : callable, optional
        Called with the number of steps every `PROGRESS_PERIOD` steps.
    """
    return _LaneLoop(case, plants, tracker, ground, seeds, progress).run()


class _LaneLoop:
    """Host of a conductor: what it begins goes through tracker and actuator, and the force comes back a step late."""

    def __init__(
        self,
        case: int,
        plants: Sequence[PlantParameters],
        tracker: Tracker,
        ground: FloatArray,
        seeds: Sequence[int],
        progress: Callable[[int], None] | None,
    ) -> None:
        self._tracker, self._progress = tracker, progress
        self._numerical = DisplacementSubstructure([numerical_building(case, plant) for plant in plants])
        self._actuator = Actuator(plants, seeds)
        self._clock = VirtualClock()
        lockstep, longest_miss = True, 0.0
        self._conductor = Conductor(
            ground.tolist(),
            self._numerical,  # type: ignore[arg-type]  # lanes of numbers where the protocol has numbers
            None,
            TIME_STEP,
            lockstep,
            longest_miss,
            self._on_step,
        )
        steps, lanes = len(ground), len(plants)
        self._displacement, self._measured = np.empty((steps, 3, lanes)), np.empty((steps, lanes))
        self._command, self._force = np.empty(steps), np.empty(steps)

    def run(self) -> LaneSignals:
        """Run the whole ground motion from rest."""
        self._conductor.reset()
        self._actuator.connect()
        self._tracker.reset()
        self._now = self._actuator.read(-1)
        self._late_force = np.zeros(self._measured.shape[1])
        due = self._conductor.poll(self._clock.now())
        while self._conductor.state is not NodeState.ENDED:
            self._clock.wait(due)
            due = self._conductor.poll(self._clock.now())
        return LaneSignals(self._displacement, self._measured, self._command, self._force, self._actuator.limited)

    def _on_step(self, begun: Begun) -> None:
        step, numerical, at_begin = begun.step, self._numerical, self._now
        if self._progress is not None and step % PROGRESS_PERIOD == 0:
            self._progress(step)
        command = self._tracker.step(Asked(numerical.state, begun.ground_acceleration, at_begin))
        self._displacement[step], self._measured[step] = numerical.displacements, at_begin.displacement
        self._command[step], self._force[step] = command[0], at_begin.force[0]
        self._now = self._actuator.move(step, command)
        now = self._clock.now()
        self._conductor.measured(self._now, now)  # type: ignore[arg-type]
        # The force at the begin of the last step acts over this one.
        self._conductor.shear(step, self._late_force, now)  # type: ignore[arg-type]
        self._late_force = at_begin.force


def reference_motion(case: int, ground: FloatArray) -> FloatArray:
    """Return the motion of the building without partition, integrated as the loop is.

    Parameters
    ----------
    case : int
        Building.
    ground : ndarray, shape (N,)
        a_g at the steps [m/s²].

    Returns
    -------
    ndarray, shape (N, 6)
        Displacements of the floors [m], then their velocities [m/s].
    """
    building: Building = reference_building(case)
    a, b = building.motion()
    step = runge_kutta_4(a, b[:, :1], TIME_STEP)
    # With z[k] = x[k] − Γ₁ a_g[k] only the ground acceleration of this step drives.
    seen = np.eye(len(a))
    system = DiscreteStateSpace(step.phi, step.phi @ step.gamma_1 + step.gamma_0, seen, seen @ step.gamma_1)
    simulation = LinearSimulation(system, -step.gamma_1 * ground[0])
    return np.asarray(simulation.advance(ground[:, None])[0].T)


def required_force(case: int, ground: FloatArray, motion: FloatArray) -> float:
    """Return the largest force that the nominal specimen needs for the motion of the building without partition [N].

    Parameters
    ----------
    case, ground
        As `reference_motion` takes them.
    motion : ndarray, shape (N, 6)
        What it returned.

    Returns
    -------
    float
        m_E ẍ + c_E ẋ + k_E x of its first floor: no compensator can follow what is beyond the limit of the actuator.
    """
    a, b = reference_building(case).motion()
    acceleration = motion @ a[3] + b[3, 0] * ground
    force = SPECIMEN_MASS * acceleration + NOMINAL.specimen_damping * motion[:, 3]
    return float(np.max(np.abs(force + NOMINAL.specimen_stiffness * motion[:, 0])))
