"""A numerical substructure that needs longer than a step: integrated with N Δt, while the loop goes on with Δt."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.substeps import ORDER, extrapolated_load, hand_over, substep_weights
from bmd_rths_core.stages.numerical_substructure import NumericalResponse
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


class IntegrationLate(Exception):
    """The next target is not there when the loop has to go towards it; the test has to end."""


class Integrated(Protocol):
    """A numerical substructure that is integrated from target to target."""

    displacements: FloatArray
    velocities: FloatArray

    def reset(self) -> None:
        """Return to rest before step 0."""

    def step(self, ground_acceleration: float, feedback_force: float) -> NumericalResponse:
        """Advance to the next target.

        Parameters
        ----------
        ground_acceleration, feedback_force : float
            Loads there [m/s², N].

        Returns
        -------
        NumericalResponse
            Interface response there. The first call is target 0, at rest.
        """

    def correct(self, force: float) -> None:
        """Make good a shear that was not known when its target was computed.

        Parameters
        ----------
        force : float
            What the shear at the last target was more than was given [N].
        """

    def correction(self) -> FloatArray:
        """Return what `correct` changes per newton.

        Returns
        -------
        ndarray, shape (2n + 1,)
            In the order of `next_target`.
        """


class Integration(Protocol):
    """Computes one target after the other, at once or beside the loop."""

    def reset(self, ground_acceleration: float) -> None:
        """Return to rest at target 0.

        Parameters
        ----------
        ground_acceleration : float
            At target 0 [m/s²].
        """

    def start(self, correction: float, ground_acceleration: float, feedback_force: float) -> None:
        """Start to compute the next target.

        Parameters
        ----------
        correction : float
            What the shear at the target that is due is more than was expected [N].
        ground_acceleration, feedback_force : float
            Loads that are expected at the next target [m/s², N].
        """

    def target(self) -> FloatArray:
        """Return the target that was started.

        Returns
        -------
        ndarray, shape (2n + 1,)
            As `next_target` has it.

        Raises
        ------
        IntegrationLate
            It is not there yet, in one line.
        """


def next_target(
    model: Integrated, interface_mass: float, correction: float, ground_acceleration: float, feedback_force: float
) -> FloatArray:
    """Compute the next target of a substructure with n floors, whoever computes it.

    Parameters
    ----------
    model : Integrated
        The substructure.
    interface_mass : float
        [kg].
    correction, ground_acceleration, feedback_force
        As `Integration.start` has them.

    Returns
    -------
    ndarray, shape (2n + 1,)
        The acceleration of the interface without what the shear adds at once [m/s²], which is the restoring force over
        mass and as smooth as the motion; displacements [m] and velocities [m/s].
    """
    model.correct(correction)
    response = model.step(ground_acceleration, feedback_force)
    restoring = response.desired_acceleration - feedback_force / interface_mass
    return np.concatenate(((restoring,), model.displacements, model.velocities))


def bytes_of_target(target: FloatArray) -> bytes:
    """Return a target for another process.

    Parameters
    ----------
    target : ndarray
        As `next_target` has it.
    """
    return target.tobytes()


def target_of_bytes(data: bytes) -> FloatArray:
    """Return the target of another process, equal bit for bit.

    Parameters
    ----------
    data : bytes
        Of `bytes_of_target`.
    """
    return np.frombuffer(data, dtype=np.float64)


class IntegrationAtOnce:
    """Compute a target when it is started: in simulation and lockstep, where nobody waits.

    Parameters
    ----------
    model : Integrated
        Made for a time step of N Δt.
    interface_mass : float
        [kg].
    """

    def __init__(self, model: Integrated, interface_mass: float) -> None:
        self._model, self._interface_mass = model, interface_mass
        self._target = np.zeros(0)

    def reset(self, ground_acceleration: float) -> None:
        """Return to rest at target 0."""
        self._model.reset()
        self._model.step(ground_acceleration, 0.0)

    def start(self, correction: float, ground_acceleration: float, feedback_force: float) -> None:
        """Compute the next target."""
        self._target = next_target(self._model, self._interface_mass, correction, ground_acceleration, feedback_force)

    def target(self) -> FloatArray:
        """Return it."""
        return self._target


class SubsteppedStage:
    """Follow an integration that takes N steps: predict while it computes, then go to where it ends.

    Parameters
    ----------
    integration : Integration
        Computes the targets.
    ground : ndarray, shape (K,)
        Ground acceleration of the whole test [m/s²]; the integration takes it at its targets, N steps ahead.
    substeps : int
        N ≥ 2.
    correction : ndarray, shape (2n + 1,)
        What a target changes by when its shear is one newton more than was expected.
    interface_mass : float
        [kg].

    Notes
    -----
    The integration to target m + 1 begins at step m N, when target m is due. The shear there is expected on the line
    through those fed back at the last two targets; what it is more is made good when it is known. So at every step m N
    the response is that of the substructure integrated with N Δt. What follows the polynomials between is the
    restoring force: the shear of every step acts on the interface at once, as without sub-steps, and the required
    force is the shear fed back at the step before. The hand-over is a fixed step, whenever the target is there:
    simulation, lockstep and real time are equal bit for bit.
    """

    takes_feedback = True

    def __init__(
        self,
        integration: Integration,
        ground: FloatArray,
        substeps: int,
        correction: FloatArray,
        interface_mass: float,
    ) -> None:
        self._integration = integration
        self._ground = np.append(ground, np.zeros(substeps)).tolist()
        self._substeps, self._hand_over = substeps, hand_over(substeps)
        self._weights = substep_weights(substeps)
        self._interface_mass = interface_mass
        self._correction = correction
        self._targets = np.zeros((ORDER + 2, len(correction)))
        self._now = np.zeros(len(correction))
        stories = len(correction) // 2
        self.displacements, self.velocities = self._now[1 : stories + 1], self._now[stories + 1 :]
        self._step, self._force, self._expected = 0, 0.0, 0.0

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._integration.reset(self._ground[0])
        self._targets[:] = 0.0
        self._now[:] = 0.0
        self._step, self._force, self._expected = 0, 0.0, 0.0

    def step(self, ground_acceleration: float, feedback_force: float) -> NumericalResponse:
        """Advance by one step of the loop; raises `IntegrationLate` where a target is not there at its hand-over."""
        part = self._step % self._substeps
        if part == 0:
            more = feedback_force - self._expected
            self._targets[1:] = self._targets[:-1]
            self._targets[1] += more * self._correction
            self._expected = extrapolated_load(feedback_force, self._force)
            self._force = feedback_force
            self._integration.start(more, self._ground[self._step + self._substeps], self._expected)
        elif part == self._hand_over:
            self._targets[0] = self._integration.target()
        np.dot(self._weights[part], self._targets, out=self._now)
        self._step += 1
        return NumericalResponse(float(self._now[0]) + feedback_force / self._interface_mass, feedback_force)

    def learn(self, measurement: TableMeasurement) -> None:
        """Do without: the shear that is fed back is all it takes."""
