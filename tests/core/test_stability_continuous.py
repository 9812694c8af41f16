"""Frequency-domain margin: models against the equations of motion, encirclements counted the slow way, hard cases."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bmd_rths_core.compensators.phase_lead import CommandShaperConfig
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.analysed_loops import AnalysisOptions, complete_loop
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, LoopTransferFunction
from bmd_rths_core.stability.loop_elements import Delay, DiscreteCompensator, MeasuredResponse, Rational
from bmd_rths_core.stability.models import (
    EQUATION_9,
    IdentifiedMode,
    experimental_building,
    experimental_modes,
    first_effective_mass,
    numerical_building,
    numerical_oscillator,
    phase_lead_compensator,
    table_sections,
    uncoupled_modes,
)
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.dynamics import servo_sections

DT = 0.005
OMEGA = np.geomspace(0.1, 2000.0, 60)
FIVE_STORIES = ShearBuilding(
    (900.0, 700.0, 800.0, 500.0, 650.0), (4e6, 3e6, 2e6, 5e6, 1e6), (900.0, 0.0, 4000.0, 100.0, 20.0)
)
ONE_MODE = experimental_modes([IdentifiedMode(17.72, 0.028)])
PLC = phase_lead_compensator(CommandShaperConfig(2.0, 2.0, 5.0 * DT), DT)

frequencies = st.floats(3.0, 200.0)
damping_ratios = st.floats(0.002, 0.2)


def unstable_poles(loop, mass_ratio, highest=20000.0):
    """Count the encirclements of −1 by following the angle of 1 + L, over a grid of turns below 0.5 rad."""
    fine = [np.linspace(1e-3, 500.0, 20001), np.geomspace(500.0, highest, 4001)]
    for pole in np.concatenate([element.poles.ravel() for element in (loop.numerical, loop.experimental)]):
        # Equal turns of the circle that a light mode traces, of any width.
        fine.append(np.abs(pole.imag + pole.real * np.tan(np.linspace(-1.57, 1.57, 2001))))
    omega, wide = np.sort(np.concatenate(fine)), np.zeros(0, dtype=int)
    while True:
        omega = np.insert(omega, wide + 1, 0.5 * (omega[wide] + omega[wide + 1]))
        values = 1.0 + loop.response(omega, mass_ratio)
        turns = np.angle(values[1:] / values[:-1])
        wide = np.flatnonzero(np.abs(turns) > 0.5)
        if not len(wide):
            return -2 * round(np.sum(turns) / (2 * np.pi))


def assert_intervals(loop, margin):
    """Just inside every stable interval there is no unstable pole, just outside there are some."""
    for interval in margin.stable_intervals:
        width = interval.upper - interval.lower
        for inside in (interval.lower + 0.02 * width, interval.lower + 0.98 * width):
            assert unstable_poles(loop, inside) == 0
        if interval.upper < LARGEST_MASS_RATIO:
            assert unstable_poles(loop, interval.upper + 0.02 * min(width, 1.0 - interval.upper)) > 0


@pytest.mark.parametrize("damper", [900.0, 0.0])
def test_experimental_building_is_the_equation_of_motion(damper):
    building = ShearBuilding(
        FIVE_STORIES.masses, FIVE_STORIES.stiffnesses, (damper, *FIVE_STORIES.damping_coefficients[1:])
    )
    a, b, c = building.relative_motion()
    shear = [-np.asarray(building.masses) @ c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b) for w in OMEGA]
    expected = -np.array(shear)[:, 0] / first_effective_mass(building)
    assert experimental_building(building).response(OMEGA) == pytest.approx(expected, rel=1e-9)


def test_numerical_building_is_the_equation_of_motion():
    m, c, k = FIVE_STORIES.mass_matrix, FIVE_STORIES.damping_matrix, FIVE_STORIES.stiffness_matrix
    flexibility = [np.linalg.inv(k - w**2 * m + 1j * w * c)[-1, -1] for w in OMEGA]
    expected = np.array(flexibility) * first_effective_mass(FIVE_STORIES)
    assert numerical_building(FIVE_STORIES).response(OMEGA) == pytest.approx(expected, rel=1e-9)


def test_one_story_is_an_oscillator():
    building = ShearBuilding((8000.0,), (8000.0 * 94.09**2,), (2 * 0.0167 * 94.09 * 8000.0,))
    oscillator = numerical_oscillator(94.09, 0.0167)
    assert numerical_building(building).response(OMEGA) == pytest.approx(oscillator.response(OMEGA), rel=1e-12)
    mode = experimental_modes([IdentifiedMode(94.09, 0.0167, 8000.0)])
    assert experimental_building(building).response(OMEGA) == pytest.approx(mode.response(OMEGA), rel=1e-12)


@given(frequencies, st.floats(1.0, 20.0))
def test_overdamped_oscillator_keeps_its_slow_pole(frequency, damping_ratio):
    s = 1j * OMEGA
    expected = 1.0 / (s**2 + 2 * damping_ratio * frequency * s + frequency**2)
    assert numerical_oscillator(frequency, damping_ratio).response(OMEGA) == pytest.approx(expected, rel=1e-9)


@given(st.lists(st.tuples(frequencies, damping_ratios, st.floats(0.01, 2.0)), min_size=1, max_size=5))
def test_identified_modes_are_their_sum(modes):
    s = 1j * OMEGA
    terms = (m * (2 * z * w * s + w**2) / (s**2 + 2 * z * w * s + w**2) for w, z, m in modes)
    response = experimental_modes([IdentifiedMode(*mode) for mode in modes]).response(OMEGA)
    expected = sum(terms) / modes[0][2]
    assert np.abs(response - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(
    "element",
    [
        experimental_building(FIVE_STORIES),
        table_sections(EQUATION_9),
        Delay(0.013),
        PLC,
        DiscreteCompensator([2.0, -5.0, 4.0], [1.0, 0.2, 0.1], DT),
        DiscreteCompensator([1.0, -1.0], [1.0, -0.99, 0.0], DT),
        MeasuredResponse(np.array([1.0, 5.0, 2000.0]), np.array([1.0, 0.5 - 0.2j, -0.1 + 0.1j])),
    ],
    ids=["building", "Eq. 9", "delay", "PLC", "lead outside", "lag", "measured"],
)
def test_phase_variation_bounds_the_phase(element):
    omega = np.linspace(0.0, 2000.0, 200001)
    value = element.response(omega)
    value = np.where(value == 0.0, 1e-300, value)
    turned = np.cumsum(np.abs(np.angle(value[2:] / value[1:-1])))
    bound = element.phase_variation(omega[2:]) - element.phase_variation(omega[1:2])
    assert (turned <= bound + 1e-6).all()


def test_gain_bounds_hold():
    omega = np.geomspace(1.0, 1e5, 4001)
    for element in (experimental_building(FIVE_STORIES), table_sections(EQUATION_9), PLC, Delay(0.1), table_sections()):
        gain = np.abs(element.response(omega))
        assert all((gain[i:].max() <= element.gain_bound(omega[i]) * (1 + 1e-12)) for i in range(0, 4001, 50))


@pytest.mark.parametrize("scheme", ["uc", "plc"])
def test_loop_of_a_configuration(scheme):
    config = Config().changed(run__scheme=scheme, simulated_table__command_delay=0.003)
    loop = complete_loop(config, AnalysisOptions())
    assert loop.feedback_delay == pytest.approx(0.008)
    assert (loop.compensator is not None) == (scheme == "plc")
    assert_intervals(loop, loop.margin())


def test_loop_without_delay_is_stable_at_every_mass_ratio():
    margin = LoopTransferFunction(numerical_oscillator(35.43, 0.02), ONE_MODE).margin()
    assert margin.allowable_mass_ratio == 1.0
    assert np.isnan(margin.critical_frequency)


def test_critical_frequency_and_ratio_close_the_loop_exactly():
    loop = LoopTransferFunction(numerical_oscillator(35.43, 0.02), ONE_MODE, table_sections(EQUATION_9), PLC, DT)
    margin = loop.margin()
    assert loop.response(margin.critical_frequency, margin.allowable_mass_ratio) == pytest.approx(-1.0, abs=1e-11)


def test_critical_point_solves_the_characteristic_equation_of_the_paper():
    """1 + G_af^N G_fa^E G_s = 0 with the masses in it, written out for one mode and a delay (Eqs. 4 to 7)."""
    m_e, w_n, z_n, w_e, z_e, tau = 1535.0, 94.09, 0.0167, 37.31, 0.0214, 0.025
    specimen = experimental_modes([IdentifiedMode(w_e, z_e, m_e)])
    margin = LoopTransferFunction(numerical_oscillator(w_n, z_n), specimen, Delay(tau)).margin()
    m_n = m_e * (1.0 - margin.allowable_mass_ratio) / margin.allowable_mass_ratio
    s = 1j * margin.critical_frequency
    g_n = s**2 / (m_n * (s**2 + 2 * z_n * w_n * s + w_n**2))
    g_e = m_e * (2 * z_e * w_e * s + w_e**2) / (s**2 + 2 * z_e * w_e * s + w_e**2)
    assert 1.0 + g_n * g_e * np.exp(-s * tau) == pytest.approx(0.0, abs=1e-11)


def test_conditionally_stable_loop_has_all_its_intervals():
    """Too much lead for the delay: unstable from 0.27 on, and stable once more from 0.66 to 0.72."""
    loop = LoopTransferFunction(
        numerical_oscillator(22.587, 0.0296),
        experimental_modes([IdentifiedMode(8.362, 0.029), IdentifiedMode(24.468, 0.01115, 0.3674)]),
        table_sections(servo_sections(191.7, 183.6, 0.3)),
        phase_lead_compensator(CommandShaperConfig(2.0, 2.0, 5.422 * DT), DT),
        0.0018939,
    )
    margin = loop.margin()
    assert len(margin.stable_intervals) == 2
    assert margin.allowable_mass_ratio == margin.stable_intervals[0].upper < margin.stable_intervals[1].lower
    assert_intervals(loop, margin)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    frequencies,
    damping_ratios,
    st.lists(st.tuples(frequencies, damping_ratios, st.floats(0.05, 2.0)), min_size=1, max_size=3),
    st.floats(0.0, 9.0).map(lambda alpha: round(alpha, 9)),
    st.floats(0.0, 0.04),
    st.floats(20.0, 400.0),
)
def test_intervals_with_compensator_agree_with_counted_encirclements(frequency, zeta, modes, alpha, delay, pole):
    loop = LoopTransferFunction(
        numerical_oscillator(frequency, zeta),
        experimental_modes([IdentifiedMode(*mode) for mode in modes]),
        table_sections(servo_sections(pole, 183.6, 0.3)),
        phase_lead_compensator(CommandShaperConfig(2.0, 2.0, alpha * DT), DT),
        delay,
    )
    margin = loop.margin()
    for interval in margin.stable_intervals:
        if interval.upper - interval.lower > 0.01:
            assert unstable_poles(loop, 0.5 * (interval.lower + interval.upper)) == 0
    ends = [0.0, *(end for i in margin.stable_intervals for end in i[:2]), LARGEST_MASS_RATIO]
    for lower, upper in zip(ends[2::2], ends[3::2], strict=False):
        if upper - lower > 0.01:
            assert unstable_poles(loop, 0.5 * (lower + upper)) > 0


@pytest.mark.parametrize("damping_ratio", [1e-2, 1e-4, 1e-6, 1e-8])
def test_no_mode_is_too_lightly_damped_to_be_seen(damping_ratio):
    """A second mode as narrow as it likes still crosses: its margin falls in proportion to its damping."""
    modes = [IdentifiedMode(20.0, 0.03), IdentifiedMode(71.3, damping_ratio, 1e-2)]
    loop = LoopTransferFunction(numerical_oscillator(40.0, 0.02), experimental_modes(modes), Delay(0.02))
    margin = loop.margin()
    s, w = 1j * 71.3, 71.3
    rest = s**2 / (s**2 + 2 * 0.02 * 40.0 * s + 1600.0) * np.exp(-s * 0.02)
    # Near the resonance L traces a circle through 0; a diameter in direction of rest · (−j) decides.
    diameter = 1e-2 / (2 * damping_ratio) * (-1j) * rest
    crossing = -(abs(diameter) ** 2) / diameter.real if diameter.real < 0 else np.inf
    if damping_ratio <= 1e-6:
        assert margin.critical_frequency == pytest.approx(w, rel=1e-3)
        ratio = margin.allowable_mass_ratio / (1.0 - margin.allowable_mass_ratio)
        assert ratio == pytest.approx(abs(crossing) / abs(diameter) ** 2, rel=0.02)
    assert loop.response(margin.critical_frequency, margin.allowable_mass_ratio) == pytest.approx(-1.0, abs=1e-6)


def test_undamped_upper_story_puts_zeros_on_the_axis():
    specimen = ShearBuilding((760.0, 800.0), (2495320.0, 4941700.0), (3330.0, 0.0))
    loop = LoopTransferFunction(numerical_oscillator(94.09, 0.0167), experimental_building(specimen), Delay(0.025))
    nearly = ShearBuilding((760.0, 800.0), (2495320.0, 4941700.0), (3330.0, 1e-6))
    other = LoopTransferFunction(numerical_oscillator(94.09, 0.0167), experimental_building(nearly), Delay(0.025))
    assert loop.margin().allowable_mass_ratio == pytest.approx(other.margin().allowable_mass_ratio, rel=1e-6)


def test_measured_table_gives_the_margin_of_the_table_that_was_measured():
    omega = np.linspace(0.05, 400.0, 16000)
    table = table_sections(EQUATION_9)
    measured = MeasuredResponse(omega, table.response(omega))
    for compensator in (None, PLC):
        known, from_data = (
            LoopTransferFunction(numerical_oscillator(35.43, 0.02), ONE_MODE, model, compensator).margin()
            for model in (table, measured)
        )
        assert from_data.allowable_mass_ratio == pytest.approx(known.allowable_mass_ratio, rel=1e-5)
        assert from_data.critical_frequency == pytest.approx(known.critical_frequency, rel=1e-6)


def test_loop_is_examined_up_to_the_last_frequency_of_the_data_and_no_further():
    """The data end a little above or below the frequency at which the loop with the true table becomes unstable."""
    numerical, experimental, table = (
        numerical_oscillator(94.09, 0.0167),
        ONE_MODE,
        Delay(0.025),
    )
    true = LoopTransferFunction(numerical, experimental, table).margin()

    def measured_up_to(highest):
        omega = np.linspace(0.1, highest, 2000)
        return LoopTransferFunction(numerical, experimental, MeasuredResponse(omega, table.response(omega))).margin()

    above, below = (measured_up_to(share * true.critical_frequency) for share in (1.02, 0.98))
    assert above.allowable_mass_ratio == pytest.approx(true.allowable_mass_ratio, rel=1e-3)
    assert below.allowable_mass_ratio > true.allowable_mass_ratio
    assert not below.critical_frequency > 0.98 * true.critical_frequency


def test_uncoupled_modes_need_damping():
    with pytest.raises(InputError, match=r"damping_ratio 0 is not allowed"):
        uncoupled_modes(ShearBuilding((1.0,), (1.0,), (0.0,)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: numerical_oscillator(35.0, 0.0), "frequencies and damping ratios > 0"),
        (lambda: IdentifiedMode(-1.0, 0.02), "frequency -1 is not allowed"),
        (lambda: experimental_modes([]), "at least one mode"),
        (lambda: experimental_building(ShearBuilding((1.0,), (1.0,), (0.0,))), "open left half-plane"),
        (lambda: Delay(-0.1), "-0.1 is not allowed"),
        (lambda: DiscreteCompensator([1.0], [1.0, -1.0], DT), "pole of modulus 1"),
        (lambda: DiscreteCompensator([1.0, 0.0], [1.0], DT), "higher order"),
        (lambda: table_sections((0.0, 0.0, 0.0, 0.0, 1.0, 5.0)), "numerator is 0"),
        (lambda: MeasuredResponse(np.array([2.0, 1.0]), np.ones(2, complex)), "increasing frequencies"),
        (lambda: MeasuredResponse(np.array([1.0]), np.ones(1, complex)), "at least two"),
        (lambda: LoopTransferFunction(numerical_oscillator(9.0, 0.1), ONE_MODE).margin(1.0), "1 is not allowed"),
        (lambda: Rational(np.zeros(0), np.array([1.0 + 0j]), np.ones(())), "pole at s = 1"),
    ],
)
def test_what_is_no_stable_part_of_a_loop_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
