"""What shapers need of the identified table: its response from command to achieved acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.protocol import Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.models.held_plant import held_plant
from bmd_rths_core.table.models.plant import Plant

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: A Markov parameter below this part of its bound is 0 but for rounding.
_NO_MARKOV = 1e-9
#: A pole and a zero nearer to each other than this, relatively, cancel.
_CANCEL = 1e-6


class Rational(NamedTuple):
    """gain Π(s − zero) / Π(s − pole).

    Parameters
    ----------
    zeros, poles : ndarray of complex
        [rad/s].
    gain : float
    """

    zeros: ComplexArray
    poles: ComplexArray
    gain: float


class HeldTable(NamedTuple):
    """x[k+1] = A x[k] + B u[k]; the acceleration of the table at the begin of step k is C x[k].

    Parameters
    ----------
    transition : ndarray, shape (m, m)
    command : ndarray, shape (m, 1)
    acceleration : ndarray, shape (1, m)
    """

    transition: FloatArray
    command: FloatArray
    acceleration: FloatArray

    def response(self, angles: FloatArray) -> ComplexArray:
        """Return the response, shape (p,).

        Parameters
        ----------
        angles : ndarray, shape (p,)
            ω Δt [rad].
        """
        identity = np.eye(len(self.transition))
        pencil = np.exp(1j * angles)[:, None, None] * identity - self.transition
        return np.asarray((self.acceleration @ np.linalg.solve(pencil, self.command))[:, 0, 0])


def identified_table(known: Known, scheme: str) -> Plant:
    """Return the identified table.

    Parameters
    ----------
    known : Known
        What is known of the test.
    scheme : str
        Name of the compensator, for the message.

    Returns
    -------
    Plant

    Raises
    ------
    InputError
        No table was identified.
    """
    if known.table is None:
        raise InputError(
            f"identified_model.table: none; scheme {scheme} requires a model of the table that `bmd-rths identify` "
            "wrote"
        )
    return known.table


def held_table(known: Known, scheme: str) -> HeldTable:
    """Return the table with held and delayed commands, without its displacement.

    Parameters
    ----------
    known : Known
        What is known of the test.
    scheme : str
        Name of the compensator, for the message.

    Returns
    -------
    HeldTable

    Raises
    ------
    InputError
        No table was identified.
    """
    plant = held_plant(identified_table(known, scheme), known.command_delay, known.time_step)
    kept = np.delete(np.arange(len(plant.transition)), [plant.displacement, plant.displacement + 1])
    return HeldTable(plant.transition[np.ix_(kept, kept)], plant.command[kept], plant.output[:1, kept])


def transfer_function(plant: Plant) -> Rational:
    """Return the achieved acceleration of the table per command, without the pure delay.

    Parameters
    ----------
    plant : Plant
        Table and specimen.

    Returns
    -------
    Rational
        What cancels is left out.

    Notes
    -----
    With r the relative degree, the zeros are the eigenvalues of the motion that the input u = −c Aʳ x / (c Aʳ⁻¹ b)
    keeps from the output, on the states where c, c A, … c Aʳ⁻¹ vanish (Isidori, "Nonlinear Control Systems",
    1995, ch. 4.3).
    """
    a, b, c, d = plant.a[:-2, :-2], plant.b[:-2], plant.output[:1, :-2], float(plant.feedthrough[0])
    rows: list[FloatArray] = []
    gain, row = d, c
    while gain == 0.0:
        rows.append(row / np.linalg.norm(row))
        markov = (row @ b).item()
        row = row @ a
        if abs(markov) > _NO_MARKOV * np.linalg.norm(rows[-1]) * np.linalg.norm(b) * np.linalg.norm(row) / (
            np.linalg.norm(a)
        ):
            gain = markov
        elif len(rows) > len(a):
            raise InputError("identified_model: the command does not move the table")
    from scipy.linalg import null_space  # as in `integration.discretisation`, not before it is needed

    basis = null_space(np.vstack(rows)) if rows else np.eye(len(a))
    inner = basis.T @ (a - b @ row / gain) @ basis
    return _minimal(np.linalg.eigvals(inner).astype(complex), np.linalg.eigvals(a).astype(complex), gain)


def _minimal(zeros: ComplexArray, poles: ComplexArray, gain: float) -> Rational:
    """Leave out the pairs that cancel, as those of a specimen that does not pull at the table."""
    kept_poles, kept_zeros = list(poles), []
    for zero in zeros:
        distance = [abs(pole - zero) for pole in kept_poles]
        nearest = int(np.argmin(distance)) if distance else -1
        if nearest >= 0 and distance[nearest] <= _CANCEL * abs(zero):
            del kept_poles[nearest]
        else:
            kept_zeros.append(zero)
    return Rational(np.array(kept_zeros, dtype=complex), np.array(kept_poles, dtype=complex), gain)
