"""Displacement commands: closed forms, scipy.signal, no drift."""

import numpy as np
import pytest
from scipy import signal

from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.displacement_command import DisplacementCommand, stroke_trips, table_motion

CONFIG = SafetyConfig()
OMEGA = CONFIG.high_pass_frequency
DT = 0.005


def transfer(frequency):
    s = 1j * frequency
    return s / ((s + OMEGA) * (s**2 + OMEGA * s + OMEGA**2))


def test_equals_scipy_for_a_random_history():
    acceleration = np.random.default_rng(3).standard_normal(4000)
    poles = OMEGA * np.exp(1j * np.pi * np.array([2 / 3, 1.0, 4 / 3]))
    for zeros, index in (([0.0], 1), ([0.0, 0.0], 0)):  # displacement, velocity
        system = signal.ZerosPolesGain(zeros, poles, 1.0).to_ss().to_discrete(DT, "zoh")
        x, expected = np.zeros(3), []
        for value in acceleration:
            x = system.A @ x + system.B[:, 0] * value
            expected.append((system.C @ x)[0].real)
        np.testing.assert_allclose(table_motion(acceleration, CONFIG, DT)[index], expected, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [0.5, 2.0, 10.0])
def test_sine_has_amplitude_and_phase_of_the_transfer_function(frequency):
    """The hold delays by half a step: the mean of the held sine over its sinc."""
    dt = 0.001
    time = dt * np.arange(round(120.0 / dt))
    _, displacement = table_motion(np.sin(frequency * time), CONFIG, dt)
    end = slice(-round(4.0 * np.pi / frequency / dt), None)
    hold = np.exp(-0.5j * frequency * dt) * np.sinc(frequency * dt / (2.0 * np.pi))
    response = transfer(frequency) * hold
    expected = np.imag(response * np.exp(1j * frequency * (time + dt)))
    np.testing.assert_allclose(displacement[end], expected[end], atol=2e-4 * abs(response))


def test_ideal_double_integral_above_the_corner():
    """At 100 times the corner the displacement is −a / Ω² with a lead of 2 ω / Ω."""
    ratio = transfer(100.0 * OMEGA) * -((100.0 * OMEGA) ** 2)
    assert abs(ratio) == pytest.approx(1.0, abs=1e-3)
    assert np.angle(ratio) == pytest.approx(0.02, abs=1e-4)


def test_constant_acceleration_leaves_no_displacement():
    velocity, displacement = table_motion(np.full(round(180.0 / DT), 0.5), CONFIG, DT)
    assert abs(displacement[-1]) < 1e-9
    assert abs(velocity[-1]) < 1e-9


def test_pulse_moves_like_a_double_integral_and_comes_back():
    """Ten steps of 1 m/s² and ten of −1 m/s²: the double integral is (10 Δt)²."""
    acceleration = np.concatenate((np.ones(10), -np.ones(10), np.zeros(24000)))
    velocity, displacement = table_motion(acceleration, CONFIG, DT)
    assert displacement[19] == pytest.approx((10 * DT) ** 2, rel=0.04)
    assert velocity[9] == pytest.approx(10 * DT, rel=0.02)
    assert abs(displacement[-1]) < 1e-9


def test_reset_forgets():
    command = DisplacementCommand(CONFIG, DT)
    first = [command.step(1.0) for _ in range(5)]
    command.reset()
    assert [command.step(1.0) for _ in range(5)] == first
    assert table_motion(np.zeros(0), CONFIG, DT)[0].shape == (0,)


def test_stroke_trips_name_the_first_step_beyond_each_limit():
    """Well before the high-pass acts, 1 m/s² has the velocity t and the displacement t²/2."""
    limits = SafetyConfig(displacement_limit=0.0203, velocity_limit=0.3, high_pass_frequency=1e-3)
    trips = {trip.limit: trip for trip in stroke_trips(np.ones(100), limits, DT)}
    assert trips["safety.displacement_limit"].step == 40  # t = 0.205 s: 0.0210 m
    assert trips["safety.velocity_limit"].step == 60  # t = 0.305 s
    assert trips["safety.velocity_limit"].value == pytest.approx(0.305, rel=1e-3)
    assert "displacement-controlled" in str(trips["safety.displacement_limit"])


def test_stroke_trips_are_those_that_would_stop_the_test():
    limits = SafetyConfig(displacement_limit=0.01, velocity_limit=0.1, ramp_velocity=0.1)
    assert len(stroke_trips(-np.ones(100), limits, DT)) == 2
    lenient = SafetyConfig(
        displacement_limit=0.01, velocity_limit=0.1, displacement_action="indicate", velocity_action="ignore"
    )
    assert stroke_trips(-np.ones(100), lenient, DT) == []
    assert stroke_trips(np.ones(10), SafetyConfig(), DT) == []
