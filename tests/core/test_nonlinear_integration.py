"""Explicit integration: poles against closed forms and the implicit methods they come from, stability limits."""

from itertools import pairwise

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.explicit_integration import (
    ExplicitIntegrator,
    SystemMatrices,
    amplification_matrix,
    chen_ricles,
    explicit_newmark,
    kolay_ricles,
)
from bmd_rths_core.structure.shear_building import ShearBuilding

METHODS = {
    "cr": chen_ricles,
    "newmark": explicit_newmark,
    **{f"kr_alpha {rho}": lambda s, dt, rho=rho: kolay_ricles(s, dt, rho) for rho in (0.0, 0.5, 0.75, 1.0)},
}
UNCONDITIONAL = [name for name in METHODS if name != "newmark"]


def oscillator(omega, ratio=0.0):
    return SystemMatrices(np.array([[1.0]]), np.array([[2 * ratio * omega]]), np.array([[omega**2]]))


def chain(building):
    return SystemMatrices(building.mass_matrix, building.damping_matrix, building.stiffness_matrix)


def radius(parameters, system, stiffness=None):
    return np.abs(np.linalg.eigvals(amplification_matrix(parameters, system, stiffness))).max()


def free_vibration(method, omega_dt, steps):
    """Return the displacement of an undamped oscillator that a unit load pushes from rest, less its static one."""
    system = oscillator(omega_dt)
    integrator = ExplicitIntegrator(method(system, 1.0), system.mass, system.damping, lambda u: omega_dt**2 * u)
    load = np.array([omega_dt**2])
    integrator.start(load)
    history = [integrator.displacement[0]]
    for _ in range(steps):
        integrator.step(load)
        history.append(integrator.displacement[0])
    return np.array(history) - 1.0


@pytest.mark.parametrize("omega_dt", [0.05, 0.3, 1.0, 1.9])
@pytest.mark.parametrize(
    ("method", "numerical"),
    [(chen_ricles, lambda x: 2 * np.arctan(x / 2)), (explicit_newmark, lambda x: 2 * np.arcsin(x / 2))],
)
def test_free_vibration_keeps_its_amplitude_and_has_the_closed_form_of_the_period(method, numerical, omega_dt):
    """tan(ω̄ Δt / 2) = ω Δt / 2 (average acceleration) and sin(ω̄ Δt / 2) = ω Δt / 2 (central difference)."""
    angle = numerical(omega_dt)
    u = free_vibration(method, omega_dt, 2000)
    cosine, sine = np.cos(angle * np.arange(2001)), np.sin(angle * np.arange(2001))
    # From u[0] and u[1] of the method itself, then undamped at the closed-form frequency for ever.
    expected = u[0] * cosine + (u[1] - u[0] * np.cos(angle)) / np.sin(angle) * sine
    assert u == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("method", "coefficient"), [(chen_ricles, 1 / 12), (explicit_newmark, -1 / 24), (METHODS["kr_alpha 1.0"], 1 / 12)]
)
def test_period_error_is_second_order_with_the_published_coefficient(method, coefficient):
    """(T̄ − T) / T ≈ Ω² / 12 for average acceleration, −Ω² / 24 for central difference (Chopra, section 5.5)."""
    for omega_dt in (0.02, 0.1):
        system = oscillator(omega_dt)
        poles = np.linalg.eigvals(amplification_matrix(method(system, 1.0), system))
        (angle,) = (np.angle(p) for p in poles if abs(abs(p) - 1) < 1e-6 and 0 < np.angle(p) < 1)
        assert (omega_dt / angle - 1) / omega_dt**2 == pytest.approx(coefficient, rel=0.02)


