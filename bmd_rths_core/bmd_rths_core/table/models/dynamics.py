"""Dynamics of the shake table: acceleration command to achieved acceleration, as a chain of analog sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError

FloatArray = NDArray[np.float64]

SECTION_LENGTH = 6


@dataclass(frozen=True)
class StateSpace:
    """ẋ = A x + B u, y = C x + D u with one input and one output.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, 1)
    c : ndarray, shape (1, n)
    d : float
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float


def servo_sections(real_pole: float, frequency: float, damping_ratio: float) -> tuple[float, ...]:
    """Return the sections of a third-order servo table with unit gain at zero frequency.

    Parameters
    ----------
    real_pole : float
        p of p / (s + p) [rad/s].
    frequency, damping_ratio : float
        ω [rad/s] and ζ of ω² / (s² + 2 ζ ω s + ω²).

    Returns
    -------
    tuple of 12 floats
        Two rows as `series` takes them.
    """
    squared = frequency**2
    return (
        *(0.0, 0.0, real_pole, 0.0, 1.0, real_pole),
        *(0.0, 0.0, squared, 1.0, 2.0 * damping_ratio * frequency, squared),
    )


def series(sections: tuple[float, ...]) -> StateSpace:
    """Return the state space of analog sections in series.

    Sections keep a transfer function of high order well conditioned, and each state is scaled by the natural frequency
    of its section, so that all entries of A are frequencies.

    Parameters
    ----------
    sections : tuple of float
        Rows of six, ``b2 b1 b0 a2 a1 a0``: (b2 s² + b1 s + b0) / (a2 s² + a1 s + a0). No row at all is a gain of one.

    Returns
    -------
    StateSpace
        Table with the acceleration command as input and the achieved acceleration as output.

    Raises
    ------
    InputError
        The number of coefficients is no multiple of six, a section is improper or of order zero, or a pole is not in
        the open left half-plane.
    """
    if len(sections) % SECTION_LENGTH:
        raise InputError(
            f"simulated_table.sections: {len(sections)} coefficients; rows of six, b2 b1 b0 a2 a1 a0, are required"
        )
    total = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), 1.0)
    for row in range(len(sections) // SECTION_LENGTH):
        section = _section(row, sections[row * SECTION_LENGTH : (row + 1) * SECTION_LENGTH])
        total = StateSpace(
            a=np.block([[total.a, np.zeros((len(total.a), len(section.a)))], [section.b @ total.c, section.a]]),
            b=np.vstack((total.b, section.b * total.d)),
            c=np.hstack((section.d * total.c, section.c)),
            d=section.d * total.d,
        )
    return total


def _section(row: int, coefficients: tuple[float, ...]) -> StateSpace:
    b2, b1, b0, a2, a1, a0 = coefficients
    name = f"simulated_table.sections row {row + 1}"
    if a2 == 0.0:
        if a1 == 0.0 or b2 != 0.0:
            raise InputError(f"{name}: {b2:g} s2 + {b1:g} s + {b0:g} over {a1:g} s + {a0:g} is improper or has no pole")
        pole = a0 / a1
        if pole <= 0.0:
            raise InputError(f"{name}: pole at s = {-pole:g} rad/s; poles in the open left half-plane are required")
        d = b1 / a1
        # ẋ = −p x + p u, so that x has the size of the input.
        return StateSpace(np.array([[-pole]]), np.array([[pole]]), np.array([[(b0 / a1 - d * pole) / pole]]), d)
    damping, squared = a1 / a2, a0 / a2
    if damping <= 0.0 or squared <= 0.0:
        roots = ", ".join(f"{root:.4g}" for root in np.roots([a2, a1, a0]))
        raise InputError(f"{name}: poles at s = {roots} rad/s; poles in the open left half-plane are required")
    omega = np.sqrt(squared)
    d = b2 / a2
    return StateSpace(
        a=np.array([[0.0, omega], [-omega, -damping]]),
        b=np.array([[0.0], [omega]]),
        c=np.array([[(b0 / a2 - d * squared) / squared, (b1 / a2 - d * damping) / omega]]),
        d=d,
    )
