"""Identification of the simulated table, sensor noise on: its own transfer function, its delay, honest coherence."""

from functools import cache
from pathlib import Path

import control
import numpy as np
import pytest

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.output import frequency_response_text, model_text
from bmd_rths_core.identification.spectral_lines import averaged_response, incoherent_bands
from bmd_rths_core.identification.table_model import identify_table
from bmd_rths_core.table.models.dynamics import SECTION_LENGTH, series
from tests.conftest import SERVO_TABLE
from tests.core.simulated_responses import simulated_responses

DT = 0.005
HZ = 2.0 * np.pi
BAND, DELAY_BAND = (0.5 * HZ, 25.0 * HZ), (0.5 * HZ, 8.0 * HZ)
LABORATORY = Config()
SERVO = LABORATORY.changed(**SERVO_TABLE)
EQUATION_9 = load_config(Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml")
TABLES = {"servo": SERVO, "interacting servo": LABORATORY, "Eq. 9": EQUATION_9}
TO_15_HZ = HZ * np.linspace(0.5, 15.0, 2000)


@cache
def driven(config, settings):
    return simulated_responses(config, excitation_command(settings, DT))


def identified(config, seed=0, order=None, **settings):
    responses = driven(config.changed(run__seed=seed), ExcitationSettings(seed=seed, **settings))
    return identify_table(responses, BAND, DELAY_BAND, order)


def true_response(config, omega):
    """Return the transfer function of a configured table by python-control."""
    table = config.simulated_table
    if table.dynamics == "interacting_servo":
        return interacting_response(config, omega)
    if table.dynamics == "servo":
        p, w, z = table.servo_real_pole, table.servo_frequency, table.servo_damping_ratio
        factors = [control.tf([p], [1.0, p]), control.tf([w**2], [1.0, 2.0 * z * w, w**2])]
    else:
        rows = np.reshape(table.sections, (-1, SECTION_LENGTH))
        factors = [control.tf(row[:3], row[3:]) for row in rows]
    responses = [control.frequency_response(factor, omega).complex for factor in factors]
    return np.prod(responses, axis=0) * np.exp(-1j * omega * table.command_delay)


def interacting_response(config, omega):
    """Return the table alone, and around it the force of the specimen that a platen moves against."""
    table, specimen = config.simulated_table, config.simulated_table.specimen(config.specimen.building())
    p, w, z = table.servo_real_pole, table.servo_frequency, table.servo_damping_ratio
    cubic = np.polymul([1.0, p], [1.0, 2.0 * z * w, w**2])
    a, b, c = specimen.relative_motion()
    reaction = control.ss(a, b, np.asarray(specimen.masses) @ c, 0.0)
    yielding = control.tf([1.0, p + 2.0 * z * w, 0.0, 0.0], table.platen_mass * cubic)
    alone, reaction, yielding = (
        control.frequency_response(part, omega).complex for part in (control.tf([p * w**2], cubic), reaction, yielding)
    )
    return alone / (1.0 + yielding * reaction)


def sections_response(model, omega):
    space = series(model.sections)
    identity = np.eye(len(space.a))
    resolvents = np.linalg.solve(1j * omega[:, None, None] * identity - space.a, space.b)
    return ((space.c @ resolvents)[:, 0, 0] + space.d) * np.exp(-1j * omega * model.rational.delay)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "order", "degree"), [("servo", 3, 0), ("interacting servo", 7, 4), ("Eq. 9", 9, 4)])
def test_own_transfer_function_is_recovered_to_15_hz(name, order, degree, seed):
    config = TABLES[name]
    model = identified(config, seed)
    ratio = sections_response(model, TO_15_HZ) / true_response(config, TO_15_HZ)
    assert np.abs(np.abs(ratio) - 1.0).max() < 0.02
    assert np.abs(np.angle(ratio, deg=True)).max() < 2.0
    assert (model.rational.order, model.rational.degree, model.rational.delay) == (order, degree, 0.0)
    assert model.residual == pytest.approx(1.0, abs=0.1)
    assert model.fit_error < 0.01
    assert min(model.criterion, key=model.criterion.get) == order


