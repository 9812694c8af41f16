"""Non-linear substructure against a tight ODE solution and the exact linear stage; configuration, loop and metrics."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bmd_rths_core.analysis.metrics import rmse_percent, run_metrics
from bmd_rths_core.analysis.reference import nonlinear_reference_response, reference_response
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stages.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure, NumericalSubstructureConfig
from bmd_rths_core.structure.nonlinear_building import NonlinearConfig, nonlinear_building
from tests.conftest import WITHOUT_LIMITS

STORIES = NumericalSubstructureConfig((900.0, 850.0, 800.0), (4e6, 3.5e6, 3e6), (3000.0, 2500.0, 2000.0))
YIELD_DRIFTS = (0.004, 0.003, 0.0025)
INTEGRATIONS = ("cr", "kr_alpha", "newmark_explicit")
MODELS = {
    "linear": {},
    "elastic-perfectly-plastic": {"story_model": "bilinear", "post_yield_ratio": 0.0},
    "bilinear": {"story_model": "bilinear", "post_yield_ratio": 0.1},
    "bouc_wen": {"story_model": "bouc_wen", "post_yield_ratio": 0.1},
    "bouc_wen, P-Delta": {
        "story_model": "bouc_wen",
        "post_yield_ratio": 0.1,
        "bouc_wen_beta": 0.7,
        "bouc_wen_gamma": 0.2,
        "bouc_wen_n": 1.5,
        "gravity_loads": (6e5, 4e5, 2e5),
        "story_heights": (3.0, 3.0, 2.5),
    },
}
DURATION = 1.2


def nonlinear(model="bilinear", integration="cr", **changes):
    return NonlinearConfig(**{"yield_drifts": YIELD_DRIFTS, "integration": integration, **MODELS[model], **changes})


def ground(t):
    """Return a strong pulse, under which every story yields."""
    return 9.0 * np.sin(18.0 * t) * np.sin(np.pi * t / DURATION) ** 2


def shear(t):
    return 3000.0 * np.sin(31.0 * t) * np.sin(np.pi * t / DURATION) ** 2


def respond(stage, dt, duration=DURATION):
    time = np.arange(round(duration / dt) + 1) * dt
    return np.array([stage.step(a, f) for a, f in zip(ground(time).tolist(), shear(time).tolist(), strict=True)]).T


def tight_solution(config, time):
    """Integrate displacement, velocity and hysteretic drift z of every story, written from the equations."""
    masses, building = np.asarray(STORIES.masses), STORIES.building()
    k, uy = np.asarray(STORIES.stiffnesses), np.asarray(YIELD_DRIFTS)
    heights = np.asarray(config.story_heights or (1.0,) * 3)
    p_delta = np.asarray(config.gravity_loads or (0.0,) * 3) / heights
    alpha = 1.0 if config.story_model == "linear" else config.post_yield_ratio

    def restoring(u, z):
        story = alpha * k * np.diff(u, prepend=0.0) + (1 - alpha) * k * z - p_delta * np.diff(u, prepend=0.0)
        return story - np.append(story[1:], 0.0)

    def hysteresis(rate, z):
        if config.story_model == "bouc_wen":
            a, beta, gamma = config.bouc_wen_a, config.bouc_wen_beta, config.bouc_wen_gamma
            return rate * (a - np.abs(z / uy) ** config.bouc_wen_n * (beta * np.sign(rate * z) + gamma))
        return np.where((np.abs(z) >= uy) & (rate * z > 0), 0.0, rate)

    def derivative(t, y):
        u, v, z = y.reshape(3, 3)
        load = -masses * ground(t)
        load[-1] += shear(t)
        acceleration = (load - building.damping_matrix @ v - restoring(u, z)) / masses
        return np.concatenate((v, acceleration, hysteresis(np.diff(v, prepend=0.0), z)))

    solution = solve_ivp(derivative, (0, time[-1]), np.zeros(9), t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3)
    u, v, z = solution.y.reshape(3, 3, -1)
    force = np.array([restoring(a, b) for a, b in zip(u.T, z.T, strict=True)])
    ductility = np.abs(np.diff(u, axis=0, prepend=0.0)).max(axis=1) / uy
    return (shear(time) - (building.damping_matrix @ v)[-1] - force[:, -1]) / masses[-1], ductility


@pytest.fixture(scope="module", params=MODELS)
def solved(request):
    time = np.arange(round(DURATION / 0.004) + 1) * 0.004
    expected, ductility = tight_solution(nonlinear(request.param), time)
    if request.param != "linear":
        assert ductility.min() > 1.3  # every story yields
    return request.param, expected


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_strong_pulse_agrees_with_a_tight_ode_solution_with_second_order(solved, integration):
    model, expected = solved
    errors = []
    for split in (1, 2, 4, 8):
        stage = NonlinearSubstructure(STORIES, nonlinear(model, integration), 0.004 / split)
        desired, _ = respond(stage, 0.004 / split)
        errors.append(np.sqrt(np.mean((desired[::split] - expected) ** 2) / np.mean(expected**2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.log2(errors[0] / errors[-1]) / 3 == pytest.approx(2.0, abs=0.1), (errors, orders)
    assert errors[0] < 0.05
    assert errors[-1] < 0.001


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_linear_springs_agree_with_the_exact_stage_to_second_order(integration):
    errors = []
    for dt in (0.004, 0.002, 0.001):
        exact, _ = respond(NumericalSubstructure(STORIES, dt), dt)
        explicit, _ = respond(NonlinearSubstructure(STORIES, nonlinear("linear", integration), dt), dt)
        errors.append(np.sqrt(np.mean((explicit - exact) ** 2) / np.mean(exact**2)))
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(2.0, abs=0.05)
    assert errors[2] < 0.001


@pytest.mark.parametrize("integration", INTEGRATIONS)
@pytest.mark.parametrize("model", MODELS)
def test_equation_of_motion_is_balanced_and_reset_repeats_bit_for_bit(model, integration):
    stage = NonlinearSubstructure(STORIES, nonlinear(model, integration), 0.005)
    first = respond(stage, 0.005)
    assert first[1] == pytest.approx(shear(np.arange(len(first[1])) * 0.005), abs=1e-7)
    stage.reset()
    assert np.array_equal(respond(stage, 0.005), first)


def test_first_step_is_at_rest_whatever_the_ground_does():
    assert NonlinearSubstructure(STORIES, nonlinear(), 0.005).step(3.0, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize("damping", [{"damping": "rayleigh", "damping_ratios": (0.02, 0.05)}, {"damping": "modal"}])
def test_damping_of_the_configuration_has_its_ratios(damping):
    config = nonlinear("linear", **{"damping_ratios": (0.02, 0.05, 0.03), **damping})
    building = nonlinear_building(STORIES.building(), config)
    modes = STORIES.building().modes()
    ratios = np.diag(modes.shapes.T @ building.damping_matrix @ modes.shapes) / (2 * modes.frequencies)
    assert ratios[:2] == pytest.approx([0.02, 0.05])
    one = nonlinear_building(STORIES.building(), nonlinear("linear", damping="modal", damping_ratios=(0.03,)))
    assert np.diag(modes.shapes.T @ one.damping_matrix @ modes.shapes) == pytest.approx(0.06 * modes.frequencies)


def configured(model="bilinear", **changes):
    """Return the paper's configuration with a yielding story below; ductilities of several on a strong ground."""
    own = {"yield_drifts": [0.0005], "integration": "cr", **MODELS[model], **changes}
    return Config().changed(run__scheme="uc", **{f"nonlinear__{key}": value for key, value in own.items()})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"nonlinear__story_model": "bilinear"},
            "nonlinear.integration: exact is for story_model linear; for bilinear one of cr, kr_alpha, "
            "newmark_explicit is required",
        ),
        (
            {
                "nonlinear__integration": "cr",
                "nonlinear__story_model": "bilinear",
                "nonlinear__yield_drifts": [0.1, 0.1],
            },
            "nonlinear.yield_drifts: 2 values; 1 are required, one a story",
        ),
        (
            {"nonlinear__integration": "cr", "nonlinear__gravity_loads": [1e5]},
            "nonlinear.story_heights: 0 values; 1 are required, one a story",
        ),
        (
            {
                "nonlinear__integration": "cr",
                "nonlinear__gravity_loads": [3e8],
                "nonlinear__story_heights": [3.0],
            },
            "nonlinear.gravity_loads: story 1 buckles; load over height is 1e+08 N/m, "
            "< 7.08234e+07 N/m, its initial stiffness, is required",
        ),
        (
            {"nonlinear__integration": "kr_alpha", "nonlinear__damping": "modal"},
            "nonlinear.damping_ratios: 0 values; 1 are required, one for all modes or one a mode",
        ),
        (
            {
                "nonlinear__integration": "kr_alpha",
                "nonlinear__damping": "rayleigh",
                "nonlinear__damping_ratios": [0.02, 0.02],
            },
            "nonlinear.rayleigh_modes: [1, 2] is not allowed; "
            "two different whole numbers from 1 to 1, the number of stories, are required",
        ),
        (
            {"nonlinear__bouc_wen_gamma": 0.6},
            "nonlinear.bouc_wen_gamma: 0.6 is not allowed; > -0.5 and <= 0.5, the value of bouc_wen_beta, is required",
        ),
        (
            {"nonlinear__integration": "newmark_explicit", "run__time_step": 0.025},
            "nonlinear.integration: explicit Newmark integration is unstable: time step 0.025 s times highest "
            "frequency 94.09 rad/s is 2.35225; < 2 is required, a time step < 0.0212562 s",
        ),
    ],
)
def test_sections_that_do_not_fit_together_are_refused_with_one_clear_line(changes, message):
    with pytest.raises(InputError) as error:
        Config().changed(**changes)
    assert str(error.value) == message


