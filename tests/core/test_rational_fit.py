"""Rational fit: recovers systems that python-control evaluates, chooses orders, stays stable; sections say the same."""

import control
import numpy as np
import pytest

from bmd_rths_core.identification.rational_fit import RationalFit
from bmd_rths_core.identification.rational_model import RationalModel
from bmd_rths_core.identification.sections import sections_of
from bmd_rths_core.identification.spectral_lines import SpectralLines
from bmd_rths_core.identification.vector_fitting import shared_poles
from bmd_rths_core.table.models.dynamics import series

OMEGA = 2 * np.pi * np.linspace(0.5, 25.0, 1500)
PAIR = (1.0, 3.0, 900.0)
RESONANCE = (1.0, 1.108, 2995.0)
ANTIRESONANCE = (1.0, 1.186, 3051.0)


def polynomial(*factors):
    product = np.array([1.0])
    for factor in factors:
        product = np.polymul(product, factor)
    return product


SYSTEMS = {
    "real pole": ([50.0], [1.0, 50.0]),
    "two real poles": ([4000.0], polynomial((1.0, 40.0), (1.0, 100.0))),
    "servo": ([1.6e6], polynomial((1.0, 49.6), (1.0, 61.3, 33709.0))),
    "biproper": ([1.0, 5.0, 800.0], PAIR),
    "interaction": (8e5 * polynomial(ANTIRESONANCE), polynomial(RESONANCE, (1.0, 80.0), (1.0, 60.0, 12000.0))),
    "real zeros": (polynomial((1.0, -30.0), (1.0, 45.0), (2.0, 70.0)), polynomial(PAIR, (1.0, 45.0, 9000.0))),
    "zero at s = 0": ([3.0, 0.0], PAIR),
}


def lines_of(responses, noise=0.0, seed=0):
    """Return lines of given responses with noise of constant size, and the weights that belong to it."""
    responses = np.column_stack(responses)
    random = np.random.default_rng(seed)
    error = random.normal(size=responses.shape) + 1j * random.normal(size=responses.shape)
    return SpectralLines(OMEGA, responses + noise * error / np.sqrt(2), np.full(responses.shape, 1 / max(noise, 1e-3)))


def response_of(numerator, denominator):
    return control.frequency_response(control.tf(numerator, denominator), OMEGA).complex


@pytest.mark.parametrize("name", SYSTEMS)
def test_system_without_noise_is_recovered(name):
    numerator, denominator = SYSTEMS[name]
    expected = response_of(numerator, denominator)
    model = RationalFit(lines_of([expected])).model(len(denominator) - 1)
    assert model.response(OMEGA)[:, 0] == pytest.approx(expected, rel=1e-6, abs=1e-8)
    poles = np.roots(denominator)
    assert np.sort_complex(model.poles) == pytest.approx(np.sort_complex(poles), rel=1e-4)


@pytest.mark.parametrize("name", SYSTEMS)
def test_sections_have_the_response_of_the_model(name):
    """`series` makes a state space of them, which is the table that the simulation runs."""
    numerator, denominator = SYSTEMS[name]
    model = RationalFit(lines_of([response_of(numerator, denominator)])).model(len(denominator) - 1)
    assert sections_response(model) == pytest.approx(model.response(OMEGA)[:, 0], rel=1e-7, abs=1e-9)


def sections_response(model):
    space = series(sections_of(model))
    identity = np.eye(len(space.a))
    resolvents = np.linalg.solve(1j * OMEGA[:, None, None] * identity - space.a, space.b)
    return (space.c @ resolvents)[:, 0, 0] + space.d


