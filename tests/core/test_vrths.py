"""The vRTHS benchmark problem: plant, building, loop and criteria against closed forms and independent computations."""

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.library import read_ground_motion
from bmd_rths_core.integration.runge_kutta import runge_kutta_4, stage_responses
from bmd_rths_core.vrths.actuator import Actuator, ActuatorMeasurement
from bmd_rths_core.vrths.criteria import criteria, tracking_lag
from bmd_rths_core.vrths.loop import reference_motion, required_force, run_lanes
from bmd_rths_core.vrths.problem import (
    CASES,
    FORCE_LIMIT,
    NOMINAL,
    RATE,
    STIFFNESS,
    TIME_STEP,
    PlantParameters,
    actuator_model,
    numerical_building,
    perturbed_plants,
    reference_building,
)
from bmd_rths_core.vrths.schemes import DEFAULT_SCHEMES, make_tracker, schemes
from bmd_rths_core.vrths.trackers import Asked, VelocityLead
from bmd_rths_core.vrths.trim import Trim

OTHER = PlantParameters(431.0, 95000.0, 5.1, 1.27e6)


def ground(seconds):
    motion = read_ground_motion("el_centro_1940_ns")
    times = np.arange(round(seconds * RATE)) * TIME_STEP
    return 0.4 * np.interp(times, motion.time_step * np.arange(motion.steps), motion.acceleration)


def closed_plant(parameters):
    """Return the control plant as its block diagram has it, by python-control."""
    s = control.tf("s")
    mass, stiffness = 29.13, parameters.specimen_stiffness
    damping = 2.0 * 0.0097 * np.sqrt(stiffness * mass)
    valve = 2.1283e13 / (s**2 + parameters.valve_damping * s + parameters.valve_stiffness)
    actuator = 1.0 / (s + parameters.leakage) / (mass * s**2 + damping * s + stiffness)
    return 1.0261 * control.feedback(valve * control.feedback(actuator, 4229700.0 * s))


@pytest.mark.parametrize("parameters", [NOMINAL, OTHER])
def test_plant_is_the_block_diagram(parameters):
    model = actuator_model(parameters)
    own = control.ss(model.a, model.b, model.displacement, 0.0)
    diagram = closed_plant(parameters)
    for hertz in (0.1, 1.0, 4.0, 20.0, 67.0, 200.0):
        omega = 2.0j * np.pi * hertz
        assert own(omega) == pytest.approx(diagram(omega), rel=1e-8)


def test_nominal_plant_is_24_ms_late():
    model = actuator_model(NOMINAL)
    for hertz in (1.0, 2.0, 3.0, 4.0):
        omega = 2.0 * np.pi * hertz
        answer = (model.displacement @ np.linalg.solve(1j * omega * np.eye(5) - model.a, model.b)).item()
        assert -np.angle(answer) / omega == pytest.approx(0.024, abs=0.001)


@pytest.mark.parametrize(("case", "damping"), list(zip(CASES, (0.05, 0.04, 0.03, 0.03), strict=True)))
def test_building_has_its_damping_in_every_mode(case, damping):
    poles = np.linalg.eigvals(reference_building(case).motion()[0])
    np.testing.assert_allclose(-poles.real / np.abs(poles), damping, rtol=2e-3)


@pytest.mark.parametrize("case", CASES)
def test_numerical_and_experimental_substructure_are_the_building(case):
    whole, numerical = reference_building(case), numerical_building(case, OTHER)
    at_actuator = np.diag([1.0, 0.0, 0.0])
    damping = 2.0 * 0.0097 * np.sqrt(1.27e6 * 29.13)
    np.testing.assert_allclose(numerical.mass + 29.13 * at_actuator, whole.mass)
    np.testing.assert_allclose(numerical.stiffness + 1.27e6 * at_actuator, STIFFNESS)
    np.testing.assert_allclose(numerical.damping + damping * at_actuator, whole.damping)
    np.testing.assert_allclose(numerical.moved_mass, whole.mass)
    with pytest.raises(InputError, match="case 5: not a building of the benchmark problem; 1 to 4 are"):
        reference_building(5)


def test_plants_are_drawn_with_their_deviations():
    plants = np.array(perturbed_plants(4000, 1))
    np.testing.assert_allclose(plants.mean(axis=0), NOMINAL, rtol=0.02)
    np.testing.assert_allclose(plants.std(axis=0), (3.3, 3300.0, 1.3, 50000.0), rtol=0.05)
    assert perturbed_plants(3, 1) == perturbed_plants(4, 1)[:3]


