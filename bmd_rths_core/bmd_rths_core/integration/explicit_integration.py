"""Explicit integration of M ü + C u̇ + r(u) = p(t): Chen-Ricles, Kolay-Ricles (KR-α) and explicit Newmark.

One step of every method has the same form, with matrices that are fixed before the test ("integration parameters"):

    u[k+1]   = u[k] + Δt u̇[k] + U ü[k]
    u̇*[k+1]  = u̇[k] + V ü[k]
    g[k+1]   = p[k+1] − C u̇*[k+1] − r(u[k+1])
    ü[k+1]   = E⁻¹ ((1 − α_f) g[k+1] + α_f g[k] − N ü[k])
    u̇[k+1]   = u̇*[k+1] + W ü[k+1]

With α₁ of the publications, U = Δt² α₁ / 2, V = (1 − γ) Δt α₁ and W = γ Δt α₁, where explicit Newmark has α₁ = I. The
velocity that CR and KR-α are published with is u̇*, which lags u̇ by γ Δt; written with u̇ itself, as here, the
displacements are the same and the velocity has second order too.

There is no iteration, and the restoring force is asked for once a step, at the end of it. All three methods have
second order. Every method is at rest before the first step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SystemMatrices:
    """The linear system an integration is tuned to.

    Parameters
    ----------
    mass, damping : ndarray, shape (n, n)
        M [kg] and C [N s/m].
    stiffness : ndarray, shape (n, n)
        The highest tangent stiffness the restoring force can have [N/m].
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray

    def highest_frequency(self) -> float:
        """Return the highest undamped natural frequency [rad/s]."""
        from scipy.linalg import eigh  # as in `integration.discretisation`, not before it is needed

        return float(np.sqrt(eigh(self.stiffness, self.mass, eigvals_only=True)[-1]))


@dataclass(frozen=True)
class IntegrationParameters:
    """What distinguishes the methods; the symbols are those of the module.

    Parameters
    ----------
    time_step : float
        Δt [s].
    displacement : ndarray, shape (n, n)
        U [s²].
    velocity : ndarray, shape (n, n)
        V [s].
    effective_mass, carried_mass : ndarray, shape (n, n)
        E and N [kg].
    alpha_f : float
        α_f, weight of the last step in the equation of motion.
    velocity_correction : ndarray, shape (n, n)
        W [s].
    """

    time_step: float
    displacement: FloatArray
    velocity: FloatArray
    effective_mass: FloatArray
    carried_mass: FloatArray
    velocity_correction: FloatArray
    alpha_f: float = 0.0


def chen_ricles(system: SystemMatrices, time_step: float) -> IntegrationParameters:
    """Return the CR method (Chen and Ricles 2008, Journal of Engineering Mechanics 134(8)).

    Parameters
    ----------
    system : SystemMatrices
        The system it is tuned to.
    time_step : float
        Δt [s].

    Returns
    -------
    IntegrationParameters

    Notes
    -----
    For the linear system it has the poles of the average-acceleration method: no numerical damping, and a numerical
    frequency ω̄ with tan(ω̄ Δt / 2) = ω Δt / 2. It is stable at any Δt as long as the tangent stiffness is not above
    the one it is tuned to (softening), and not negative.
    """
    alpha_1 = _solved(_alpha(system, time_step, 0.5, 0.25), system.mass)
    return _newmark_form(alpha_1, time_step, 0.5, system.mass, np.zeros_like(system.mass))


def kolay_ricles(system: SystemMatrices, time_step: float, rho_infinity: float) -> IntegrationParameters:
    """Return the KR-α method (Kolay and Ricles 2014, Earthquake Engineering and Structural Dynamics 43(9)).

    Parameters
    ----------
    system : SystemMatrices
        The system it is tuned to.
    time_step : float
        Δt [s].
    rho_infinity : float
        Spectral radius at infinite frequency, 0 to 1; 1 has no numerical damping.

    Returns
    -------
    IntegrationParameters

    Notes
    -----
    For the linear system it has the poles of the generalised-α method (Chung and Hulbert 1993) with the same ρ_∞. The
    restoring force inside the step is the weighted mean of its ends (generalised trapezoidal rule), so that a
    hysteretic spring sees each drift once. Stable at any Δt under the condition of `chen_ricles`.
    """
    alpha_m = (2.0 * rho_infinity - 1.0) / (rho_infinity + 1.0)
    alpha_f = rho_infinity / (rho_infinity + 1.0)
    gamma = 0.5 - alpha_m + alpha_f
    beta = 0.25 * (0.5 + gamma) ** 2
    alpha = _alpha(system, time_step, gamma, beta)
    alpha_1 = _solved(alpha, system.mass)
    alpha_3 = _solved(alpha, alpha_f * alpha + (alpha_m - alpha_f) * system.mass)
    carried = system.mass @ alpha_3
    return _newmark_form(alpha_1, time_step, gamma, system.mass - carried, carried, alpha_f)


