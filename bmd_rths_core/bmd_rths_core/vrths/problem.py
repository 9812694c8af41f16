"""The benchmark problem of virtual real-time hybrid simulation: its numbers, its building cases and its plants.

Silva, Gomez, Maghareh, Dyke and Spencer (2020), Benchmark control problem for real-time hybrid simulation, Mechanical
Systems and Signal Processing 135, 106381. A frame of three stories, of which a part of the first floor is the
experimental substructure, moved by an actuator. What the interface exchanges is a displacement and a force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError

FloatArray = NDArray[np.float64]

#: Rate of the loop [Hz], and time step [s].
RATE = 4096.0
TIME_STEP = 1.0 / RATE

#: Part of a record that is used.
INTENSITY = 0.4

#: Stiffness of the frame, condensed to the horizontal motion of its three floors, from the actuator up [N/m].
STIFFNESS = np.array(
    [
        [26054883.87960384, -23133938.8771082, 5937035.46333915],
        [-23133938.8771082, 32560774.18638033, -14419970.77723698],
        [5937035.46333915, -14419970.77723699, 9267275.50622431],
    ]
)

#: Mass of every floor [kg], and c11 c12 c13 c22 c23 c33 of the damping [N s/m], by case.
_CASES: dict[int, tuple[float, tuple[float, ...]]] = {
    1: (1000.0, (14084.2757453, -7873.03146091, 440.45149884, 14943.6229379, -6348.67209631, 7223.1013168)),
    2: (1100.0, (11817.42262042, -6606.21542331, 369.67556223, 12538.57756973, -5327.04737379, 6060.31980985)),
    3: (1300.0, (9635.01436336, -5386.0257742, 301.43864014, 10223.00681177, -4343.08470212, 4941.29882487)),
    4: (1000.0, (8450.56544718, -4723.81887655, 264.27089931, 8966.17376274, -3809.20325778, 4333.86079008)),
}
CASES = tuple(_CASES)

#: The experimental substructure: mass [kg], and damping ratio.
SPECIMEN_MASS, SPECIMEN_DAMPING_RATIO = 29.13, 0.0097

#: The actuator: gain of the servo valve, natural velocity feedback, gain of the command, largest force [N].
VALVE_GAIN, VELOCITY_FEEDBACK, COMMAND_GAIN, FORCE_LIMIT = 2.1283e13, 4229700.0, 1.0261, 8900.0

#: Range [V] and step of the acquisition: 18 bit a volt. The transducer of the displacement has 1 V a metre.
RANGE, RESOLUTION = 3.8, 2.0**-18

#: Noise of the transducers of displacement [m²/Hz] and force [N²/Hz]: power of band-limited white noise.
DISPLACEMENT_NOISE, FORCE_NOISE = 6.25e-14, 1.16e-3

#: The chirp of the ground: from and to these frequencies [Hz], in this time [s], with this amplitude [m/s²].
CHIRP_FREQUENCIES, CHIRP_DURATION, CHIRP_AMPLITUDE = (0.1, 40.0), 90.0, 1.0


class Building(NamedTuple):
    """M ẍ + C ẋ + K x = −M_g 1 a_g − f at the first floor, relative to the ground.

    Parameters
    ----------
    mass, damping, stiffness : ndarray, shape (n, n)
        [kg], [N s/m], [N/m].
    moved_mass : ndarray, shape (n, n)
        M_g, which the ground moves: that of the whole building, because the force of the experimental substructure is
        measured relative to the ground [kg].
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    moved_mass: FloatArray

    def motion(self) -> tuple[FloatArray, FloatArray]:
        """Return A and B of ẋ = A x + B u: displacements, then velocities; the inputs are a_g and f.

        Returns
        -------
        a : ndarray, shape (2n, 2n)
        b : ndarray, shape (2n, 2)
        """
        n = len(self.mass)
        force = np.zeros((n, 1))
        force[0] = 1.0
        of_state = np.linalg.solve(self.mass, -np.hstack((self.stiffness, self.damping)))
        of_inputs = np.linalg.solve(self.mass, -np.hstack((self.moved_mass.sum(axis=1, keepdims=True), force)))
        return np.vstack((np.eye(n, 2 * n, n), of_state)), np.vstack((np.zeros((n, 2)), of_inputs))


class PlantParameters(NamedTuple):
    """What differs from one control plant to another.

    Parameters
    ----------
    valve_damping : float
        β₁ [rad/s].
    valve_stiffness : float
        β₂ [rad²/s²].
    leakage : float
        a₃ [rad/s].
    specimen_stiffness : float
        k_E [N/m].
    """

    valve_damping: float = 425.0
    valve_stiffness: float = 99976.0
    leakage: float = 3.3
    specimen_stiffness: float = 1190000.0

    @property
    def specimen_damping(self) -> float:
        """c_E = 2 ζ_E √(k_E m_E) [N s/m]."""
        return 2.0 * SPECIMEN_DAMPING_RATIO * math.sqrt(self.specimen_stiffness * SPECIMEN_MASS)