# Runge-Kutta


def slopes_by_hand(slope, state, step):
    first = slope(state, 0.0)
    second = slope(state + 0.5 * step * first, 0.5)
    third = slope(state + 0.5 * step * second, 0.5)
    fourth = slope(state + step * third, 1.0)
    return state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def test_runge_kutta_as_matrices():
    random = np.random.default_rng(0)
    a, b, state = random.standard_normal((4, 4)), random.standard_normal((4, 2)), random.standard_normal(4)
    begin, end, step = np.array([1.0, -2.0]), np.array([0.5, 3.0]), 0.3
    expected = slopes_by_hand(lambda x, share: a @ x + b @ (begin + share * (end - begin)), state, step)
    matrices = runge_kutta_4(a, b, step)
    np.testing.assert_allclose(matrices.phi @ state + matrices.gamma_0 @ begin + matrices.gamma_1 @ end, expected)


def test_a_load_at_every_stage_is_a_held_load():
    random = np.random.default_rng(1)
    a, b = random.standard_normal((3, 3)), random.standard_normal((3, 1))
    matrices = runge_kutta_4(a, b, 0.2)
    stages, after = stage_responses(a, b[:, 0], 0.2)
    np.testing.assert_allclose(after.sum(axis=1), (matrices.gamma_0 + matrices.gamma_1)[:, 0])
    np.testing.assert_allclose(stages.sum(axis=2), matrices.stages[:, :, -1], atol=1e-15)
    assert not np.triu(stages[:, 0]).any()  # nothing acts before its time


# The actuator


@pytest.mark.parametrize("height", [0.001, 0.2])
def test_actuator_moves_as_its_equations(height):
    """Within the limit of the force, and far beyond it; the equations are written anew, in SI units."""
    actuator = Actuator([NOMINAL, OTHER], [0, 1])

    def slope(_, x):
        flow, rate, force, displacement, velocity = x
        limited = np.clip(force, -8900.0, 8900.0)
        damping = 2.0 * 0.0097 * np.sqrt(1.27e6 * 29.13)
        return (
            rate,
            2.1283e13 * (1.0261 * height - displacement) - 431.0 * rate - 95000.0 * flow,
            flow - 5.1 * force - 4229700.0 * velocity,
            velocity,
            (limited - damping * velocity - 1.27e6 * displacement) / 29.13,
        )

    times = np.arange(1, 201) * TIME_STEP
    exact = solve_ivp(slope, (0.0, times[-1]), np.zeros(5), t_eval=times, rtol=1e-10, atol=1e-9, method="DOP853").y
    moved = []
    for step in range(len(times)):
        actuator.move(step, np.full(2, height))
        moved.append((actuator.true_displacement[1], actuator.true_force[1]))
    displacement, force = np.array(moved).T
    np.testing.assert_allclose(displacement, exact[3], atol=2e-3 * np.abs(exact[3]).max())
    np.testing.assert_allclose(force, np.clip(exact[2], -8900, 8900), atol=1e-2 * np.abs(force).max())
    assert actuator.limited.all() == (height == 0.2)
    assert np.abs(force).max() <= FORCE_LIMIT


def test_limit_acts_in_every_evaluation():
    actuator, model = Actuator([OTHER], [0]), actuator_model(OTHER)

    def slope(x, _):
        excess = x[2] - np.clip(x[2], -8900.0, 8900.0)
        return model.a @ x + model.b[:, 0] * 0.3 + model.by_limited_force * excess

    state = np.zeros(5)
    for step in range(150):
        actuator.move(step, np.array([0.3]))
        state = slopes_by_hand(slope, state, TIME_STEP)
        assert actuator.true_displacement[0] == pytest.approx(state[3], rel=1e-9)
    assert abs(state[2]) > 8900.0


def test_sensors_have_their_noise_and_steps():
    actuator = Actuator([NOMINAL, NOMINAL], [3, 4])
    read = [actuator.read(k) for k in range(5000)]
    displacement, force = np.array([r.displacement for r in read]), np.array([r.force for r in read])
    np.testing.assert_allclose(displacement.std(axis=0), 16e-6, rtol=0.05)
    np.testing.assert_allclose(force.std(axis=0), np.sqrt(1.16e-3 * 4096), rtol=0.05)
    np.testing.assert_array_equal(displacement * 2**18, np.rint(displacement * 2**18))
    assert abs(np.corrcoef(displacement.T)[0, 1]) < 0.05


