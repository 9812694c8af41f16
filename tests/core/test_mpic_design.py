"""Design of the model-predictive interface control: every part against a closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag

from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.compensators.mpic.estimation import observer
from bmd_rths_core.compensators.mpic.tracking import error_system, tracking
from bmd_rths_core.compensators.mpic.virtual_building import virtual_building
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.held_plant import held_plant
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.mpic_parts import DT, ERROR, NOISE, NUMERICAL, SPECIMEN, WEIGHTS, motion, parts, quiet

# ---- the plant whose command is held


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


# ---- the virtual building


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


def test_virtual_building_feels_the_share_of_the_shear_that_is_fed_back():
    building = virtual_building(NUMERICAL, SPECIMEN, 0.3, DT)
    whole = virtual_building(NUMERICAL, SPECIMEN.scaled(0.3), 1.0, DT)
    np.testing.assert_allclose(building.transition, whole.transition, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(building.acceleration, whole.acceleration, rtol=1e-10, atol=1e-12)


# ---- the observer


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


# ---- the tracking


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
