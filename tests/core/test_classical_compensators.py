"""Tuned phase lead, inverse, feedforward with LQG, and the adaptive ones: each part against a closed form."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.signal import bessel, butter, freqs_zpk, sosfilt

from bmd_rths_core.compensators.adaptation import AdaptiveShaper, Limits, Sample, difference_weights
from bmd_rths_core.compensators.adaptive_model_based import NormalisedGradient
from bmd_rths_core.compensators.adaptive_time_series import MovingLeastSquares
from bmd_rths_core.compensators.identified_table import held_table, transfer_function
from bmd_rths_core.compensators.inverse import cascade, inverse_system
from bmd_rths_core.compensators.phase_lead import CommandShaperConfig
from bmd_rths_core.compensators.phase_lead import transfer_function as phase_lead
from bmd_rths_core.compensators.tuned_phase_lead import search
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.build import make_command_shaper, make_known
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.table.models.dynamics import series, servo_sections
from bmd_rths_core.table.models.plant import driven_plant, interacting_plant
from bmd_rths_core.table.models.sensors import noise_streams
from tests.core.mpic_parts import DT, exact, motion, quiet

SPECIMEN = ShearBuilding((760.0, 800.0), (2.5e6, 4.9e6), (3330.0, 78.0))
ANGLES = np.array([0.01, 0.1, 0.4, 0.66, 1.0, 2.0, 3.0])


def under(scheme, make=exact, **changes):
    return make(**changes).changed(run__scheme=scheme, shear_estimator__source="kalman")


def known(scheme, **changes):
    return make_known(under(scheme, **changes))


def response(system, angles):
    """Return the response from the first input, by python-control."""
    ss = control.ss(*(part[:, :1] if part is system.b or part is system.d else part for part in system), DT)
    return np.array([ss(np.exp(1j * angle)).item() for angle in angles])


# The identified table


@pytest.mark.parametrize("plant", [interacting_plant(43.0, 135.0, 0.05, 6353.0, SPECIMEN)])
def test_zeros_and_poles_have_the_response_of_the_plant(plant):
    zeros, poles, gain = transfer_function(plant)
    omega = np.array([0.5, 5.0, 18.0, 60.0, 135.0, 400.0])
    a, b, c = plant.a[:-2, :-2], plant.b[:-2], plant.output[:1, :-2]
    expected = [(c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b)).item() for w in omega]
    found = freqs_zpk(zeros, poles, gain, omega)[1]
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert len(zeros) == 2 * SPECIMEN.stories


def test_zeros_are_the_poles_of_the_specimen_on_a_table_that_stands():
    """Where the specimen does not let the table accelerate: the antiresonances of control-structure interaction."""
    zeros = transfer_function(interacting_plant(43.0, 135.0, 0.05, 6353.0, SPECIMEN)).zeros
    fixed = np.linalg.eigvals(SPECIMEN.relative_motion()[0])
    np.testing.assert_allclose(np.sort_complex(zeros), np.sort_complex(fixed), rtol=1e-8)


def test_specimen_that_does_not_pull_cancels():
    plant = driven_plant(series(servo_sections(43.0, 135.0, 0.05)), SPECIMEN)
    zeros, poles, gain = transfer_function(plant)
    assert len(zeros) == 0
    pair = 135.0 * (-0.05 + 1j * np.sqrt(1.0 - 0.05**2))
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex([-43.0, pair, pair.conjugate()]), rtol=1e-9)
    assert gain == pytest.approx(43.0 * 135.0**2, rel=1e-9)


def test_a_table_without_dynamics_is_its_gain():
    zeros, poles, gain = transfer_function(driven_plant(series(()), SPECIMEN))
    assert (len(zeros), len(poles), gain) == (0, 0, 1.0)


def test_held_table_answers_one_step_later_than_it_is_measured():
    """The command of a step cannot move the table at its begin; afterwards it answers as the simulated table does."""
    config = under("plc_tuned", quiet, simulated_table__command_delay=0.0037, identified_model__command_delay=0.0037)
    table = held_table(make_known(config), "plc_tuned")
    loop = closed_loop(config.changed(force_correction__feedback_scale=1e-9))
    by_command = loop.outputs.index("table_acceleration")
    ss = control.ss(table.transition, table.command, table.acceleration, 0.0, DT)
    assert ss(np.exp(0.1j)).item() == pytest.approx(table.response(np.array([0.1]))[0], rel=1e-9)
    # From the ground, the acceleration of the table over the command is the same but for the step.
    z = np.exp(0.1j)
    a, b, c, d = loop.system
    signals = (c @ np.linalg.solve(z * np.eye(len(a)) - a, b[:, :1]) + d[:, :1])[:, 0]
    measured = signals[by_command] / signals[loop.outputs.index("command")]
    assert measured / z == pytest.approx(table.response(np.array([0.1]))[0], rel=1e-6)


# Inverse


def test_inverse_is_the_low_pass_over_the_table_at_the_warped_frequencies():
    what = known("inverse")
    system = inverse_system(what, 30.0, "inverse")
    omega = 2.0 / DT * np.tan(ANGLES / 2.0)
    low = freqs_zpk(*bessel(3, 2 * np.pi * 30.0, analog=True, output="zpk", norm="mag"), omega)[1]
    table = freqs_zpk(*transfer_function(what.table), omega)[1]
    np.testing.assert_allclose(response(system, ANGLES), low / table, rtol=1e-6)
    assert np.abs(np.linalg.eigvals(system.a)).max() < 1.0


def test_cascade_is_the_filter_of_scipy():
    sections = butter(4, (1.0, 20.0), "bandpass", fs=1.0 / DT, output="sos")
    signal = np.random.default_rng(0).standard_normal(300)
    a, b, c, d = cascade(sections)
    state, found = np.zeros((len(a), 1)), []
    for value in signal:
        found.append((c @ state + d * value).item())
        state = a @ state + b * value
    np.testing.assert_allclose(found, sosfilt(sections, signal), rtol=1e-10, atol=1e-12)


# Tuned phase lead


@pytest.mark.slow
def test_search_finds_a_minimum_that_no_neighbour_and_no_other_grid_is_below():
    what = known("plc_tuned")
    found = search(what)
    within, everywhere = np.linspace(0.04, 8.0, 200) * 2 * np.pi * DT, np.linspace(np.pi / 200, np.pi, 200)
    table = held_table(what, "plc_tuned")

    def cost(w1, w2, lead):
        parts = []
        for angles in (within, everywhere):
            numerator, denominator = phase_lead(CommandShaperConfig(w1, w2, lead), DT)
            z = np.exp(1j * angles)
            parts.append(np.polyval(numerator, z) / np.polyval(denominator, z) * table.response(angles))
        return np.mean(np.abs(1.0 - parts[0]) ** 2) + 0.02 * np.mean(np.abs(parts[1]) ** 2)

    least = cost(found.w1, found.w2, found.lead_time)
    others = [
        cost(w1, w2, lead)
        for w1 in np.linspace(1.5, 4.0, 9)
        for w2 in np.linspace(0.0, 2.4, 9)
        for lead in np.linspace(0.0, 0.04, 9)
    ]
    assert least < min(others)
    for change in ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, -0.01, 0.0), (0.0, 0.0, 1e-4), (0.0, 0.0, -1e-4)):
        assert cost(*np.add((found.w1, found.w2, found.lead_time), change)) > least - 1e-9
    assert least < cost(2.0, 2.0, 0.025)


# Feedforward with LQG


def test_gains_of_the_feedback_are_those_of_python_control():
    what = known("ff_lqg")
    settings, table, forward = what.settings, held_table(what, "ff_lqg"), inverse_system(what, 60.0, "ff_lqg")
    shaped = np.exp(-2 * np.pi * settings.error_frequency * DT)
    size = len(table.transition) + 1
    a, b = np.zeros((size, size)), np.vstack((table.command, [[0.0]]))
    a[:-1, :-1], a[-1, -1] = table.transition, shaped
    c = np.append(table.acceleration, 1.0)[None]
    gain = control.dlqr(a, b, c.T @ c, [[settings.command_weight]])[0]
    enters = np.eye(size)[:, -1:] * np.sqrt(1 - shaped**2) * settings.error
    noise = what.noise.acceleration**2
    prior = control.dlqe(a, enters, c, [[1.0]], [[noise]])[1]
    kalman = prior @ c.T / (c @ prior @ c.T + noise)
    system = make_command_shaper(under("ff_lqg")).state_space()
    n = len(forward.a)
    np.testing.assert_allclose(system.c[0, n:], (-gain @ (np.eye(size) - kalman @ c))[0], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(system.d[0, 1], (-gain @ kalman).item(), rtol=1e-5)
    np.testing.assert_allclose(system.d[0, 0], (forward.d + gain @ kalman).item(), rtol=1e-5)
    closed = a - b @ gain
    np.testing.assert_allclose(system.a[n:, n:], closed @ (np.eye(size) - kalman @ c), rtol=1e-5, atol=1e-6)


def measurement(step, table=0.4, applied=0.1):
    return TableMeasurement(step, applied, 1e-3, table, 0.0, 40.0, np.array([0.1, 0.2]))


def test_feedback_bridges_a_lost_measurement_and_knows_a_command_that_was_not_applied():
    shaper = make_command_shaper(under("ff_lqg"))

    def second(*news):
        shaper.reset()
        first = shaper.step(0.5)
        for table, applied in news:
            shaper.learn(measurement(0, table, first if applied is None else applied))
        return shaper.step(0.5)

    nothing = second()
    assert second((np.nan, None)) == nothing
    assert second((0.4, None)) != nothing
    assert second((np.nan, 9.0)) != nothing


# Adaptive


def test_moving_least_squares_is_the_fit_of_numpy_and_waits_for_motion():
    random, rule = np.random.default_rng(1), MovingLeastSquares(50, 0.1)
    rows, commands = random.standard_normal((80, 3)), random.standard_normal(80)
    start = np.ones(3)
    for k in range(80):
        found = rule.wanted(Sample(rows[k], commands[k]), start)
        assert (found is start) == (k < 49)
    np.testing.assert_allclose(found, np.linalg.lstsq(rows[30:], commands[30:], rcond=None)[0], rtol=1e-8)
    rule.reset()
    for k in range(80):
        assert rule.wanted(Sample(0.01 * rows[k], commands[k]), start) is start


def test_gradient_is_that_of_the_squared_error_and_ends_at_the_true_coefficients():
    random, true, rule = np.random.default_rng(2), np.array([1.1, 0.9, 1.2]), NormalisedGradient(4.0, 0.1, DT)
    factors = np.ones(3)
    for k in range(6000):
        phi = random.standard_normal(3)
        before, factors = factors, rule.wanted(Sample(phi, float(phi @ true)), factors)
        change = factors - before
        if k == 500:
            np.testing.assert_allclose(np.cross(change, phi), 0.0, atol=1e-12)
            assert np.dot(change, phi) * (phi @ (true - before)) >= 0.0
    np.testing.assert_allclose(factors, true, atol=1e-3)


def test_gradient_never_goes_beyond_what_makes_the_error_vanish():
    rule = NormalisedGradient(1e4, 0.0, DT)
    phi = np.array([3.0, 1.0, -2.0])
    after = rule.wanted(Sample(phi, 10.0), np.ones(3))
    assert phi @ after == pytest.approx(10.0, rel=1e-9)


@pytest.mark.parametrize("scheme", ["ats", "amb"])
def test_factors_go_to_those_of_the_table_within_rate_and_bounds(scheme):
    """A table whose inverse is just Σ aⱼ Dʲ, with other coefficients than were identified."""
    settings, shaper = known(scheme).settings, make_command_shaper(under(scheme))
    true = np.array([1.1, 1.15, 0.85])
    table, history = 20.0 * motion(4001).acceleration, []
    derivatives = np.stack([table, np.append(0.0, table[:-1]), np.append([0.0, 0.0], table[:-2])], axis=1)
    commands = derivatives @ difference_weights(DT).T @ (shaper.initial * true)
    for k in range(4000):
        shaper.step(table[k])
        shaper.learn(measurement(k, table[k + 1], commands[k]))
        history.append(shaper.factors.copy())
    assert np.abs(np.diff(history, axis=0)).max() <= settings.largest_rate * DT + 1e-12
    np.testing.assert_allclose(history[-1], true, atol=1e-6 if scheme == "ats" else 0.1)
    narrow = make_command_shaper(under(scheme, **{f"{scheme}__largest_change": 0.05}))
    for k in range(2500):
        narrow.step(table[k])
        narrow.learn(measurement(k, table[k + 1], commands[k]))
    np.testing.assert_allclose(narrow.factors, [1.05, 1.05, 0.95], atol=1e-9 if scheme == "ats" else 0.04)


@pytest.mark.parametrize("scheme", ["ats", "amb"])
def test_nothing_is_adapted_after_a_lost_measurement_until_the_filters_forget_it(scheme):
    shaper = make_command_shaper(under(scheme))
    table, wide = 20.0 * motion(1501).acceleration, 0
    commands = 1.1 * np.convolve(table, shaper.initial @ difference_weights(DT))
    for k in range(1500):
        shaper.step(table[k])
        if k == 700:
            before = shaper.factors
        if k == 701:
            continue
        shaper.learn(measurement(k, np.nan if k == 700 else table[k + 1], commands[k]))
        if 700 <= k < 1102:
            assert (shaper.factors == before).all()
            wide += 1
    assert wide == 401
    assert not (shaper.factors == before).all()


@pytest.mark.parametrize("scheme", ["ats", "amb"])
def test_coefficients_to_begin_with_make_the_table_follow(scheme):
    shaper, what = make_command_shaper(under(scheme)), known(scheme)
    angles = 2 * np.pi * DT * np.array([1.0, 2.0, 4.0])
    through = response(shaper.held(), angles) * held_table(what, scheme).response(angles)
    assert np.abs(through - 1.0).max() < 0.15
    assert np.abs(held_table(what, scheme).response(angles) - 1.0).max() > 0.5


def test_a_table_that_leads_is_refused():
    plant = driven_plant(series((0.0, 0.1, 1.0, 0.0, 0.01, 1.0)), SPECIMEN)
    leading = replace(known("ats"), table=plant)
    with pytest.raises(InputError, match="scheme ats requires positive ones, those of a table that lags"):
        AdaptiveShaper(leading, Limits(0.5, 10.0, 0.3, 0.25), "ats", MovingLeastSquares(4, 0.1))


# The whole


@pytest.mark.parametrize("scheme", ["plc_tuned", "inverse", "ff_lqg"])
def test_the_assembled_loop_is_the_loop_step_by_step(scheme):
    config, ground = under(scheme), motion()
    loop = closed_loop(config, displacement=True)
    record = RthsLoop(config, ground).run()
    main, drive = noise_streams(config.run.seed)
    noise = np.hstack((main.standard_normal((600, 4)), drive.standard_normal((600, 2))))
    simulation = LinearSimulation(loop.system, loop.start * ground.acceleration[0])
    outputs = dict(zip(loop.outputs, simulation.advance(ground.acceleration[:, None], noise)[0], strict=True))
    for name in ("desired_acceleration", "required_force", "command", "table_displacement", "corrected_force"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())
    assert record.outcome == "finished"
    assert closed_loop(config).spectral_radius < 1.0


@pytest.mark.parametrize("scheme", ["ats", "amb"])
def test_the_loop_of_an_adaptive_one_is_assembled_as_it_begins(scheme):
    config, ground = under(scheme, **{f"{scheme}__largest_change": 0.0}), motion()
    assert not has_matrices(config)
    loop = closed_loop(config, displacement=True)
    record = RthsLoop(config, ground).run()
    main, drive = noise_streams(config.run.seed)
    noise = np.hstack((main.standard_normal((600, 4)), drive.standard_normal((600, 2))))
    simulation = LinearSimulation(loop.system, loop.start * ground.acceleration[0])
    outputs = dict(zip(loop.outputs, simulation.advance(ground.acceleration[:, None], noise)[0], strict=True))
    np.testing.assert_allclose(outputs["command"], record.command, atol=1e-8 * np.abs(record.command).max())


@pytest.mark.parametrize(
    ("scheme", "changes", "message"),
    [
        *(
            (scheme, {"identified_model__table": "none"}, f"identified_model.table: none; scheme {scheme} requires")
            for scheme in ("plc_tuned", "inverse", "ff_lqg", "ats", "amb")
        ),
        ("plc_tuned", {"plc_tuned__highest_frequency": 100.0}, "plc_tuned.highest_frequency: 100 Hz is not allowed"),
        ("inverse", {"inverse__low_pass_frequency": 120.0}, "inverse.low_pass_frequency: 120 Hz is not allowed"),
        ("ff_lqg", {"ff_lqg__low_pass_frequency": 100.0}, "ff_lqg.low_pass_frequency: 100 Hz is not allowed"),
        (
            "inverse",
            {"identified_model__table": "sections", "identified_model__sections": [0.0, -1.0, 50.0, 0.0, 1.0, 50.0]},
            "identified_model: the table has a zero at 50",
        ),
        ("ats", {"ats__upper_frequency": 100.0}, "ats.lower_frequency, ats.upper_frequency: 0.5 and 100 Hz are not"),
        ("amb", {"amb__lower_frequency": 12.0}, "amb.lower_frequency, amb.upper_frequency: 12 and 10 Hz are not"),
    ],
)
def test_refusals(scheme, changes, message):
    with pytest.raises(InputError, match=message):
        make_command_shaper(under(scheme, **changes))


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["plc_tuned", "inverse", "ff_lqg", "ats", "amb"])
def test_error_is_below_that_without_compensation(scheme):
    ground = motion(1200)
    perfect = RthsLoop(Config().changed(simulated_table__dynamics="perfect", run__scheme="uc"), ground).run()

    def error(name):
        record = RthsLoop(under(name), ground).run()
        assert record.outcome == "finished"
        return np.std(record.desired_acceleration - perfect.desired_acceleration)

    assert error(scheme) < 0.8 * error("uc")
