"""Reference response against scipy.signal.lsim and a tight ODE solution."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.config import Config

DT = 0.005


def whole_building():
    config = Config()
    return config.specimen.building().stacked_on(config.numerical_substructure.building())


def test_reference_agrees_with_scipy_lsim():
    ground = np.random.default_rng(0).normal(size=500)
    building = whole_building()
    a, b, c = building.relative_motion()
    _, expected, _ = lsim((a, b, c, np.zeros((3, 1))), ground, np.arange(500) * DT, interp=True)
    assert reference_response(building, ground, DT) == pytest.approx(expected, rel=1e-8, abs=1e-9)


@pytest.mark.slow
def test_reference_agrees_with_a_tight_ode_solution_of_equation_1():
    building = whole_building()
    time = np.arange(100) * DT
    ground = np.sin(25.0 * time) * np.exp(-time)
    inverse = np.linalg.inv(building.mass_matrix)

    def derivative(t, y):
        acceleration = -inverse @ (building.damping_matrix @ y[3:] + building.stiffness_matrix @ y[:3])
        return np.concatenate((y[3:], acceleration - np.interp(t, time, ground)))

    solution = solve_ivp(derivative, (0.0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-11, atol=1e-13, max_step=DT)
    absolute = -inverse @ (building.damping_matrix @ solution.y[3:] + building.stiffness_matrix @ solution.y[:3])
    assert reference_response(building, ground, DT) == pytest.approx(absolute.T, rel=1e-6, abs=1e-7)
