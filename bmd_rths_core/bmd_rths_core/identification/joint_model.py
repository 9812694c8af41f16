"""Table and specimen fitted together, as compensators need them: a servo that the specimen pulls at, and its floors.

A transfer function of the table alone freezes the pull of the specimen in its zeros: it is right for the specimen it
was identified with, and wrong as soon as that one changes. Here the poles of the servo, the mass of the platen, gain
and delay are fitted together with stiffness and damping of every story. The command is known exactly, so that the
maximum likelihood solution for the same white noise in all accelerometers is output-error least squares over all lines
(Pintelon and Schoukens, "System Identification", 2nd ed., Chapter 8). Its covariance is what a Monte Carlo study draws
from. Where a table is no such servo, the sections that were identified and the same specimen are taken instead: the
Bayesian information criterion decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from bmd_rths_core.identification.excited_table import Responses
from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray, hold
from bmd_rths_core.identification.joint_tables import (
    FittedHydraulicServo,
    FittedSections,
    FittedServo,
    FittedTable,
)
from bmd_rths_core.identification.specimen_model import SpecimenModel, floor_transmissibility
from bmd_rths_core.identification.spectral_lines import TAPER, averaged_response, tapered_transform
from bmd_rths_core.identification.table_model import TableModel
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import SimulationFromRest
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.held_plant import held_plant
from bmd_rths_core.table.models.plant import Plant

#: Where the search begins [rad/s, 1, kg over that of the specimen].
_FIRST_POLES, _FIRST_DAMPING, _FIRST_MASSES = ((40.0, 120.0), (60.0, 200.0)), 0.1, (1.0, 4.0)
_FIRST_DELAY = 1e-3
_EVALUATIONS = 60
#: A servo that leaves so many times what the sections leave, with stories that are kept, is no servo.
_COMPETES = 2.0
#: The same by simulation, where nothing leaks and both leave less: a servo far behind does not catch up.
_COMPETES_SIMULATED = 10.0
#: Displacement and force are compared above this frequency, where drift is small [rad/s].
_ABOVE_DRIFT = 2.0 * np.pi * 5.0


@dataclass(frozen=True)
class JointModel:
    """A table and the specimen on it, fitted together.

    Parameters
    ----------
    table : str
        ``"interacting_servo"``, ``"hydraulic_servo"`` or ``"sections"``.
    servo : dict of str to float
        Values of the table by name; empty for sections.
    servo_deviations : dict of str to float
        Their standard deviations.
    sections : tuple of float
        Rows of the table, with `command_delay`, where it is no servo.
    command_delay : float
        Pure delay [s].
    building : ShearBuilding
        The specimen.
    stiffness_deviations, damping_deviations : ndarray, shape (n,)
        Standard deviations [N/m, N s/m].
    fit_error : float
        Root mean square of measured less modelled accelerations over that of the measured.
    noise : dict of str to float
        Measured noise of the sensors, root mean square: ``acceleration_noise`` and, where they were recorded,
        ``displacement_noise`` and ``shear_noise``.
    """

    table: str
    servo: dict[str, float]
    servo_deviations: dict[str, float]
    sections: tuple[float, ...]
    command_delay: float
    building: ShearBuilding
    stiffness_deviations: FloatArray
    damping_deviations: FloatArray
    fit_error: float
    noise: dict[str, float]

    def summary(self) -> dict[str, Any]:
        """Return what was found as plain values."""
        return {
            "table": self.table,
            "fit_error_percent": 100.0 * self.fit_error,
            "servo": self.servo,
            "servo_deviations": self.servo_deviations,
            "stiffnesses": list(self.building.stiffnesses),
            "stiffness_deviations": self.stiffness_deviations.tolist(),
            "damping_coefficients": list(self.building.damping_coefficients),
            "damping_deviations": self.damping_deviations.tolist(),
            "noise": self.noise,
        }

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return the section of a configuration that holds this model."""
        values: dict[str, Any] = {"table": self.table, "command_delay": float(f"{self.command_delay:.6g}")}
        values |= {name: float(f"{value:.6g}") for name, value in self.servo.items()}
        if self.table == "sections":
            values["sections"] = list(self.sections)
        values["stiffnesses"] = [float(f"{value:.8g}") for value in self.building.stiffnesses]
        values["damping_coefficients"] = [float(f"{value:.6g}") for value in self.building.damping_coefficients]
        deviations = {
            "table": list(self.servo_deviations.values()),
            "stiffness": self.stiffness_deviations.tolist(),
            "damping": self.damping_deviations.tolist(),
        }
        values |= {f"{name}_deviations": [float(f"{v:.3g}") for v in own] for name, own in deviations.items() if own}
        values |= {name: float(f"{value:.4g}") for name, value in self.noise.items()}
        return {"identified_model": values}


