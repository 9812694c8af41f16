"""Shear building: Table 1 of the paper, and independent eigenvalue solutions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.shear_building import ShearBuilding, mass_ratio

TABLE_1 = ShearBuilding((760.0, 800.0), (2495320.0, 4941700.0), (3330.0, 78.0))
positive = st.floats(1e-1, 1e3)


def test_table_1_gives_the_frequencies_damping_and_mass_of_the_paper():
    modes = TABLE_1.modes()
    assert [f"{f / (2 * np.pi):.3f}" for f in modes.frequencies] == ["5.938", "19.211"]
    assert [f"{100 * z:.3f}" for z in modes.damping_ratios] == ["2.136", "1.238"]
    assert f"{modes.effective_masses[0]:.0f}" == "1535"
    assert f"{mass_ratio(modes.effective_masses[0], 8000.0):.3f}" == "0.161"
    assert f"{94.09 / modes.frequencies[0]:.2f}" == "2.52"


def test_default_configuration_is_the_simplified_bmd():
    config = Config()
    assert config.specimen.building() == TABLE_1
    (frequency,) = config.numerical_substructure.building().modes().frequencies
    (damping,) = config.numerical_substructure.building().modes().damping_ratios
    assert frequency == pytest.approx(94.09, rel=1e-12)
    assert damping == pytest.approx(0.0167, rel=1e-12)


def test_matrices_are_those_of_equation_2():
    building = ShearBuilding((1.0, 2.0, 3.0), (10.0, 20.0, 30.0), (0.1, 0.2, 0.3))
    assert np.array_equal(building.mass_matrix, np.diag([1.0, 2.0, 3.0]))
    assert np.array_equal(building.stiffness_matrix, [[30.0, -20.0, 0.0], [-20.0, 50.0, -30.0], [0.0, -30.0, 30.0]])
    assert np.allclose(building.damping_matrix, [[0.3, -0.2, 0.0], [-0.2, 0.5, -0.3], [0.0, -0.3, 0.3]], atol=1e-15)


def test_uniform_cantilever_has_the_closed_form_frequencies():
    n, k, m = 7, 3.0e6, 2.0e3
    building = ShearBuilding((m,) * n, (k,) * n, (0.0,) * n)
    i = np.arange(1, n + 1)
    closed_form = 2.0 * np.sqrt(k / m) * np.sin((2 * i - 1) * np.pi / (2 * (2 * n + 1)))
    assert building.modes().frequencies == pytest.approx(closed_form, rel=1e-10)


@given(st.lists(st.tuples(positive, positive), min_size=1, max_size=6))
def test_modes_of_random_buildings_agree_with_the_eigenvalues_of_the_state_matrix(stories):
    masses, stiffnesses = zip(*stories, strict=True)
    # Damping proportional to stiffness keeps the modes real, so that ζᵢ = β ωᵢ / 2 holds exactly.
    beta = 1e-4
    building = ShearBuilding(masses, stiffnesses, tuple(beta * k for k in stiffnesses))
    modes = building.modes()
    a, _, _ = building.relative_motion()
    eigenvalues = np.linalg.eigvals(a)
    # The eigenvalue solver of the unsymmetric matrix is good to about √ε of the largest frequency.
    tolerance = 1e-6 * modes.frequencies[-1]
    assert np.sort(np.abs(eigenvalues))[::2] == pytest.approx(modes.frequencies, rel=1e-5, abs=tolerance)
    assert modes.damping_ratios == pytest.approx(0.5 * beta * modes.frequencies, rel=1e-6)
    assert modes.effective_masses.sum() == pytest.approx(building.total_mass, rel=1e-9)


def test_building_stacked_on_another_is_the_whole_building():
    lower = ShearBuilding((8000.0,), (7e7,), (2.5e4,))
    whole = TABLE_1.stacked_on(lower)
    assert whole.masses == (8000.0, 760.0, 800.0)
    assert whole.stiffness_matrix[0, 0] == 7e7 + 2495320.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((-760.0,), (1.0,), (0.0,)), "masses[0]: -760 is not allowed; > 0 kg is required"),
        (((1.0,), (0.0,), (0.0,)), "stiffnesses[0]: 0 is not allowed; > 0 N/m is required"),
        (((1.0,), (1.0,), (-1.0,)), "damping_coefficients[0]: -1 is not allowed; >= 0 N s/m is required"),
        (((1.0,), (float("nan"),), (1.0,)), "stiffnesses[0]: nan is not allowed; > 0 N/m is required"),
    ],
)
def test_impossible_values_are_refused(arguments, message):
    with pytest.raises(InputError) as error:
        ShearBuilding(*arguments)
    assert str(error.value) == message


def test_lists_of_different_length_are_refused():
    with pytest.raises(InputError, match="they have 2, 1 and 1 entries"):
        ShearBuilding((1.0, 1.0), (1.0,), (0.0,))