def poles_of_generalised_alpha(omega_dt, ratio, rho):
    """Return the three poles of the implicit method of Chung and Hulbert (1993) for ω = Ω, Δt = 1."""
    alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma, beta = 0.5 - alpha_m + alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2
    c, k = 2 * ratio * omega_dt, omega_dt**2
    left = np.array(
        [[1, 0, -beta], [0, 1, -gamma], [(1 - alpha_f) * k, (1 - alpha_f) * c, 1 - alpha_m]],
    )
    right = np.array([[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-alpha_f * k, -alpha_f * c, -alpha_m]])
    return np.sort_complex(np.linalg.eigvals(np.linalg.solve(left, right)))


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.75, 1.0])
@pytest.mark.parametrize("ratio", [0.0, 0.05])
@pytest.mark.parametrize("omega_dt", [0.1, 1.0, 10.0])
def test_kr_alpha_has_the_poles_of_the_implicit_generalised_alpha_method(rho, ratio, omega_dt):
    system = oscillator(omega_dt, ratio)
    poles = np.linalg.eigvals(amplification_matrix(kolay_ricles(system, 1.0, rho), system))
    for pole in poles_of_generalised_alpha(omega_dt, ratio, rho):
        assert np.abs(poles - pole).min() < 1e-7  # its spurious pole too


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.75, 1.0])
def test_spectral_radius_of_kr_alpha_at_infinite_frequency_is_rho_infinity(rho):
    system = oscillator(1e4)
    assert radius(kolay_ricles(system, 1.0, rho), system) == pytest.approx(rho, abs=0.02)


@pytest.mark.parametrize("omega_dt", [0.1, 1.0, 1.9])
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("name", ["cr", "newmark"])
def test_spectral_radius_of_a_damped_oscillator_is_the_analytic_one(name, ratio, omega_dt):
    """z² − (2 − D − S) z + (1 − D) = 0 written out by hand for each method, D from damping and S from stiffness."""
    x, k = 2 * ratio * omega_dt, omega_dt**2
    alpha = 1 / (1 + x / 2 + (k / 4 if name == "cr" else 0.0))
    expected = np.abs(np.roots([1.0, -2.0 + alpha * (x + k), 1.0 - alpha * x])).max()
    system = oscillator(omega_dt, ratio)
    assert radius(METHODS[name](system, 1.0), system) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("name", UNCONDITIONAL)
def test_oscillator_that_softens_is_stable_at_any_time_step(name):
    for ratio in (0.0, 0.02, 0.3, 3.0):
        for omega_dt in np.logspace(-1, 3, 25):
            system = oscillator(omega_dt, ratio)
            parameters = METHODS[name](system, 1.0)
            for share in (1.0, 0.7, 0.3, 0.05, 0.0):
                assert radius(parameters, system, share * system.stiffness) < 1 + 1e-6


@pytest.mark.parametrize("name", UNCONDITIONAL)
def test_stories_that_soften_one_by_one_are_stable_at_any_time_step_with_any_dampers(name):
    rng = np.random.default_rng(0)
    for _ in range(100):
        n = int(rng.integers(2, 6))
        masses, stiffnesses = 10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(-2, 4, n)
        dampers = 10 ** rng.uniform(-4, 2, n) * (rng.random(n) < 0.7)
        soft = np.maximum(stiffnesses * rng.choice([0.0, 0.05, 0.5, 1.0], n), 1e-9)
        system = chain(ShearBuilding(tuple(masses), tuple(stiffnesses), tuple(dampers)))
        softened = ShearBuilding(tuple(masses), tuple(soft), tuple(dampers)).stiffness_matrix
        assert radius(METHODS[name](system, 1.0), system, softened) < 1 + 1e-5


def test_chen_ricles_bears_stiffening_up_to_its_closed_form():
    """Ω_t² ≤ 4 + Ω² for a tangent frequency Ω_t above the one it is tuned to."""
    system = oscillator(1.5)
    parameters = chen_ricles(system, 1.0)
    assert radius(parameters, system, np.array([[0.999 * (4 + 1.5**2)]])) < 1 + 1e-9
    assert radius(parameters, system, np.array([[1.001 * (4 + 1.5**2)]])) > 1.01


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.7, 2.0])
def test_limit_of_explicit_newmark_is_exact_and_damping_does_not_move_it(ratio):
    below = oscillator(2.0 - 1e-9, ratio)
    assert radius(explicit_newmark(below, 1.0), below) < 1 + 1e-9
    beyond = oscillator(2.0 + 1e-4, ratio)
    parameters = explicit_newmark(oscillator(1.0, ratio * 2.0001), 1.0)  # the method does not contain the stiffness
    assert radius(parameters, beyond) > 1.0
    for omega in (2.0, 2.0 + 1e-9):
        with pytest.raises(InputError):
            explicit_newmark(oscillator(omega, ratio), 1.0)


