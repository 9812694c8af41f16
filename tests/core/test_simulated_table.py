"""Simulated table: transfer functions, exact discretisation, delay, sensors."""

import numpy as np
import pytest
from scipy.signal import freqs, lsim

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.dynamics import series, servo_sections
from bmd_rths_core.table.simulated import SimulatedTable, SimulatedTableConfig

DT = 0.005
SPECIMEN = Config().specimen.building()
QUIET = {"acceleration_noise": 0.0, "shear_noise": 0.0}
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
    force = 2500.0 * achieved[fine::fine] - shear
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


def test_perfect_table_follows_at_once_and_integrates_to_its_displacement():
    table = SimulatedTable(SimulatedTableConfig(dynamics="perfect", **QUIET), SPECIMEN, DT, seed=0)
    measurements = drive(table, [2.0] * 100)
    time = np.arange(1, 101) * DT
    assert [m.table_acceleration for m in measurements] == [2.0] * 100
    assert [m.table_displacement for m in measurements] == pytest.approx(time**2, rel=1e-12)


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
