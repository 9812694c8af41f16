"""The loop as it runs: equal to `RthsLoop` step by step, and its margin confirmed by what the loop then does."""

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, LoopTransferFunction
from bmd_rths_core.stability.discrete import configured_mass_ratio, discrete_margin, with_mass_ratio
from bmd_rths_core.stability.loop_elements import Delay
from bmd_rths_core.stability.models import EQUATION_9, experimental_building, numerical_building
from tests.conftest import SERVO_TABLE, WITHOUT_LIMITS

DT = 0.005
QUIET = Config().changed(
    simulated_table__acceleration_noise=0.0,
    simulated_table__shear_noise=0.0,
    simulated_table__displacement_noise=0.0,
    simulated_table__force_noise=0.0,
    **SERVO_TABLE,
    **WITHOUT_LIMITS,
)
TABLES = {
    "servo": {},
    "fractional delay": {"simulated_table__command_delay": 0.0075},
    "perfect, delayed": {"simulated_table__dynamics": "perfect", "simulated_table__command_delay": 0.012},
    "perfect": {"simulated_table__dynamics": "perfect"},
    "Eq. 9": {"simulated_table__dynamics": "sections", "simulated_table__sections": list(EQUATION_9)},
}
SCHEMES = ("uc", "fc", "plc", "plc_fc")
SOURCES = ("kalman", "load_cell")
THREE_STORIES = {
    "numerical_substructure__masses": [9000.0, 7000.0, 6000.0],
    "numerical_substructure__stiffnesses": [9e7, 8e7, 6e7],
    "numerical_substructure__damping_coefficients": [9e4, 6e4, 4e4],
}
#: Explicit integrations of stories that stay elastic under the pulse.
EXPLICIT = {
    "cr": {"nonlinear__integration": "cr", "nonlinear__damping": "modal", "nonlinear__damping_ratios": [0.02]},
    "kr_alpha": {
        "nonlinear__integration": "kr_alpha",
        "nonlinear__story_model": "bilinear",
        "nonlinear__yield_drifts": [1.0, 1.0, 1.0],
        "nonlinear__gravity_loads": [4e5, 3e5, 2e5],
        "nonlinear__story_heights": [1.1, 1.1, 1.1],
    },
    "newmark_explicit": {"nonlinear__integration": "newmark_explicit"},
}
#: Stable up to 0.789, and once more from 0.843 to 0.861.
CONDITIONAL = {
    "run__scheme": "plc",
    "shear_estimator__source": "load_cell",
    "command_shaper__lead_time": 3.0808 * DT,
    "simulated_table__servo_real_pole": 77.346,
    "simulated_table__servo_damping_ratio": 0.3,
    "numerical_substructure__stiffnesses": [2440169.0],
    "numerical_substructure__damping_coefficients": [8383.13],
    "specimen__masses": [760.0, 521.833],
    "specimen__stiffnesses": [680461.7, 1067557.86],
    "specimen__damping_coefficients": [1916.897, 638.966],
}


def pulse(steps):
    """Return a motion that begins at 0, as the linear system assumes, and is over after 0.5 s."""
    time = np.arange(steps) * DT
    acceleration = np.where(time < 0.5, np.sin(2 * np.pi * 4.0 * time) * np.sin(np.pi * time / 0.5) ** 2, 0.0)
    return GroundMotion("pulse", DT, acceleration, "test", "0" * 64)


def simulate(config, motion):
    """Return the outputs of the assembled loop by name, without noise."""
    loop = closed_loop(config)
    ground = motion.acceleration[:, None]
    noise = np.zeros((len(ground), loop.system.b.shape[1] - 1))
    outputs = LinearSimulation(loop.system, loop.start @ ground[:1]).advance(ground, noise)
    return dict(zip(loop.outputs, outputs[0], strict=True))


