"""Sub-steps: their polynomials, the loop with an ideal table, and the loop as a linear system from target to target."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bmd_rths_core.analysis.numerical_motion import numerical_motion
from bmd_rths_core.campaign.engine import is_linear
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.integration.substeps import MOST_SUBSTEPS, ORDER, hand_over, lagrange, substep_weights
from bmd_rths_core.loop.build import make_integrated_stage, make_numerical_substructure
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.analysed_loops import AnalysisOptions, complete_loop, paper_loop
from bmd_rths_core.stability.assessment import assess
from bmd_rths_core.stability.confirmation import confirm
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio
from bmd_rths_core.stability.substepped import substepped_margin

DT = 1.0 / 1024.0
QUIET = {
    f"simulated_table__{name}": 0.0
    for name in ("acceleration_noise", "displacement_noise", "shear_noise", "force_noise")
}
FAST = Config().changed(run__time_step=DT, safety__stability_action="ignore", **QUIET)

YIELDING = {
    "nonlinear__story_model": "bilinear",
    "nonlinear__yield_drifts": [6e-5],
    "nonlinear__integration": "kr_alpha",
}


def with_substeps(substeps, config=FAST, **changes):
    return config.changed(numerical_substructure__substeps=substeps, **changes)


def smooth_motion(time_step, duration=1.0):
    time = np.arange(round(duration / time_step) + 1) * time_step
    acceleration = 0.5 * np.sin(2 * np.pi * 3.0 * time) * np.minimum(1.0, time / 0.2) ** 2
    return GroundMotion("smooth", time_step, acceleration, "test", "0" * 64)


def run(config, motion=None):
    record = RthsLoop(config, motion or smooth_motion(config.run.time_step)).run()
    assert record.outcome == "finished", record.reason
    return record


# ---- the polynomials


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("substeps", [2, 4, 5, MOST_SUBSTEPS])
def test_predictor_and_corrector_are_exact_for_polynomials_of_their_order_and_no_further(order, substeps):
    weights = substep_weights(substeps, order)
    assert not weights[: hand_over(substeps), 0].any()
    for power in range(order + 2):
        at = lambda time, power=power: (time + 0.3) ** power  # noqa: E731
        for part in range(substeps):
            value = weights[part] @ at(1.0 - np.arange(order + 2.0))
            if power <= order or part == 0:
                assert value == pytest.approx(at(part / substeps), rel=1e-9, abs=1e-9)
            else:
                assert abs(value - at(part / substeps)) > 1e-6


def test_the_hand_over_is_the_last_substep_within_80_percent():
    assert [hand_over(n) for n in (2, 3, 4, 5, 10, 20)] == [1, 2, 3, 4, 8, 16]
    for substeps in range(2, MOST_SUBSTEPS + 1):
        assert hand_over(substeps) <= 0.8 * substeps < hand_over(substeps) + 1


def test_weights_are_those_of_numpy_polyfit():
    nodes, values = np.array([1.0, 0.0, -1.0]), np.array([0.4, -1.1, 2.2])
    fit = np.polynomial.Polynomial.fit(nodes, values, 2)
    assert lagrange(nodes, 0.35) @ values == pytest.approx(fit(0.35))


# ---- the stage


@pytest.mark.parametrize(
    "nonlinear",
    [
        {},
        {"nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [1e-5], "nonlinear__integration": "kr_alpha"},
    ],
    ids=["exact", "yielding"],
)
@pytest.mark.parametrize("substeps", [2, 5])
def test_at_the_targets_it_is_the_substructure_integrated_with_their_time_step(substeps, nonlinear):
    config = with_substeps(substeps, **nonlinear)
    random = np.random.default_rng(5)
    ground, shear = random.normal(size=81), 1e3 * random.normal(size=81)
    shear[0] = 0.0  # nothing is fed back before step 0
    stage, own = make_integrated_stage(config, ground), make_numerical_substructure(config)
    stage.reset()
    own.reset()
    for k in range(81):
        response = stage.step(ground[k], shear[k])
        assert response.required_force == shear[k]
        if k % substeps == 0:
            expected = own.step(ground[k], shear[k])
            assert response.desired_acceleration == pytest.approx(expected.desired_acceleration, rel=1e-9, abs=1e-12)
            assert stage.displacements == pytest.approx(own.displacements, rel=1e-9, abs=1e-15)
            assert stage.velocities == pytest.approx(own.velocities, rel=1e-9, abs=1e-12)
    if nonlinear:
        assert np.abs(own.displacements).max() > 2e-5


def test_between_the_targets_the_shear_of_every_step_acts_at_once():
    config = with_substeps(5)
    random = np.random.default_rng(5)
    ground, shear = random.normal(size=40), 1e3 * random.normal(size=40)
    mass = config.elastic_substructure().interface_mass
    one, other = make_integrated_stage(config, ground), make_integrated_stage(config, ground)
    for stage in (one, other):
        stage.reset()
    for k in range(38):
        responses = one.step(ground[k], shear[k]), other.step(ground[k], shear[k])
        assert responses[0] == responses[1]
    responses = one.step(ground[38], shear[38]), other.step(ground[38], shear[38] + 80.0)
    difference = responses[1].desired_acceleration - responses[0].desired_acceleration
    assert difference == pytest.approx(80.0 / mass)


def test_the_stage_begins_anew_after_a_reset():
    config = with_substeps(5)
    random = np.random.default_rng(6)
    ground, shear = random.normal(size=33), 1e3 * random.normal(size=33)
    stage = make_integrated_stage(config, ground)
    runs = []
    for _ in range(2):
        stage.reset()
        runs.append([stage.step(*loads) for loads in zip(ground, shear, strict=True)])
    assert runs[0] == runs[1]


def test_a_given_shear_leads_to_the_response_that_scipy_integrates():
    """With a table that does what it should: no further from the truth than an integration with N Δt is."""
    errors = []
    for time_step, substeps in ((4 * DT, 1), (DT, 4), (0.5 * DT, 4)):
        config = with_substeps(substeps, run__time_step=time_step)
        building = config.elastic_substructure()
        mass, c, k = building.interface_mass, building.damping_matrix[0, 0], building.stiffness_matrix[0, 0]
        time = np.arange(round(0.5 / time_step)) * time_step
        stage = make_integrated_stage(config, np.zeros(len(time)))
        stage.reset()
        desired = np.array([stage.step(0.0, pulsating(t)).desired_acceleration for t in time])

        def motion(t, y, c=c, k=k, mass=mass):
            return [y[1], (pulsating(t) - c * y[1] - k * y[0]) / mass]

        truth = solve_ivp(motion, (0.0, 0.5), [0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12).y
        expected = (pulsating(time) - c * truth[1] - k * truth[0]) / mass
        errors.append(np.abs(desired - expected).max() / np.abs(expected).max())
    assert errors[1] < 1.3 * errors[0] < 0.02
    assert errors[2] < 0.3 * errors[1]  # of second order


def pulsating(time):
    return 2e3 * np.sin(2.0 * np.pi * 3.0 * time) ** 2


# ---- the loop


def test_the_loop_converges_to_that_without_substeps():
    differences = []
    for time_step in (2.0 * DT, DT):
        motion = smooth_motion(time_step, 0.5)
        plain = run(FAST.changed(run__time_step=time_step), motion)
        stepped = run(with_substeps(4, run__time_step=time_step), motion)
        difference = stepped.desired_acceleration - plain.desired_acceleration
        differences.append(np.abs(difference).max() / np.abs(plain.desired_acceleration).max())
    assert differences[0] > 2.5 * differences[1]
    assert differences[1] < 0.02


@pytest.mark.parametrize("substeps", [2, 5])
@pytest.mark.parametrize("scheme", ["uc", "plc_fc"])
def test_the_loop_as_a_linear_system_is_the_loop_that_runs(substeps, scheme):
    config = with_substeps(substeps, run__scheme=scheme)
    motion = smooth_motion(DT, 0.5)
    record = run(config, motion)
    loop = closed_loop(config, displacement=True)
    count = 1 + (motion.steps - 1) // substeps
    ground = np.append(motion.acceleration, np.zeros(substeps))
    noise = np.zeros((count, loop.system.b.shape[1] - 1))
    known = ground[: loop.start.shape[1], None]
    simulation = LinearSimulation(loop.system, loop.start @ known)
    outputs = simulation.advance(ground[substeps::substeps][:count, None], noise)[0]
    for name in ("desired_acceleration", "required_force", "table_acceleration", "corrected_force"):
        recorded = getattr(record, name)[::substeps]
        assert outputs[loop.outputs.index(name)] == pytest.approx(recorded, rel=1e-7, abs=1e-7 * np.abs(recorded).max())
    radius = np.abs(np.linalg.eigvals(loop.system.a)).max() ** (1.0 / substeps)
    moving = closed_loop(config)
    assert moving.substeps == substeps
    assert moving.spectral_radius == pytest.approx(min(radius, moving.spectral_radius))


def test_the_margin_is_where_the_loop_begins_to_grow_in_time():
    config = with_substeps(4)
    margin = substepped_margin(config)
    ratio = margin.allowable_mass_ratio
    assert 0.0 < ratio < 1.0
    for share, stable in ((0.999, True), (1.001, False)):
        assert (closed_loop(with_mass_ratio(config, share * ratio)).spectral_radius < 1.0) == stable
    assert confirm(config, margin).confirmed


def test_analyses_that_know_nothing_of_substeps_refuse_or_are_not_made():
    config = with_substeps(4)
    options = AnalysisOptions()
    for analysis in (lambda: paper_loop(config, options), lambda: complete_loop(config, options)):
        with pytest.raises(InputError, match=r"numerical_substructure.substeps: 4, which the analyses in continuous"):
            analysis()
    with pytest.raises(InputError, match=r"numerical_substructure.substeps: 4, with which the shear"):
        discrete_margin(config)
    assessment = assess(config, options)
    assert set(assessment.analyses) == {"discrete"}
    assert assessment.go
    assert not has_matrices(config)
    assert not is_linear(config)
    assert has_matrices(FAST)


def test_the_motion_of_the_substructure_is_computed_again_from_the_record():
    config = with_substeps(4, numerical_substructure__masses=[8000.0, 8000.0],
                           numerical_substructure__stiffnesses=[2e8, 2e8],
                           numerical_substructure__damping_coefficients=[5e4, 5e4])  # fmt: skip
    motion = numerical_motion(run(config), config)
    assert motion.deviation_percent < 1e-6


def test_yielding_stories_are_computed_again_at_their_targets():
    config = with_substeps(4, **YIELDING)
    motion = numerical_motion(run(config), config)
    assert motion.deviation_percent < 1e-6
    assert np.abs(motion.drifts).max() > 3e-4


# ---- the parameter


def test_substeps_that_cannot_be_are_refused():
    with pytest.raises(InputError, match=r"numerical_substructure.substeps: 21 is not allowed; >= 1 and <= 20"):
        with_substeps(21)
    with pytest.raises(InputError, match=r"numerical_substructure.substeps: 2.5 is not a whole number"):
        with_substeps(2.5)
    with pytest.raises(InputError, match=r"substeps: 20 steps of 0.01 s; an integration step of at most 0.1 s"):
        with_substeps(20, run__time_step=0.01)
    with pytest.raises(InputError, match=r"numerical_substructure.substeps: 4, but run.scheme mpic integrates"):
        with_substeps(4, run__scheme="mpic")


def test_an_explicit_integration_has_to_be_stable_with_its_own_step():
    bilinear = {"nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [1e-3]}
    explicit = FAST.changed(nonlinear__integration="newmark_explicit", **bilinear)
    with pytest.raises(InputError, match=r"nonlinear.integration"):
        with_substeps(20, explicit, run__time_step=0.004)


def test_order():
    assert ORDER == 3
    assert with_substeps(4).integration_step == pytest.approx(4 * DT)
