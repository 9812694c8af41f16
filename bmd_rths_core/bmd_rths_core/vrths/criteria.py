"""J₁ to J₉ of the benchmark problem, as Silva et al. (2020) define them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.vrths.problem import RATE

FloatArray = NDArray[np.float64]

#: Largest lag that J₁ looks at [samples].
LARGEST_LAG = 49

CRITERIA = tuple(f"J{i}" for i in range(1, 10))
UNITS = {name: "ms" if name == "J1" else "%" for name in CRITERIA}


def tracking_lag(desired: FloatArray, measured: FloatArray) -> int:
    """Return the lag of 0 to 49 samples with the greatest correlation of the measured behind the desired motion.

    Parameters
    ----------
    desired, measured : ndarray, shape (N,)
        N > 50.
    """
    length = len(desired)
    correlations = [
        _correlation(desired[: length - lag], measured[lag:]) for lag in range(min(LARGEST_LAG, length - 2) + 1)
    ]
    return int(np.argmax(correlations))


def criteria(desired: FloatArray, measured: FloatArray, reference: FloatArray, upper: FloatArray) -> dict[str, float]:
    """Return J₁ [ms] and J₂ to J₉ [%].

    Parameters
    ----------
    desired, measured : ndarray, shape (N,)
        Displacement that the numerical substructure asks for, and that of the actuator as it is measured [m].
    reference : ndarray, shape (N, 3)
        Displacements of the floors of the building without partition [m].
    upper : ndarray, shape (N, 2)
        Displacements of floors 2 and 3 of the numerical substructure [m].

    Returns
    -------
    dict of str to float
        By ``J1`` to ``J9``.

    Notes
    -----
    J₁ lag of the greatest correlation; J₂ = std(m − d) / std(d), J₃ = max |m − d| / max |d|; J₄ and J₅ the same of m
    and r₁; J₆ and J₇ = std(x − r) / std(r) of floors 2 and 3, J₈ and J₉ = max |x − r| / max |r| of floors 2 and 3.
    """
    second, third = (upper[:, 0], reference[:, 1]), (upper[:, 1], reference[:, 2])
    values = (
        1e3 * tracking_lag(desired, measured) / RATE,
        _deviation(measured, desired),
        _peak(measured, desired),
        _deviation(measured, reference[:, 0]),
        _peak(measured, reference[:, 0]),
        _deviation(*second),
        _deviation(*third),
        _peak(*second),
        _peak(*third),
    )
    return dict(zip(CRITERIA, values, strict=True))


def _correlation(one: FloatArray, other: FloatArray) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0


def _deviation(found: FloatArray, true: FloatArray) -> float:
    return 100.0 * float(np.std(found - true) / np.std(true))


def _peak(found: FloatArray, true: FloatArray) -> float:
    return 100.0 * float(np.max(np.abs(found - true)) / np.max(np.abs(true)))
