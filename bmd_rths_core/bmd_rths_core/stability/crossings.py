"""Every frequency at which the loop transfer function is real and negative, and in which direction it passes there.

Instead of a grid there is a proof. A cell is an interval of frequencies with the values at its ends and a bound of the
phase variation inside. When the phase, starting and ending where it does and moving no farther than that, cannot reach
the level, the cell is dropped; otherwise it is halved. What is left at the end are the crossings.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IndexArray = NDArray[np.intp]

#: Values M of some loops at some frequencies [rad/s].
Response = Callable[[FloatArray, IndexArray], ComplexArray]
#: Phase variations of some loops from zero frequency to some frequencies [rad].
Variation = Callable[[FloatArray, IndexArray], FloatArray]

#: A cell with a crossing is refined by secants from this phase variation on [rad]: crossings within it count as one.
_SMALL = 1e-3
#: A cell without a change of sign is dropped from this phase variation on [rad]: the phase touches the level at most.
_TANGENT = 1e-7
_SECANT_STEPS = 4
#: From a cell to begin with to a variation of `_TANGENT`.
_HALVINGS = 23


class Cells(NamedTuple):
    """Intervals of frequency, one an entry.

    Parameters
    ----------
    loop : ndarray of int, shape (n,)
        Which loop the cell belongs to.
    lower, upper : ndarray, shape (n,)
        Ends [rad/s].
    lower_value, upper_value : ndarray of complex, shape (n,)
        M at the ends.
    lower_variation, upper_variation : ndarray, shape (n,)
        Phase variation from zero frequency to the ends [rad].
    """

    loop: IndexArray
    lower: FloatArray
    upper: FloatArray
    lower_value: ComplexArray
    upper_value: ComplexArray
    lower_variation: FloatArray
    upper_variation: FloatArray

    def take(self, which: NDArray[np.bool_]) -> Cells:
        """Return some of the cells.

        Parameters
        ----------
        which : ndarray of bool, shape (n,)

        Returns
        -------
        Cells
        """
        return Cells._make(values[which] for values in self)

    def halved(self, response: Response, variation: Variation) -> Cells:
        """Return both halves of every cell.

        Parameters
        ----------
        response, variation : callable
            See `Response` and `Variation`.

        Returns
        -------
        Cells
        """
        middle = 0.5 * (self.lower + self.upper)
        value, varied = response(middle, self.loop), variation(middle, self.loop)
        first = (self.loop, self.lower, middle, self.lower_value, value, self.lower_variation, varied)
        second = (self.loop, middle, self.upper, value, self.upper_value, varied, self.upper_variation)
        return Cells._make(np.concatenate(pair) for pair in zip(first, second, strict=True))


class Crossings(NamedTuple):
    """Crossings of the positive real axis by M, one an entry.

    Parameters
    ----------
    loop : ndarray of int, shape (n,)
        Which loop.
    frequency : ndarray, shape (n,)
        ω [rad/s].
    value : ndarray, shape (n,)
        M > 0.
    direction : ndarray of int, shape (n,)
        −1 when the phase falls through the level with rising frequency, +1 when it rises.
    """

    loop: IndexArray
    frequency: FloatArray
    value: FloatArray
    direction: IndexArray


def halved_towards(end: float, node: float) -> FloatArray:
    """Return a node and those that halve the way from there to an end again and again.

    Where the phase is that of the level, or next to it, a cell is halved until it is exhausted. With these nodes in the
    cells to begin with, that is one evaluation instead of as many as there are halvings.

    Parameters
    ----------
    end, node : float
        [rad/s].

    Returns
    -------
    ndarray
    """
    nodes = [node]
    for _ in range(_HALVINGS):
        nodes.append(0.5 * (end + nodes[-1]))
    return np.array(nodes)


def positive_real_crossings(response: Response, variation: Variation, cells: Cells) -> Crossings:
    """Find where M(jω) is real and positive.

    Parameters
    ----------
    response, variation : callable
        See `Response` and `Variation`.
    cells : Cells
        Cells to begin with, of any width.

    Returns
    -------
    Crossings
        All crossings in the cells; frequencies to a relative 1e-12.
    """
    found = []
    while len(cells.loop):
        varied = cells.upper_variation - cells.lower_variation
        begin, end = np.angle(cells.lower_value), np.angle(cells.upper_value)
        # Below a quarter turn the difference of the angles is unambiguous and the opposite axis out of reach.
        turn = np.abs(np.angle(cells.upper_value * cells.lower_value.conj()))
        detour = 0.5 * np.maximum(varied - turn, 0.0)
        nearest = np.minimum(np.abs(begin), np.abs(end))
        certain = varied < 0.5 * np.pi
        changes = (begin >= 0.0) != (end >= 0.0)
        changes &= nearest < 0.5 * np.pi
        crossed = certain & changes & (varied < _SMALL)
        exhausted = cells.upper - cells.lower <= 4e-16 * cells.upper
        hopeless = (certain & ~changes & ((nearest > detour + 1e-15) | (varied < _TANGENT))) | (exhausted & ~crossed)
        if crossed.any():
            found.append(cells.take(crossed))
        rest = cells.take(~(crossed | hopeless))
        cells = rest.halved(response, variation) if len(rest.loop) else rest
    if not found:
        empty = np.zeros(0)
        return Crossings(empty.astype(np.intp), empty, empty, empty.astype(np.intp))
    return _polished(response, Cells._make(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _polished(response: Response, cells: Cells) -> Crossings:
    """Refine brackets by secants; over so small a cell the phase is as good as linear."""
    lower, upper = cells.lower, cells.upper
    begin, end = np.angle(cells.lower_value), np.angle(cells.upper_value)
    direction = np.where(begin >= 0.0, -1, 1)
    frequency, value = lower, cells.lower_value
    for _ in range(_SECANT_STEPS):
        slope = end - begin
        share = np.clip(np.divide(-begin, slope, out=np.full_like(slope, 0.5), where=slope != 0.0), 0.0, 1.0)
        frequency = lower + share * (upper - lower)
        value = response(frequency, cells.loop)
        angle = np.angle(value)
        left = (angle >= 0.0) == (begin >= 0.0)
        lower, begin = np.where(left, frequency, lower), np.where(left, angle, begin)
        upper, end = np.where(left, upper, frequency), np.where(left, end, angle)
    return Crossings(cells.loop, frequency, np.abs(value), direction.astype(np.intp))
