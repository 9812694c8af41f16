"""Model-predictive interface control: every part against a closed form, the whole against the assembled loop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag
from scipy.signal import butter, sosfiltfilt

from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.design import design
from bmd_rths_core.compensators.mpic.estimation import ModelError, observer
from bmd_rths_core.compensators.mpic.tracking import TrackingWeights, error_system, tracking
from bmd_rths_core.compensators.mpic.virtual_building import virtual_building
from bmd_rths_core.compensators.protocol import SensorNoise
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.build import make_interface_control, make_known
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.controlled import controlled_margin, loop_at_mass_ratio
from bmd_rths_core.stability.discrete import configured_mass_ratio
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.models.held_plant import held_plant
from bmd_rths_core.table.models.plant import interacting_plant
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_core.table.models.simulated import SimulatedTable

DT = 0.005
NUMERICAL = ShearBuilding((900.0, 700.0), (3e6, 2.5e6), (4e3, 3e3))
SPECIMEN = ShearBuilding((760.0, 800.0), (2.5e6, 4.9e6), (3330.0, 78.0))
NOISE = SensorNoise(0.0524, 5e-5, 20.0)
ERROR = ModelError(command=0.01, floors=0.2)
WEIGHTS = TrackingWeights(floors=0.03, command=1e-3, centring=1.5)


def exact(**changes):
    """Return a configuration whose identified model is the truth of its simulated table."""
    table = Config().simulated_table
    servo = {name: getattr(table, f"{name}") for name in ("servo_real_pole", "servo_frequency", "servo_damping_ratio")}
    known = {"table": "interacting_servo", "platen_mass": table.platen_mass, **servo}
    values = {f"identified_model__{name}": value for name, value in known.items()}
    return Config().changed(run__scheme="mpic", shear_estimator__source="load_cell", **(values | changes))


def quiet(**changes):
    noises = ("acceleration_noise", "shear_noise", "displacement_noise", "force_noise")
    return exact(**{f"simulated_table__{name}": 0.0 for name in noises}, **changes)


def motion(steps=600, seed=3):
    """Return noise of 1 to 10 Hz: the ground comes back."""
    band = butter(2, (1.0, 10.0), "bandpass", fs=1.0 / DT, output="sos")
    smooth = sosfiltfilt(band, np.random.default_rng(seed).standard_normal(steps))
    ramp = np.minimum(1.0, np.arange(steps) / 100.0) * np.minimum(1.0, np.arange(steps)[::-1] / 100.0)
    return GroundMotion("random", DT, 0.3 * smooth * ramp / np.abs(smooth).max(), "made here", "0" * 64)


def parts(delay=0.0):
    plant = held_plant(interacting_plant(43.0, 135.0, 0.05, 6353.0, SPECIMEN), delay, DT)
    return plant, virtual_building(NUMERICAL, SPECIMEN, 1.0, DT)


# The plant whose command is held


@pytest.mark.parametrize("delay", [0.0, 0.0012, 0.005, 0.0137])
def test_held_plant_answers_as_the_simulated_table(delay):
    config = quiet(simulated_table__command_delay=delay)
    table = SimulatedTable(config.simulated_table, SPECIMEN, DT, 0)
    plant = held_plant(config.simulated_table.plant(SPECIMEN), delay, DT)
    random, state = np.random.default_rng(1), np.zeros(len(plant.transition))
    for k in range(200):
        command = random.standard_normal()
        state = plant.transition @ state + plant.command[:, 0] * command
        measured = table.exchange(TableCommand(k, command))
        expected = [measured.table_acceleration, *measured.floor_accelerations, measured.table_displacement]
        np.testing.assert_allclose(plant.output @ state, expected, rtol=1e-9, atol=1e-12)


# The virtual building


def test_virtual_building_is_the_whole_building():
    building = virtual_building(NUMERICAL, SPECIMEN, 1.0, DT)
    ground = motion().acceleration
    reference = reference_response(SPECIMEN.stacked_on(NUMERICAL), ground, DT)
    state = np.zeros(len(building.force))
    for k in range(1, len(ground)):
        before, now = building.ground_before[:, 0] * ground[k - 1], building.ground_now[:, 0] * ground[k]
        state = building.transition @ state + before + now
        floors = [building.acceleration @ state, *(building.floors @ state)]
        np.testing.assert_allclose(floors, reference[k, 1:], rtol=1e-9, atol=1e-10)
        assert building.force @ state == pytest.approx(-np.dot(SPECIMEN.masses, floors[1:]), rel=1e-9, abs=1e-7)


def test_virtual_building_feels_the_share_of_the_shear_that_is_fed_back():
    building = virtual_building(NUMERICAL, SPECIMEN, 0.3, DT)
    whole = virtual_building(NUMERICAL, SPECIMEN.scaled(0.3), 1.0, DT)
    np.testing.assert_allclose(building.transition, whole.transition, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(building.acceleration, whole.acceleration, rtol=1e-10, atol=1e-12)


# The observer


def test_gain_of_the_observer_is_where_the_filter_recursion_ends():
    plant, building = parts()
    found = observer(plant, building, SPECIMEN, NOISE, True, ERROR)
    a = block_diag(plant.transition, building.transition)
    c = np.hstack((found.measurement, np.zeros((len(found.measurement), len(building.force)))))
    acting = ERROR.floors * np.vstack((plant.unmodelled, building.unmodelled))
    command = ERROR.command * np.vstack((plant.unknown, np.zeros((len(building.force), 1))))
    q, p = acting @ acting.T + command @ command.T, np.eye(len(a)) * 1e-6
    for _ in range(40000):
        gain = np.linalg.solve(c @ p @ c.T + found.noise, c @ p).T
        following = a @ (p - gain @ c @ p) @ a.T + q
        p, last = 0.5 * (following + following.T), p
        if np.abs(p - last).max() < 1e-15 * np.abs(p).max():
            break
    both = np.vstack((found.plant_gain, found.building_gain))
    scale = np.sqrt(np.diag(found.covariance))[:, None] / np.sqrt(np.diag(found.noise))
    np.testing.assert_allclose(both / scale, gain / scale, atol=1e-6)


def test_observer_has_the_error_that_it_says():
    """10,000 steps of a plant that has just the errors that are assumed."""
    plant, building = parts()
    found = observer(plant, building, SPECIMEN, NOISE, True, ERROR)
    random = np.random.default_rng(0)
    sizes = len(plant.transition), len(building.force)
    true, virtual, predicted, modelled = (np.zeros(size) for size in (*sizes, *sizes))
    errors = []
    for _ in range(10_000):
        innovation = found.measurement @ (true - predicted) + np.sqrt(np.diag(found.noise)) * random.standard_normal(
            len(found.noise)
        )
        errors.append(building.acceleration @ (virtual - modelled))
        predicted = plant.transition @ (predicted + found.plant_gain @ innovation)
        modelled = building.transition @ (modelled + found.building_gain @ innovation)
        floors, command = ERROR.floors * random.standard_normal(2), ERROR.command * random.standard_normal()
        true = plant.transition @ true + plant.unmodelled @ floors + plant.unknown[:, 0] * command
        virtual = building.transition @ virtual + building.unmodelled @ floors
    row = np.concatenate((np.zeros(sizes[0]), building.acceleration))
    assert np.std(errors) == pytest.approx(np.sqrt(row @ found.covariance @ row), rel=0.1)


# The tracking


def test_errors_of_the_table_follow_from_its_motion_and_that_of_the_building():
    plant, building = parts(delay=0.003)
    system = error_system(plant, building, DT)
    random = np.random.default_rng(2)
    ground = random.standard_normal(80)
    x, virtual = np.zeros(len(plant.transition)), np.zeros(len(building.force))
    travel = speed = 0.0
    state = np.concatenate((x, virtual, ground[:1]))
    interface, moving = building.interface
    for k in range(79):
        command = random.standard_normal()
        state = system.transition @ state + system.command[:, 0] * command + system.ground[:, 0] * ground[k + 1]
        x = plant.transition @ x + plant.command[:, 0] * command
        virtual = (
            building.transition @ virtual + np.hstack((building.ground_before, building.ground_now)) @ ground[k : k + 2]
        )
        travel += DT * speed + DT**2 * (ground[k] / 3.0 + ground[k + 1] / 6.0)
        speed += DT * (ground[k] + ground[k + 1]) / 2.0
        at = plant.displacement
        assert state[at] == pytest.approx(x[at] - virtual[interface] - travel, rel=1e-9, abs=1e-12)
        assert state[at + 1] == pytest.approx(x[at + 1] - virtual[moving] - speed, rel=1e-9, abs=1e-12)
        error = plant.output[0] @ x - building.acceleration @ virtual
        assert system.error[0] @ state == pytest.approx(error, rel=1e-9, abs=1e-9)


def test_tracking_solves_its_riccati_equation_and_is_stable():
    system = error_system(*parts(), DT)
    found = tracking(system, WEIGHTS, 3)
    a, b, _, error, d = system
    cost = error.T @ np.diag([1.0, 0.03, 0.03]) @ error
    cost[d, d] += WEIGHTS.centring**4
    cost[d + 1, d + 1] += WEIGHTS.centring**2
    closed = a - b @ found.gain[None]
    balance = closed.T @ found.cost @ closed + cost + WEIGHTS.command * np.outer(found.gain, found.gain)
    np.testing.assert_allclose(balance, found.cost, rtol=1e-6, atol=1e-6 * np.abs(found.cost).max())
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


def test_preview_is_the_optimum_over_a_horizon_that_ends_far_away():
    """The whole future as one least-squares problem gives the same first command."""
    system, known = error_system(*parts(), DT), 3
    found = tracking(system, WEIGHTS, known)
    a, b, e, error, d = system
    weights = np.vstack(
        (
            np.diag([1.0, *np.sqrt([0.03, 0.03])]) @ error,
            WEIGHTS.centring**2 * np.eye(len(a))[d],
            WEIGHTS.centring * np.eye(len(a))[d + 1],
        )
    )
    factor = np.linalg.cholesky(0.5 * (found.cost + found.cost.T) + 1e-12 * np.eye(len(a)))
    random, horizon = np.random.default_rng(5), 40
    start, ground = random.standard_normal(len(a)) * 1e-3, np.zeros(horizon)
    ground[:known] = random.standard_normal(known)
    free, forced = [], []
    state, by_command = start, np.zeros((len(a), horizon))
    rows = [(weights @ by_command, weights @ state)]
    for k in range(horizon):
        state = a @ state + e[:, 0] * ground[k]
        by_command = a @ by_command
        by_command[:, k] += b[:, 0]
        last = k == horizon - 1
        rows.append(((factor.T if last else weights) @ by_command, (factor.T if last else weights) @ state))
    forced = np.vstack([row for row, _ in rows] + [np.sqrt(WEIGHTS.command) * np.eye(horizon)])
    free = np.concatenate([value for _, value in rows] + [np.zeros(horizon)])
    best = np.linalg.lstsq(forced, -free, rcond=None)[0]
    assert -found.gain @ start - found.preview @ ground[:known] == pytest.approx(best[0], rel=1e-6)


# The whole


def test_a_test_with_true_models_and_no_noise_is_the_building():
    config, ground = quiet(), motion()
    record = RthsLoop(config, ground).run()
    whole = config.specimen.building().stacked_on(config.numerical_substructure.building())
    reference = reference_response(whole, ground.acceleration, DT)
    size = np.sqrt(np.mean(reference**2, axis=0))
    np.testing.assert_array_less(np.std(record.desired_acceleration - reference[:, 0]), 1e-9 * size[0])
    for floor in (0, 1):
        error = record.floor_accelerations[:-1, floor] - reference[1:, 1 + floor]
        assert np.sqrt(np.mean(error**2)) < 0.02 * size[1 + floor]


def test_the_assembled_loop_is_the_loop_step_by_step():
    config, ground = exact(), motion()
    loop = closed_loop(config, displacement=True)
    record = RthsLoop(config, ground).run()
    main, drive = noise_streams(config.run.seed)
    noise = np.hstack((main.standard_normal((600, 4)), drive.standard_normal((600, 2))))
    ahead = np.append(ground.acceleration[loop.preview :], np.zeros(loop.preview))[:, None]
    simulation = LinearSimulation(loop.system, loop.start @ ground.acceleration[: loop.preview, None])
    outputs = dict(zip(loop.outputs, simulation.advance(ahead, noise)[0], strict=True))
    for name in ("desired_acceleration", "required_force", "command", "table_displacement", "corrected_force"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())
    np.testing.assert_allclose(outputs["acting_force"][:-1], record.required_force[1:], atol=1e-6)
    assert loop.spectral_radius < 1.0


def test_a_lost_measurement_is_bridged_and_another_step_is_no_news():
    control, ground = make_interface_control(exact()), np.array([0.1, 0.2, 0.1, 0.0])
    measured = TableMeasurement(0, 0.5, 1e-3, 0.3, 0.0, 40.0, np.array([0.1, 0.2]))

    def second(*news):
        control.reset()
        control.step(ground)
        for entry in news:
            control.learn(entry)
        return control.step(ground)

    bridged = second()
    assert second(measured) != bridged
    assert second(measured._replace(step=5)) == bridged
    lost = measured._replace(floor_accelerations=np.array([np.nan, 0.2]), applied_command=np.nan)
    assert second(lost) == bridged


def test_a_command_that_was_not_applied_is_known():
    """The table held another command: a control that is told so goes on as if it had asked for that one."""
    config = quiet()
    control, ground = make_interface_control(config), np.zeros(4)
    table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
    commands = []
    for k in range(400):
        commands.append(control.step(ground).command)
        applied = 0.5 if k == 100 else commands[-1]
        control.learn(table.exchange(TableCommand(k, applied)))
    assert max(map(abs, commands[:101])) == 0.0
    assert np.abs(table.motion.acceleration) < 1e-3
    predicted = control._state[control._layout.plant][-2]  # displacement as predicted, next to the true one
    assert predicted == pytest.approx(table.motion.displacement, rel=0.05, abs=1e-6)


def test_step_allocates_a_result_and_nothing_else_changes_the_packed_matrices():
    packed = design(make_known(exact()))
    control = MpicControl(packed, 2, load_cell=True)
    before = packed.measured.copy()
    for _ in range(10):
        control.step(np.ones(4))
    assert (packed.measured == before).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"identified_model__table": "none"},
            "identified_model.table: none; scheme mpic requires a model of the table",
        ),
        ({"nonlinear__integration": "cr"}, "nonlinear.integration: scheme mpic requires 'exact'"),
        (
            {"identified_model__stiffnesses": [1e6], "identified_model__damping_coefficients": [1.0]},
            "identified_model.stiffnesses: 1 entries; the specimen has 2",
        ),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(InputError, match=message):
        make_interface_control(exact(**changes))


def test_the_hybrid_test_follows_a_specimen_that_is_not_its_model():
    """Capture: without noise, a stiffness changed by 1 % changes the result as it changes the building."""
    ground, config = motion(2000), quiet()
    changed = config.changed(simulated_table__specimen_stiffness_factor=1.01)
    runs = [RthsLoop(entry, ground).run() for entry in (config, changed)]
    lower = config.numerical_substructure.building()
    true = [entry.simulated_table.specimen(entry.specimen.building()).stacked_on(lower) for entry in (config, changed)]
    first, second = (reference_response(building, ground.acceleration, DT) for building in true)
    by_truth, by_test = second - first, runs[1].desired_acceleration - runs[0].desired_acceleration
    assert by_test @ by_truth[:, 0] / (by_truth[:, 0] @ by_truth[:, 0]) > 0.9
    at_top = runs[1].floor_accelerations[:-1, 1] - runs[0].floor_accelerations[:-1, 1]
    assert at_top @ by_truth[1:, 2] / (by_truth[1:, 2] @ by_truth[1:, 2]) > 0.95


def test_noise_of_the_displacement_does_not_change_what_does_not_read_it():
    ground = motion()
    loud = Config()
    silent = loud.changed(simulated_table__displacement_noise=0.0, simulated_table__force_noise=0.0)
    first, second = (RthsLoop(config, ground).run() for config in (loud, silent))
    for name in ("command", "desired_acceleration", "base_shear", "floor_accelerations", "corrected_force"):
        assert (getattr(first, name) == getattr(second, name)).all()
    added = first.table_displacement - second.table_displacement
    assert np.std(added) == pytest.approx(5e-5, rel=0.1)
    assert np.std(first.actuator_force - second.actuator_force) == pytest.approx(20.0, rel=0.1)


def test_seed_of_both_streams_is_that_of_the_run():
    ground, config = motion(50), exact()
    same = RthsLoop(config, ground).run().same_signals(RthsLoop(config, ground).run())
    other = RthsLoop(replace(config, run=replace(config.run, seed=1)), ground).run()
    assert same
    assert not other.same_signals(RthsLoop(config, ground).run())


def test_virtual_building_is_exact_between_the_steps_too():
    """Against an adaptive integration of the coupled equations under a ground acceleration that is linear."""
    building = virtual_building(NUMERICAL, SPECIMEN, 1.0, DT)
    whole = SPECIMEN.stacked_on(NUMERICAL)
    a, by_ground, _ = whole.relative_motion()

    def rate(t, x):
        return a @ x + by_ground[:, 0] * (1.0 + 2.0 * t / DT)

    end = solve_ivp(rate, (0.0, DT), np.zeros(8), rtol=1e-11, atol=1e-14, method="DOP853").y[:, -1]
    state = (building.ground_before * 1.0 + building.ground_now * 3.0)[:, 0]
    np.testing.assert_allclose(state[:2], end[:2], rtol=1e-7)
    np.testing.assert_allclose(state[4:6], end[2:4] - end[1], rtol=1e-6)


# Stability


def heavier(config, factor):
    """Return a loop whose real specimen is heavier, step by step: the control keeps its model."""
    specimen = config.specimen.building()
    real = replace(specimen, masses=tuple(factor * mass for mass in specimen.masses))
    return SimulatedTable(config.simulated_table, real, config.run.time_step, config.run.seed)


def test_loop_with_a_heavier_specimen_is_that_of_a_table_that_carries_one():
    config, ground = quiet(), motion()
    configured = configured_mass_ratio(config)
    quotient = 1.2 * configured / (1.0 - configured)
    loop = loop_at_mass_ratio(config, configured, quotient / (1.0 + quotient))
    record = RthsLoop(config, ground, table=heavier(config, 1.2)).run()
    ahead = np.append(ground.acceleration[loop.preview :], np.zeros(loop.preview))[:, None]
    simulation = LinearSimulation(loop.system, loop.start @ ground.acceleration[: loop.preview, None])
    outputs = dict(zip(loop.outputs, simulation.advance(ahead, np.zeros((600, 6)))[0], strict=True))
    for name in ("desired_acceleration", "command", "table_displacement"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())


def test_margin_is_where_the_eigenvalues_leave_the_unit_circle():
    config = exact(
        mpic__model_error=5.0,
        identified_model__stiffnesses=[1.5e6, 3e6],
        identified_model__damping_coefficients=[3330.0, 78.0],
    )
    configured = configured_mass_ratio(config)
    margin = controlled_margin(config, configured)
    radius = loop_at_mass_ratio(config, configured, configured).spectral_radius
    assert bool(margin.stable_intervals) == (radius < 1.0)
    for interval in margin.stable_intervals:
        for end, frequency in ((interval.lower, interval.lower_frequency), (interval.upper, interval.upper_frequency)):
            if np.isfinite(frequency):
                assert loop_at_mass_ratio(config, configured, end).spectral_radius == pytest.approx(1.0, abs=1e-6)
            else:
                assert loop_at_mass_ratio(config, configured, end).spectral_radius < 1.0
