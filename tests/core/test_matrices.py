"""Structures as engineers have them: by matrices, with modal or Rayleigh damping, integrated exactly where linear."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import savemat

from bmd_rths_core.analysis.metrics import references_of
from bmd_rths_core.config import Config, config_from_mapping, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess
from bmd_rths_core.stability.discrete import configured_mass_ratio, with_mass_ratio
from bmd_rths_core.stability.models import experimental_building, numerical_building
from bmd_rths_core.structure.matrix_building import matrix_building
from bmd_rths_core.structure.matrix_file import read_matrices
from bmd_rths_core.structure.shear_building import ShearBuilding

THREE = {"masses": [4000.0, 4000.0, 3000.0], "stiffnesses": [4e7, 3e7, 2e7]}
TWO = ShearBuilding((760.0, 800.0), (2495320.0, 4941700.0), (3330.0, 78.0))
THREE_STORIES = ShearBuilding((4000.0, 4000.0, 3000.0), (4e7, 3e7, 2e7), (2e4, 2e4, 1e4))


def condensed():
    """Consistent mass and bending stiffness: full matrices, as a condensed model has them."""
    mass = 900.0 * np.array([[4.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]]) / 3.0
    stiffness = 5e6 * np.array([[7.0, -4.0, 1.0], [-4.0, 6.0, -2.5], [1.0, -2.5, 1.6]])
    damping = 0.4 * mass + 2e-4 * stiffness
    return matrix_building("specimen", mass, damping, stiffness)


def write(path, building):
    if path.suffix == ".npz":
        np.savez(path, M=building.mass_matrix, C=building.damping_matrix, K=building.stiffness_matrix)
    elif path.suffix == ".mat":
        savemat(path, {"M": building.mass_matrix, "C": building.damping_matrix, "K": building.stiffness_matrix})
    else:
        rows = ["# condensed", ""]
        for name, matrix in (
            ("M", building.mass_matrix),
            ("C", building.damping_matrix),
            ("K", building.stiffness_matrix),
        ):
            rows += [name, *(", ".join(repr(value) for value in row) for row in matrix.tolist())]
        path.write_text("\n".join(rows))
    return str(path)


def given(path, section, **values):
    return config_from_mapping({section: {"matrices": path, **values}})


@pytest.mark.parametrize("ending", ["csv", "npz", "mat"])
def test_matrices_are_read_from_a_file_and_travel_with_the_configuration(tmp_path, ending):
    path = write(tmp_path / f"model.{ending}", condensed())
    config = given(path, "specimen")
    assert config.specimen.building() == condensed()
    assert config.specimen.masses == condensed().masses
    assert config.specimen.identified_frequency == 0.0
    (tmp_path / f"model.{ending}").unlink()
    copy = tmp_path / "copy.yaml"
    copy.write_text(dump_config(config))
    assert load_config(copy) == config
    assert config_from_mapping(config.as_mapping()) == config
    stories = config.changed(specimen__masses=[1.0], specimen__stiffnesses=[1e3], specimen__damping_coefficients=[1.0])
    assert stories.specimen.building() == ShearBuilding((1.0,), (1e3,), (1.0,))


def test_matrices_of_a_chain_are_the_chain_to_every_analysis(tmp_path):
    """Simulation, reference, eigenvalues of the loop and both transfer functions: once by stories, once by matrices."""
    specimen, numerical = write(tmp_path / "e.npz", TWO), write(tmp_path / "n.npz", THREE_STORIES)
    by_matrices = config_from_mapping(
        {
            "specimen": {"matrices": specimen},
            "numerical_substructure": {"matrices": numerical},
            "force_correction": {"feedback_scale": 0.1},
        }
    )
    stories = {
        "masses": list(THREE_STORIES.masses),
        "stiffnesses": list(THREE_STORIES.stiffnesses),
        "damping_coefficients": list(THREE_STORIES.damping_coefficients),
    }
    by_stories = config_from_mapping({"numerical_substructure": stories, "force_correction": {"feedback_scale": 0.1}})
    ground = GroundMotion("test", 0.005, np.random.default_rng(1).standard_normal(400), "test", "0" * 64)
    records = [RthsLoop(config, ground).run() for config in (by_matrices, by_stories)]
    for name in ("command", "table_acceleration", "floor_accelerations", "corrected_force"):
        ours, theirs = (getattr(record, name) for record in records)
        assert ours == pytest.approx(theirs, abs=1e-7 * np.abs(theirs).max()), name
    ours, theirs = (references_of([ground.acceleration], config)[0] for config in (by_matrices, by_stories))
    assert ours == pytest.approx(theirs, abs=1e-9 * np.abs(theirs).max())
    ours, theirs = (assess(config, AnalysisOptions()) for config in (by_matrices, by_stories))
    assert ours.discrete.spectral_radius == pytest.approx(theirs.discrete.spectral_radius, abs=1e-9)
    for name, analysis in ours.analyses.items():
        expected = theirs.analyses[name].margin.allowable_mass_ratio
        assert analysis.margin.allowable_mass_ratio == pytest.approx(expected, rel=1e-6), name


def test_transfer_functions_of_full_matrices_are_those_of_their_dynamic_stiffness():
    """Independent of zeros and poles: one linear system for each frequency."""
    building = condensed()
    m, c, k = building.mass_matrix, building.damping_matrix, building.stiffness_matrix
    first = building.modes().effective_masses[0]
    omega = np.geomspace(1.0, 600.0, 40)
    ones, roof = np.ones(3), np.eye(3)[-1]
    experimental, numerical = experimental_building(building), numerical_building(building)
    for w in omega:
        dynamic = np.linalg.inv(-(w**2) * m + 1j * w * c + k)
        shear = ones @ (1j * w * c + k) @ dynamic @ m @ ones
        assert experimental.response(np.array([w]))[0] == pytest.approx(shear / first, rel=1e-8)
        assert numerical.response(np.array([w]))[0] == pytest.approx(first * roof @ dynamic @ roof, rel=1e-8)


def test_the_numerical_substructure_of_full_matrices_is_integrated_exactly(tmp_path):
    """Against the equation of motion M u" + C u' + K u = −M 1 a_g + e f by another integrator."""
    config = given(write(tmp_path / "n.npz", condensed()), "numerical_substructure")
    stage, dt, steps = make_numerical_substructure(config), 0.005, 60
    random = np.random.default_rng(3)
    ground, force = random.standard_normal(steps), 1e3 * random.standard_normal(steps)
    building = condensed()
    m, c, k = building.mass_matrix, building.damping_matrix, building.stiffness_matrix
    inverse, roof, time = np.linalg.inv(m), np.eye(3)[-1], np.arange(steps) * dt

    def rates(t, state):
        a, f = np.interp(t, time, ground), np.interp(t, time, force)
        return np.concatenate((state[3:], inverse @ (roof * f - c @ state[3:] - k @ state[:3]) - a))

    whole = solve_ivp(rates, (0.0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-10, atol=1e-14, max_step=dt / 4)
    response = [stage.step(a, f) for a, f in zip(ground, force, strict=True)]
    states = whole.y.T
    expected = (inverse @ (roof[:, None] * force - c @ states[:, 3:].T - k @ states[:, :3].T))[-1]
    ours = np.array([entry.desired_acceleration for entry in response])
    assert ours == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())
    assert [entry.required_force for entry in response] == pytest.approx(force)


