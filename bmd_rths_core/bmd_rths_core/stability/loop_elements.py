"""Elements of the loop transfer function: gain, phase, and how far the phase can have moved between two frequencies.

Every element knows, in closed form, the total variation of its own phase along the imaginary axis. That is what lets
`crossings` prove that an interval of frequencies holds no phase crossing, however lightly a mode is damped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.unit_circle import DiscreteRational

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class LoopElement(Protocol):
    """A linear time-invariant, stable part of the loop."""

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return the frequency response at s = jω.

        Parameters
        ----------
        frequency : ndarray
            ω ≥ 0 [rad/s].
        """

    def phase_variation(self, frequency: FloatArray) -> FloatArray:
        """Return the total variation of the phase from zero frequency to ω [rad], or an upper bound of it.

        Parameters
        ----------
        frequency : ndarray
            ω ≥ 0 [rad/s]. The difference of two results bounds what the phase does between the two frequencies.
        """

    def gain_bound(self, frequency: float) -> float:
        """Return an upper bound of the gain at ω and all higher frequencies; infinite where none is known.

        Parameters
        ----------
        frequency : float
            ω ≥ 0 [rad/s].
        """

    @property
    def last_frequency(self) -> float:
        """Frequency up to which the response is known [rad/s]."""


@dataclass(frozen=True)
class Rational:
    """A rational transfer function in s by its zeros, poles and gain: g Π(s − zᵢ) / Π(s − pᵢ).

    Parameters
    ----------
    zeros : ndarray, shape (..., n_z)
        Zeros [rad/s], complex.
    poles : ndarray, shape (..., n_p)
        Poles [rad/s], complex, all in the open left half-plane.
    gain : ndarray, shape (...)
        Ratio of the leading coefficients. Leading axes hold several functions at once; they are broadcast against the
        frequencies.

    Raises
    ------
    InputError
        A pole is not in the open left half-plane.
    """

    zeros: ComplexArray
    poles: ComplexArray
    gain: FloatArray

    def __post_init__(self) -> None:
        """Check that the function is stable: the encirclement count starts from a stable open loop."""
        if self.poles.size and not np.max(self.poles.real) < 0.0:
            worst = self.poles.ravel()[np.argmax(self.poles.real)]
            raise InputError(f"pole at s = {worst:.4g} rad/s; poles in the open left half-plane are required")

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return the frequency response."""
        s = 1j * np.asarray(frequency)
        value: ComplexArray = np.asarray(self.gain + 0.0j) * np.ones_like(s)
        for k in range(max(self.zeros.shape[-1], self.poles.shape[-1])):
            # One zero with one pole at a time: no overflow, however many there are.
            if k < self.zeros.shape[-1]:
                value = value * (s - self.zeros[..., k])
            if k < self.poles.shape[-1]:
                value = value / (s - self.poles[..., k])
        return np.asarray(value)

    def phase_variation(self, frequency: FloatArray) -> FloatArray:
        """Return the sum of the variations of every zero and pole, each monotonic."""
        omega, (centre, width, at_zero) = np.asarray(frequency)[..., None], self._roots
        return np.asarray((np.arctan2(omega - centre, width) - at_zero).sum(axis=-1))

    def gain_bound(self, frequency: float) -> float:
        """Return the bound from the moduli of zeros and poles."""
        zeros, poles, gain, farthest = self._moduli
        if frequency <= 2.0 * farthest or zeros.shape[-1] > poles.shape[-1]:
            return np.inf if poles.shape[-1] else float(gain.max())
        grow, shrink = (1.0 + zeros / frequency).prod(axis=-1), (1.0 - poles / frequency).prod(axis=-1)
        return float((gain * grow / shrink).max() * frequency ** (zeros.shape[-1] - poles.shape[-1]))

    @property
    def last_frequency(self) -> float:
        """Infinity: the response is known everywhere."""
        return np.inf

    @cached_property
    def _roots(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Imaginary part and distance from the axis of every zero and pole, and its phase at zero frequency."""
        roots = np.concatenate((self.zeros, self.poles), axis=-1)
        centre, width = roots.imag, np.abs(roots.real)
        return centre, width, np.arctan2(-centre, width)

    @cached_property
    def _moduli(self) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Moduli of zeros, poles and gain, and that of the farthest pole."""
        poles = np.abs(self.poles)
        return np.abs(self.zeros), poles, np.abs(self.gain), float(np.max(poles, initial=0.0))

    def take(self, index: NDArray[np.intp]) -> Rational:
        """Return some of several functions, for frequencies that stand beside them.

        Parameters
        ----------
        index : ndarray of int
            Positions along the first axis.

        Returns
        -------
        Rational
        """
        return Rational(self.zeros[index], self.poles[index], self.gain[index])


@dataclass(frozen=True)
class Delay:
    """A pure delay e^{−sτ}, exact.

    Parameters
    ----------
    time : float
        τ ≥ 0 [s].

    Raises
    ------
    InputError
        The delay is negative or not finite.
    """

    time: float

    def __post_init__(self) -> None:
        """Check the delay."""
        if not (np.isfinite(self.time) and self.time >= 0.0):
            raise InputError(f"delay: {self.time:g} is not allowed; >= 0 s is required")

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return the frequency response."""
        return np.asarray(np.exp(-1j * self.time * np.asarray(frequency)))

    def phase_variation(self, frequency: FloatArray) -> FloatArray:
        """Return ω τ."""
        return self.time * np.asarray(frequency)

    def gain_bound(self, frequency: float) -> float:
        """Return 1."""
        return 1.0

    @property
    def last_frequency(self) -> float:
        """Infinity: the response is known everywhere."""
        return np.inf


