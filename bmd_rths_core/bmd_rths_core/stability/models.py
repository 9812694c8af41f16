"""Models of the parts of Eq. 7: numerical and experimental substructure, table, compensator.

Both substructures come as zeros, poles and gain. For a chain of masses these are eigenvalues of smaller chains, so
that no polynomial is ever multiplied out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigvals

from bmd_rths_core.compensators.phase_lead import CommandShaperConfig, transfer_function
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.loop_elements import ComplexArray, DiscreteCompensator, Rational
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.dynamics import SECTION_LENGTH, series
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

FloatArray = NDArray[np.float64]

#: An eigenvalue of Rosenbrock's matrix above this, over the highest frequency, is one at infinity.
_INFINITE_ZERO = 1e6

#: Eq. 9 as rows of ``b2 b1 b0 a2 a1 a0``: the identified table with the 8-story specimen on it.
EQUATION_9: tuple[float, ...] = (
    *(1.0, 1.186, 3051.0, 1.0, 1.108, 2995.0),
    *(1.0, 4.739, 1.06e4, 1.0, 4.567, 1.049e4),
    *(0.0, 0.0, 8960.0, 1.0, 97.46, 8960.0),
    *(0.0, 0.0, 2.13e4, 1.0, 21.07, 2.13e4),
    *(0.0, 0.0, 1.1768e10 / (8960.0 * 2.13e4), 0.0, 1.0, 64.95),
)


@dataclass(frozen=True)
class IdentifiedMode:
    """One identified mode of the experimental substructure.

    Parameters
    ----------
    frequency : float
        ω > 0 [rad/s].
    damping_ratio : float
        ζ > 0.
    effective_mass : float
        Effective modal mass > 0 [kg]. With one mode it cancels in the mass ratio.

    Raises
    ------
    InputError
        A value is not positive.
    """

    frequency: float
    damping_ratio: float
    effective_mass: float = 1.0

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("frequency", "damping_ratio", "effective_mass"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"mode: {name} {value:g} is not allowed; > 0 is required")


def numerical_oscillator(frequency: ArrayLike, damping_ratio: ArrayLike) -> Rational:
    """Return numerical substructures of one degree of freedom, m_N u / f = 1 / (s² + 2 ζ_N ω_N s + ω_N²).

    Parameters
    ----------
    frequency : array_like
        ω_N > 0 [rad/s].
    damping_ratio : array_like
        ζ_N > 0.

    Returns
    -------
    Rational
        Interface displacement from the interface force times m_N [s²]; G_af^N of Eq. 7 is s² / m_N times it. As many
        functions as there are frequencies.

    Raises
    ------
    InputError
        A value is not positive: without damping the open loop is not stable.
    """
    omega, zeta = np.broadcast_arrays(np.asarray(frequency, dtype=float), np.asarray(damping_ratio, dtype=float))
    if not (np.isfinite(omega).all() and np.isfinite(zeta).all() and (omega > 0.0).all() and (zeta > 0.0).all()):
        raise InputError("numerical substructure: frequencies and damping ratios > 0 are required")
    # Both poles from the fast one: of an overdamped oscillator the slow one would be a difference that cancels.
    fast = -omega * (zeta + np.sqrt(zeta.astype(complex) ** 2 - 1.0))
    poles = np.stack((fast, omega**2 / fast), axis=-1)
    return Rational(np.zeros((*omega.shape, 0), dtype=complex), poles, np.ones(omega.shape))


def numerical_building(building: LinearBuilding) -> Rational:
    """Return a numerical substructure of any number of stories as `numerical_oscillator` does.

    Parameters
    ----------
    building : LinearBuilding
        Stories from the ground up; the interface is the topmost floor. m_N is its first effective modal mass.

    Returns
    -------
    Rational
        Interface displacement from the interface force, times m_N [s²].

    Notes
    -----
    The zeros are the eigenvalues of the building with the interface held fast.
    """
    return elastic_numerical_building(building, first_effective_mass(building))


def elastic_numerical_building(building: LinearBuilding, effective_mass: float) -> Rational:
    """Return a numerical substructure as `numerical_building` does, with a given effective mass.

    Parameters
    ----------
    building : LinearBuilding
        For small motion about rest, with P-Delta and any damping.
    effective_mass : float
        m_N of Eq. 8 [kg].

    Returns
    -------
    Rational
        See `numerical_building`.
    """
    mass, damping, stiffness = building.mass_matrix, building.damping_matrix, building.stiffness_matrix
    zeros = _eigenvalues(mass[:-1, :-1], damping[:-1, :-1], stiffness[:-1, :-1])
    return Rational(zeros, _eigenvalues(mass, damping, stiffness), np.asarray(effective_mass / building.interface_mass))


def experimental_building(building: LinearBuilding) -> Rational:
    """Return an experimental substructure with all its modes, −f / (m_E a_table).

    Parameters
    ----------
    building : LinearBuilding
        Stories from the table up. m_E is the first effective modal mass.

    Returns
    -------
    Rational
        Shear on the numerical substructure from the table acceleration, −G_fa^E / m_E of Eq. 7.

    Notes
    -----
    Damping couples the modes here, as it does in the equation of motion; `uncoupled_modes` neglects that.
    With x_b the table displacement and D the dynamic stiffness, −f = (k₁ + c₁ s) x_b det D_free / det D, where D_free
    is the chain without its first story, free at both ends. Its rigid-body motion cancels the s² of the acceleration;
    its other eigenvalues, those of the story drifts, are the zeros, together with −k₁/c₁.
    """
    if not isinstance(building, ShearBuilding) or building.damping is not None:
        return _by_matrices(building)
    m = np.asarray(building.masses)
    k, c = np.asarray(building.stiffnesses), np.asarray(building.damping_coefficients)
    drift = np.diff(np.eye(len(m)), axis=0)
    flexibility = drift @ np.diag(1.0 / m) @ drift.T
    zeros = _companion_eigenvalues(flexibility * c[1:], flexibility * k[1:])
    leading = k[0]
    if c[0] > 0.0:
        zeros, leading = np.append(zeros, -k[0] / c[0]), c[0]
    poles = _eigenvalues(building.mass_matrix, building.damping_matrix, building.stiffness_matrix)
    return Rational(zeros, poles, np.asarray(leading / first_effective_mass(building)))


def experimental_modes(modes: Sequence[IdentifiedMode]) -> Rational:
    """Return an experimental substructure by its identified modes, −f / (m_E a_table).

    Parameters
    ----------
    modes : sequence of IdentifiedMode
        The first one is the dominant mode, whose effective modal mass is m_E.

    Returns
    -------
    Rational
        Σ (mᵢ/m_E) (2 ζᵢ ωᵢ s + ωᵢ²) / (s² + 2 ζᵢ ωᵢ s + ωᵢ²).

    Raises
    ------
    InputError
        There is no mode.
    """
    if not modes:
        raise InputError("experimental substructure: at least one mode is required")
    omega = np.array([mode.frequency for mode in modes])
    damping = 2.0 * np.array([mode.damping_ratio for mode in modes]) * omega
    mass = np.array([mode.effective_mass for mode in modes]) / modes[0].effective_mass
    n = len(modes)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -np.diag(damping)]])
    c = np.concatenate((mass * omega**2, mass * damping))
    gain = float(mass @ damping)
    # Zeros of a strictly proper system with c b = gain: eigenvalues of (1 − b c / c b) A, of which one is 0.
    a_zeros = a.copy()
    a_zeros[n:] -= (c @ a) / gain
    zeros = np.linalg.eigvals(a_zeros)
    zeros = np.delete(zeros, np.argmin(np.abs(zeros)))
    poles = np.linalg.eigvals(a)
    return Rational(zeros.astype(complex), poles.astype(complex), np.asarray(gain))


def uncoupled_modes(building: LinearBuilding) -> tuple[IdentifiedMode, ...]:
    """Return the modes of a building as if they were identified: the coupling of the modes by damping is neglected.

    Parameters
    ----------
    building : LinearBuilding
        Stories from the table up.

    Returns
    -------
    tuple of IdentifiedMode
        All modes, lowest frequency first.

    Raises
    ------
    InputError
        A mode has no damping.
    """
    modes = building.modes()
    values = (modes.frequencies, modes.damping_ratios, modes.effective_masses)
    return tuple(IdentifiedMode(*mode) for mode in zip(*(v.tolist() for v in values), strict=True))


def table_sections(sections: tuple[float, ...] = ()) -> Rational:
    """Return a table made of analog sections in series; without any, the perfect table.

    Parameters
    ----------
    sections : tuple of float
        Rows of six, ``b2 b1 b0 a2 a1 a0``, as `bmd_rths_core.table.models.dynamics.series` takes them.

    Returns
    -------
    Rational
        Achieved from commanded acceleration, G_s of Eq. 7.

    Raises
    ------
    InputError
        See `bmd_rths_core.table.models.dynamics.series`; or a section has no numerator.
    """
    series(sections)  # for its checks
    zeros, poles, gain = [], [], 1.0
    for row in range(0, len(sections), SECTION_LENGTH):
        numerator = np.trim_zeros(np.array(sections[row : row + 3]), "f")
        denominator = np.trim_zeros(np.array(sections[row + 3 : row + 6]), "f")
        if not len(numerator):
            raise InputError(f"table sections row {row // SECTION_LENGTH + 1}: the numerator is 0")
        zeros.append(np.roots(numerator))
        poles.append(np.roots(denominator))
        gain *= numerator[0] / denominator[0]
    none = np.zeros(0, dtype=complex)
    return Rational(np.concatenate((none, *zeros)), np.concatenate((none, *poles)), np.asarray(gain))


def simulated_table(config: SimulatedTableConfig, specimen: LinearBuilding) -> Rational:
    """Return the model of the simulated table, without its pure delay.

    Parameters
    ----------
    config : SimulatedTableConfig
        Table.
    specimen : LinearBuilding
        What stands on it. It matters for an interacting servo alone, and should then be the experimental substructure
        of the same loop: where the two differ, the poles of one are not the zeros of the other.

    Returns
    -------
    Rational
        See `table_sections`. The zeros of an interacting servo are the poles of the specimen on a table at rest.

    Raises
    ------
    InputError
        See `table_sections`.
    """
    if config.dynamics != "interacting_servo":
        table = table_sections(config.own_sections)
        return _as_built(table.zeros, np.append(table.poles, config.mode_poles), table.gain, config)
    zeros = _eigenvalues(specimen.mass_matrix, specimen.damping_matrix, specimen.stiffness_matrix)
    poles = np.asarray(np.linalg.eigvals(config.plant(specimen).a[:-2, :-2]), dtype=complex)
    return _as_built(zeros, poles, np.asarray(config.servo_real_pole * config.servo_frequency**2), config)


def _as_built(zeros: ComplexArray, poles: ComplexArray, gain: FloatArray, config: SimulatedTableConfig) -> Rational:
    """Return a table with its own gain and the zeros of the further mode, whose poles are there already."""
    shared = 1.0 - config.unmodelled_mode if config.unmodelled_mode > 0.0 else 1.0
    return Rational(np.append(zeros, config.mode_zeros), poles, config.command_gain * shared * gain)


def phase_lead_compensator(config: CommandShaperConfig, time_step: float) -> DiscreteCompensator:
    """Return the phase-lead compensator of the command shaper (Eq. 10).

    Parameters
    ----------
    config : CommandShaperConfig
        Weights and lead time.
    time_step : float
        Δt [s].

    Returns
    -------
    DiscreteCompensator
    """
    return DiscreteCompensator(*transfer_function(config, time_step), time_step)


def first_effective_mass(building: LinearBuilding) -> float:
    """Return the effective modal mass of the first mode, m_E or m_N of Eq. 8.

    Parameters
    ----------
    building : LinearBuilding
        Experimental or numerical substructure.

    Returns
    -------
    float
        [kg].
    """
    return float(building.modes().effective_masses[0])


def _by_matrices(building: LinearBuilding) -> Rational:
    """Return −f / (m_E a_table) = 1ᵀ (C s + K) (M s² + C s + K)⁻¹ M 1 / m_E, with the zeros of Rosenbrock's matrix."""
    a, b, c = building.relative_motion()
    output = np.asarray(building.masses) @ c
    scale = float(building.modes().frequencies[-1])
    states = len(a)
    # The velocities in units of `scale` times the displacements, so that all entries are of one size.
    units = np.repeat([1.0, scale], states // 2)
    system = np.block([[a * units / units[:, None] / scale, b / units[:, None]], [output * units, np.zeros((1, 1))]])
    system[-1] /= np.abs(system[-1]).max()
    values = eigvals(system, np.diag([1.0] * states + [0.0]))
    zeros = scale * values[np.isfinite(values) & (np.abs(values) < _INFINITE_ZERO)]
    poles = _eigenvalues(building.mass_matrix, building.damping_matrix, building.stiffness_matrix)
    # At rest the shear is that of the whole mass.
    ratio = np.exp(np.sum(np.log(-poles.astype(complex))) - np.sum(np.log(-zeros.astype(complex)))).real
    return Rational(zeros, poles, np.asarray(building.total_mass * ratio / first_effective_mass(building)))


def _eigenvalues(mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> ComplexArray:
    diagonal = np.diag(mass)
    if np.array_equal(mass, np.diag(diagonal)):
        return _companion_eigenvalues(damping / diagonal[:, None], stiffness / diagonal[:, None])
    solved = np.asarray(np.linalg.solve(mass, np.hstack((damping, stiffness))), dtype=np.float64)
    return _companion_eigenvalues(solved[:, : len(mass)], solved[:, len(mass) :])


def _companion_eigenvalues(damping: FloatArray, stiffness: FloatArray) -> ComplexArray:
    """Return the eigenvalues of s² + s damping + stiffness; scaled, so that all entries are frequencies."""
    n = len(stiffness)
    if n == 0:
        return np.zeros(0, dtype=complex)
    scale = np.sqrt(np.linalg.norm(stiffness, 2))
    companion = np.block([[np.zeros((n, n)), scale * np.eye(n)], [-stiffness / scale, -damping]])
    return np.asarray(np.linalg.eigvals(companion), dtype=complex)