def test_the_loop_with_a_full_specimen_is_its_matrices(tmp_path):
    """A run without noise follows the closed loop, and its reference is the building of both."""
    config = given(write(tmp_path / "e.npz", condensed()), "specimen").changed(
        simulated_table__acceleration_noise=0.0,
        simulated_table__dynamics="perfect",
        run__scheme="uc",
        shear_estimator__source="load_cell",
        simulated_table__shear_noise=0.0,
        force_correction__feedback_scale=0.05,
    )
    assert closed_loop(config).spectral_radius < 1.0
    ground = GroundMotion("test", 0.005, 0.1 * np.sin(np.arange(600) * 0.03), "test", "0" * 64)
    record = RthsLoop(config, ground).run()
    reference = references_of([ground.acceleration], config)[0]
    assert record.desired_acceleration == pytest.approx(reference[:, 0], abs=0.03 * np.abs(reference).max())
    assert record.floor_accelerations[:, -1] == pytest.approx(reference[:, -1], abs=0.06 * np.abs(reference).max())


@pytest.mark.parametrize("section", ["specimen", "numerical_substructure"])
def test_modal_and_rayleigh_damping_need_no_coefficients(section):
    modal = config_from_mapping({section: {**THREE, "damping": "modal", "damping_ratios": [0.02]}})
    building = getattr(modal, section).building()
    assert building.modes().damping_ratios == pytest.approx([0.02] * 3)
    rayleigh = config_from_mapping(
        {section: {**THREE, "damping": "rayleigh", "damping_ratios": [0.02, 0.03], "rayleigh_modes": [1, 3]}}
    )
    assert getattr(rayleigh, section).building().modes().damping_ratios[[0, 2]] == pytest.approx([0.02, 0.03])
    assert closed_loop(rayleigh).system.a.shape[0] > 0