@pytest.mark.slow
def test_delay_of_equation_9_is_the_one_checked_from_the_paper():
    delay = identified(EQUATION_9, order=9).delay
    assert 26.9e-3 < delay.smallest < delay.seconds < delay.largest < 27.4e-3
    assert delay.steps == pytest.approx(delay.seconds / DT)


def test_delay_is_the_slope_of_the_phase():
    """A weighted fit of python-control's phase, through the origin."""
    model = identified(SERVO, order=3)
    band = model.measured.between(*DELAY_BAND)
    grid = np.linspace(1e-3, DELAY_BAND[1], 5000)
    phase = np.interp(band.frequencies, grid, np.unwrap(np.angle(true_response(SERVO, grid))))
    weight = np.sqrt(band.coherence[:, 0])
    slope = np.linalg.lstsq((weight * band.frequencies)[:, None], weight * phase, rcond=None)[0][0]
    assert model.delay.seconds == pytest.approx(-slope, abs=2e-5)


def test_pure_delay_spares_order():
    config = SERVO.changed(simulated_table__command_delay=0.0123)
    model = identified(config, duration=120.0)
    assert (model.rational.order, model.rational.degree) == (3, 0)
    assert model.rational.delay == pytest.approx(0.0123, abs=1e-4)
    assert sections_response(model, TO_15_HZ) == pytest.approx(true_response(config, TO_15_HZ), rel=0.01)


def test_pole_far_below_the_band_is_left_out_with_its_zero():
    """Zero and pole at 0.008 and 0.03 Hz lead by 5 degrees at the lowest line, which a fit notices."""
    slow = (0.0, 1.0, -0.05, 0.0, 1.0, 0.2)
    sections = (0.0, 0.0, 60.0, 0.0, 1.0, 60.0, *slow)
    config = Config().changed(
        simulated_table__dynamics="sections", simulated_table__sections=sections, simulated_table__command_delay=0.0
    )
    asked, chosen = identified(config, order=2, duration=120.0), identified(config, duration=120.0)
    assert np.abs(asked.rational.poles).min() < 0.1 * BAND[0]
    assert np.abs(chosen.rational.poles).min() > 0.1 * BAND[0]
    assert np.abs(sections_response(chosen, TO_15_HZ[100:]) / true_response(config, TO_15_HZ[100:]) - 1).max() < 0.1
    assert sections_response(chosen, np.array([1e-3]))[0].real == pytest.approx(1.0, abs=0.05)
    assert sections_response(asked, np.array([1e-3]))[0].real < 0.0


def test_sweep_identifies_too():
    model = identified(SERVO, kind="sweep", amplitude=0.4, order=3)
    assert sections_response(model, TO_15_HZ) == pytest.approx(true_response(SERVO, TO_15_HZ), rel=0.02)


def test_identified_table_moves_like_the_original():
    config = SERVO.changed(simulated_table__command_delay=0.0062)
    parameters = identified(config, duration=120.0).parameters()
    changes = {f"simulated_table__{key}": value for key, value in parameters["simulated_table"].items()}
    quiet = {"simulated_table__acceleration_noise": 0.0}
    other = ExcitationSettings(seed=99, duration=30.0)
    original, model = driven(config.changed(**quiet), other), driven(config.changed(**changes, **quiet), other)
    assert np.std(model.table - original.table) < 0.01 * np.std(original.table)
    assert np.std(model.floors - original.floors) < 0.01 * np.std(original.floors)


