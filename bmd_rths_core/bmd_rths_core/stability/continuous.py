"""Stability of the loop by its transfer function (Eqs. 7 and 8): allowable mass ratio, exact up to rounding.

L(s) = (m_E/m_N) L₀(s) is proportional to the ratio of the masses, because each substructure keeps its frequencies and
damping ratios. So every frequency at which L₀ is real and negative is the critical frequency of one ratio,
m_E/m_N = −1/L₀, and the number of encirclements of −1 changes there and nowhere else. Sorted by that ratio, the
directions of the crossings add up to the number of unstable poles of the closed loop; no loop is taken for stable
because its first crossing looks harmless, and a loop that is stable again at a larger ratio is found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.crossings import Cells, Crossings, halved_towards, positive_real_crossings
from bmd_rths_core.stability.loop_elements import ComplexArray, Delay, LoopElement, Rational
from bmd_rths_core.stability.models import numerical_oscillator, table_sections

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: Mass ratios up to here are examined first. At 1 the numerical substructure would have no mass at all.
LARGEST_MASS_RATIO = 0.99

#: A loop that is stable up to there is examined up to here, and taken for stable at every ratio if it is stable still.
NEARLY_ONE = 1.0 - 1e-6

#: Phase variation of a cell to begin with [rad]; any value gives the same result.
_FIRST_CELL = 0.5


class StableInterval(NamedTuple):
    """Mass ratios between which the loop is stable.

    Parameters
    ----------
    lower, upper : float
        Ends of the interval of ρ = m_E / (m_N + m_E) (Eq. 8).
    lower_frequency, upper_frequency : float
        Frequency at which the loop oscillates at the end [rad/s]; NaN at an end that is only where the search ends.
    """

    lower: float
    upper: float
    lower_frequency: float
    upper_frequency: float


class StabilityMargin(NamedTuple):
    """Allowable mass ratio of a loop.

    Parameters
    ----------
    allowable_mass_ratio : float
        End of the stable interval that begins at 0; 0 when there is none.
    critical_frequency : float
        Frequency at which the loop oscillates there [rad/s]; NaN when the search ended before the stability.
    stable_intervals : tuple of StableInterval
        All of them up to the largest ratio that was examined.
    """

    allowable_mass_ratio: float
    critical_frequency: float
    stable_intervals: tuple[StableInterval, ...]


class MarginCurve(NamedTuple):
    """Allowable mass ratio over the frequency of the numerical substructure, as in Figures 7, 8 and 11 of the paper.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω_N [rad/s].
    allowable_mass_ratios : ndarray, shape (n,)
        ρ (Eq. 8).
    critical_frequencies : ndarray, shape (n,)
        [rad/s]; NaN where the search ended before the stability.
    """

    frequencies: FloatArray
    allowable_mass_ratios: FloatArray
    critical_frequencies: FloatArray


@dataclass(frozen=True)
class LoopTransferFunction:
    """The loop of Eq. 7, L(s) = G_af^N(s) G_fa^E(s) G_s(s) C(e^{s Δt}) e^{−s τ}, positive for negative feedback.

    Parameters
    ----------
    numerical : Rational
        From `models.numerical_oscillator`, one or many at once, or from `models.numerical_building`.
    experimental : Rational
        From `models.experimental_building` or `models.experimental_modes`.
    table : LoopElement
        Achieved from commanded acceleration: `models.table_sections`, a `Delay`, a `MeasuredResponse`; perfect by
        default.
    compensator : LoopElement, optional
        From `models.phase_lead_compensator`, or any `DiscreteCompensator`.
    feedback_delay : float
        τ ≥ 0 [s]: k Δt for a shear that is fed back k steps late.
    """

    numerical: Rational
    experimental: Rational
    table: LoopElement = field(default_factory=table_sections)
    compensator: LoopElement | None = None
    feedback_delay: float = 0.0

    @property
    def _rest(self) -> tuple[LoopElement, ...]:
        """Everything that does not depend on the numerical substructure."""
        compensator = () if self.compensator is None else (self.compensator,)
        return (self.experimental, self.table, *compensator, Delay(self.feedback_delay))

    def response(self, frequency: ArrayLike, mass_ratio: float) -> ComplexArray:
        """Return L(jω).

        Parameters
        ----------
        frequency : array_like
            ω [rad/s].
        mass_ratio : float
            ρ of Eq. 8, from 0 to less than 1.

        Returns
        -------
        ndarray of complex
            The closed loop is stable when 1 + L has no zero in the right half-plane.
        """
        omega = np.asarray(frequency, dtype=float)
        value = self.numerical.response(omega)
        for element in self._rest:
            value = value * element.response(omega)
        return np.asarray(-(omega**2) * value * mass_ratio / (1.0 - mass_ratio))

    def margin(self, largest: float | None = None) -> StabilityMargin:
        """Return the allowable mass ratio.

        Parameters
        ----------
        largest : float, optional
            See `margins`.

        Returns
        -------
        StabilityMargin
        """
        return self.margins(largest)[0]

    def margins(self, largest: float | None = None) -> list[StabilityMargin]:
        """Return the allowable mass ratio for each of the numerical substructures.

        Parameters
        ----------
        largest : float, optional
            Largest mass ratio to examine, between 0 and 1. Without it, `LARGEST_MASS_RATIO` for a loop that is unstable
            below it; 1 for a loop that is stable up to there and `NEARLY_ONE`, where its response is known everywhere.

        Returns
        -------
        list of StabilityMargin

        Raises
        ------
        InputError
            The largest mass ratio is not between 0 and 1.
        """
        if largest is None:
            return self._margins_to_the_end()
        if not 0.0 < largest < 1.0:
            raise InputError(f"largest mass ratio: {largest:g} is not allowed; > 0 and < 1 is required")
        poles = self.numerical.poles.reshape(-1, self.numerical.poles.shape[-1])
        zeros = self.numerical.zeros.reshape(len(poles), -1)
        numerical = Rational(zeros, poles, self.numerical.gain.reshape(-1))
        crossings = self._crossings(numerical, largest / (1.0 - largest))
        with np.errstate(divide="ignore"):
            ratios = 1.0 / (crossings.frequency**2 * crossings.value)
        order = np.lexsort((ratios, crossings.loop))
        first = np.searchsorted(crossings.loop[order], np.arange(len(poles) + 1))
        each = (order[begin:end] for begin, end in pairwise(first))
        return [_margin(ratios[own], crossings.frequency[own], crossings.direction[own], largest) for own in each]

    def _margins_to_the_end(self) -> list[StabilityMargin]:
        found = self.margins(LARGEST_MASS_RATIO)
        beyond = [i for i, margin in enumerate(found) if margin.allowable_mass_ratio == LARGEST_MASS_RATIO]
        if not beyond or any(math.isfinite(element.last_frequency) for element in (self.numerical, *self._rest)):
            return found
        poles = self.numerical.poles.reshape(-1, self.numerical.poles.shape[-1])
        flat = Rational(self.numerical.zeros.reshape(len(poles), -1), poles, self.numerical.gain.reshape(-1))
        again = replace(self, numerical=flat.take(np.array(beyond))).margins(NEARLY_ONE)
        for i, margin in zip(beyond, again, strict=True):
            stable = margin.stable_intervals
            if stable[-1].upper == NEARLY_ONE:
                stable = (*stable[:-1], stable[-1]._replace(upper=1.0))
            found[i] = StabilityMargin(stable[0].upper, stable[0].upper_frequency, stable)
        return found

    def _crossings(self, numerical: Rational, largest: float) -> Crossings:
        rest = self._rest

        def of_rest(omega: FloatArray) -> ComplexArray:
            value = np.ones(omega.shape, dtype=complex)
            for element in rest:
                value = value * element.response(omega)
            return value

        def of(loop: IndexArray) -> Rational:
            return numerical if len(numerical.poles) == 1 else numerical.take(loop)

        def response(omega: FloatArray, loop: IndexArray) -> ComplexArray:
            return of_rest(omega) * of(loop).response(omega)

        def variation(omega: FloatArray, loop: IndexArray) -> FloatArray:
            return _variation(rest, omega) + of(loop).phase_variation(omega)

        nodes = _nodes(rest, _highest_frequency((numerical, *rest), largest))
        nodes = np.concatenate((nodes[:1], halved_towards(0.0, nodes[1])[:0:-1], nodes[1:]))
        # Loops along the first axis, frequencies along the second; the rest of the loop is evaluated once for all.
        each = Rational(numerical.zeros[:, None], numerical.poles[:, None], numerical.gain[:, None])
        values = of_rest(nodes) * each.response(nodes)
        variations = _variation(rest, nodes) + each.phase_variation(nodes)
        loop = np.repeat(np.arange(len(values)), len(nodes) - 1)
        lower, upper = np.tile(nodes[:-1], len(values)), np.tile(nodes[1:], len(values))
        lower_value, upper_value = values[:, :-1].ravel(), values[:, 1:].ravel()
        lower_variation, upper_variation = variations[:, :-1].ravel(), variations[:, 1:].ravel()
        cells = Cells(loop, lower, upper, lower_value, upper_value, lower_variation, upper_variation)
        return positive_real_crossings(response, variation, cells)


def margin_curve(
    frequencies: ArrayLike,
    damping_ratio: float,
    experimental: Rational,
    table: LoopElement | None = None,
    compensator: LoopElement | None = None,
    feedback_delay: float = 0.0,
) -> MarginCurve:
    """Return the allowable mass ratio over the frequency of the numerical substructure.

    Parameters
    ----------
    frequencies : array_like, shape (n,)
        ω_N > 0 [rad/s].
    damping_ratio : float
        ζ_N > 0.
    experimental, table, compensator, feedback_delay
        See `LoopTransferFunction`; no table is the perfect one.

    Returns
    -------
    MarginCurve

    Raises
    ------
    InputError
        See `models.numerical_oscillator`.
    """
    omega = np.asarray(frequencies, dtype=float)
    loops = LoopTransferFunction(
        numerical_oscillator(omega, damping_ratio),
        experimental,
        table_sections() if table is None else table,
        compensator,
        feedback_delay,
    )
    margins = loops.margins()
    ratios = np.array([margin.allowable_mass_ratio for margin in margins])
    return MarginCurve(omega, ratios, np.array([margin.critical_frequency for margin in margins]))


def _margin(ratios: FloatArray, frequencies: FloatArray, directions: IndexArray, largest: float) -> StabilityMargin:
    """Add up the encirclements: two unstable poles more or less, for ω and −ω, at every crossing."""
    unstable, intervals = 0, []
    lower, lower_frequency = 0.0, np.nan
    for ratio, frequency, direction in zip(ratios.tolist(), frequencies.tolist(), directions.tolist(), strict=True):
        mass_ratio = ratio / (1.0 + ratio)
        if not mass_ratio < largest:
            break
        if unstable == 0:
            intervals.append(StableInterval(lower, mass_ratio, lower_frequency, frequency))
        unstable -= 2 * direction
        if unstable == 0:
            lower, lower_frequency = mass_ratio, frequency
    if unstable == 0:
        intervals.append(StableInterval(lower, largest, lower_frequency, np.nan))
    first = intervals[0]
    return StabilityMargin(first.upper, first.upper_frequency, tuple(intervals))


def _highest_frequency(elements: tuple[LoopElement, ...], largest: float) -> float:
    """Return where L₀ becomes too small for a crossing at the largest ratio of the masses, or is not known any more."""
    frequency, last = 1.0, min(element.last_frequency for element in elements)
    while frequency < last:
        if frequency**2 * math.prod(element.gain_bound(frequency) for element in elements) * largest < 1.0:
            return frequency
        frequency *= 1.1
    return last


def _variation(elements: tuple[LoopElement, ...], omega: FloatArray) -> FloatArray:
    return np.asarray(sum(element.phase_variation(omega) for element in elements))


def _nodes(elements: tuple[LoopElement, ...], highest: float) -> FloatArray:
    nodes = np.linspace(0.0, highest, 33)
    variation = _variation(elements, nodes)
    while True:
        width = np.diff(nodes)
        coarse = np.flatnonzero((np.diff(variation) > _FIRST_CELL) & (width > 1e-9 * nodes[1:]))
        if not len(coarse):
            return nodes
        added, after = nodes[coarse] + 0.5 * width[coarse], coarse + 1
        nodes = np.insert(nodes, after, added)
        variation = np.insert(variation, after, _variation(elements, added))