def identify_joint(
    responses: Responses, table: TableModel, specimen: SpecimenModel, band: tuple[float, float]
) -> JointModel:
    """Fit table and specimen together.

    Parameters
    ----------
    responses : Responses
        Measured responses.
    table : TableModel
        The table alone, from the same responses.
    specimen : SpecimenModel
        The specimen alone, from the same responses; its masses are kept.
    band : (float, float)
        Band of the fit [rad/s].

    Returns
    -------
    JointModel
    """
    lines = _Lines(responses, band)
    masses = np.asarray(specimen.building.masses)
    stories = np.concatenate((specimen.building.stiffnesses, np.maximum(specimen.building.damping_coefficients, 1.0)))
    sections = FittedSections(table.sections, table.rational.delay)
    chain = _table_fit(lines, sections, sections.values, masses, stories)
    fits: list[tuple[_Fit, FittedTable]] = []

    def left(table: FittedTable, fit: _Fit) -> float:
        simulated = _simulation(lines, table, len(fit.values), masses)(np.concatenate((fit.values, stories)))
        return float(np.sum(np.abs(simulated) ** 2))

    simpler = np.inf
    for servo, starts in ((FittedServo(), _starts(masses)), (FittedHydraulicServo(), _hydraulic_starts(masses))):
        alone = min((_table_fit(lines, servo, first, masses, stories) for first in starts), key=_Fit.cost)
        competes = alone.cost() < _COMPETES * chain.cost() and alone.criterion() < simpler
        if competes and left(servo, alone) < _COMPETES_SIMULATED * left(sections, chain):
            fits.append((_joint_fit(lines, servo, alone.values, masses, stories), servo))
        simpler = alone.criterion()
    fits.append((_joint_fit(lines, sections, chain.values, masses, stories), sections))
    return _model(lines, masses, *min(fits, key=lambda pair: pair[0].criterion()))


