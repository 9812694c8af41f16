"""Numerical substructure against closed forms, scipy.signal.lsim and a tight solve_ivp."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from bmd_rths_core.config import Config
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure, NumericalSubstructureConfig

DT = 0.005
THREE_STORIES = NumericalSubstructureConfig((900.0, 850.0, 800.0), (4e6, 3.5e6, 3e6), (3000.0, 2500.0, 2000.0))


def respond(config, ground, shear):
    """Return desired acceleration and required force of every step; shear[k] is the one used at step k."""
    stage = NumericalSubstructure(config, DT)
    return np.array([stage.step(a, f) for a, f in zip(ground, shear, strict=True)]).T


def random_loads(n, seed=1):
    rng = np.random.default_rng(seed)
    ground, shear = rng.normal(size=n), 500.0 * rng.normal(size=n)
    shear[0] = 0.0
    return ground, shear


def test_undamped_oscillator_under_a_ramp_of_shear_has_the_closed_form_response():
    m, k = 8000.0, 8000.0 * 94.09**2
    config = NumericalSubstructureConfig((m,), (k,), (0.0,))
    time = np.arange(400) * DT
    omega, rate = 94.09, 1000.0
    desired, required = respond(config, np.zeros_like(time), rate * time)
    # u = (rate/k)(t − sin ωt / ω), so ü = (rate/k) ω sin ωt.
    assert desired == pytest.approx(rate / k * omega * np.sin(omega * time), abs=1e-9)
    assert required == pytest.approx(rate * time, abs=1e-8)


@pytest.mark.parametrize("config", [Config().numerical_substructure, THREE_STORIES], ids=["one story", "three stories"])
def test_piecewise_linear_loads_agree_with_scipy_lsim(config):
    ground, shear = random_loads(600)
    desired, _ = respond(config, ground, shear)
    a, b, _ = config.building().relative_motion()
    n = config.building().stories
    shear_input = np.zeros((2 * n, 1))
    shear_input[-1] = 1.0 / config.masses[-1]
    inputs = np.hstack((b, shear_input))
    output = a[-1:], np.array([[0.0, 1.0 / config.masses[-1]]])
    _, expected, _ = lsim((a, inputs, *output), np.column_stack((ground, shear)), np.arange(600) * DT, interp=True)
    assert desired == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_three_stories_agree_with_a_tight_ode_solution():
    ground, shear = random_loads(60, seed=3)
    ground[0] = 0.0
    desired, _ = respond(THREE_STORIES, ground, shear)
    building = THREE_STORIES.building()
    time = np.arange(60) * DT
    inverse_mass = np.diag(1.0 / np.asarray(building.masses))

    def derivative(t, y):
        u, v = y[:3], y[3:]
        load = np.array([0.0, 0.0, np.interp(t, time, shear)])
        force = load - building.damping_matrix @ v - building.stiffness_matrix @ u
        return np.concatenate((v, inverse_mass @ force - np.interp(t, time, ground)))

    solution = solve_ivp(derivative, (0.0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-10, atol=1e-12, max_step=DT)
    u, v = solution.y[:3], solution.y[3:]
    restoring = building.damping_matrix @ v + building.stiffness_matrix @ u
    assert desired == pytest.approx((shear - restoring[-1]) / 800.0, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("config", [Config().numerical_substructure, THREE_STORIES], ids=["one story", "three stories"])
def test_equation_of_motion_is_balanced_by_the_shear_fed_back(config):
    ground, shear = random_loads(300)
    _, required = respond(config, ground, shear)
    assert required == pytest.approx(shear, abs=1e-7)


def test_reset_returns_to_rest():
    ground, shear = random_loads(50)
    stage = NumericalSubstructure(THREE_STORIES, DT)
    first = [stage.step(a, f) for a, f in zip(ground, shear, strict=True)]
    stage.reset()
    assert [stage.step(a, f) for a, f in zip(ground, shear, strict=True)] == first


def test_first_step_is_at_rest_whatever_the_ground_does():
    response = NumericalSubstructure(THREE_STORIES, DT).step(3.0, 0.0)
    assert response.desired_acceleration == 0.0
    assert response.required_force == 0.0