# The loop


def test_loop_is_its_equations_step_by_step():
    """The problem written down anew for one lane, without anything of the package but its numbers."""
    case, lead, acceleration = 3, 0.024, ground(2.3)[-1500:]
    found = run_lanes(case, [NOMINAL, OTHER], VelocityLead(lead), acceleration, [7, 8])

    whole, model = reference_building(case), actuator_model(OTHER)
    damping = 2.0 * 0.0097 * np.sqrt(1.27e6 * 29.13)
    mass = whole.mass - np.diag([29.13, 0, 0])
    c, k = whole.damping - np.diag([damping, 0, 0]), STIFFNESS - np.diag([1.27e6, 0, 0])
    noise = np.random.default_rng(8).standard_normal((4096, 2)) * np.sqrt([6.25e-14 * 4096, 1.16e-3 * 4096])
    state, plant, late = np.zeros(6), np.zeros(5), 0.0
    for step, now in enumerate(acceleration):
        measured, force = plant[3] + noise[step, 0], plant[2] + noise[step, 1]
        np.testing.assert_allclose(found.displacement[step, :, 1], state[:3], rtol=1e-7, atol=1e-12)
        assert found.measured[step, 1] == pytest.approx(measured, abs=2.0**-19 + 1e-9)
        command = state[0] + lead * state[3]
        plant = slopes_by_hand(lambda x, _, u=command: model.a @ x + model.b[:, 0] * u, plant, TIME_STEP)
        if step + 1 < len(acceleration):

            def slope(x, share, a=now, b=acceleration[step + 1], f=late):
                load = -whole.mass @ np.ones(3) * (a + share * (b - a)) - f * np.array([1.0, 0.0, 0.0])
                return np.append(x[3:], np.linalg.solve(mass, load - c @ x[3:] - k @ x[:3]))

            state = slopes_by_hand(slope, state, TIME_STEP)
        late = force


def test_reference_is_the_building_by_scipy():
    acceleration = ground(3.0)
    a, b = reference_building(2).motion()
    times = np.arange(len(acceleration)) * TIME_STEP
    _, expected, _ = lsim((a, b[:, :1], np.eye(3, 6), np.zeros((3, 1))), acceleration, times)
    np.testing.assert_allclose(reference_motion(2, acceleration)[:, :3], expected, atol=1e-4 * np.abs(expected).max())


# Criteria


def test_required_force_is_that_of_the_specimen_in_the_building_by_scipy():
    motion = ground(5.0)
    a, b = reference_building(3).motion()
    times = TIME_STEP * np.arange(len(motion))
    _, states, _ = lsim((a, b[:, :1], np.eye(6), np.zeros((6, 1))), motion, times)
    position, velocity = states[:, 0], states[:, 3]
    acceleration = np.gradient(velocity, TIME_STEP)
    damping = 2.0 * 0.0097 * np.sqrt(29.13 * 1.19e6)
    force = np.abs(29.13 * acceleration + damping * velocity + 1.19e6 * position).max()
    assert required_force(3, motion, reference_motion(3, motion)) == pytest.approx(force, rel=1e-4)


def test_criteria_worked_by_hand():
    desired = np.array([1.0, -1.0, 3.0, -3.0])
    measured = np.array([1.0, -1.0, 3.0, -2.0])
    reference = np.array([[2.0, 1.0, 4.0], [-2.0, -1.0, -4.0], [2.0, 1.0, 4.0], [-2.0, -1.0, -4.0]])
    upper = np.array([[1.5, 4.0], [-1.0, -4.0], [1.0, 5.0], [-1.0, -4.0]])
    found = criteria(desired, measured, reference, upper)
    assert found["J2"] == pytest.approx(100.0 * np.sqrt(0.1875 / 5.0))  # errors 0, 0, 0, 1 have variance 3/16
    assert found["J3"] == pytest.approx(100.0 / 3.0)
    assert found["J4"] == pytest.approx(100.0 * np.sqrt(0.6875 / 4.0))  # errors -1, 1, 1, 0: 3/4 − 1/16
    assert found["J5"] == pytest.approx(50.0)
    assert found["J6"] == pytest.approx(100.0 * np.sqrt(0.046875))  # errors 0.5, 0, 0, 0: 1/16 − 1/64
    assert found["J7"] == pytest.approx(100.0 * np.sqrt(0.1875 / 16.0))  # errors 0, 0, 1, 0
    assert found["J8"] == pytest.approx(50.0)
    assert found["J9"] == pytest.approx(25.0)


