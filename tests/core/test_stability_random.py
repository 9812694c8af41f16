"""A thousand random loops: the frequency-domain margin against the eigenvalues of the delay differential equation.

The eigenvalue side shares nothing with the product but the equations of motion. It writes the loop in the time domain,
lets the shear travel through its delay as a transport equation, collocates that on Chebyshev points (Trefethen 2000;
Breda, Maset and Vermiglio 2005), and looks whether an eigenvalue enters the right half-plane at the margin, not before.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, LoopTransferFunction
from bmd_rths_core.stability.loop_elements import Delay
from bmd_rths_core.stability.models import IdentifiedMode, experimental_modes, numerical_oscillator, table_sections
from bmd_rths_core.table.models.dynamics import servo_sections

SYSTEMS = 1000
POINTS = 20
LADDER = np.geomspace(1e-4, LARGEST_MASS_RATIO / (1.0 - LARGEST_MASS_RATIO), 32)


def differentiation(points):
    """Chebyshev differentiation matrix on [0, 1], from 0 on."""
    x = np.cos(np.pi * np.arange(points + 1) / points)
    c = np.where(np.isin(np.arange(points + 1), (0, points)), 2.0, 1.0) * (-1.0) ** np.arange(points + 1)
    d = np.outer(c, 1.0 / c) / (x[:, None] - x + np.eye(points + 1))
    return -2.0 * (d - np.diag(d.sum(axis=1)))


TRANSPORT = differentiation(POINTS)


def generators(frequency, zeta, modes, servo, delay):
    """Return A₀ and A₁: the loop with the ratio of masses r is ẋ = (A₀ + r A₁) x."""
    n_modes, (pole, servo_frequency, servo_damping) = len(modes), servo
    line = POINTS if delay > 0.0 else 0
    n = 2 + 3 + 2 * n_modes + line
    free, driven = np.zeros((n, n)), np.zeros((n, n))
    unit = np.eye(n)
    u, v, lag, p, q = unit[:5]
    position, velocity = unit[5 : 5 + n_modes], unit[5 + n_modes : 5 + 2 * n_modes]
    shear = sum(m * (2 * z * w * velocity[i] + w**2 * position[i]) for i, (w, z, m) in enumerate(modes))
    restoring = 2 * zeta * frequency * v + frequency**2 * u
    # Eq. 4 divided by m_N, with f = m_E · shear; without a delay line the shear arrives at once.
    free[0], free[1], driven[1] = v, -restoring, unit[-1] if line else shear
    free[2], driven[2] = pole * (-restoring - lag), pole * driven[1]
    free[3] = q
    free[4] = servo_frequency**2 * (lag - p) - 2 * servo_damping * servo_frequency * q
    for i, (w, z, _) in enumerate(modes):
        free[5 + i] = velocity[i]
        free[5 + n_modes + i] = -2 * z * w * velocity[i] - w**2 * position[i] - p
    if line:
        inner = unit[n - line :]
        free[n - line :] = -(TRANSPORT[1:, 1:] @ inner + np.outer(TRANSPORT[1:, 0], shear)) / delay
    return free, driven


def largest_real_part(generator, ratios):
    free, driven = generator
    return np.linalg.eigvals(free + np.asarray(ratios)[:, None, None] * driven).real.max(axis=1)


def is_where_eigenvalues_leave(generator, mass_ratio):
    """Tell whether every rung of the ladder below a mass ratio is stable, and the loop ends there: a thousandth off."""
    just_below, just_above = (share * mass_ratio / (1.0 - share * mass_ratio) for share in (0.999, 1.001))
    below = np.append(LADDER[just_below > LADDER], just_below)
    if (largest_real_part(generator, below) >= 0.0).any():
        return False
    return mass_ratio == LARGEST_MASS_RATIO or largest_real_part(generator, [just_above])[0] >= 0.0


def between(lower, upper, share):
    return lower * (upper / lower) ** share


def test_differentiation_matrix_of_the_reference():
    d = differentiation(POINTS)
    x = 0.5 * (1.0 - np.cos(np.pi * np.arange(POINTS + 1) / POINTS))
    assert np.abs(d @ np.sin(3.0 * x) - 3.0 * np.cos(3.0 * x)).max() < 1e-10


@pytest.mark.slow
def test_a_thousand_random_loops_agree():
    disagreements, tried = [], 0

    @settings(
        max_examples=SYSTEMS,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
    def compare(seed, second_mode, delayed):
        nonlocal tried
        x = np.random.default_rng(seed).random(12)  # the values hypothesis likes would crowd the corners
        frequency, zeta = between(5.0, 150.0, x[0]), between(0.005, 0.1, x[1])
        modes = [(between(5.0, 100.0, x[2]), between(0.005, 0.1, x[3]), 1.0)]
        if second_mode:
            modes.append((modes[0][0] * between(1.3, 4.0, x[4]), between(0.005, 0.1, x[5]), between(0.02, 1.0, x[6])))
        servo = between(20.0, 400.0, x[7]), between(60.0, 400.0, x[8]), between(0.05, 1.2, x[9])
        delay, line = (0.001 + 0.03 * x[10], 0.005 * round(2 * x[11])) if delayed else (0.0, 0.0)
        loop = LoopTransferFunction(
            numerical_oscillator(frequency, zeta),
            experimental_modes([IdentifiedMode(*mode) for mode in modes]),
            SeriesTable(table_sections(servo_sections(*servo)), Delay(delay)),
            feedback_delay=line,
        )
        ours = loop.margin(LARGEST_MASS_RATIO).allowable_mass_ratio
        tried += 1
        if not is_where_eigenvalues_leave(generators(frequency, zeta, modes, servo, delay + line), ours):
            disagreements.append((ours, frequency, zeta, modes, servo, delay, line))

    compare()
    print(f"{len(disagreements)} of {tried} disagree")
    assert tried >= SYSTEMS
    assert len(disagreements) <= tried // 100, disagreements[:5]


class SeriesTable:
    """A table with a delay of its own: anything with the methods of `LoopElement` is an element."""

    def __init__(self, *elements):
        self._elements = elements

    def response(self, frequency):
        return np.prod([element.response(frequency) for element in self._elements], axis=0)

    def phase_variation(self, frequency):
        return np.sum([element.phase_variation(frequency) for element in self._elements], axis=0)

    def gain_bound(self, frequency):
        return np.prod([element.gain_bound(frequency) for element in self._elements])

    @property
    def last_frequency(self):
        return min(element.last_frequency for element in self._elements)
