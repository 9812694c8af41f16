"""Story springs against closed forms and a tight ODE solution of the Bouc-Wen equation."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.structure.story_springs import BilinearSpring, BoucWenSpring, LinearSpring, StorySprings

K, UY = 2e6, 0.004
CYCLES = np.concatenate([np.linspace(a, b, 400)[1:] for a, b in [(0, 1), (1, -1), (-1, 1)]])


def forces(spring, drifts):
    return np.array([spring.force(drift) for drift in drifts])


def loop_energy(spring, amplitude):
    """Return the energy of one closed cycle in the steady state."""
    drifts = amplitude * CYCLES
    force = forces(spring, drifts)
    drifts, force = drifts[-799:], force[-799:]
    return float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(drifts)))


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.3, 1.0])
def test_bilinear_backbone(ratio):
    drifts = np.linspace(0.0, 5 * UY, 101)
    backbone = np.where(drifts < UY, K * drifts, K * UY + ratio * K * (drifts - UY))
    for sign in (1.0, -1.0):
        assert forces(BilinearSpring(K, UY, ratio), sign * drifts) == pytest.approx(sign * backbone, rel=1e-12)


def test_bilinear_unloads_elastically_and_yields_again_after_twice_the_yield_drift():
    spring = BilinearSpring(K, UY, 0.1)
    peak = spring.force(4 * UY)
    assert spring.force(2 * UY) == pytest.approx(peak - 2 * K * UY)
    assert spring.force(1 * UY) == pytest.approx(peak - 2 * K * UY - 0.1 * K * UY)  # kinematic hardening


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("ductility", [1.0, 1.5, 6.0])
def test_energy_of_a_bilinear_cycle(ratio, ductility):
    """Parallelogram: 4 (1 − α) k u_y (u_max − u_y); for elastic-perfectly-plastic 4 F_y (u_max − u_y)."""
    expected = 4 * (1 - ratio) * K * UY * (ductility - 1) * UY
    # The trapezoidal rule cuts the corners of the loop.
    assert loop_energy(BilinearSpring(K, UY, ratio), ductility * UY) == pytest.approx(expected, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize(("n", "closed_form"), [(1.0, lambda x: 1 - np.exp(-x)), (2.0, np.tanh)])
def test_bouc_wen_loading_curves_have_closed_forms(n, closed_form):
    drifts = np.linspace(0.0, 6 * UY, 61)
    expected = K * UY * closed_form(drifts / UY)
    assert forces(BoucWenSpring(K, UY, 0.0, n=n), drifts) == pytest.approx(expected, rel=1e-5, abs=1e-9)
    (last,) = forces(BoucWenSpring(K, UY, 0.0, n=n), drifts[-1:])  # in one step
    assert last == pytest.approx(expected[-1], rel=1e-4)


@pytest.mark.parametrize(
    "shape",
    [(1.0, 0.5, 0.5, 1.0), (1.0, 0.5, 0.5, 2.0), (1.0, 0.8, -0.3, 3.0), (2.0, 0.6, 0.1, 1.5), (1.0, 0.5, 0.5, 8)],
)
def test_bouc_wen_agrees_with_a_tight_ode_solution(shape):
    a, beta, gamma, n = shape
    time = np.linspace(0.0, 10.0, 1001)

    def drift(t):
        return UY * (2.5 * np.sin(2.0 * t) * np.sin(0.3 * t) + 0.5 * np.sin(5.0 * t))

    def rate(t, z):
        v = UY * (
            5.0 * np.cos(2.0 * t) * np.sin(0.3 * t) + 0.75 * np.sin(2.0 * t) * np.cos(0.3 * t) + 2.5 * np.cos(5.0 * t)
        )
        return v / UY * (a - np.abs(z) ** n * (beta * np.sign(v * z) + gamma))

    z = solve_ivp(rate, (0, 10), [0.0], t_eval=time, rtol=1e-9, atol=1e-11, max_step=0.01).y[0]
    expected = 0.1 * K * drift(time) + 0.9 * K * UY * z
    response = forces(BoucWenSpring(K, UY, 0.1, *shape), drift(time))
    # The samples miss the peak of a reversal by up to a quarter of a sampling step squared: 1e-3 of the yield force.
    assert response == pytest.approx(expected, abs=2e-3 * K * UY)
    finer = BoucWenSpring(K, UY, 0.1, *shape)
    finer_response = forces(finer, drift(np.linspace(0.0, 10.0, 20001)))[::20]
    assert finer_response == pytest.approx(expected, abs=2e-5 * K * UY)


def test_bouc_wen_approaches_the_bilinear_spring():
    drifts = 4 * UY * CYCLES
    bilinear = forces(BilinearSpring(K, UY, 0.1), drifts)
    # With beta = gamma unloading is elastic, as that of the bilinear spring.
    errors = [np.abs(forces(BoucWenSpring(K, UY, 0.1, n=n), drifts) - bilinear).max() for n in (2, 5, 10, 20, 50)]
    assert all(later < 0.6 * earlier for earlier, later in pairwise(errors))
    assert errors[-1] < 0.02 * K * UY


@pytest.mark.parametrize(
    "shape", [(1.0, 0.5, 0.5, 2.0), (1.0, 0.9, -0.4, 1.0), (3.0, 0.6, 0.1, 20.0), (1, 0.5, 0.5, 50)]
)
def test_bouc_wen_is_bounded_and_never_steeper_than_it_says_whatever_the_step(shape):
    a, beta, gamma, n = shape
    limit = K * UY * (a / (beta + gamma)) ** (1 / n)
    spring = BoucWenSpring(K, UY, 0.0, *shape)
    assert (spring.force(1e-9 * UY) / (1e-9 * UY)) == pytest.approx(spring.initial_stiffness, rel=1e-6)
    rng = np.random.default_rng(0)
    drifts = np.cumsum(UY * rng.normal(size=3000) * 10 ** rng.uniform(-3, 1, size=3000))
    response = forces(spring, drifts)
    assert np.abs(response).max() <= limit * (1 + 1e-12)
    steepest = np.abs(np.diff(response) / np.diff(drifts)).max()
    assert 0.9 * spring.highest_stiffness < steepest <= spring.highest_stiffness * (1 + 1e-3)
    assert spring.force(1e300) == pytest.approx(limit)
    assert spring.force(-1e300) == pytest.approx(-limit)


@pytest.mark.parametrize("spring", [LinearSpring(K), BilinearSpring(K, UY, 0.1), BoucWenSpring(K, UY, 0.1)])
def test_reset_returns_to_the_virgin_state(spring):
    first = forces(spring, 3 * UY * CYCLES)
    spring.reset()
    assert np.array_equal(forces(spring, 3 * UY * CYCLES), first)


def test_linear_stories_give_the_stiffness_matrix_and_p_delta_lowers_it():
    stiffnesses, geometric = (4e6, 3e6, 2e6), (3e5, 2e5, 1e5)
    masses, none = (1.0,) * 3, (0.0,) * 3
    net = tuple(k - g for k, g in zip(stiffnesses, geometric, strict=True))
    shape = np.array([0.01, -0.02, 0.04])
    for loads, expected in ((none, stiffnesses), (geometric, net)):
        stories = StorySprings([LinearSpring(k) for k in stiffnesses], loads)
        matrix = ShearBuilding(masses, expected, none).stiffness_matrix
        assert stories.floor_forces(shape) == pytest.approx(matrix @ shape, rel=1e-12)
