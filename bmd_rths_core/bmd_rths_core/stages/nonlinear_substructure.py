"""Numerical substructure with hysteretic stories, any damping and P-Delta, integrated explicitly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.explicit_integration import (
    ExplicitIntegrator,
    IntegrationParameters,
    SystemMatrices,
    amplification_matrix,
    chen_ricles,
    explicit_newmark,
    kolay_ricles,
    load_matrix,
)
from bmd_rths_core.stages.numerical_substructure import NumericalResponse, NumericalSubstructureConfig
from bmd_rths_core.structure.nonlinear_building import NonlinearConfig, nonlinear_building
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableMeasurement


class NonlinearSubstructure:
    """Integrate the non-linear numerical substructure; takes the place of `NumericalSubstructure`.

    Parameters
    ----------
    config : NumericalSubstructureConfig
        Masses, initial stiffnesses and damping coefficients.
    nonlinear : NonlinearConfig
        Springs, damping, P-Delta and integration; an integration other than exact.
    time_step : float
        Δt [s].

    Attributes
    ----------
    displacements, velocities : ndarray, shape (n,)
        Motion of the floors relative to the ground at the last step [m, m/s].

    Raises
    ------
    InputError
        The two sections do not fit together, or the integration is not stable with this time step.

    Notes
    -----
    Displacement and velocity come from the integration, the acceleration of every method from the equation of motion at
    the end of the step, as for the linear substructure: the required force is the shear fed back.
    """

    takes_feedback = True

    def __init__(self, config: NumericalSubstructureConfig, nonlinear: NonlinearConfig, time_step: float) -> None:
        chain = config.building()
        if not isinstance(chain, ShearBuilding):
            raise InputError(
                f"nonlinear.integration: {nonlinear.integration} is for stories; numerical_substructure has matrices, "
                "for which exact is required"
            )
        building = nonlinear_building(chain, nonlinear)
        system = building.system()
        parameters = _integration_parameters(system, nonlinear, time_step)
        self._system, self._parameters = system, parameters
        self._initial_stiffness = building.initial_stiffness_matrix
        self._stories = building.stories()
        self._integrator = ExplicitIntegrator(parameters, system.mass, system.damping, self._stories.floor_forces)
        self.displacements, self.velocities = self._integrator.displacement, self._integrator.velocity
        self._masses = building.masses
        self._interface_mass = float(building.masses[-1])
        self._interface_damping = system.damping[-1].copy()
        self._load = np.zeros(len(self._masses))
        self._started = False

    def reset(self) -> None:
        """Return to rest and to virgin stories before step 0."""
        self._stories.reset()
        self._started = False

    def step(self, ground_acceleration: float, feedback_force: float) -> NumericalResponse:
        """Advance to the next step.

        Parameters
        ----------
        ground_acceleration : float
            a_g of this step [m/s²].
        feedback_force : float
            Interface shear fed back at the last step [N].

        Returns
        -------
        NumericalResponse
            Interface response at this step. The first call is step 0, at rest.
        """
        load, integrator = self._load, self._integrator
        np.multiply(self._masses, -ground_acceleration, out=load)
        load[-1] += feedback_force
        if self._started:
            integrator.step(load)
        else:
            integrator.start(load)
            self._started = True
        restoring = float(self._interface_damping.dot(integrator.velocity)) + float(integrator.restoring[-1])
        acceleration = (feedback_force - restoring) / self._interface_mass
        return NumericalResponse(acceleration, self._interface_mass * acceleration + restoring)

    def correct(self, force: float) -> None:
        """Add to the shear at the last target what was not known when it was computed."""
        self._load[:] = 0.0
        self._load[-1] = force
        self._integrator.correct(self._load)

    def correction(self) -> NDArray[np.float64]:
        """Return what `correct` changes per newton."""
        n = len(self._masses)
        velocity = load_matrix(self._parameters)[n : 2 * n, -1]
        damping = -float(self._interface_damping.dot(velocity)) / self._interface_mass
        return np.concatenate(((damping,), np.zeros(n), velocity))

    def learn(self, measurement: TableMeasurement) -> None:
        """Do nothing: this stage uses only the shear that is fed back."""

    def state_space(self) -> DiscreteStateSpace:
        """Return the stage as a linear system: small motion about rest, as long as no story leaves its first tangent.

        Returns
        -------
        DiscreteStateSpace
            Inputs and outputs as `NumericalSubstructure.state_space` has them. The state is that of the integration,
            displacement, velocity, acceleration and unbalanced force over mass. A first load of 0 is assumed.
        """
        n, m = len(self._masses), self._interface_mass
        # Forces over masses in the state: it does not depend on how heavy the substructure is.
        scale = np.ones(4 * n)
        scale[3 * n :] = self._masses
        a = amplification_matrix(self._parameters, self._system, self._initial_stiffness) * scale / scale[:, None]
        load = np.vstack((-self._masses, np.eye(1, n, n - 1)[0])).T
        b = load_matrix(self._parameters) @ load / scale[:, None]
        restoring = np.concatenate((self._initial_stiffness[-1], self._interface_damping, np.zeros(2 * n)))
        # Desired acceleration (f − r x) / m, required force, which is f, displacements, for the state x of this step.
        of_motion = np.vstack((-restoring / m, np.zeros(4 * n), np.eye(n, 4 * n)))
        of_force = np.zeros((len(of_motion), 2))
        of_force[:2, 1] = 1.0 / m, 1.0
        return DiscreteStateSpace(a=a, b=b, c=of_motion @ a, d=of_motion @ b + of_force)


def _integration_parameters(
    system: SystemMatrices, nonlinear: NonlinearConfig, time_step: float
) -> IntegrationParameters:
    if nonlinear.integration == "cr":
        return chen_ricles(system, time_step)
    if nonlinear.integration == "kr_alpha":
        return kolay_ricles(system, time_step, nonlinear.rho_infinity)
    if nonlinear.integration == "newmark_explicit":
        try:
            return explicit_newmark(system, time_step)
        except InputError as error:
            raise InputError(f"nonlinear.integration: {error}") from error
    raise ValueError("exact integration is that of NumericalSubstructure")
