"""Exact discretisation against scipy and python-control."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from bmd_rths_core.integration.discretisation import first_order_hold, zero_order_hold


def random_system(seed, n=4, m=2):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n)) * 20.0
    a -= (np.linalg.eigvals(a).real.max() + 1.0) * np.eye(n)
    return a, rng.normal(size=(n, m)), np.eye(n), np.zeros((n, m))


@given(st.integers(0, 10_000), st.sampled_from([0.001, 0.005, 0.02]))
def test_zero_order_hold_agrees_with_scipy_and_python_control(seed, dt):
    a, b, c, d = random_system(seed)
    phi, gamma = zero_order_hold(a, b, dt)
    scipy_phi, scipy_gamma, *_ = cont2discrete((a, b, c, d), dt, method="zoh")
    theirs = control.c2d(control.ss(a, b, c, d), dt, method="zoh")
    for ours, other in ((phi, scipy_phi), (gamma, scipy_gamma), (phi, theirs.A), (gamma, theirs.B)):
        assert ours == pytest.approx(other, rel=1e-9, abs=1e-12)


@given(st.integers(0, 10_000), st.sampled_from([0.001, 0.005, 0.02]))
def test_first_order_hold_agrees_with_scipy(seed, dt):
    a, b, c, d = random_system(seed)
    phi, gamma_0, gamma_1 = first_order_hold(a, b, dt)
    # scipy shifts the state so that the input appears at one instant only: B = Γ₀ + Φ Γ₁, D = C Γ₁.
    scipy_phi, scipy_b, _, scipy_d, _ = cont2discrete((a, b, c, d), dt, method="foh")
    assert phi == pytest.approx(scipy_phi, rel=1e-9, abs=1e-12)
    assert gamma_0 + phi @ gamma_1 == pytest.approx(scipy_b, rel=1e-9, abs=1e-12)
    assert gamma_1 == pytest.approx(scipy_d, rel=1e-9, abs=1e-12)


def test_integrator_has_the_closed_form_weights():
    _, gamma_0, gamma_1 = first_order_hold(np.zeros((1, 1)), np.ones((1, 1)), 0.25)
    assert gamma_0[0, 0] == pytest.approx(0.125, rel=1e-14)
    assert gamma_1[0, 0] == pytest.approx(0.125, rel=1e-14)
