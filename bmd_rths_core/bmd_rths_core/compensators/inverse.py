"""Inverse of the identified table, made proper by a Bessel low-pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bmd_rths_core.compensators.identified_table import identified_table, transfer_function
from bmd_rths_core.compensators.linear_shaper import LinearShaper
from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.parameters import check_parameters, parameter


@dataclass(frozen=True)
class InverseConfig:
    """Up to where the table is inverted."""

    SECTION: ClassVar[str] = "inverse"

    low_pass_frequency: float = parameter(
        60.0,
        description="Frequency at which the Bessel low-pass of the inverse takes 3 dB; below half the rate of the loop",
        unit="Hz",
        source="tuned on the simulated table",
        lower=0.1,
        upper=5e3,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


def inverse_system(known: Known, low_pass_frequency: float, section: str) -> DiscreteStateSpace:
    """Return Q(z), the inverse of the identified table times a low-pass.

    Parameters
    ----------
    known : Known
        With an identified table.
    low_pass_frequency : float
        Of the Bessel low-pass [Hz].
    section : str
        Section of the parameter and name of the compensator, for messages.

    Returns
    -------
    DiscreteStateSpace
        Input desired acceleration, output command [m/s²].

    Raises
    ------
    InputError
        No table was identified, it has a zero in the right half-plane, or the low-pass is above half the rate.

    Notes
    -----
    Q(s) = F(s) / T(s) with F of the relative degree of the table T, the least that makes Q proper; Q(z) by the bilinear
    transform. The table's pure delay and the lag of F remain (Tomizuka 1987, J. Dyn. Syst. Meas. Control 109, 65-68,
    on why a zero in the right half-plane cannot be inverted).
    """
    # scipy.signal takes half a second to import, which the other schemes need not wait.
    from scipy.signal import bessel, bilinear_zpk, zpk2sos

    rate = 1.0 / known.time_step
    if not low_pass_frequency < 0.5 * rate:
        raise InputError(
            f"{section}.low_pass_frequency: {low_pass_frequency:g} Hz is not allowed; less than half the rate of the "
            f"loop, {0.5 * rate:g} Hz, is required"
        )
    zeros, poles, gain = transfer_function(identified_table(known, section))
    unstable = zeros[zeros.real >= 0.0]
    if len(unstable):
        raise InputError(
            f"identified_model: the table has a zero at {unstable[0]:.4g} rad/s; scheme {section} requires all of them "
            "in the left half-plane"
        )
    order, corner = max(1, len(poles) - len(zeros)), 2.0 * np.pi * low_pass_frequency
    low_zeros, low_poles, low_gain = bessel(order, corner, "lowpass", analog=True, output="zpk", norm="mag")
    discrete = bilinear_zpk(
        np.concatenate((poles, low_zeros)), np.concatenate((zeros, low_poles)), low_gain / gain, fs=rate
    )
    return cascade(np.asarray(zpk2sos(*discrete)))


def cascade(sections: np.ndarray) -> DiscreteStateSpace:
    """Return second-order sections in series as one system.

    Parameters
    ----------
    sections : ndarray, shape (p, 6)
        As scipy has them.

    Returns
    -------
    DiscreteStateSpace
        In the transposed direct form II, two states a section.
    """
    size = 2 * len(sections)
    a, b, c, d = np.zeros((size, size)), np.zeros((size, 1)), np.zeros((1, size)), np.ones((1, 1))
    for i, (b0, b1, b2, _, a1, a2) in enumerate(sections.tolist()):
        own = slice(2 * i, 2 * i + 2)
        by_input = np.array([[b1 - a1 * b0], [b2 - a2 * b0]])
        a[own] += by_input @ c
        a[own, own] += [[-a1, 1.0], [-a2, 0.0]]
        b[own] = by_input @ d
        c, d = b0 * c, b0 * d
        c[0, 2 * i] += 1.0
    return DiscreteStateSpace(a, b, c, d)


def make_inverse(known: Known) -> LinearShaper:
    """Return the inverse of the identified table."""
    settings: InverseConfig = known.settings
    return LinearShaper(inverse_system(known, settings.low_pass_frequency, "inverse"))


COMPENSATORS = (
    Compensator(
        "inverse",
        "Inverse of the identified table with a Bessel low-pass",
        "The identified table, without zeros in the right half-plane; takes no preview",
        shaper=make_inverse,
        learns=False,
        settings=InverseConfig,
    ),
)