def test_limit_of_explicit_newmark_is_told_in_one_line():
    with pytest.raises(InputError) as error:
        explicit_newmark(oscillator(400.0), 0.005)
    assert str(error.value) == (
        "explicit Newmark integration is unstable: time step 0.005 s times highest frequency 400 rad/s is 2; "
        "< 2 is required, a time step < 0.005 s"
    )


def test_limit_of_explicit_newmark_with_unequal_dampers_is_that_of_the_highest_mode():
    building = ShearBuilding((900.0, 850.0, 800.0), (4e6, 3.5e6, 3e6), (9e4, 0.0, 2e3))
    limit = 2.0 / float(building.modes().frequencies[-1])
    system = chain(building)
    assert radius(explicit_newmark(system, 0.9999 * limit), system) < 1.0
    with pytest.raises(InputError, match=f"a time step < {limit:.6g} s"):
        explicit_newmark(system, limit)


@pytest.mark.parametrize("name", METHODS)
def test_integrator_does_what_its_amplification_matrix_says(name):
    building = ShearBuilding((900.0, 850.0, 800.0), (4e6, 3.5e6, 3e6), (3000.0, 0.0, 2000.0))
    system = chain(building)
    parameters = METHODS[name](system, 0.005)
    integrator = ExplicitIntegrator(parameters, system.mass, system.damping, lambda u: system.stiffness @ u)
    load = np.array([1e4, -2e4, 5e3])
    integrator.start(load)
    state = np.concatenate((np.zeros(6), load / building.masses, load))
    matrix = amplification_matrix(parameters, system)
    for _ in range(50):
        integrator.step(np.zeros(3))
        state = matrix @ state
        assert integrator.displacement == pytest.approx(state[:3], rel=1e-9, abs=1e-12)
        assert integrator.velocity == pytest.approx(state[3:6], rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("rho", [None, 0.0, 0.75, 1.0])
def test_displacements_are_those_of_the_published_form(rho):
    """Chen and Ricles (2008) without rho, Kolay and Ricles (2014) with it, in their own variables."""
    building = ShearBuilding((900.0, 850.0, 800.0), (4e6, 3.5e6, 3e6), (3000.0, 0.0, 2000.0))
    system, dt = chain(building), 0.005
    m, c, k = system.mass, system.damping, system.stiffness
    if rho is None:
        alpha_m, alpha_f, gamma, beta = 0.0, 0.0, 0.5, 0.25
        parameters = chen_ricles(system, dt)
    else:
        alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 - alpha_m + alpha_f
        beta = (0.5 + gamma) ** 2 / 4
        parameters = kolay_ricles(system, dt, rho)
    alpha = m + gamma * dt * c + beta * dt**2 * k
    alpha_1 = np.linalg.solve(alpha, m)
    alpha_2 = (0.5 + gamma) * alpha_1
    alpha_3 = np.linalg.solve(alpha, alpha_m * m + alpha_f * gamma * dt * c + alpha_f * beta * dt**2 * k)
    time = np.arange(200) * dt
    loads = np.outer(np.sin(20 * time), [1e4, -2e4, 5e3])
    integrator = ExplicitIntegrator(parameters, m, c, lambda u: k @ u)
    integrator.start(loads[0])
    u, v, a = np.zeros(3), np.zeros(3), np.zeros(3)
    for last, load in pairwise(loads):
        new_v = v + dt * alpha_1 @ a
        new_u = u + dt * v + dt**2 * alpha_2 @ a
        at_v, at_u = (1 - alpha_f) * new_v + alpha_f * v, (1 - alpha_f) * new_u + alpha_f * u
        weighted = np.linalg.solve(m, (1 - alpha_f) * load + alpha_f * last - c @ at_v - k @ at_u)
        a = np.linalg.solve(np.eye(3) - alpha_3, weighted - alpha_3 @ a)
        u, v = new_u, new_v
        integrator.step(load)
        assert integrator.displacement == pytest.approx(u, rel=1e-9, abs=1e-12)