def explicit_newmark(system: SystemMatrices, time_step: float) -> IntegrationParameters:
    """Return the explicit Newmark method, γ = 1/2 and β = 0 (Newmark 1959).

    Parameters
    ----------
    system : SystemMatrices
        The system; only mass and damping enter the method, the stiffness its limit.
    time_step : float
        Δt [s].

    Returns
    -------
    IntegrationParameters

    Raises
    ------
    InputError
        The step is not below the stability limit.

    Notes
    -----
    The numerical frequency follows sin(ω̄ Δt / 2) = ω Δt / 2. The method is stable for ω Δt < 2 with the highest
    frequency of the system. Viscous damping, of whatever distribution, leaves this limit as it is: the velocity at the
    end of the step is implicit, and M − Δt² K / 4 > 0 makes an energy that cannot grow. At the limit itself -1 is
    a double pole, and the response of an undamped system grows in proportion to time.
    """
    frequency = system.highest_frequency()
    if frequency * time_step >= 2.0 * (1.0 - 1e-12):
        raise InputError(
            f"explicit Newmark integration is unstable: time step {time_step:g} s times highest frequency "
            f"{frequency:.6g} rad/s is {frequency * time_step:.6g}; < 2 is required, "
            f"a time step < {2.0 / frequency:.6g} s"
        )
    effective_mass = system.mass + 0.5 * time_step * system.damping
    return _newmark_form(np.eye(len(system.mass)), time_step, 0.5, effective_mass, np.zeros_like(system.mass))


def amplification_matrix(
    parameters: IntegrationParameters, system: SystemMatrices, stiffness: FloatArray | None = None
) -> FloatArray:
    """Return the matrix that takes [u, u̇, ü, g] from one step of free vibration to the next.

    Parameters
    ----------
    parameters : IntegrationParameters
        The method.
    system : SystemMatrices
        Its damping matrix is that of the vibration.
    stiffness : ndarray, shape (n, n), optional
        Stiffness of the vibration [N/m]; that of `system` by default.

    Returns
    -------
    ndarray, shape (4n, 4n)
        The method is stable when no eigenvalue is outside the unit circle and none on it is defective.
    """
    k = system.stiffness if stiffness is None else stiffness
    p, one, zero = parameters, np.eye(len(k)), np.zeros_like(k)
    displacement = np.hstack((one, p.time_step * one, p.displacement, zero))
    predicted = np.hstack((zero, one, p.velocity, zero))
    unbalance = -system.damping @ predicted - k @ displacement
    last = np.hstack((zero, zero, -p.carried_mass, p.alpha_f * one))
    acceleration = np.linalg.solve(p.effective_mass, (1.0 - p.alpha_f) * unbalance + last)
    velocity = predicted + p.velocity_correction @ acceleration
    return np.vstack((displacement, velocity, acceleration, unbalance))


def load_matrix(parameters: IntegrationParameters) -> FloatArray:
    """Return what a load at the end of a step adds to [u, u̇, ü, g] there.

    Parameters
    ----------
    parameters : IntegrationParameters
        The method.

    Returns
    -------
    ndarray, shape (4n, n)
        Per unit of load; with `amplification_matrix` it makes the linear system of the method.
    """
    p, one = parameters, np.eye(len(parameters.effective_mass))
    acceleration = (1.0 - p.alpha_f) * np.linalg.inv(p.effective_mass)
    return np.vstack((np.zeros_like(one), p.velocity_correction @ acceleration, acceleration, one))