@pytest.mark.parametrize("where", ["nonlinear", "numerical_substructure"])
def test_rayleigh_damping_is_integrated_exactly(where):
    """No explicit method is asked for any more; the result is that of the same dampers as a chain."""
    beta = 4e-4  # in proportion to stiffness: dampers of the stories
    frequencies = ShearBuilding(tuple(THREE["masses"]), tuple(THREE["stiffnesses"]), (0.0,) * 3).modes().frequencies
    ratios = [beta * w / 2 for w in frequencies[:2]]
    damping = {"damping": "rayleigh", "damping_ratios": ratios, "rayleigh_modes": [1, 2]}
    numerical = {**THREE, "damping_coefficients": [0.0] * 3} | (damping if where == "numerical_substructure" else {})
    ours = config_from_mapping(
        {"numerical_substructure": numerical} | ({where: damping} if where == "nonlinear" else {})
    )
    chain = config_from_mapping(
        {"numerical_substructure": {**THREE, "damping_coefficients": [beta * k for k in THREE["stiffnesses"]]}}
    )
    stages = [make_numerical_substructure(config) for config in (ours, chain)]
    force = 1e3 * np.random.default_rng(2).standard_normal(200)
    answers = [[stage.step(0.3, f).desired_acceleration for f in force] for stage in stages]
    assert answers[0] == pytest.approx(answers[1], rel=1e-6, abs=1e-6)


def test_p_delta_of_linear_stories_is_integrated_exactly():
    loads = {"gravity_loads": [4e5, 2e5, 1e5], "story_heights": [3.0, 3.0, 3.0]}
    numerical = {**THREE, "damping_coefficients": [2e4] * 3}
    config = config_from_mapping({"numerical_substructure": numerical, "nonlinear": loads})
    softer = [k - p / 3.0 for k, p in zip(THREE["stiffnesses"], loads["gravity_loads"], strict=True)]
    chain = ShearBuilding(tuple(THREE["masses"]), tuple(softer), (2e4,) * 3)
    assert config.elastic_substructure().stiffness_matrix == pytest.approx(chain.stiffness_matrix)
    explicit = config.changed(nonlinear__integration="cr", run__time_step=1e-4)
    exact = config.changed(run__time_step=1e-4)
    stages = [make_numerical_substructure(entry) for entry in (exact, explicit)]
    answers = [[stage.step(0.5, 0.0).desired_acceleration for _ in range(2000)] for stage in stages]
    assert answers[0] == pytest.approx(answers[1], abs=2e-3)


def test_another_mass_ratio_scales_matrices_too(tmp_path):
    config = given(write(tmp_path / "n.npz", condensed()), "numerical_substructure")
    scaled = with_mass_ratio(config, 0.2)
    assert configured_mass_ratio(scaled) == pytest.approx(0.2)
    before, after = (entry.numerical_substructure.building().modes() for entry in (config, scaled))
    assert after.frequencies == pytest.approx(before.frequencies)
    assert after.damping_ratios == pytest.approx(before.damping_ratios)