def test_default_is_the_exact_linear_stage():
    assert isinstance(make_numerical_substructure(Config()), NumericalSubstructure)
    assert isinstance(make_numerical_substructure(configured()), NonlinearSubstructure)


def test_reference_is_exact_while_no_story_yields():
    lower, upper = STORIES.building(), Config().specimen.building()
    motion = 1e-3 * np.random.default_rng(0).normal(size=400)
    building = nonlinear_building(lower, nonlinear("bilinear")).below(upper)
    exact = reference_response(upper.stacked_on(lower), motion, 0.005)
    assert nonlinear_reference_response(building, motion, 0.005, 2) == pytest.approx(exact, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_reference_agrees_with_a_fine_explicit_integration_and_has_converged(model):
    """The building alone: CR with a fiftieth of the step, on a ground that is linear between the steps."""
    dt, split = 0.005, 50
    coarse = np.arange(241) * dt
    fine = np.interp(np.arange(240 * split + 1) * dt / split, coarse, ground(coarse))
    stage = NonlinearSubstructure(STORIES, nonlinear(model), dt / split)
    expected = np.array([stage.step(a, 0.0).desired_acceleration for a in fine.tolist()])[::split]
    errors = {}
    for substeps in (5, 10):
        building = nonlinear_building(STORIES.building(), nonlinear(model))
        response = nonlinear_reference_response(building, ground(coarse), dt, substeps)[:, -1]
        errors[substeps] = np.sqrt(np.mean((response - expected) ** 2) / np.mean(expected**2))
    assert errors[10] < 1e-3, errors


@pytest.mark.slow
def test_loop_with_a_yielding_substructure_converges_to_its_reference_with_first_order():
    errors = []
    for dt in (0.00125, 0.000625, 0.0003125):
        config = configured(yield_drifts=[0.0003]).changed(
            run__time_step=dt,
            simulated_table__dynamics="perfect",
            simulated_table__acceleration_noise=0.0,
            simulated_table__shear_noise=0.0,
            simulated_table__displacement_noise=0.0,
            simulated_table__force_noise=0.0,
        )
        time = np.arange(round(3.0 / dt) + 1) * dt
        acceleration = 3.0 * np.sin(2 * np.pi * 3.1 * time) * np.sin(np.pi * time / 3.0) ** 2
        record = RthsLoop(config, GroundMotion("pulse", dt, acceleration, "test", "0" * 64)).run()
        errors.append(run_metrics(record).rmse_percent["substructure"])
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(1.0, abs=0.25), errors
    assert errors[2] < 0.5


STRONG = {"ground_motion__peak_acceleration": 8.0, "ground_motion__duration": 10.0, **WITHOUT_LIMITS}


@pytest.fixture(scope="module")
def linear_on_strong_el_centro():
    config = Config().changed(run__scheme="plc_fc", **STRONG)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


@pytest.mark.parametrize("integration", INTEGRATIONS)
@pytest.mark.parametrize("model", ["elastic-perfectly-plastic", "bilinear", "bouc_wen"])
def test_loop_on_strong_el_centro_yields_and_stays_finite(linear_on_strong_el_centro, model, integration):
    config = configured(model, integration=integration).changed(run__scheme="plc_fc", **STRONG)
    record = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    assert record.outcome == "finished"
    assert all(np.isfinite(signal).all() for signal in record.signals().values())
    # It did yield.
    assert rmse_percent(linear_on_strong_el_centro.desired_acceleration, record.desired_acceleration) > 30.0