def test_coherence_is_what_noise_and_response_make_it():
    """Closed form γ² = S_y / (S_y + S_n): Eq. 9 falls to 25 Hz, and the noise is white to the Nyquist frequency."""
    settings = ExcitationSettings(amplitude=0.06)
    responses = driven(EQUATION_9, settings)
    measured = averaged_response(responses.command, responses.table[:, None], DT, BAND)
    spectrum = np.mean(responses.command**2) / ((BAND[1] - BAND[0]) / HZ)
    inner = measured.between(1.0 * HZ, 24.0 * HZ)
    noise = 0.0524**2 / (0.5 / DT)
    power = np.abs(true_response(EQUATION_9, inner.frequencies)) ** 2 * spectrum
    expected = power / (power + noise)
    assert expected.min() < 0.45
    # An estimate from n averages is too high by about (1 − γ²)² / n.
    expected += (1.0 - expected) ** 2 / 20.0
    assert inner.coherence[:, 0].mean() == pytest.approx(expected.mean(), abs=0.02)
    for coherence, low in zip(np.array_split(inner.coherence[:, 0], 23), np.array_split(expected, 23), strict=True):
        assert coherence.mean() == pytest.approx(low.mean(), abs=0.08)
    bands = incoherent_bands(measured)
    for frequency in inner.frequencies[expected < 0.45]:
        assert any(lowest <= frequency <= highest for lowest, highest in bands)


def test_too_little_coherence_is_refused_with_the_share_that_is_coherent():
    responses = driven(EQUATION_9, ExcitationSettings(amplitude=0.05, duration=60.0))
    with pytest.raises(InputError, match=r"only \d+ % of the band has a coherence of 0.8") as error:
        identify_table(responses, BAND, DELAY_BAND)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("band", "delay_band", "order", "expected"),
    [
        (BAND, DELAY_BAND, 0, "order: 0"),
        (BAND, DELAY_BAND, 13, "<= 12"),
        (BAND, (30.0 * HZ, 40.0 * HZ), 3, "no line was measured from 30 to 40 Hz"),
        ((5.0 * HZ, 5.2 * HZ), DELAY_BAND, 3, "frequencies of the band 5 to 5.2 Hz"),
    ],
)
def test_wrong_request_is_refused_in_one_line(band, delay_band, order, expected):
    responses = driven(SERVO, ExcitationSettings(duration=30.0))
    with pytest.raises(InputError, match=expected):
        identify_table(responses, band, delay_band, order)


def test_reversed_polarity_is_refused():
    row = (0.0, 0.0, -50.0, 0.0, 1.0, 50.0)
    config = SERVO.changed(simulated_table__dynamics="sections", simulated_table__sections=list(row))
    with pytest.raises(InputError, match="moves against its command"):
        identify_table(driven(config, ExcitationSettings(duration=30.0)), BAND, DELAY_BAND, order=1)


@pytest.mark.slow
def test_model_file_is_merged_over_a_configuration(tmp_path):
    model = identified(EQUATION_9, order=9, duration=120.0)
    path = tmp_path / "model.yaml"
    path.write_text(model_text(model.parameters(), ["two", "remarks"]))
    assert path.read_text().startswith("# two\n# remarks\n/**:\n")
    merged = SERVO.merged(path)
    assert merged.simulated_table.dynamics == "sections"
    assert merged.simulated_table.sections == model.sections
    assert merged.command_shaper.lead_time == pytest.approx(model.delay.seconds, abs=5e-7)
    assert merged.simulated_table.acceleration_noise == SERVO.simulated_table.acceleration_noise
    assert merged.specimen == SERVO.specimen


def test_frequency_response_text_has_the_measured_values():
    measured = identified(SERVO, order=3, duration=60.0).measured
    head, *rows = frequency_response_text(measured).splitlines()
    assert head == "frequency_hz,magnitude,phase_deg,coherence"
    table = np.array([[float(value) for value in row.split(",")] for row in rows])
    assert table[:, 0] * HZ == pytest.approx(measured.frequencies)
    response = table[:, 1] * np.exp(1j * np.radians(table[:, 2]))
    assert response == pytest.approx(measured.response[:, 0], rel=1e-6)
    assert np.abs(np.diff(table[:, 2])).max() < 90.0
    assert table[:, 3] == pytest.approx(measured.coherence[:, 0])
