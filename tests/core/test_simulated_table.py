"""Simulated table: transfer functions, exact discretisation, delay, sensors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import freqs, lsim

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.models import simulated_table
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.dynamics import series, servo_sections
from bmd_rths_core.table.models.simulated import SimulatedTable
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

DT = 0.005
SPECIMEN = Config().specimen.building()
QUIET = {"acceleration_noise": 0.0, "shear_noise": 0.0, "displacement_noise": 0.0, "force_noise": 0.0}
#: Eq. 9 of the paper, one row a section.
EQUATION_9 = (
    *(0.0, 0.0, 1.1768e10, 0.0, 1.0, 64.95),
    *(1.0, 1.186, 3051.0, 1.0, 1.108, 2995.0),
    *(1.0, 4.739, 1.06e4, 1.0, 4.567, 1.049e4),
    *(0.0, 0.0, 1.0, 1.0, 97.46, 8960.0),
    *(0.0, 0.0, 1.0, 1.0, 21.07, 2.13e4),
)


def equation_9_polynomials():
    numerator = 1.1768e10 * np.polymul([1, 1.186, 3051], [1, 4.739, 1.06e4])
    denominator = np.array([1.0])
    for factor in ([1, 64.95], [1, 1.108, 2995], [1, 97.46, 8960], [1, 4.567, 1.049e4], [1, 21.07, 2.13e4]):
        denominator = np.polymul(denominator, factor)
    return numerator, denominator


def frequency_response(sections, omega):
    model = series(sections)
    n = len(model.a)
    return np.array([(model.c @ np.linalg.solve(1j * w * np.eye(n) - model.a, model.b))[0, 0] + model.d for w in omega])


def drive(table, commands):
    return [table.exchange(TableCommand(k, a)) for k, a in enumerate(commands)]


def test_equation_9_has_the_gain_and_delay_checked_from_the_paper():
    assert abs(frequency_response(EQUATION_9, [1e-6])[0]) == pytest.approx(0.977, abs=5e-4)
    frequency = np.array([0.5, 2.0, 4.0, 8.0, 8.98])
    # The phase passes −180° before the last frequency, so it is followed up from zero.
    grid = np.linspace(0.01, 9.0, 2000)
    phase = np.unwrap(np.angle(frequency_response(EQUATION_9, 2 * np.pi * grid)))
    delay_ms = -1e3 * np.interp(frequency, grid, phase) / (2 * np.pi * frequency)
    assert delay_ms[:4] == pytest.approx(27.15, abs=0.2)
    assert delay_ms[4] == pytest.approx(29.9, abs=0.05)


def test_sections_in_series_have_the_frequency_response_of_the_polynomials():
    omega = np.logspace(-1, 3, 200)
    _, expected = freqs(*equation_9_polynomials(), worN=omega)
    assert frequency_response(EQUATION_9, omega) == pytest.approx(expected, rel=1e-9)


def test_sections_with_feedthrough_have_the_frequency_response_of_the_polynomials():
    sections = (2.0, 3.0, 50.0, 0.5, 4.0, 80.0, 0.0, 3.0, 7.0, 0.0, 2.0, 9.0)
    omega = np.logspace(-1, 3, 50)
    _, expected = freqs(np.polymul([2, 3, 50], [3, 7]), np.polymul([0.5, 4, 80], [2, 9]), worN=omega)
    assert frequency_response(sections, omega) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("delay_steps", [0.0, 1.0, 2.0, 0.2, 3.6])
@pytest.mark.parametrize("dynamics", ["servo", "sections"])
def test_sensors_agree_with_scipy_on_a_finer_grid(dynamics, delay_steps):
    """Lsim with a tenth of the step and held input is an independent solution; delays here are whole tenths."""
    fine = 10
    commands = np.random.default_rng(2).normal(size=80)
    servo = {"servo_real_pole": 49.6, "servo_frequency": 183.6, "servo_damping_ratio": 0.167}
    chain = {"dynamics": dynamics, "sections": EQUATION_9, "command_delay": delay_steps * DT}
    config = SimulatedTableConfig(**chain, **servo, **QUIET)
    table = SimulatedTable(config, SPECIMEN, DT, seed=0)
    measurements = drive(table, commands)

    model = series(EQUATION_9 if dynamics == "sections" else servo_sections(*servo.values()))
    shift = round(delay_steps * fine)
    held = np.concatenate((np.zeros(shift), np.repeat(commands, fine)))[: 80 * fine]
    phi_input = np.append(held, 0.0)
    time = np.arange(80 * fine + 1) * DT / fine
    # lsim without interpolation holds the input over each fine step.
    _, achieved, _ = lsim((model.a, model.b, model.c, [[model.d]]), phi_input, time, interp=False)
    measured = np.array([m.table_acceleration for m in measurements])
    assert measured == pytest.approx(achieved[fine::fine], rel=1e-7, abs=1e-9)

    a, b, c = SPECIMEN.relative_motion()
    n_table = len(model.a)
    chain = np.block([[model.a, np.zeros((n_table, 4))], [b @ model.c, a]])
    chain_output = np.hstack((np.zeros((2, n_table)), c))
    _, floors, _ = lsim(
        (chain, np.vstack((model.b, b * model.d)), chain_output, np.zeros((2, 1))), phi_input, time, interp=False
    )
    measured_floors = np.array([m.floor_accelerations for m in measurements])
    assert measured_floors == pytest.approx(floors[fine::fine], rel=1e-7, abs=1e-9)
    shear = -floors[fine::fine] @ np.asarray(SPECIMEN.masses)
    assert [m.base_shear for m in measurements] == pytest.approx(shear, rel=1e-7, abs=1e-6)
    force = config.platen_mass * achieved[fine::fine] - shear
    assert [m.actuator_force for m in measurements] == pytest.approx(force, rel=1e-7, abs=1e-5)


def test_specimen_on_the_table_is_not_quite_its_model():
    config = SimulatedTableConfig(specimen_stiffness_factor=1.21, **QUIET)
    specimen = config.specimen(SPECIMEN)
    ours, model = specimen.modes(), SPECIMEN.modes()
    # Frequencies follow the root of the stiffness, damping ratios c / (2 sqrt(k m)).
    assert ours.frequencies == pytest.approx(1.1 * model.frequencies, rel=1e-12)
    assert ours.damping_ratios == pytest.approx(model.damping_ratios / 1.1, rel=1e-12)
    commands = np.random.default_rng(3).normal(size=50)
    floors = [m.floor_accelerations for m in drive(SimulatedTable(config, SPECIMEN, DT, seed=0), commands)]
    same = SimulatedTable(SimulatedTableConfig(**QUIET), specimen, DT, seed=0)
    assert np.array_equal(floors, [m.floor_accelerations for m in drive(same, commands)])


INTERACTING = {
    "dynamics": "interacting_servo",
    "servo_real_pole": 45.0,
    "servo_frequency": 140.0,
    "servo_damping_ratio": 0.1,
    "platen_mass": 3000.0,
}


def reaction_per_acceleration(specimen, s):
    """Force of the specimen on the table over its acceleration, from the equation of motion of the floors."""
    m, c, k = specimen.mass_matrix, specimen.damping_matrix, specimen.stiffness_matrix
    relative = np.linalg.solve(m * s**2 + c * s + k, -m @ np.ones(len(m)))
    return np.sum(m @ (1.0 + s**2 * relative))


def interacting_response(specimen, s):
    """Return the closed form: the cubic of the table alone, and M x'' = A P - reaction."""
    p, w, z, m = (INTERACTING[n] for n in ("servo_real_pole", "servo_frequency", "servo_damping_ratio", "platen_mass"))
    cubic = (s + p) * (s**2 + 2 * z * w * s + w**2)
    return p * w**2 / (cubic + s**2 * (s + p + 2 * z * w) * reaction_per_acceleration(specimen, s) / m)


def test_interacting_servo_has_the_closed_form_and_the_zeros_of_its_specimen():
    config = SimulatedTableConfig(**INTERACTING, specimen_stiffness_factor=1.1)
    specimen = config.specimen(SPECIMEN)
    omega = np.concatenate(([0.01], np.linspace(1.0, 400.0, 300)))
    expected = np.array([interacting_response(specimen, 1j * w) for w in omega])
    plant = config.plant(specimen)
    n = len(plant.a) - 2
    found = [plant.output[0, :n] @ np.linalg.solve(1j * w * np.eye(n) - plant.a[:n, :n], plant.b[:n, 0]) for w in omega]
    assert found == pytest.approx(expected, rel=1e-9)
    model = simulated_table(config, specimen)
    assert model.response(omega) == pytest.approx(expected, rel=1e-8)
    assert np.sort(np.abs(model.zeros)) == pytest.approx(np.repeat(specimen.modes().frequencies, 2), rel=1e-3)


def test_interacting_servo_without_weight_of_the_specimen_is_the_servo():
    """With a platen of 1e9 kg nothing pulls at it."""
    commands = np.random.default_rng(4).normal(size=200)
    heavy = SimulatedTable(SimulatedTableConfig(**{**INTERACTING, "platen_mass": 1e9}, **QUIET), SPECIMEN, DT, seed=0)
    servo = SimulatedTable(SimulatedTableConfig(**{**INTERACTING, "dynamics": "servo"}, **QUIET), SPECIMEN, DT, seed=0)
    for ours, theirs in zip(drive(heavy, commands), drive(servo, commands), strict=True):
        assert ours.table_acceleration == pytest.approx(theirs.table_acceleration, abs=2e-5)
        assert ours.floor_accelerations == pytest.approx(theirs.floor_accelerations, abs=2e-5)


def test_interacting_servo_moves_as_its_equations_of_motion_say():
    """Displacement, velocity, pressure and floors as states, driven by the twice integrated command, by scipy."""
    p, w, z, m = (INTERACTING[n] for n in ("servo_real_pole", "servo_frequency", "servo_damping_ratio", "platen_mass"))
    oil, leak = w**2 + 2 * z * w * p, p + 2 * z * w
    n = SPECIMEN.stories
    inverse = np.diag(1.0 / np.asarray(SPECIMEN.masses))
    k, c = inverse @ SPECIMEN.stiffness_matrix, inverse @ SPECIMEN.damping_matrix
    # States: reference and rate, table displacement and velocity, pressure per mass, floor displacements, velocities.
    a = np.zeros((5 + 2 * n, 5 + 2 * n))
    absolute = np.zeros((n, 5 + 2 * n))  # accelerations of the floors
    absolute[:, 5 : 5 + n], absolute[:, 5 + n :] = -k, -c
    absolute[:, 2], absolute[:, 3] = k.sum(axis=1), c.sum(axis=1)
    table = np.zeros(5 + 2 * n)
    table[4] = 1.0
    table -= np.asarray(SPECIMEN.masses) @ absolute / m
    a[0, 1] = a[2, 3] = 1.0
    a[3] = table
    a[4, 0], a[4, 2], a[4, 3], a[4, 4] = p * w**2, -p * w**2, -oil, -leak
    a[5 : 5 + n, 5 + n :] = np.eye(n)
    a[5 + n :] = absolute
    b = np.eye(5 + 2 * n)[:, [1]]
    displacement = np.eye(1, 5 + 2 * n, 2)
    outputs = np.vstack((table, absolute, displacement, m * table + np.asarray(SPECIMEN.masses) @ absolute))
    commands = np.random.default_rng(5).normal(size=150)
    held, time = np.append(np.repeat(commands, 10), 0.0), np.arange(1501) * DT / 10
    _, expected, _ = lsim((a, b, outputs, np.zeros((len(outputs), 1))), held, time, interp=False)
    measured = drive(SimulatedTable(SimulatedTableConfig(**INTERACTING, **QUIET), SPECIMEN, DT, seed=0), commands)
    found = [[r.table_acceleration, *r.floor_accelerations, r.table_displacement, r.actuator_force] for r in measured]
    assert np.array(found) == pytest.approx(expected[10::10], rel=1e-6, abs=1e-8)


@given(
    poles=st.tuples(st.floats(5.0, 300.0), st.floats(20.0, 500.0), st.floats(1e-3, 2.0)),
    platen_mass=st.floats(10.0, 1e5),
    specimen=st.tuples(st.floats(1e4, 1e8), st.floats(1e4, 1e8), st.floats(1.0, 1e4), st.floats(1.0, 1e4)),
)
def test_interacting_servo_is_stable_with_any_specimen(poles, platen_mass, specimen):
    names = ("servo_real_pole", "servo_frequency", "servo_damping_ratio")
    config = SimulatedTableConfig(**{**INTERACTING, "platen_mass": platen_mass, **dict(zip(names, poles, strict=True))})
    plant = config.plant(ShearBuilding(SPECIMEN.masses, specimen[:2], specimen[2:]))
    assert np.linalg.eigvals(plant.a[:-2, :-2]).real.max() < 0.0


def test_interacting_servo_needs_a_platen():
    with pytest.raises(InputError, match=r"simulated_table\.platen_mass: 0 kg; .*'interacting_servo' requires > 0 kg"):
        SimulatedTableConfig(**{**INTERACTING, "platen_mass": 0.0})


def test_perfect_table_follows_at_once_and_integrates_to_its_displacement():
    table = SimulatedTable(SimulatedTableConfig(dynamics="perfect", **QUIET), SPECIMEN, DT, seed=0)
    measurements = drive(table, [2.0] * 100)
    time = np.arange(1, 101) * DT
    assert [m.table_acceleration for m in measurements] == [2.0] * 100
    assert [m.table_displacement for m in measurements] == pytest.approx(time**2, rel=1e-12)


@pytest.mark.slow
def test_noise_has_the_stated_size_and_comes_from_the_seed():
    def rest(seed):
        table = SimulatedTable(SimulatedTableConfig(), SPECIMEN, DT, seed=seed)
        return np.array([[m.table_acceleration, *m.floor_accelerations] for m in drive(table, [0.0] * 20_000)])

    noise = rest(seed=4)
    # 20,000 samples know their standard deviation to 0.5 %; five times that is allowed.
    assert noise.std(axis=0) == pytest.approx([0.0524] * 3, rel=0.025)
    assert np.array_equal(noise, rest(seed=4))
    assert not np.array_equal(noise, rest(seed=5))


def test_connect_starts_again_from_rest_with_the_same_noise():
    table = SimulatedTable(SimulatedTableConfig(), SPECIMEN, DT, seed=1)
    commands = np.random.default_rng(0).normal(size=30)
    first = drive(table, commands)
    table.connect()
    second = drive(table, commands)
    assert [m[:6] for m in first] == [m[:6] for m in second]


def test_quantisation_rounds_to_the_resolution():
    config = SimulatedTableConfig(acceleration_resolution=0.01)
    table = SimulatedTable(config, SPECIMEN, DT, seed=0)
    values = np.array([m.floor_accelerations for m in drive(table, np.sin(np.arange(200) * 0.1))]) / 0.01
    assert values == pytest.approx(np.round(values), abs=1e-9)
    assert len(np.unique(np.round(values))) > 50


def test_lost_commands_are_simulated_with_the_last_command_held():
    config = SimulatedTableConfig()
    commands = [1.0, -0.5, -0.5, -0.5, 0.3]
    every = drive(SimulatedTable(config, SPECIMEN, DT, seed=3), commands)
    lossy = SimulatedTable(config, SPECIMEN, DT, seed=3)
    received = [lossy.exchange(TableCommand(k, commands[k])) for k in (0, 1, 4)]
    assert received[-1][:6] == every[-1][:6]
    assert np.array_equal(received[-1].floor_accelerations, every[-1].floor_accelerations)


def test_stopped_table_refuses_commands_and_old_steps_are_refused():
    table = SimulatedTable(SimulatedTableConfig(), SPECIMEN, DT, seed=0)
    drive(table, [0.0, 0.0])
    with pytest.raises(RuntimeError, match="step 2 is next"):
        table.exchange(TableCommand(1, 0.0))
    table.stop()
    with pytest.raises(RuntimeError, match="command of step 2 refused: the simulated table is stopped"):
        table.exchange(TableCommand(2, 0.0))


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ((1.0, 2.0), "2 coefficients; rows of six"),
        ((0.0, 0.0, 1.0, 0.0, 1.0, -5.0), "row 1: pole at s = 5 rad/s"),
        ((0.0, 0.0, 1.0, 1.0, -2.0, 100.0), "row 1: poles at s = "),
        ((1.0, 0.0, 1.0, 0.0, 1.0, 5.0), "improper or has no pole"),
        ((), "empty; dynamics 'sections' requires at least one row of six"),
    ],
)
def test_impossible_tables_are_refused(sections, message):
    with pytest.raises(InputError) as error:
        SimulatedTableConfig(dynamics="sections", sections=sections)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
