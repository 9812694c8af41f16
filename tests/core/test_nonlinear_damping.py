"""Rayleigh and modal damping against the definition of the modal damping ratio."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.damping import modal_damping, rayleigh_coefficients, rayleigh_damping
from bmd_rths_core.structure.shear_building import ShearBuilding

BUILDING = ShearBuilding((900.0, 850.0, 800.0, 700.0), (4e6, 3.5e6, 3e6, 2e6), (0.0,) * 4)


def modal_matrix(damping):
    shapes = BUILDING.modes().shapes
    return shapes.T @ damping @ shapes


def test_modal_damping_gives_every_mode_its_ratio_and_couples_none():
    ratios = np.array([0.02, 0.05, 0.0, 0.1])
    expected = np.diag(2 * ratios * BUILDING.modes().frequencies)
    assert modal_matrix(modal_damping(BUILDING, ratios)) == pytest.approx(expected, abs=1e-10)


def test_modal_damping_of_a_free_vibration_decays_as_its_ratio_says():
    """The complex eigenvalues of the first-order system are −ζ ω ± i ω √(1 − ζ²)."""
    ratios = np.array([0.02, 0.05, 0.1, 0.3])
    inverse = np.diag(1 / np.asarray(BUILDING.masses))
    damping = modal_damping(BUILDING, ratios)
    a = np.block([[np.zeros((4, 4)), np.eye(4)], [-inverse @ BUILDING.stiffness_matrix, -inverse @ damping]])
    values = np.linalg.eigvals(a)
    values = values[values.imag > 0]
    values = values[np.argsort(np.abs(values))]
    assert np.abs(values) == pytest.approx(BUILDING.modes().frequencies, rel=1e-9)
    assert -values.real / np.abs(values) == pytest.approx(ratios, rel=1e-9)


@pytest.mark.parametrize("modes", [(0, 1), (0, 3), (2, 1)])
def test_rayleigh_damping_meets_both_ratios_and_the_curve_between(modes):
    frequencies = BUILDING.modes().frequencies
    targets = [float(frequencies[mode]) for mode in modes]
    alpha, beta = rayleigh_coefficients(targets, (0.02, 0.03))
    matrix = modal_matrix(rayleigh_damping(BUILDING, alpha, beta))
    ratios = np.diag(matrix) / (2 * frequencies)
    assert matrix == pytest.approx(np.diag(np.diag(matrix)), abs=1e-10)
    assert ratios[list(modes)] == pytest.approx([0.02, 0.03], rel=1e-10)
    assert ratios == pytest.approx(alpha / (2 * frequencies) + beta * frequencies / 2, rel=1e-10)


def test_stiffness_proportional_damping_is_that_of_story_dampers():
    dampers = replace(BUILDING, damping_coefficients=tuple(1e-3 * k for k in BUILDING.stiffnesses))
    assert rayleigh_damping(BUILDING, 0.0, 1e-3) == pytest.approx(dampers.damping_matrix)


def test_negative_damping_of_a_mode_is_refused():
    frequencies = [float(f) for f in BUILDING.modes().frequencies[:2]]
    with pytest.raises(InputError, match=r"gives mode 4 a ratio of -0\.\d+; >= 0 is required"):
        rayleigh_damping(BUILDING, *rayleigh_coefficients(frequencies, (0.2, 0.01)))