def test_the_mode_of_the_paper_is_no_default_for_another_specimen():
    """Stories of another specimen have their own first mode; that of the paper stays where its specimen does."""
    assert Config().specimen.identified_frequency == 37.31
    assert config_from_mapping({"specimen": {"masses": [760.0, 800.0]}}).specimen.identified_frequency == 37.31
    other = config_from_mapping({"specimen": {"masses": [700.0, 800.0]}})
    assert (other.specimen.identified_frequency, other.specimen.identified_damping_ratio) == (0.0, 0.0)
    told = config_from_mapping({"specimen": {"masses": [700.0, 800.0], "identified_frequency": 38.0}})
    assert told.specimen.identified_frequency == 38.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("M\n1, 0\n0, 1\n", "no matrix K; it has M"),
        ("M\n1, 0\n0\nK\n1\n", "M has 2 rows of 1, 2 entries"),
        ("1, 2\n", "line 1: '1, 2'; the name M, C or K is required before it"),
        ("M\n1.0, x\n", "line 2: '1.0, x' is not a row of numbers"),
        ("M\n1\nM\n1\n", "line 3: a second matrix M"),
        ("M\n1\nK\nnan\n", "K has an entry that is not finite"),
    ],
)
def test_a_wrong_file_of_matrices_is_told_in_one_line(tmp_path, text, message):
    path = tmp_path / "model.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        given(str(path), "specimen")
    assert str(error.value).startswith(f"specimen.matrices: {path}")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"M": [[1.0]], "K": [[1e3]]}, "damping: coefficients, but there is no matrix C"),
        ({"M": [[2.0, 0.5], [0.4, 2.0]], "K": np.eye(2) * 1e3}, "mass_matrix: entries 1,2 and 2,1 are 0.5 and 0.4"),
        ({"M": np.eye(2), "K": [[1e3, 2e3], [2e3, 1e3]]}, "stiffness_matrix: smallest eigenvalue -1e+03"),
        ({"M": np.eye(2), "K": np.eye(3) * 1e3}, "mass_matrix: 4 entries; 9 are required"),
        ({"M": [[1.0]], "K": [[1e12]]}, "a mode of 1e+06 rad/s; at most 30000 rad/s is integrated exactly"),
        ({"M": [["a"]], "K": [[1.0]]}, "a square matrix of real numbers is required"),
    ],
)
def test_matrices_that_are_no_building_are_refused(tmp_path, values, message):
    path = tmp_path / "model.npz"
    np.savez(path, **{name: np.asarray(matrix) for name, matrix in values.items()})
    with pytest.raises(InputError) as error:
        given(str(path), "specimen")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_files_that_are_none_are_refused(tmp_path):
    broken = tmp_path / "model.npz"
    broken.write_bytes(b"PK\x03\x04 no archive")
    for path, message in (
        (broken, "cannot be read"),
        (tmp_path / "none.mat", "No such file"),
        ("m.txt", ".csv, .npz, .mat"),
    ):
        with pytest.raises(InputError, match=message):
            read_matrices(path)


def test_stories_beside_matrices_are_refused(tmp_path):
    path = write(tmp_path / "model.npz", TWO)
    for values, message in (
        ({"stiffnesses": [1.0, 2.0]}, "specimen.stiffnesses: beside matrices"),
        ({"masses": [1.0, 2.0]}, "specimen.masses: beside matrices"),
    ):
        with pytest.raises(InputError, match=message):
            given(path, "specimen", **values)
    with pytest.raises(InputError, match=r"nonlinear.integration: cr is for stories"):
        config_from_mapping({"numerical_substructure": {"matrices": path}, "nonlinear": {"integration": "cr"}})
    ratios = {"damping": "modal", "damping_ratios": [0.02]}
    with pytest.raises(InputError, match=r"nonlinear.damping: modal, beside numerical_substructure.damping modal"):
        config_from_mapping({"numerical_substructure": ratios, "nonlinear": ratios})