class DiscreteCompensator:
    """A compensator given as discrete transfer function, evaluated exactly at z = e^{s Δt} (Eq. 10).

    Parameters
    ----------
    numerator, denominator : array_like
        Coefficients in descending powers of z.
    time_step : float
        Δt [s].

    Raises
    ------
    InputError
        The compensator is improper, or a pole is not inside the unit circle.
    """

    def __init__(self, numerator: ArrayLike, denominator: ArrayLike, time_step: float) -> None:
        b = np.trim_zeros(np.atleast_1d(np.asarray(numerator, dtype=float)), "f")
        a = np.trim_zeros(np.atleast_1d(np.asarray(denominator, dtype=float)), "f")
        self._time_step = time_step
        if not 0 < len(b) <= len(a):
            raise InputError("compensator: numerator of a higher order than the denominator, or without coefficients")
        poles = np.roots(a)
        if np.max(np.abs(poles), initial=0.0) >= 1.0:
            raise InputError(f"compensator: pole of modulus {np.abs(poles).max():.4g}; less than 1 is required")
        zeros = np.roots(b).astype(complex)
        self._rational = DiscreteRational(zeros, poles.astype(complex), b[0] / a[0])
        # Poles this far from the circle are resolved by the spacing; the tenth is for what lies between two points.
        points = 64 * max(8, int(np.ceil(8.0 / (1.0 - np.max(np.abs(poles), initial=0.0)))))
        self._peak = 1.1 * float(np.abs(self.response(np.linspace(0.0, np.pi / time_step, points))).max())

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return the frequency response."""
        return self._rational.response(np.exp(1j * self._time_step * np.asarray(frequency)))

    def phase_variation(self, frequency: FloatArray) -> FloatArray:
        """Return the sum of the variations of every zero and pole."""
        return self._rational.phase_variation(self._time_step * np.asarray(frequency))

    def gain_bound(self, frequency: float) -> float:
        """Return the peak gain on the unit circle."""
        return self._peak

    @property
    def last_frequency(self) -> float:
        """Infinity: the response is known everywhere."""
        return np.inf


@dataclass(frozen=True)
class MeasuredResponse:
    """A frequency response as data, for example of the table with the specimen on it.

    The logarithm of the gain and the unwrapped phase are linear between the frequencies. Below the first one the gain
    is that of the first and the phase falls linearly to zero. Above the last nothing is known and nothing is said: the
    loop is examined up to there.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Increasing, > 0 [rad/s].
    values : ndarray, shape (n,)
        Complex response, not 0. Between two frequencies the phase must turn by less than half a turn.

    Raises
    ------
    InputError
        There is no such data.
    """

    frequencies: FloatArray
    values: ComplexArray

    def __post_init__(self) -> None:
        """Check the data."""
        w, h = np.asarray(self.frequencies), np.asarray(self.values)
        if w.ndim != 1 or w.shape != h.shape or len(w) < 2 or not (np.isfinite(w).all() and np.isfinite(h).all()):
            raise InputError("measured response: one finite value at each of at least two frequencies is required")
        if w[0] <= 0.0 or np.any(np.diff(w) <= 0.0) or np.any(h == 0.0):
            raise InputError("measured response: increasing frequencies > 0 rad/s and values other than 0 are required")

    def _phase(self) -> tuple[FloatArray, FloatArray]:
        return np.append(0.0, self.frequencies), np.append(0.0, np.unwrap(np.angle(self.values)))

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return the interpolated response."""
        gain = np.exp(np.interp(frequency, self.frequencies, np.log(np.abs(self.values))))
        return np.asarray(gain * np.exp(1j * np.interp(frequency, *self._phase())))

    def phase_variation(self, frequency: FloatArray) -> FloatArray:
        """Return the length of the phase curve."""
        w, phase = self._phase()
        return np.asarray(np.interp(frequency, w, np.append(0.0, np.cumsum(np.abs(np.diff(phase))))))

    def gain_bound(self, frequency: float) -> float:
        """Return infinity, because nothing is known above the data."""
        return np.inf

    @property
    def last_frequency(self) -> float:
        """Last frequency of the data [rad/s]."""
        return float(self.frequencies[-1])