def growth_rate(config, most=3500):
    """Return the growth of the response over its last quarter, per step."""
    # Long enough for the critical pair to outlive everything else, and not for it to pass the limit.
    steps = min(most, round(15.0 / abs(closed_loop(config).spectral_radius - 1.0)))
    record = RthsLoop(config, pulse(steps)).run()
    assert record.outcome == "finished"
    window = steps // 8
    earlier, later = record.desired_acceleration[-2 * window : -window], record.desired_acceleration[-window:]
    return (np.abs(later).max() / np.abs(earlier).max()) ** (1.0 / window)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_linear_system_equals_the_loop_step_by_step(scheme, table, source):
    config = QUIET.changed(run__scheme=scheme, shear_estimator__source=source, **TABLES[table])
    motion = pulse(600)
    record = RthsLoop(config, motion).run()
    for name, ours in simulate(config, motion).items():
        if name.startswith(("displacement", "acting")):  # no signals of a record
            continue
        floor = name.removeprefix("floor_")
        theirs = record.floor_accelerations[:, int(floor) - 1] if floor != name else getattr(record, name)
        assert np.abs(ours - theirs).max() <= 1e-10 * np.abs(theirs).max(), name


def test_linear_system_of_several_stories_equals_the_loop():
    config = QUIET.changed(**THREE_STORIES)
    record = RthsLoop(config, pulse(600)).run()
    ours = simulate(config, pulse(600))["corrected_force"]
    assert np.abs(ours - record.corrected_force).max() <= 1e-10 * np.abs(record.corrected_force).max()


@pytest.mark.parametrize("integration", EXPLICIT)
def test_linear_system_of_an_explicit_integration_equals_the_loop(integration):
    """As long as no story yields, the bilinear stories are linear; P-Delta and modal damping are in the matrices."""
    config = QUIET.changed(**THREE_STORIES, **EXPLICIT[integration])
    record = RthsLoop(config, pulse(600)).run()
    ours = simulate(config, pulse(600))
    for name in ("desired_acceleration", "required_force", "corrected_force"):
        theirs = getattr(record, name)
        assert np.abs(ours[name] - theirs).max() <= 1e-10 * np.abs(theirs).max(), name


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"run__scheme": "uc"},
        {"run__scheme": "fc", "shear_estimator__source": "load_cell"},
        {"run__scheme": "plc", **TABLES["fractional delay"]},
        {"run__scheme": "plc", **TABLES["Eq. 9"]},
        {"run__scheme": "plc_fc"},
        {"run__scheme": "plc_fc", **TABLES["perfect, delayed"]},
        {"run__scheme": "uc", **THREE_STORIES},
        {"run__scheme": "uc", **THREE_STORIES, **EXPLICIT["cr"]},
        {"run__scheme": "plc_fc", **THREE_STORIES, **EXPLICIT["kr_alpha"]},
    ],
    ids=lambda changes: " ".join(str(value)[:12] for value in changes.values()),
)
def test_loop_decays_below_its_margin_and_grows_above(changes):
    """At the margin the spectral radius is 1 but for rounding; around it the loop does what its radius says."""
    config = QUIET.changed(**changes)
    margin = discrete_margin(config)
    at = closed_loop(with_mass_ratio(config, margin.allowable_mass_ratio))
    assert at.spectral_radius == pytest.approx(1.0, abs=1e-9)
    for share, grows in ((0.96, False), (1.04, True)):
        scaled = with_mass_ratio(config, share * margin.allowable_mass_ratio)
        radius = closed_loop(scaled).spectral_radius
        assert (radius > 1.0) == grows
        rate = growth_rate(scaled)
        assert (rate > 1.0) == grows
        assert rate - 1.0 == pytest.approx(radius - 1.0, rel=0.1)


def test_margin_is_where_the_spectral_radius_is_one():
    for scheme in SCHEMES:
        config = Config().changed(run__scheme=scheme)
        ratio = discrete_margin(config).allowable_mass_ratio
        assert closed_loop(with_mass_ratio(config, ratio)).spectral_radius == pytest.approx(1.0, abs=1e-10)


