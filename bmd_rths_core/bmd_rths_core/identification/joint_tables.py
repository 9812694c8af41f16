"""Structures of a table that can be fitted together with its specimen: servos that are pulled at, or sections."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np

from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.dynamics import SECTION_LENGTH, series
from bmd_rths_core.table.models.plant import HydraulicServo, Plant, driven_plant, hydraulic_plant, interacting_plant

#: Parameters of the servo, in front of those of the stories.
SERVO = ("gain", "servo_real_pole", "servo_frequency", "servo_damping_ratio", "platen_mass", "command_delay")

#: Parameters of the hydraulic servo, likewise.
HYDRAULIC_SERVO = ("gain", *HydraulicServo._fields, "command_delay")


def servo_response(frequencies: FloatArray, servo: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
    """Return the response of a servo table that a specimen pulls at, from command to acceleration.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω [rad/s].
    servo : ndarray, shape (6,)
        Values of `SERVO`.
    apparent_mass : ndarray of complex, shape (n,)
        −f / a_t of the specimen [kg].

    Returns
    -------
    ndarray of complex, shape (n,)

    Notes
    -----
    `table.models.plant.interacting_plant` in the frequency domain: with c = p + 2 ζ ω, ω_h² = ω² + 2 ζ ω p,
    K_p ω_h² = p ω² and μ = 1 + apparent mass / M, a_t / u = K_p ω_h² / (μ s² (s + c) + ω_h² (s + K_p)).
    """
    gain, pole, frequency, damping, mass, delay = servo
    s = 1j * frequencies
    oil = frequency**2 + 2.0 * damping * frequency * pole
    closed = (1.0 + apparent_mass / mass) * s**2 * (s + pole + 2.0 * damping * frequency) + oil * s
    numerator = pole * frequency**2
    return np.asarray(gain * numerator * np.exp(-s * delay) / (closed + numerator))


def servo_changes(frequencies: FloatArray, servo: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
    """Return the derivatives of this response over the values of the servo.

    Parameters
    ----------
    frequencies, servo, apparent_mass
        As for `servo_response`.

    Returns
    -------
    ndarray of complex, shape (n, 6)
    """
    gain, pole, frequency, damping, mass, _ = servo
    s = 1j * frequencies
    loaded, leak = (1.0 + apparent_mass / mass) * s**2, pole + 2.0 * damping * frequency
    oil, numerator = frequency**2 + 2.0 * damping * frequency * pole, pole * frequency**2
    denominator = loaded * (s + leak) + oil * s + numerator
    by_pole = 1.0 / pole - (loaded + 2.0 * damping * frequency * s + frequency**2) / denominator
    by_frequency = 2.0 * damping * loaded + 2.0 * (frequency + damping * pole) * s + 2.0 * pole * frequency
    by_damping = -2.0 * frequency * (loaded + pole * s) / denominator
    by_mass = apparent_mass / mass**2 * s**2 * (s + leak) / denominator
    relative = (np.full_like(s, 1.0 / gain), by_pole, 2.0 / frequency - by_frequency / denominator, by_damping, by_mass)
    response = servo_response(frequencies, servo, apparent_mass)
    return np.asarray(response[:, None] * np.column_stack((*relative, -s)))


def hydraulic_response(frequencies: FloatArray, servo: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
    """Return the response of a hydraulic servo table that a specimen pulls at, from command to acceleration.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        ω [rad/s].
    servo : ndarray, shape (9,)
        Values of `HYDRAULIC_SERVO`.
    apparent_mass : ndarray of complex, shape (n,)
        −f / a_t of the specimen [kg].

    Returns
    -------
    ndarray of complex, shape (n,)

    Notes
    -----
    `table.models.plant.hydraulic_plant` in the frequency domain: with μ = 1 + apparent mass / M and the inverse of the
    valve v = (s/ω_v)² + 2 ζ_v s/ω_v + 1, a_t / u = ω_o² K_p / (μ s² (v (s + c) + ω_o² K_d) + ω_o² (v s + K_p)).
    """
    gain, proportional, oil, leak, mass, valve, damping, feedback, delay = servo
    s = 1j * frequencies
    inverse = (s / valve) ** 2 + 2.0 * damping * s / valve + 1.0
    loaded = (1.0 + apparent_mass / mass) * s**2 * (inverse * (s + leak) + oil**2 * feedback)
    numerator = oil**2 * proportional
    return np.asarray(gain * numerator * np.exp(-s * delay) / (loaded + oil**2 * inverse * s + numerator))


def hydraulic_changes(frequencies: FloatArray, servo: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
    """Return the derivatives of this response over the values of the servo.

    Parameters
    ----------
    frequencies, servo, apparent_mass
        As for `hydraulic_response`.

    Returns
    -------
    ndarray of complex, shape (n, 9)
    """
    gain, proportional, oil, leak, mass, valve, damping, feedback, _ = servo
    s = 1j * frequencies
    inverse = (s / valve) ** 2 + 2.0 * damping * s / valve + 1.0
    loaded, column = (1.0 + apparent_mass / mass) * s**2, oil**2
    moved = inverse * (s + leak) + column * feedback
    denominator = loaded * moved + column * (inverse * s + proportional)
    by_inverse = -(loaded * (s + leak) + column * s) / denominator
    relative = (
        np.full_like(s, 1.0 / gain),
        1.0 / proportional - column / denominator,
        2.0 / oil - 2.0 * oil * (loaded * feedback + inverse * s + proportional) / denominator,
        -loaded * inverse / denominator,
        apparent_mass / mass**2 * s**2 * moved / denominator,
        by_inverse * (-2.0 * s**2 / valve**3 - 2.0 * damping * s / valve**2),
        by_inverse * 2.0 * s / valve,
        -loaded * column / denominator,
        -s,
    )
    response = hydraulic_response(frequencies, servo, apparent_mass)
    return np.asarray(response[:, None] * np.column_stack(relative))


class FittedTable(Protocol):
    """A structure of the table, with values to be found.

    Attributes
    ----------
    name : str
        As `identified_model.table` has it.
    names : tuple of str
        Of the values, where each is a parameter of its own.
    """

    name: ClassVar[str]
    names: ClassVar[tuple[str, ...]] = ()

    def response(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the response from command to acceleration.

        Parameters
        ----------
        frequencies : ndarray, shape (n,)
            ω [rad/s].
        values : ndarray, shape (m,)
            Of the structure.
        apparent_mass : ndarray of complex, shape (n,)
            −f / a_t of the specimen [kg].
        """

    def changes(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the derivatives of the response over the values, one a column.

        Parameters
        ----------
        frequencies : ndarray, shape (n,)
            ω [rad/s].
        values : ndarray, shape (m,)
            Of the structure.
        apparent_mass : ndarray of complex, shape (n,)
            −f / a_t of the specimen [kg].
        """

    def plant(self, values: FloatArray, specimen: ShearBuilding) -> tuple[Plant, float]:
        """Return table and specimen as one system, and the pure delay [s].

        Parameters
        ----------
        values : ndarray, shape (m,)
            Of the structure.
        specimen : ShearBuilding
            What stands on the table.
        """


class FittedServo(FittedTable):
    """A third-order servo that the specimen pulls at; its values are those of `SERVO`."""

    name, names = "interacting_servo", SERVO

    def response(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the response of the servo."""
        return servo_response(frequencies, values, apparent_mass)

    def changes(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the derivatives of the servo."""
        return servo_changes(frequencies, values, apparent_mass)

    def plant(self, values: FloatArray, specimen: ShearBuilding) -> tuple[Plant, float]:
        """Return servo and specimen."""
        gain, pole, frequency, damping, mass, delay = values.tolist()
        plant = interacting_plant(pole, frequency, damping, mass, specimen)
        return plant._replace(b=gain * plant.b), delay


class FittedHydraulicServo(FittedTable):
    """A servo with oil column and servovalve that the specimen pulls at; its values are those of `HYDRAULIC_SERVO`."""

    name, names = "hydraulic_servo", HYDRAULIC_SERVO

    def response(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the response of the servo."""
        return hydraulic_response(frequencies, values, apparent_mass)

    def changes(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the derivatives of the servo."""
        return hydraulic_changes(frequencies, values, apparent_mass)

    def plant(self, values: FloatArray, specimen: ShearBuilding) -> tuple[Plant, float]:
        """Return servo and specimen."""
        gain, *servo, delay = values.tolist()
        plant = hydraulic_plant(HydraulicServo(*servo), specimen)
        return plant._replace(b=gain * plant.b), delay


class FittedSections(FittedTable):
    """A table of sections in series, with every coefficient that is neither 0 nor a leading 1 as a value.

    Parameters
    ----------
    sections : tuple of float
        As `simulated_table.sections` has them.
    delay : float
        Pure delay [s].
    """

    name = "sections"

    def __init__(self, sections: tuple[float, ...], delay: float) -> None:
        self._rows, self._delay = np.array(sections).reshape(-1, SECTION_LENGTH), delay
        denominators = self._rows[:, SECTION_LENGTH // 2 :]
        leading = np.zeros_like(self._rows, dtype=bool)
        leading[np.arange(len(self._rows)), SECTION_LENGTH // 2 + np.argmax(denominators != 0.0, axis=1)] = True
        self._free = (self._rows != 0.0) & ~leading
        self.values: FloatArray = self._rows[self._free]

    def response(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the response, which does not depend on the specimen."""
        s = 1j * frequencies
        powers = np.vstack((s**2, s, np.ones_like(s)))
        above, below = np.split(self.rows(values), 2, axis=1)
        return np.asarray(np.prod((above @ powers) / (below @ powers), axis=0) * np.exp(-s * self._delay))

    def changes(self, frequencies: FloatArray, values: FloatArray, apparent_mass: ComplexArray) -> ComplexArray:
        """Return the derivatives over the free coefficients."""
        s = 1j * frequencies
        powers = np.vstack((s**2, s, np.ones_like(s)))
        above, below = (half @ powers for half in np.split(self.rows(values), 2, axis=1))
        response = np.prod(above / below, axis=0) * np.exp(-s * self._delay)
        relative = np.concatenate((powers / above[:, None], -powers / below[:, None]), axis=1)
        return np.asarray(response[:, None] * relative[self._free].T)

    def rows(self, values: FloatArray) -> FloatArray:
        """Return the sections with other values, shape (sections, 6).

        Parameters
        ----------
        values : ndarray, shape (m,)
            Free coefficients.
        """
        rows: FloatArray = self._rows.copy()
        rows[self._free] = values
        return rows

    def plant(self, values: FloatArray, specimen: ShearBuilding) -> tuple[Plant, float]:
        """Return sections and specimen."""
        return driven_plant(series(tuple(self.rows(values).ravel().tolist())), specimen), self._delay

    @property
    def delay(self) -> float:
        """Pure delay [s]."""
        return self._delay