class ExplicitIntegrator:
    """Integrate a system from rest.

    Parameters
    ----------
    parameters : IntegrationParameters
        The method.
    mass, damping : ndarray, shape (n, n)
        M [kg] and C [N s/m].
    restoring_force : callable
        r(u) [N]: takes the displacements, called once a step in the order of time.

    Attributes
    ----------
    displacement, velocity : ndarray, shape (n,)
        u [m] and u̇ [m/s] at the last step.
    restoring : ndarray, shape (n,)
        r(u) at the last step [N].
    """

    def __init__(
        self,
        parameters: IntegrationParameters,
        mass: FloatArray,
        damping: FloatArray,
        restoring_force: Callable[[FloatArray], FloatArray],
    ) -> None:
        n = len(mass)
        one = np.eye(n)
        p = parameters
        # [u, u̇, ü] of the last step give u and the predicted velocity; [g, g of the last step, ü] the acceleration.
        self._predict = np.block([[one, p.time_step * one, p.displacement], [np.zeros((n, n)), one, p.velocity]])
        inverse = np.linalg.inv(p.effective_mass)
        self._accelerate = inverse @ np.hstack(((1.0 - p.alpha_f) * one, p.alpha_f * one, -p.carried_mass))
        self._correction = p.velocity_correction
        self._inverse_mass = np.linalg.inv(mass)
        self._damping = damping
        self._restoring_force = restoring_force
        self._motion = np.zeros(3 * n)
        self._balance = np.zeros(3 * n)
        self._viscous = np.zeros(n)
        self._change = np.zeros(n)
        self.displacement, self.velocity = self._motion[:n], self._motion[n : 2 * n]
        self.restoring = np.zeros(n)
        self._moved, self._acceleration = self._motion[: 2 * n], self._motion[2 * n :]
        self._unbalance, self._last_unbalance = self._balance[:n], self._balance[n : 2 * n]
        self._last_acceleration = self._balance[2 * n :]
        self._predicted = np.zeros(2 * n)

    def start(self, load: FloatArray) -> None:
        """Return to rest; the first acceleration balances the load.

        Parameters
        ----------
        load : ndarray, shape (n,)
            p at step 0 [N].
        """
        self._motion[:] = 0.0
        self.restoring[:] = 0.0
        np.dot(self._inverse_mass, load, out=self._acceleration)
        self._unbalance[:] = load

    def step(self, load: FloatArray) -> None:
        """Advance to the next step.

        Parameters
        ----------
        load : ndarray, shape (n,)
            p at the end of the step [N].
        """
        self._last_unbalance[:] = self._unbalance
        self._last_acceleration[:] = self._acceleration
        np.dot(self._predict, self._motion, out=self._predicted)
        self._moved[:] = self._predicted
        self.restoring[:] = self._restoring_force(self.displacement)
        np.dot(self._damping, self.velocity, out=self._viscous)
        np.subtract(load, self._viscous, out=self._unbalance)
        np.subtract(self._unbalance, self.restoring, out=self._unbalance)
        np.dot(self._accelerate, self._balance, out=self._acceleration)
        np.dot(self._correction, self._acceleration, out=self._change)
        np.add(self.velocity, self._change, out=self.velocity)

    def correct(self, load: FloatArray) -> None:
        """Add to the load of the last step, which moves no floor yet.

        Parameters
        ----------
        load : ndarray, shape (n,)
            What was not known of it [N]. Not before the first step.
        """
        np.add(self._unbalance, load, out=self._unbalance)
        change = self._accelerate[:, : len(load)] @ load
        self._acceleration += change
        self.velocity += self._correction @ change


def _alpha(system: SystemMatrices, time_step: float, gamma: float, beta: float) -> FloatArray:
    damping: FloatArray = gamma * time_step * system.damping
    stiffness: FloatArray = beta * time_step**2 * system.stiffness
    return system.mass + damping + stiffness


def _solved(left: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(left, right), dtype=np.float64)


def _newmark_form(
    alpha_1: FloatArray,
    time_step: float,
    gamma: float,
    effective_mass: FloatArray,
    carried_mass: FloatArray,
    alpha_f: float = 0.0,
) -> IntegrationParameters:
    return IntegrationParameters(
        time_step,
        displacement=0.5 * time_step**2 * alpha_1,
        velocity=(1.0 - gamma) * time_step * alpha_1,
        effective_mass=effective_mass,
        carried_mass=carried_mass,
        velocity_correction=gamma * time_step * alpha_1,
        alpha_f=alpha_f,
    )