@pytest.mark.parametrize("degree", range(6))
@pytest.mark.parametrize("seed", range(4))
def test_sections_of_any_structure(seed, degree):
    random = np.random.default_rng(seed)
    quadratics = random.uniform(0.01, 2.0, size=(2, 2))
    numerators = random.normal(size=(degree + 1, 1))
    model = RationalModel(100.0, quadratics, random.uniform(0.1, 2.0, size=1), numerators, 0.0)
    assert sections_response(model) == pytest.approx(model.response(OMEGA)[:, 0], rel=1e-8)
    even = RationalModel(100.0, quadratics, np.zeros(0), numerators[:5], 0.0)
    assert sections_response(even) == pytest.approx(even.response(OMEGA)[:, 0], rel=1e-8)


def test_shared_poles_of_several_responses():
    denominator = polynomial(PAIR, RESONANCE)
    responses = [response_of(n, denominator) for n in ([1e6], [1e3, 1e5], [900.0, 0.0, 2e5])]
    lines = lines_of(responses)
    scale = OMEGA[-1]
    poles = scale * shared_poles(1j * OMEGA / scale, lines.response, lines.weight, 4)
    expected = [np.roots(factor)[0] for factor in (RESONANCE, PAIR)]
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(expected), rel=1e-6)
    model = RationalFit(lines).model_near(0.98 * poles)
    assert model.response(OMEGA) == pytest.approx(lines.response, rel=1e-6, abs=1e-8)


def test_pure_delay_is_found_and_not_invented():
    plain = response_of(*SYSTEMS["servo"])
    noisy = lines_of([plain * np.exp(-1j * OMEGA * 0.0217)], noise=0.01)
    fit = RationalFit(noisy)
    model = fit.simplified(fit.delayed_model(3, 0.05))
    assert model.delay == pytest.approx(0.0217, abs=5e-5)
    assert model.degree == 0
    without = RationalFit(lines_of([plain], noise=0.01))
    assert without.criterion(without.simplified(without.model(3))) < without.criterion(without.delayed_model(3, 0.05))


@pytest.mark.parametrize("seed", range(3))
def test_criterion_is_best_for_the_true_order_and_degree(seed):
    fit = RationalFit(lines_of([response_of(*SYSTEMS["interaction"])], noise=0.02, seed=seed))
    models = {order: fit.model(order) for order in range(1, 8)}
    assert min(models, key=lambda order: fit.criterion(models[order])) == 5
    assert fit.simplified(models[5]).degree == 2
    # Real and imaginary part have half of the variance each.
    assert fit.residual_power(models[5]) == pytest.approx(0.5, abs=0.05)


def test_criterion_is_that_of_schwarz():
    lines = lines_of([response_of(*SYSTEMS["servo"])], noise=0.05)
    fit = RationalFit(lines)
    model = fit.simplified(fit.model(3))
    squares = np.sum(np.abs(lines.response - model.response(OMEGA)) ** 2) / 0.05**2
    assert model.parameters == 4
    assert fit.criterion(model) == pytest.approx(3000 * np.log(squares / 3000) + 4 * np.log(3000))


def test_improvement_after_vector_fitting_reaches_the_smallest_error():
    """No small change of a pole may lower the error."""
    fit = RationalFit(lines_of([response_of(*SYSTEMS["interaction"])], noise=0.05))
    model = fit.simplified(fit.model(5))
    for i in np.ndindex(model.quadratics.shape):
        for factor in (0.995, 1.005):
            changed = model.quadratics.copy()
            changed[i] *= factor
            other = RationalModel(model.scale, changed, model.linears, model.numerators, 0.0)
            assert fit.residual_power(other) > fit.residual_power(model)


def test_poles_of_an_unstable_system_are_reflected():
    expected = response_of([900.0], [1.0, -3.0, 900.0])
    model = RationalFit(lines_of([expected])).model(2)
    assert (model.poles.real < 0.0).all()


def test_lines_without_weight_do_not_count():
    expected = response_of(*SYSTEMS["servo"])
    lines = lines_of([expected])
    lines.response[100:200] = 1e3
    lines.weight[100:200] = 0.0
    assert RationalFit(lines).model(3).response(OMEGA)[:, 0] == pytest.approx(expected, rel=1e-6)