class _Lines:
    """Spectra of everything that was measured, within the band."""

    def __init__(self, responses: Responses, band: tuple[float, float]) -> None:
        averaged = averaged_response(responses.command, responses.table[:, None], responses.time_step, band)
        columns = np.column_stack((responses.command, responses.table, responses.floors))
        self.frequencies, spectra = tapered_transform(columns, responses.time_step, averaged)
        self.s: ComplexArray = np.asarray(1j * self.frequencies)
        self.command = spectra[:, 0] * hold(self.frequencies, responses.time_step)
        self.accelerations = spectra[:, 1:]
        # White noise of unit variance has this power in a line.
        length = len(responses.command)
        from scipy.signal.windows import tukey  # as in `frequency_response`

        self._window = tukey(length, min(1.0, 2.0 * TAPER / (length * responses.time_step)))
        self.power = float(np.sum(self._window**2))
        self.unit = float(np.sqrt(self.power))
        self._commands, self._time_step = responses.command, responses.time_step
        lines = 2.0 * np.pi * np.fft.rfftfreq(length, responses.time_step)
        self._inside = (lines >= averaged.frequencies[0]) & (lines <= averaged.frequencies[-1])
        drives = {"displacement_noise": responses.displacement, "shear_noise": responses.shear}
        self.drives = {
            name: tapered_transform(signal[:, None], responses.time_step, averaged)[1][:, 0]
            for name, signal in drives.items()
            if signal is not None and np.isfinite(signal).all()
        }

    def difference(self, table: ComplexArray, directions: ComplexArray) -> ComplexArray:
        """Return measured less modelled accelerations, in units of white noise.

        Parameters
        ----------
        table : ndarray of complex, shape (lines,)
            From command to acceleration of the table.
        directions : ndarray of complex, shape (lines, n + 1)
            Accelerations per acceleration of the table.

        Returns
        -------
        ndarray of complex, shape (lines, n + 1)
        """
        return np.asarray((self.accelerations - (table * self.command)[:, None] * directions) / self.unit)

    def simulated_difference(self, plant: Plant, delay: float) -> ComplexArray:
        """Return the same for a plant that is simulated with the recorded command: nothing leaks at the ends."""
        held = held_plant(plant, delay, self._time_step)
        moving = np.delete(np.arange(len(held.transition)), [held.displacement, held.displacement + 1])
        a, b = held.transition[np.ix_(moving, moving)], held.command[moving]
        rows = held.output[:-1][:, moving]
        simulated = SimulationFromRest(DiscreteStateSpace(a, b, rows @ a, rows @ b)).outputs(self._commands)
        spectra = np.fft.rfft(self._window * simulated)[:, self._inside].T
        return np.asarray((self.accelerations - spectra) / self.unit)


@dataclass(frozen=True)
class _Fit:
    """Values of the table and then of the stories, their standard deviations, and the spectra that are left over."""

    values: FloatArray
    deviations: FloatArray
    difference: ComplexArray

    def cost(self) -> float:
        """Return the sum of squares."""
        return float(np.sum(np.abs(self.difference) ** 2))

    def criterion(self) -> float:
        """Return the Bayesian information criterion."""
        count = 2 * self.difference.size
        return float(count * np.log(self.cost() / count) + len(self.values) * np.log(count))


def _starts(masses: FloatArray) -> list[FloatArray]:
    total = float(masses.sum())
    return [
        np.array([1.0, pole, frequency, _FIRST_DAMPING, mass * total, _FIRST_DELAY])
        for pole, frequency in _FIRST_POLES
        for mass in _FIRST_MASSES
    ]


def _hydraulic_starts(masses: FloatArray) -> list[FloatArray]:
    total = float(masses.sum())
    return [
        np.array([1.0, 40.0, 160.0, 5.0, mass * total, valve, 0.7, 1e-3, _FIRST_DELAY])
        for mass in _FIRST_MASSES
        for valve in (100.0, 300.0)
    ]


def _table_fit(lines: _Lines, table: FittedTable, first: FloatArray, masses: FloatArray, stories: FloatArray) -> _Fit:
    """Return the table that fits best with stories that are kept."""
    directions = floor_transmissibility(lines.s, masses, stories)
    apparent = directions[:, 1:] @ masses
    # No table changes what is not along the directions, which is left out of the search.
    size = np.linalg.norm(directions, axis=1)
    along = np.sum(directions.conj() * lines.accelerations, axis=1) / size
    command = lines.command * size

    def residual(values: FloatArray) -> ComplexArray:
        return np.asarray((along - table.response(lines.frequencies, values, apparent) * command) / lines.unit)

    def jacobian(values: FloatArray) -> ComplexArray:
        return np.asarray(-table.changes(lines.frequencies, values, apparent) * (command / lines.unit)[:, None])

    values, deviations = _least_squares(first, residual, jacobian)
    response = table.response(lines.frequencies, values, apparent)
    return _Fit(values, deviations, lines.difference(response, directions))


def _joint_fit(lines: _Lines, table: FittedTable, first: FloatArray, masses: FloatArray, stories: FloatArray) -> _Fit:
    """Return table and stories that fit best together, by simulation of the whole record."""
    difference = _simulation(lines, table, len(first), masses)
    values, deviations = _least_squares(np.concatenate((first, stories)), difference)
    return _Fit(values, deviations, difference(values))