@pytest.mark.slow
def test_conditionally_stable_loop_has_all_its_intervals():
    config = QUIET.changed(**CONDITIONAL)
    first, second = discrete_margin(config).stable_intervals
    assert first.upper == pytest.approx(0.789, abs=1e-3)
    assert (second.lower, second.upper) == pytest.approx((0.843, 0.861), abs=1e-3)
    for end in (first.upper, second.lower, second.upper):
        assert closed_loop(with_mass_ratio(config, end)).spectral_radius == pytest.approx(1.0, abs=1e-9)
    # The loop itself, as far from the ends as it can be: it takes the fewest steps there.
    for ratio, stable in ((0.70, True), (0.816, False), (0.852, True), (0.90, False)):
        assert (growth_rate(with_mass_ratio(config, ratio), most=12000) < 1.0) == stable


def test_small_steps_approach_the_transfer_function():
    """Hold, feedback step and first-order hold vanish with Δt; what remains is Eq. 7 with the pure delay."""
    delay = 0.02
    config = QUIET.changed(
        run__scheme="uc",
        shear_estimator__source="load_cell",
        simulated_table__dynamics="perfect",
        simulated_table__command_delay=delay,
    )
    loop = LoopTransferFunction(
        numerical_building(config.numerical_substructure.building()),
        experimental_building(config.specimen.building()),
        Delay(delay),
    )
    exact = loop.margin().allowable_mass_ratio
    errors = [
        abs(discrete_margin(config.changed(run__time_step=step)).allowable_mass_ratio - exact)
        for step in (0.002, 0.001, 0.0005)
    ]
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert order == pytest.approx(1.0, abs=0.35)
    assert errors[-1] < 0.02 * exact


def test_transfer_function_with_the_holds_as_delay_is_near_the_loop_as_it_runs():
    """One step of feedback and half a step of zero-order hold: the two analyses differ by a few per cent."""
    config = QUIET.changed(run__scheme="uc", shear_estimator__source="load_cell", **TABLES["perfect, delayed"])
    loop = LoopTransferFunction(
        numerical_building(config.numerical_substructure.building()),
        experimental_building(config.specimen.building()),
        feedback_delay=0.012 + 0.5 * DT,
    )
    assert discrete_margin(config).allowable_mass_ratio == pytest.approx(loop.margin().allowable_mass_ratio, rel=0.1)


def test_with_mass_ratio_keeps_frequencies_and_damping_ratios():
    config = Config().changed(**THREE_STORIES)
    scaled = with_mass_ratio(config, 0.37)
    assert configured_mass_ratio(scaled) == pytest.approx(0.37, rel=1e-12)
    before, after = (c.numerical_substructure.building().modes() for c in (config, scaled))
    assert after.frequencies == pytest.approx(before.frequencies, rel=1e-12)
    assert after.damping_ratios == pytest.approx(before.damping_ratios, rel=1e-12)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("scheme", ["fc", "plc_fc"])
def test_full_correction_gain_is_not_stable_at_any_mass_ratio(scheme, source):
    """Decision 0003 goes deeper than noise: the pole at −1 leaves the unit circle with the first gram of specimen."""
    config = QUIET.changed(run__scheme=scheme, shear_estimator__source=source, force_correction__gain=1.0)
    assert discrete_margin(config).allowable_mass_ratio == 0.0
    eigenvalues = np.linalg.eigvals(closed_loop(config).system.a)
    alternating = eigenvalues[np.argmin(np.abs(eigenvalues + 1.0))]
    assert alternating.imag == 0.0
    assert -1.001 < alternating.real < -1.00001


def test_margin_stops_at_the_largest_ratio():
    margin = discrete_margin(Config(), largest=0.2)
    assert margin.allowable_mass_ratio == 0.2
    assert np.isnan(margin.critical_frequency)
    assert LARGEST_MASS_RATIO > 0.2


@pytest.mark.parametrize("ratio", [0.0, 1.0, float("nan")])
def test_impossible_mass_ratio_is_refused(ratio):
    with pytest.raises(InputError, match="mass ratio"):
        with_mass_ratio(Config(), ratio)
