"""Vector fitting: poles that several frequency responses share, found by repeated linear least squares.

Relaxed vector fitting with real coefficients and one QR decomposition a response: Gustavsen and Semlyen, "Rational
approximation of frequency domain responses by vector fitting", IEEE Trans. Power Delivery 14(3), 1999; Gustavsen,
"Improving the pole relocating properties of vector fitting", 21(3), 2006; Deschrijver, Mrozowski, Dhaene and De Zutter,
"Macromodeling of multiport systems using a fast implementation of the vector fitting method", IEEE MWCL 18(6), 2008.
"""

from __future__ import annotations

import numpy as np

from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray

_ITERATIONS = 10
_CONVERGED = 1e-4


def shared_poles(s: ComplexArray, response: ComplexArray, weight: FloatArray, order: int) -> ComplexArray:
    """Return stable poles that the responses share.

    Parameters
    ----------
    s : ndarray of complex, shape (n,)
        jω, scaled so that the largest is j.
    response : ndarray of complex, shape (n, m)
        m frequency responses.
    weight : ndarray, shape (n, m)
        One over their standard deviations.
    order : int
        Number of poles.

    Returns
    -------
    ndarray of complex
        Real poles, and of each complex pair the one with positive imaginary part, scaled as s. Unstable ones are
        reflected at the imaginary axis.
    """
    poles = _first_poles(order, float(np.abs(s[0])))
    for _ in range(_ITERATIONS):
        relocated = _relocated(s, response, weight, poles)
        converged = len(relocated) == len(poles) and np.allclose(relocated, poles, rtol=_CONVERGED)
        poles = relocated
        if converged:
            break
    return poles


def _first_poles(order: int, lowest: float) -> ComplexArray:
    """Return lightly damped pairs over the band, as Gustavsen and Semlyen recommend."""
    imaginary = np.geomspace(max(lowest, 0.05), 1.0, order // 2)
    return np.append((-0.1 + 1j) * imaginary, [-0.5 + 0j] * (order % 2))


def _relocated(s: ComplexArray, response: ComplexArray, weight: FloatArray, poles: ComplexArray) -> ComplexArray:
    """Return the zeros of σ, fitted so that σ and σ·H both have the given poles."""
    columns = np.column_stack((_partial_fractions(s, poles), np.ones(len(s))))
    size = columns.shape[1]
    rows = []
    for own, own_weight in zip(response.T, weight.T, strict=True):
        block = own_weight[:, None] * np.hstack((columns, -own[:, None] * columns))
        triangle = np.asarray(np.linalg.qr(np.vstack((block.real, block.imag)), mode="r"))
        rows.append(triangle[size:, size:])
    # Relaxation: not a coefficient of σ is fixed, but the sum of σ over all lines, which avoids σ = 0.
    scale = np.linalg.norm(weight * response) / len(s)
    system = np.vstack((*rows, scale * columns.sum(axis=0).real))
    right = np.append(np.zeros(len(system) - 1), scale * len(s))
    norms = np.linalg.norm(system, axis=0)
    sigma = np.linalg.lstsq(system / norms, right, rcond=None)[0] / norms
    a, b = _realisation(poles)
    zeros = np.asarray(np.linalg.eigvals(a - np.outer(b, sigma[:-1]) / sigma[-1]), dtype=complex)
    zeros = np.asarray(-np.abs(zeros.real) + 1j * zeros.imag)
    return np.sort_complex(zeros[zeros.imag >= 0.0])


def _partial_fractions(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Return 1/(s − p) of real poles, and of pairs the two combinations that have real coefficients."""
    columns = []
    for pole in poles:
        if pole.imag == 0.0:
            columns.append(1.0 / (s - pole))
        else:
            upper, lower = 1.0 / (s - pole), 1.0 / (s - pole.conjugate())
            columns += [upper + lower, 1j * (upper - lower)]
    return np.column_stack(columns)


def _realisation(poles: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return A and b whose states are the partial fractions."""
    size = sum(1 if pole.imag == 0.0 else 2 for pole in poles)
    a, b = np.zeros((size, size)), np.zeros(size)
    row = 0
    for pole in poles:
        if pole.imag == 0.0:
            a[row, row], b[row] = pole.real, 1.0
            row += 1
        else:
            a[row : row + 2, row : row + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            b[row] = 2.0
            row += 2
    return a, b
