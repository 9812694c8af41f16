"""A rational model as a chain of analog sections: the form in which the simulated table takes it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray
from bmd_rths_core.identification.rational_model import RationalModel


def sections_of(model: RationalModel) -> tuple[float, ...]:
    """Return the first transfer function of a model as sections in series, without the pure delay.

    Zeros stand over the poles of the nearest natural frequency, so that no section has a large dynamic range; the gain
    is in the first section.

    Parameters
    ----------
    model : RationalModel
        The model; its numerator has no higher degree than its denominator.

    Returns
    -------
    tuple of float
        Rows of ``b2 b1 b0 a2 a1 a0`` in rad/s, as `table.dynamics.series` takes them.
    """
    scale = model.scale
    denominators = [(1.0, a1 * scale, a0 * scale**2) for a1, a0 in model.quadratics]
    denominators += [(0.0, 1.0, a0 * scale) for a0 in model.linears]
    zeros = scale * np.roots(model.numerators[::-1, 0])
    numerators = _matched(_factors(np.asarray(zeros, dtype=complex)), denominators)
    # Each section has about unit gain; what is missing or too much is found in the leading coefficients.
    scaled = [_scaled(above, below) for above, below in zip(numerators, denominators, strict=True)]
    gain = model.numerators[-1, 0] * scale ** (model.order - model.degree)
    gain /= np.prod([next(b for b in above if b != 0.0) for above in scaled])
    scaled[0] = tuple(gain * b for b in scaled[0])
    rows = zip(scaled, denominators, strict=True)
    return tuple(float(value) for above, below in rows for value in (*above, *below))


def _factors(zeros: ComplexArray) -> list[tuple[float, float, float]]:
    """Return the zeros as factors of second degree, and at most one of first degree at the end."""
    factors = [(1.0, -2.0 * zero.real, abs(zero) ** 2) for zero in zeros if zero.imag > 0.0]
    real: FloatArray = np.sort(zeros[zeros.imag == 0.0].real)
    for one, two in zip(real[0::2], real[1::2], strict=False):
        factors.append((1.0, -(one + two), one * two))
    if len(real) % 2:
        factors.append((0.0, 1.0, -real[-1]))
    return factors


def _matched(
    factors: Sequence[tuple[float, float, float]], denominators: Sequence[tuple[float, float, float]]
) -> list[tuple[float, float, float]]:
    """Return a numerator for each denominator, 1 where no factor is left."""
    numerators: list[tuple[float, float, float]] = [(0.0, 0.0, 1.0)] * len(denominators)
    free = set(range(len(denominators)))
    for factor in factors:
        first_degree = factor[0] == 0.0
        # A factor of second degree needs a section of second order; one of first degree prefers one of first order.
        fitting = [i for i in free if first_degree or denominators[i][0] != 0.0]
        preferred = [i for i in fitting if first_degree and denominators[i][0] == 0.0] or fitting
        own = min(preferred, key=lambda i: abs(_log_frequency(denominators[i]) - _log_frequency(factor)))
        numerators[own] = factor
        free.remove(own)
    return numerators


def _log_frequency(factor: tuple[float, float, float]) -> float:
    second, first, constant = factor
    size = np.sqrt(abs(constant)) if second != 0.0 else abs(constant) / first
    return float(np.log(max(size, 1e-9)))


def _scaled(above: tuple[float, float, float], below: tuple[float, float, float]) -> tuple[float, ...]:
    """Return the numerator times the power of the natural frequency that gives the section about unit gain."""
    missing = _degree(below) - _degree(above)
    return tuple(float(np.exp(missing * _log_frequency(below))) * b for b in above)


def _degree(factor: tuple[float, float, float]) -> int:
    return 2 - next(i for i, value in enumerate(factor) if value != 0.0)