NOMINAL = PlantParameters()
#: Standard deviations of the parameters of perturbed plants.
_DEVIATIONS = PlantParameters(3.3, 3300.0, 1.3, 50000.0)


class ActuatorModel(NamedTuple):
    """ẋ = A x + B u with the commanded displacement as u, as long as the force is within its limit.

    Parameters
    ----------
    a : ndarray, shape (5, 5)
        The state is flow of the servo valve and its rate, force of the actuator, displacement and velocity, the first
        two in units that make them small numbers: 1e7 and 1e9 [N/s, N/s²].
    b : ndarray, shape (5, 1)
    by_limited_force : ndarray, shape (5,)
        What a newton that the force is above its limit, and so does not act, takes away from ẋ.
    force, displacement : ndarray, shape (5,)
        The force the specimen gets, m_E ẍ + c_E ẋ + k_E x [N], and its displacement [m], of the state.
    """

    a: FloatArray
    b: FloatArray
    by_limited_force: FloatArray
    force: FloatArray
    displacement: FloatArray


def actuator_model(parameters: PlantParameters) -> ActuatorModel:
    """Return servo valve, actuator and experimental substructure in their loop.

    Parameters
    ----------
    parameters : PlantParameters
        Of the plant.

    Notes
    -----
    Valve G_s = a₁β₀ / (s² + β₁ s + β₂) of 1.0261 u − x; force G_a = 1 / (s + a₃) of the valve less a₂ ẋ; the specimen
    m_E ẍ + c_E ẋ + k_E x = force (Silva et al. 2020, Fig. 6).
    """
    flow, rate = 1e7, 1e9
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[0, 1] = rate / flow
    a[1, 0], a[1, 1] = -parameters.valve_stiffness * flow / rate, -parameters.valve_damping
    a[1, 3], b[1, 0] = -VALVE_GAIN / rate, COMMAND_GAIN * VALVE_GAIN / rate
    a[2, 0], a[2, 2], a[2, 4] = flow, -parameters.leakage, -VELOCITY_FEEDBACK
    a[3, 4] = 1.0
    a[4, 2], a[4, 3] = 1.0 / SPECIMEN_MASS, -parameters.specimen_stiffness / SPECIMEN_MASS
    a[4, 4] = -parameters.specimen_damping / SPECIMEN_MASS
    unit = np.eye(5)
    return ActuatorModel(a, b, -a[4, 2] * unit[4], unit[2], unit[3])


def reference_building(case: int) -> Building:
    """Return the building without partition.

    Parameters
    ----------
    case : int
        One of `CASES`.

    Raises
    ------
    InputError
        There is no such case.
    """
    if case not in _CASES:
        raise InputError(f"case {case}: not a building of the benchmark problem; {CASES[0]} to {CASES[-1]} are")
    floor, (c11, c12, c13, c22, c23, c33) = _CASES[case]
    mass = floor * np.eye(3)
    return Building(mass, np.array([[c11, c12, c13], [c12, c22, c23], [c13, c23, c33]]), STIFFNESS, mass)


def numerical_building(case: int, parameters: PlantParameters = NOMINAL) -> Building:
    """Return the numerical substructure: what is left of the building without the experimental one.

    Parameters
    ----------
    case : int
        One of `CASES`.
    parameters : PlantParameters
        Of the plant: the stiffness k_E that its specimen has is not in the numerical substructure.

    Raises
    ------
    InputError
        There is no such case.
    """
    whole = reference_building(case)
    at_actuator = np.zeros((3, 3))
    at_actuator[0, 0] = 1.0
    return Building(
        whole.mass - SPECIMEN_MASS * at_actuator,
        whole.damping - parameters.specimen_damping * at_actuator,
        whole.stiffness - parameters.specimen_stiffness * at_actuator,
        whole.moved_mass,
    )


def perturbed_plants(count: int, seed: int) -> tuple[PlantParameters, ...]:
    """Return drawn plants.

    Parameters
    ----------
    count : int
        How many.
    seed : int
        Of the drawing; the first plants of a longer list are those of a shorter one.
    """
    drawn = np.random.default_rng(seed).standard_normal((count, len(NOMINAL)))
    plants = np.array(NOMINAL) + drawn * np.array(_DEVIATIONS)
    return tuple(PlantParameters(*plant) for plant in plants.tolist())
