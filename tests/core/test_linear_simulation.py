"""Many runs of a linear system at once, against scipy and against each other."""

import numpy as np
import pytest
from scipy.signal import dlsim

from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import BLOCK, LinearSimulation, SimulationFromRest


def random_system(size, inputs, outputs):
    random = np.random.default_rng(size)
    a = random.standard_normal((size, size))
    shapes = ((size, inputs), (outputs, size), (outputs, inputs))
    return DiscreteStateSpace(0.99 * a / np.abs(np.linalg.eigvals(a)).max(), *map(random.standard_normal, shapes))


@pytest.mark.parametrize("steps", [1, BLOCK - 1, BLOCK, 5 * BLOCK + 7])
@pytest.mark.parametrize("runs", [1, 3])
def test_outputs_are_those_of_scipy(steps, runs):
    system, random = random_system(5, 3, 4), np.random.default_rng(1)
    start, own = random.standard_normal((5, runs)), random.standard_normal((steps, runs))
    shared = random.standard_normal((steps, 2))
    outputs = LinearSimulation(system, start).advance(own, shared)
    assert outputs.shape == (runs, 4, steps)
    for i in range(runs):
        _, expected, _ = dlsim((*system, 1.0), np.column_stack((own[:, i], shared)), x0=start[:, i])
        assert pytest.approx(expected, rel=1e-11, abs=1e-11 * np.abs(expected).max()) == outputs[i].T


def test_one_call_equals_several_and_runs_can_be_taken_out():
    system, random = random_system(4, 1, 2), np.random.default_rng(2)
    own = random.standard_normal((300, 3))
    whole = LinearSimulation(system, np.ones((4, 3))).advance(own)
    simulation = LinearSimulation(system, np.ones((4, 3)))
    first = simulation.advance(own[:100])
    simulation.keep(np.array([True, False, True]))
    second = simulation.advance(own[100:, [0, 2]])
    assert first == pytest.approx(whole[..., :100], rel=1e-12, abs=1e-12)
    assert second == pytest.approx(whole[[0, 2], :, 100:], rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("steps", [1, 2 * BLOCK, 11 * BLOCK + 5])
def test_outputs_from_rest_are_those_of_a_run(steps):
    system, own = random_system(6, 1, 3), np.random.default_rng(4).standard_normal(steps)
    (expected,) = LinearSimulation(system, np.zeros((6, 1))).advance(own[:, None])
    assert SimulationFromRest(system).outputs(own) == pytest.approx(
        expected, rel=1e-10, abs=1e-11 * np.abs(expected).max()
    )