@pytest.mark.parametrize("lag", [0, 7, 49])
def test_lag_is_found(lag):
    motion = np.random.default_rng(5).standard_normal(3000).cumsum()
    late = np.concatenate((np.full(lag, motion[0]), motion))[: len(motion)]
    assert tracking_lag(motion, late) == lag
    upper = np.column_stack((motion, motion))
    found = criteria(motion, late, np.column_stack((motion, upper)), upper)
    assert found["J1"] == pytest.approx(lag / 4.096)


def test_a_lead_is_no_lag():
    motion = np.sin(np.arange(8000) / 200.0)
    assert tracking_lag(motion, np.roll(motion, -20)) == 0


# Compensators


@pytest.mark.slow
def test_every_scheme_moves_the_actuator():
    acceleration, plants = ground(1.2), [NOMINAL, *perturbed_plants(1, 0)]
    for name in schemes():
        if name in ("ats", "amb"):
            acceleration = acceleration[:1500]
        found = run_lanes(1, plants, make_tracker(name, 1, 2), acceleration, [0, 1])
        assert np.isfinite(found.command).all(), name
        assert np.abs(found.command).max() > 1e-6, name


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("plc_fc", "scheme plc_fc: corrects the force of a shake table, and tracks no displacement; one of uc, "),
        ("mpic", "scheme mpic: controls an acceleration, and tracks no displacement"),
        ("mpc", "scheme 'mpc': unknown; one of uc, "),
    ],
)
def test_what_tracks_no_displacement_is_refused(name, problem):
    with pytest.raises(InputError, match=problem):
        make_tracker(name, 1, 1)


@pytest.mark.slow
def test_best_scheme_follows_to_the_noise():
    """On the nominal plant, and on drawn ones: J₂ is what the noise of the transducer makes, and little more."""
    acceleration = ground(6.0)
    plants = [NOMINAL, *perturbed_plants(3, 11)]
    found = run_lanes(4, plants, make_tracker(DEFAULT_SCHEMES[-1], 4, 4), acceleration, range(4))
    reference = reference_motion(4, acceleration)[:, :3]
    for lane in range(4):
        motion = found.displacement[:, :, lane]
        values = criteria(motion[:, 0], found.measured[:, lane], reference, motion[:, 1:])
        assert values["J1"] == 0.0
        noise = 1600e-6 / motion[:, 0].std()
        assert values["J2"] < np.hypot(noise, 0.7)  # one step ahead at 3.6 Hz is 0.55 %
        assert values["J4"] < 4.0
        assert max(values["J6"], values["J7"]) < 3.2
    assert not found.limited.any()


@pytest.mark.slow
def test_trim_makes_another_actuator_answer_as_the_nominal_one():
    plants = [NOMINAL, PlantParameters(leakage=6.0), PlantParameters(valve_stiffness=92000.0)]
    times = np.arange(round(5.0 * RATE)) * TIME_STEP
    wanted = 1e-3 * (np.sin(2.0 * np.pi * 2.9 * times) + np.sin(2.0 * np.pi * 1.3 * times))
    errors = []
    for trim in (None, Trim(3)):
        actuator, moved = Actuator(plants, [0, 1, 2]), []
        seen = actuator.read(-1)
        for step, value in enumerate(wanted.tolist()):
            command = np.full(3, value)
            applied = command if trim is None else trim.applied(command, seen.displacement)
            seen = actuator.move(step, applied)
            moved.append(actuator.true_displacement)
        answer = np.array(moved)[len(times) // 2 :]
        errors.append(np.std(answer[:, 1:] - answer[:, :1], axis=0) / np.std(answer[:, 0]))
    assert (errors[0] > 0.01).all()
    assert (errors[1] < 0.2 * errors[0]).all()


def test_trim_leaves_a_resting_actuator_alone():
    trim, actuator = Trim(2), Actuator([NOMINAL, OTHER], [0, 1])
    for step in range(4096):
        actuator.move(step, trim.applied(np.zeros(2), actuator.read(step).displacement))
    np.testing.assert_allclose(trim.gain, 1.0, atol=0.01)
    np.testing.assert_allclose(trim.lag * 48.2, 1.0, atol=0.01)


def test_velocity_lead_by_hand():
    asked = Asked(np.array([[1.0], [0], [0], [2.0], [0], [0]]), 0.0, ActuatorMeasurement(-1, np.zeros(1), np.zeros(1)))
    assert VelocityLead(0.1).step(asked).tolist() == [1.2]
