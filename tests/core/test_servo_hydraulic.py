"""Servo-hydraulic table: against the equations in physical units by another integrator, and against Eq. 9."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.models import EQUATION_9
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.sensors import Sensors
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicConfig, ServoHydraulicTable

DT = 0.005
SPECIMEN = Config().specimen.building()
EIGHT_STORY = load_config(Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml")


def quiet(floors=2):
    return Sensors(
        floors,
        acceleration_noise=0.0,
        acceleration_resolution=0.0,
        shear_noise=0.0,
        displacement_noise=0.0,
        force_noise=0.0,
        seed=0,
    )


def make(specimen=SPECIMEN, time_step=DT, **changes):
    return ServoHydraulicTable(ServoHydraulicConfig(**changes), quiet(specimen.stories), specimen, time_step)


def drive(table, commands):
    return [table.exchange(TableCommand(k, a)) for k, a in enumerate(commands)]


def pseudo_random(steps, scale):
    """Band-limited commands that begin and end at zero."""
    time = np.arange(steps) * DT
    random = np.random.default_rng(5)
    waves = sum(np.sin(2 * np.pi * f * time + random.uniform(0, 2 * np.pi)) for f in (0.7, 1.9, 4.3, 7.1, 11.0))
    return scale * waves * np.sin(np.pi * time / time[-1]) ** 2


class Physical:
    """The same table in Pa, m³/s and N, written down from the equations and not from the code."""

    def __init__(self, config, supply=1.0, valve=1.0):
        self.c, self.supply, self.valve = config, supply * config.supply_pressure, valve
        self.area = config.force_capacity / config.supply_pressure

    def rates(self, _, state, command):
        c = self.c
        xr, vr, error, x, v, pressure, opening, opening_rate, u1, u2, du1, du2 = state
        wanted = (
            c.proportional_gain * (xr - x)
            + c.integral_gain * error
            + c.velocity_feedforward * vr
            - c.pressure_feedback * self.area * pressure / c.platen_mass
        ) / c.rated_velocity
        wanted = np.clip(wanted, -self.valve, self.valve)
        rated_flow = self.area * c.rated_velocity
        flow = rated_flow * opening * np.sqrt(max(0.0, self.supply - np.sign(opening) * pressure) / c.supply_pressure)
        stiffness = 4.0 * c.bulk_modulus / c.oil_volume
        excess = max(0.0, abs(pressure) - c.supply_pressure) * np.sign(pressure)
        pressure_rate = stiffness * (flow - self.area * v - c.leakage * pressure) - excess / 1e-3
        (m1, m2), (k1, k2), (c1, c2) = SPECIMEN.masses, SPECIMEN.stiffnesses, SPECIMEN.damping_coefficients
        lower, upper = k1 * u1 + c1 * du1, k2 * (u2 - u1) + c2 * (du2 - du1)
        beyond = max(0.0, abs(x) - c.stroke)
        stop = -c.platen_mass * (2e5 * beyond * np.sign(x) + 200.0 * v) if beyond else 0.0
        friction = c.coulomb_friction * np.tanh(v / 2e-3)
        a = (self.area * pressure - c.viscous_damping * v - friction + stop + lower) / c.platen_mass
        w = c.washout_frequency
        return [
            vr,
            command - 1.4 * w * vr - w**2 * xr,
            xr - x,
            v,
            a,
            pressure_rate,
            opening_rate,
            c.valve_frequency**2 * (wanted - opening) - 2 * c.valve_damping_ratio * c.valve_frequency * opening_rate,
            du1,
            du2,
            (upper - lower) / m1 - a,
            -upper / m2 - a,
        ]

    def run(self, commands):
        """Return displacement, table acceleration and actuator force at the end of every step."""
        state, rows = np.zeros(12), []
        for command in commands:
            solution = solve_ivp(
                self.rates, (0.0, DT), state, args=(command,), method="RK45", rtol=1e-8, atol=1e-12, max_step=5e-4
            )
            state = solution.y[:, -1]
            rows.append((state[3], self.rates(0.0, state, command)[4], self.area * state[5]))
        return np.array(rows)


def measured(table, commands):
    return np.array([(m.table_displacement, m.table_acceleration, m.actuator_force) for m in drive(table, commands)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "degraded"),
    [(0.1, (1.0, 1.0)), (3.0, (1.0, 1.0)), (1.0, (0.05, 1.0)), (1.0, (1.0, 0.02))],
    ids=["small", "large", "valve saturates", "little pressure"],
)
def test_motion_agrees_with_the_physical_equations_and_another_integrator(scale, degraded):
    commands = pseudo_random(160, scale)
    valve, supply = degraded
    table = make()
    table.degrade(valve, supply)
    expected = Physical(ServoHydraulicConfig(), supply, valve).run(commands)
    scale_of = np.abs(Physical(ServoHydraulicConfig()).run(commands)).max(axis=0)
    assert measured(table, commands) / scale_of == pytest.approx(expected / scale_of, abs=2e-3)


def test_without_pressure_the_table_does_not_move():
    table = make()
    table.degrade(1.0, 0.0)
    commands = pseudo_random(100, 1.0)
    usual = np.abs(measured(make(), commands)[:, 0]).max()
    assert np.abs(measured(table, commands)[:, 0]).max() < 1e-3 * usual


@pytest.mark.slow
def test_end_stop_holds_the_table_near_the_stroke():
    commands = np.full(200, 0.3)
    expected = Physical(ServoHydraulicConfig(stroke=0.01)).run(commands)
    found = measured(make(stroke=0.01), commands)
    assert found[:, 0] == pytest.approx(expected[:, 0], abs=2e-5)
    assert 0.01 < found[:, 0].max() < 0.02


def test_a_tenth_of_the_substep_changes_the_motion_by_less_than_a_thousandth(monkeypatch):
    commands = pseudo_random(200, 0.2)
    usual = measured(make(), commands)
    monkeypatch.setattr("bmd_rths_core.table.models.servo_hydraulic.LONGEST_SUBSTEP", 0.5e-4)
    fine = measured(make(), commands)
    assert usual / np.abs(fine).max(axis=0) == pytest.approx(fine / np.abs(fine).max(axis=0), abs=1e-3)


def test_force_saturates_at_the_capacity_of_the_actuator():
    """An actuator that is too weak gives what it has and no more, within what the relief valves let through."""
    commands = pseudo_random(200, 0.3)
    strong = np.abs(measured(make(), commands)[:, 2]).max()
    usual = ServoHydraulicConfig()
    pressure = usual.supply_pressure * 0.5 * strong / usual.force_capacity
    weak = np.abs(measured(make(force_capacity=0.5 * strong, supply_pressure=pressure), commands)[:, 2]).max()
    assert 0.45 * strong < weak < 0.6 * strong


def test_table_at_rest_stays_exactly_at_rest():
    for m in drive(make(), [0.0] * 400):
        assert (m.table_displacement, m.table_acceleration, m.actuator_force, m.base_shear) == (0.0, 0.0, 0.0, 0.0)
        assert not m.floor_accelerations.any()


def test_table_comes_back_to_zero_after_a_pulse_with_an_offset():
    commands = np.concatenate((np.full(20, 0.5), np.zeros(3_000)))
    table = make(washout_frequency=2.0)
    displacements = [m.table_displacement for m in drive(table, commands)]
    assert max(displacements) > 0.005
    assert abs(displacements[-1]) < 1e-4
    assert abs(table.reference[0]) < 1e-9


@pytest.mark.parametrize("frequency", [1.0, 5.0, 9.0])
def test_linearised_response_is_that_of_a_small_sine(frequency):
    """Without Coulomb friction, which has no linearisation at rest."""
    table = make(coulomb_friction=0.0, time_step=1e-3)
    omega = 2.0 * np.pi * frequency
    time = np.arange(8_000) * 1e-3
    accelerations = np.array([m.table_acceleration for m in drive(table, 0.01 * np.cos(omega * time))])
    whole = round(5.0 * frequency) / frequency
    late = time > time[-1] - whole
    ratio = 2.0 * np.mean(accelerations[late] * np.exp(-1j * omega * (time[late] + 1e-3))) / 0.01
    held = np.sinc(frequency * 1e-3) * np.exp(-0.5j * omega * 1e-3)
    expected = table.frequency_response(np.array([omega]))[0] * held
    assert ratio == pytest.approx(expected, rel=0.01)


def equation_9(omega):
    response = np.ones(len(omega), dtype=complex)
    for row in np.reshape(EQUATION_9, (-1, 6)):
        response *= np.polyval(row[:3], 1j * omega) / np.polyval(row[3:], 1j * omega)
    return response


def gain_and_delay(response, omega):
    return np.abs(response), -np.unwrap(np.angle(response)) / omega


def test_eight_story_table_is_that_of_equation_9_away_from_the_modes_of_the_specimen():
    frequency = np.linspace(0.5, 15.0, 600)
    omega = 2.0 * np.pi * frequency
    specimen = EIGHT_STORY.specimen.building()
    table = ServoHydraulicTable(EIGHT_STORY.servo_hydraulic, quiet(specimen.stories), specimen, DT)
    gain, delay = gain_and_delay(table.frequency_response(omega), omega)
    paper_gain, paper_delay = gain_and_delay(equation_9(omega), omega)
    away = (frequency >= 1.0) & (np.abs(frequency - 9.1) > 1.0) & (np.abs(frequency - 3.05) > 0.3)
    assert gain[away] == pytest.approx(paper_gain[away], rel=0.1)
    assert delay[away] == pytest.approx(paper_delay[away], abs=2.5e-3)
    assert delay[away & (frequency < 8.0)] == pytest.approx(27e-3, abs=2.5e-3)


def test_specimen_acts_back_on_the_table():
    """At a fixed-base frequency of the specimen the table hardly moves, just below it moves more than it should."""
    frequency = np.linspace(4.0, 8.0, 800)
    omega = 2.0 * np.pi * frequency
    gain = np.abs(make().frequency_response(omega))
    light = replace(SPECIMEN, masses=(0.1, 0.1), stiffnesses=(330.0, 618.0), damping_coefficients=(0.4, 0.01))
    smooth = np.abs(make(specimen=light).frequency_response(omega))
    first_mode = SPECIMEN.modes().frequencies[0] / (2.0 * np.pi)
    assert abs(frequency[np.argmin(gain / smooth)] - first_mode) < 0.15
    assert (gain / smooth).min() < 0.8
    assert (gain / smooth).max() > 1.05


def test_skipped_steps_hold_the_last_command_and_old_ones_are_refused():
    commands = [0.5, -0.2, -0.2, -0.2, 0.1]
    every = drive(make(), commands)
    table = make()
    received = [table.exchange(TableCommand(k, commands[k])) for k in (0, 1, 4)]
    assert received[-1][:6] == every[-1][:6]
    with pytest.raises(RuntimeError, match="step 5 is next"):
        table.exchange(TableCommand(3, 0.0))
    table.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        table.exchange(TableCommand(5, 0.0))
    table.connect()
    assert table.exchange(TableCommand(0, 0.0)).table_displacement == 0.0


def test_impossible_hydraulics_are_refused():
    with pytest.raises(InputError, match=r"servo_hydraulic\.bulk_modulus: 0\.0 is not allowed; >= 10000000 Pa and"):
        ServoHydraulicConfig(bulk_modulus=0.0)