def _simulation(
    lines: _Lines, table: FittedTable, count: int, masses: FloatArray
) -> Callable[[FloatArray], ComplexArray]:
    """Return the function of `count` values of the table and those of the stories that tells what is left over."""

    def difference(values: FloatArray) -> ComplexArray:
        own, of_stories = np.split(values, [count])
        stiffness, damping = np.split(of_stories, 2)
        specimen = ShearBuilding(tuple(masses.tolist()), tuple(stiffness.tolist()), tuple(damping.tolist()))
        return lines.simulated_difference(*table.plant(own, specimen))

    return difference


def _least_squares(
    first: FloatArray,
    difference: Callable[[FloatArray], ComplexArray],
    jacobian: Callable[[FloatArray], ComplexArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the values that leave least, and their deviations, searched relative to the first ones; no sign changes.

    Without a Jacobian it is found by small changes.
    """

    def residual(factors: FloatArray) -> FloatArray:
        left = difference(factors * first).ravel()
        return np.concatenate((left.real, left.imag))

    def derivatives(factors: FloatArray) -> FloatArray:
        assert jacobian is not None
        change = jacobian(factors * first).reshape(-1, len(first)) * first
        return np.vstack((change.real, change.imag))

    solution = least_squares(
        residual,
        np.ones(len(first)),
        "2-point" if jacobian is None else derivatives,
        bounds=(0.0, np.inf),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
    )
    variance = 2.0 * solution.cost / (len(solution.fun) - len(first))
    size = np.maximum(np.linalg.norm(solution.jac, axis=0), 1e-30)
    scaled = solution.jac / size
    spread = np.sqrt(variance * np.diag(np.linalg.pinv(scaled.T @ scaled)).clip(0.0)) / size
    return solution.x * first, np.abs(first) * spread


def _model(lines: _Lines, masses: FloatArray, fit: _Fit, table: FittedTable) -> JointModel:
    """Return the model of a fit."""
    own = 2 * len(masses)
    stiffness, damping = np.split(fit.values[-own:], 2)
    of_stiffness, of_damping = np.split(fit.deviations[-own:], 2)
    servo = dict(zip(table.names, fit.values.tolist(), strict=False))
    spread = dict(zip(table.names, fit.deviations.tolist(), strict=False))
    sections = table if isinstance(table, FittedSections) else None
    measured = float(np.sum(np.abs(lines.accelerations) ** 2)) / lines.power
    return JointModel(
        table=table.name,
        command_delay=servo.pop("command_delay") if sections is None else sections.delay,
        servo=servo,
        servo_deviations=spread,
        sections=() if sections is None else tuple(sections.rows(fit.values[:-own]).ravel().tolist()),
        building=ShearBuilding(tuple(masses.tolist()), tuple(stiffness.tolist()), tuple(damping.tolist())),
        stiffness_deviations=of_stiffness,
        damping_deviations=of_damping,
        fit_error=float(np.sqrt(fit.cost() / measured)),
        noise=_noise(lines, fit, masses),
    )


def _noise(lines: _Lines, fit: _Fit, masses: FloatArray) -> dict[str, float]:
    """Return the noise of the sensors: what no model of table and specimen explains of their signals."""
    noise = {"acceleration_noise": float(np.sqrt(np.mean(np.abs(fit.difference) ** 2)))}
    modelled = lines.accelerations / lines.unit - fit.difference
    explained = {
        "displacement_noise": -modelled[:, 0] / lines.frequencies**2,
        "shear_noise": -modelled[:, 1:] @ masses,
    }
    high = lines.frequencies > _ABOVE_DRIFT
    for name, spectrum in lines.drives.items():
        left = spectrum / lines.unit - explained[name]
        noise[name] = float(np.sqrt(np.mean(np.abs(left[high]) ** 2)))
    return noise
