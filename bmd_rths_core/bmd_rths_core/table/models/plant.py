"""Table and specimen as one linear system, from the command to what can be measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.models.dynamics import StateSpace

FloatArray = NDArray[np.float64]


class Plant(NamedTuple):
    """ẋ = A x + B u, y = C x + D u with the acceleration command as u.

    Parameters
    ----------
    a : ndarray, shape (m, m)
        The last two states are displacement [m] and velocity [m/s] of the table, on which nothing else depends.
    b : ndarray, shape (m, 1)
    output : ndarray, shape (n + 2, m)
        Rows: absolute acceleration of the table and of n floors [m/s²], displacement of the table [m].
    feedthrough : ndarray, shape (n + 2,)
    """

    a: FloatArray
    b: FloatArray
    output: FloatArray
    feedthrough: FloatArray


def driven_plant(table: StateSpace, specimen: LinearBuilding) -> Plant:
    """Return a table that moves as if nothing stood on it, and drives its specimen.

    Parameters
    ----------
    table : StateSpace
        From the command to the achieved acceleration.
    specimen : LinearBuilding
        n floors.

    Returns
    -------
    Plant
    """
    n_table = len(table.a)
    a = np.zeros((n_table, n_table + 2 * specimen.stories))
    a[:, :n_table] = table.a
    acceleration = np.zeros(n_table + 2 * specimen.stories)
    acceleration[:n_table] = table.c[0]
    return _with_specimen(a, table.b[:, 0], acceleration, table.d, specimen)


def interacting_plant(
    real_pole: float, frequency: float, damping_ratio: float, platen_mass: float, specimen: LinearBuilding
) -> Plant:
    """Return a displacement-controlled servo table that its specimen pulls at: control-structure interaction.

    Parameters
    ----------
    real_pole, frequency, damping_ratio : float
        Poles of the table alone: −p, and the pair with ω [rad/s] and ζ.
    platen_mass : float
        Mass of platen and piston M > 0 [kg].
    specimen : LinearBuilding
        n floors.

    Returns
    -------
    Plant

    Notes
    -----
    M ẍ = A P − Σ mᵢ aᵢ, with the oil pressure per mass y = A P / M that follows from the flow of a proportional
    displacement loop, ẏ = ω_h² (K_p (r − x) − ẋ) − c y (Dyke, Spencer, Quast and Sain 1995, J. Engrg. Mech. 121,
    322-338). Without a specimen the poles of x / r are those given when c = p + 2 ζ ω, ω_h² = ω² + 2 ζ ω p and
    K_p ω_h² = p ω². The states are w = K_p (ṙ − ẋ), z = K_p (r − x) − ẋ and y, so that the integrals of the command
    do not appear. The real part of ẋ per force is ω² ω_h² (c − K_p) over a square, and c > p > K_p: the table takes
    energy at every frequency, so that it is stable with any specimen on it.
    """
    size = 3 + 2 * specimen.stories
    oil = frequency**2 + 2.0 * damping_ratio * frequency * real_pole
    gain = real_pole * frequency**2 / oil
    floors = specimen.relative_motion()[2]
    acceleration = np.zeros(size)
    acceleration[2] = 1.0
    acceleration[3:] = -np.asarray(specimen.masses) @ floors / platen_mass
    a = np.zeros((3, size))
    a[0] = -gain * acceleration
    a[1] = -acceleration
    a[1, 0] += 1.0
    a[2, 1], a[2, 2] = oil, -(real_pole + 2.0 * damping_ratio * frequency)
    return _with_specimen(a, np.array([gain, 0.0, 0.0]), acceleration, 0.0, specimen)


class HydraulicServo(NamedTuple):
    """A displacement-controlled table with oil column and servovalve.

    Parameters
    ----------
    proportional_gain : float
        K_p, valve velocity per displacement error [1/s].
    oil_frequency : float
        ω_o of platen and oil column [rad/s].
    leakage_rate : float
        c, share of the load pressure that leaks in a second [1/s].
    platen_mass : float
        Mass of platen and piston M > 0 [kg].
    valve_frequency : float
        ω_v of the servovalve [rad/s].
    valve_damping_ratio : float
        ζ_v of the servovalve [1].
    pressure_feedback : float
        K_d, valve velocity per acceleration that the load pressure gives the platen [s].
    """

    proportional_gain: float
    oil_frequency: float
    leakage_rate: float
    platen_mass: float
    valve_frequency: float
    valve_damping_ratio: float
    pressure_feedback: float


def hydraulic_plant(servo: HydraulicServo, specimen: LinearBuilding) -> Plant:
    """Return a hydraulic servo table, its valve not infinitely fast, that its specimen pulls at.

    Parameters
    ----------
    servo : HydraulicServo
        The table.
    specimen : LinearBuilding
        n floors.

    Returns
    -------
    Plant

    Notes
    -----
    As `interacting_plant`, with ẏ = ω_o² (q − ẋ) − c y and the opening of the valve q as the velocity it gives without
    load, q̈ = ω_v² (K_p (r − x) − K_d y − q) − 2 ζ_v ω_v q̇ (Merritt 1967, "Hydraulic Control Systems", ch. 6; Conte and
    Trombetti 2000, Earthq. Eng. Struct. Dyn. 29, 1041-1063). The states are w = K_p (ṙ − ẋ), z = K_p (r − x) − ẋ, q̇,
    q − ẋ and y. Unlike the servo without a valve it is not stable with any values.
    """
    size = 5 + 2 * specimen.stories
    acceleration = np.zeros(size)
    acceleration[4] = 1.0
    acceleration[5:] = -np.asarray(specimen.masses) @ specimen.relative_motion()[2] / servo.platen_mass
    valve = servo.valve_frequency
    a = np.zeros((5, size))
    a[0] = -servo.proportional_gain * acceleration
    a[1] = a[3] = -acceleration
    a[1, 0] += 1.0
    a[2, 1:5] = valve**2 * np.array([1.0, -2.0 * servo.valve_damping_ratio / valve, -1.0, -servo.pressure_feedback])
    a[3, 2] += 1.0
    a[4, 3], a[4, 4] = servo.oil_frequency**2, -servo.leakage_rate
    return _with_specimen(a, np.array([servo.proportional_gain, 0.0, 0.0, 0.0, 0.0]), acceleration, 0.0, specimen)


def commanded_through(filtered: StateSpace, plant: Plant) -> Plant:
    """Return a plant whose command goes through something first.

    Parameters
    ----------
    filtered : StateSpace
        From the command to what acts as command.
    plant : Plant
        Table and specimen.

    Returns
    -------
    Plant
    """
    first, size = len(filtered.a), len(filtered.a) + len(plant.a)
    a, b = np.zeros((size, size)), np.vstack((filtered.b, plant.b * filtered.d))
    a[:first, :first], a[first:, first:] = filtered.a, plant.a
    a[first:, :first] = plant.b @ filtered.c
    output = np.hstack((np.outer(plant.feedthrough, filtered.c[0]), plant.output))
    return Plant(a, b, output, plant.feedthrough * filtered.d)


def _with_specimen(
    table: FloatArray, by_command: FloatArray, acceleration: FloatArray, feedthrough: float, specimen: LinearBuilding
) -> Plant:
    """Add the specimen, driven by the acceleration of the table, and the displacement of the table.

    The rows of `table` and `acceleration` are over the states of the table and then those of the specimen.
    """
    floors_a, floors_b, floors_c = specimen.relative_motion()
    n_table, size = table.shape[0], table.shape[1] + 2
    floors = slice(n_table, size - 2)
    a, b = np.zeros((size, size)), np.zeros((size, 1))
    a[:n_table, :-2], b[:n_table, 0] = table, by_command
    a[floors, :-2] = floors_b * acceleration
    a[floors, floors] += floors_a
    b[floors] = floors_b * feedthrough
    a[-2, -1] = 1.0
    a[-1, :-2], b[-1] = acceleration, feedthrough
    output = np.zeros((specimen.stories + 2, size))
    output[0, :-2] = acceleration
    output[1:-1, floors] = floors_c
    output[-1, -2] = 1.0
    through = np.zeros(specimen.stories + 2)
    through[0] = feedthrough
    return Plant(a, b, output, through)
