"""The discrete Riccati equation, at once or in pieces of a fraction of a millisecond, one a step of a running test."""

from __future__ import annotations

from collections.abc import Generator
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Change of the solution, relative to its largest entry, at which the doubling ends.
_CONVERGED = 1e-12
#: 2 to this power steps of the Riccati recursion: a loop that forgets more slowly does not come to an end here.
_LARGEST_POWER = 40

T = TypeVar("T")
#: Work that can be left after every piece, and what comes out of it.
Pieces = Generator[None, None, T]


class RiccatiSolver(Protocol):
    """Solve X = Aᵀ X A − Aᵀ X B (R + Bᵀ X B)⁻¹ Bᵀ X A + Q for the stabilising X."""

    def __call__(self, a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> Pieces[FloatArray]:
        """Return the work.

        Parameters
        ----------
        a : ndarray, shape (n, n)
        b : ndarray, shape (n, m)
        q : ndarray, shape (n, n)
        r : ndarray, shape (m, m)

        Returns
        -------
        generator of ndarray, shape (n, n)

        Raises
        ------
        ValueError, numpy.linalg.LinAlgError
            There is no stabilising solution.
        """


def at_once(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> Pieces[FloatArray]:
    """Solve in one piece, by scipy.

    Parameters
    ----------
    a, b, q, r
        As `RiccatiSolver` has them.
    """
    from scipy.linalg import solve_discrete_are  # not before it is needed

    yield from ()
    return np.asarray(solve_discrete_are(a, b, q, r))


def by_doubling(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> Pieces[FloatArray]:
    """Solve by structure-preserving doubling (Chu, Fan, Lin and Wang 2004, Int. J. Control 77, 767-788).

    Every piece makes twice as many steps of the Riccati recursion as the one before.

    Parameters
    ----------
    a, b, q, r
        As `RiccatiSolver` has them.
    """
    g, h, one = b @ np.linalg.solve(r, b.T), q, np.eye(len(a))
    for _ in range(_LARGEST_POWER):
        yield
        inverse = np.linalg.inv(one + g @ h)
        left = a @ inverse
        following = h + a.T @ h @ inverse @ a
        g, a = g + left @ g @ a.T, left @ a
        change, h = np.abs(following - h).max(), 0.5 * (following + following.T)
        if change <= _CONVERGED * np.abs(h).max():
            return np.asarray(h)
    raise np.linalg.LinAlgError("the doubling does not converge")


def finished(pieces: Pieces[T]) -> T:
    """Do all the work there is, and return what comes out of it.

    Parameters
    ----------
    pieces : generator
        The work.
    """
    while True:
        try:
            next(pieces)
        except StopIteration as end:
            result: T = end.value
            return result
