"""Model of the specimen from the accelerations of table and floors: modes, and the stories of a shear building.

The modes come from poles that the frequency responses of all floors share, and need no masses. The stiffness and
damping of the stories need the floor masses: the story shears V_i = Σ_{j≥i} m_j a_j = −(k_i + c_i s)(a_i − a_{i−1})/s²
are linear in them (Eq. 5), which gives a first solution. Noise in the drifts biases it. So it is improved to the
maximum likelihood solution for the same noise in all sensors, table included: at each line the measured accelerations,
less their projection on what the building allows, are as small as possible (errors in variables; Pintelon and
Schoukens, "System Identification", 2nd ed., Chapter 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excited_table import Responses
from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray, FrequencyResponse
from bmd_rths_core.identification.rational_fit import RationalFit
from bmd_rths_core.identification.spectral_lines import (
    averaged_response,
    coherence_summary,
    spectral_lines,
    tapered_transform,
)
from bmd_rths_core.structure.shear_building import ShearBuilding

#: Number of the lowest frequencies whose mean tells the sign of a floor, and how far from 1 its size may be there.
_QUASI_STATIC, _AS_MUCH = 4, 0.5


@dataclass(frozen=True)
class SpecimenModel:
    """An identified specimen of n stories.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Natural frequencies of the shared poles [rad/s], the lowest first.
    damping_ratios : ndarray, shape (n,)
        Damping ratios of the shared poles.
    building : ShearBuilding
        Given floor masses with identified story stiffnesses and damping coefficients.
    stiffness_deviations : ndarray, shape (n,)
        Standard deviations of the stiffnesses [N/m].
    damping_deviations : ndarray, shape (n,)
        Standard deviations of the damping coefficients [N s/m].
    measured : FrequencyResponse
        Welch estimate from table to floors within the band, shape (f, n).
    """

    frequencies: FloatArray
    damping_ratios: FloatArray
    building: ShearBuilding
    stiffness_deviations: FloatArray
    damping_deviations: FloatArray
    measured: FrequencyResponse

    def summary(self) -> dict[str, Any]:
        """Return what was found as plain values, frequencies in Hz."""
        return {
            "frequencies_hz": (self.frequencies / (2.0 * np.pi)).tolist(),
            "damping_ratios": self.damping_ratios.tolist(),
            "masses": list(self.building.masses),
            "stiffnesses": list(self.building.stiffnesses),
            "stiffness_deviations": self.stiffness_deviations.tolist(),
            "damping_coefficients": list(self.building.damping_coefficients),
            "damping_deviations": self.damping_deviations.tolist(),
            "coherence": coherence_summary(self.measured),
        }

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return the sections of a configuration that make up this model; the simulated specimen is then the model."""
        return {
            "specimen": {
                "masses": list(self.building.masses),
                "stiffnesses": [float(f"{value:.8g}") for value in self.building.stiffnesses],
                "damping_coefficients": [float(f"{value:.6g}") for value in self.building.damping_coefficients],
                "identified_frequency": float(f"{self.frequencies[0]:.6g}"),
                "identified_damping_ratio": float(f"{self.damping_ratios[0]:.5g}"),
            },
            "simulated_table": {"specimen_stiffness_factor": 1.0},
        }


def identify_specimen(responses: Responses, masses: tuple[float, ...], band: tuple[float, float]) -> SpecimenModel:
    """Identify the specimen on the table.

    Parameters
    ----------
    responses : Responses
        Measured responses.
    masses : tuple of float
        Floor masses from the table up [kg]; stiffnesses and damping coefficients are proportional to their scale.
    band : (float, float)
        Band of the fit [rad/s], which has to contain the modes.

    Returns
    -------
    SpecimenModel

    Raises
    ------
    InputError
        The number of floors is another one, too little of the band is coherent, or no shear building fits.
    """
    if responses.floors.shape[1] != len(masses):
        raise InputError(
            f"specimen: accelerations of {responses.floors.shape[1]} floors were measured, "
            f"the configuration has {len(masses)}"
        )
    measured = averaged_response(responses.table, responses.floors, responses.time_step, band)
    refuse_reversed(measured)
    lines = spectral_lines(responses.table, responses.floors, responses.time_step, measured)
    building, deviations = _stories(responses, np.asarray(masses), measured)
    of_stories = _oscillating(np.asarray(np.linalg.eigvals(building.relative_motion()[0]), dtype=complex))
    first = RationalFit(lines).model_near(of_stories)
    modal = RationalFit(lines.reweighted(first.response(lines.frequencies))).improved(first)
    poles = _oscillating(modal.poles)
    stiffness, damping = np.split(deviations, 2)
    return SpecimenModel(np.abs(poles), -poles.real / np.abs(poles), building, stiffness, damping, measured)


def refuse_reversed(measured: FrequencyResponse) -> None:
    """Refuse floors whose accelerometer has the wrong sign: below their first mode they move with the table.

    Parameters
    ----------
    measured : FrequencyResponse
        Floors over table, shape (n, floors).

    Raises
    ------
    InputError
        A floor moves against the table, as much as the table itself.
    """
    lowest = np.mean(measured.response[:_QUASI_STATIC], axis=0)
    for floor, value in enumerate(lowest.tolist(), 1):
        if value.real < 0.0 and abs(abs(value) - 1.0) < _AS_MUCH:
            hertz = measured.frequencies[0] / (2.0 * np.pi)
            raise InputError(
                f"specimen: floor {floor} moves against the table at {hertz:.2g} Hz, as much as the table; the sign of "
                f"its accelerometer is wrong (sensors.floor_scales[{floor - 1}] has the other one)"
            )


def _oscillating(poles: ComplexArray) -> ComplexArray:
    """Return of each complex pair the pole with positive imaginary part, the lowest frequency first."""
    upper = poles[poles.imag > 0.0]
    if 2 * len(upper) != len(poles):
        raise InputError(f"specimen: only {len(upper)} of {len(poles) // 2} modes oscillate; a wider band may help")
    return np.asarray(upper[np.argsort(np.abs(upper))])


def _stories(responses: Responses, masses: FloatArray, measured: FrequencyResponse) -> tuple[ShearBuilding, FloatArray]:
    """Return the building and the standard deviations of its stiffnesses and damping coefficients."""
    sensors = np.column_stack((responses.table, responses.floors))
    frequencies, spectra = tapered_transform(sensors, responses.time_step, measured)
    s: ComplexArray = np.asarray(1j * frequencies)
    first = _first_solution(measured, masses)

    def residual(factors: FloatArray) -> FloatArray:
        across = _across(floor_transmissibility(s, masses, factors * first), spectra)[0]
        return np.concatenate((across.real.ravel(), across.imag.ravel()))

    def jacobian(factors: FloatArray) -> FloatArray:
        directions, change = transmissibility_changes(s, masses, factors * first)
        across, along, unit = _across(directions, spectra)
        along_change = np.einsum("lf,lfp->lp", unit.conj(), change)
        back = np.einsum("lfp,lf->lp", change.conj(), across)
        moved = along[..., None] * (change - directions[..., None] * along_change[:, None])
        rows = -(moved + unit[..., None] * back[:, None]).reshape(-1, len(first)) * first
        return np.vstack((rows.real, rows.imag))

    solution = least_squares(residual, np.ones(len(first)), jacobian, x_scale="jac", method="trf")
    found = solution.x * first
    stories = len(masses)
    if (found[:stories] <= 0.0).any():
        raise InputError("specimen: no shear building with the given masses fits the measured floor accelerations")
    # Of the stories + 1 complex values of a line one is the unknown motion of the table.
    variance = 2.0 * solution.cost / (2 * stories * len(s) - len(found))
    deviations = np.abs(first) * np.sqrt(variance * np.diag(np.linalg.inv(solution.jac.T @ solution.jac)))
    damping = tuple(max(0.0, float(c)) for c in found[stories:])
    return ShearBuilding(tuple(masses.tolist()), tuple(found[:stories].tolist()), damping), deviations


def _first_solution(measured: FrequencyResponse, masses: FloatArray) -> FloatArray:
    """Return k and c of each story by linear least squares on the averaged responses."""
    s: ComplexArray = np.asarray(1j * measured.frequencies)
    above_table = np.column_stack((np.ones(len(s)), measured.response))
    solution = []
    for i in range(len(masses)):
        shear = above_table[:, i + 1 :] @ masses[i:]
        drift = (above_table[:, i + 1] - above_table[:, i]) / s**2
        # A drift derived from accelerations has an error that grows to low frequency: weights as for accelerations.
        weight = measured.frequencies**2 * measured.coherence.min(axis=1)
        columns = -np.column_stack((drift, s * drift)) * weight[:, None]
        rows, right = np.vstack((columns.real, columns.imag)), shear * weight
        scale = np.linalg.norm(rows, axis=0)
        values = np.linalg.lstsq(rows / scale, np.concatenate((right.real, right.imag)), rcond=None)[0] / scale
        # The smallest damping keeps the relative change of a later search meaningful.
        solution.append((abs(values[0]), max(values[1], 1e-5 * abs(values[0]))))
    return np.asarray(np.transpose(solution).ravel(), dtype=np.float64)


def floor_transmissibility(s: ComplexArray, masses: FloatArray, values: FloatArray) -> ComplexArray:
    """Return absolute accelerations per acceleration of the table.

    Parameters
    ----------
    s : ndarray of complex, shape (lines,)
        jω [rad/s].
    masses : ndarray, shape (n,)
        Floor masses [kg].
    values : ndarray, shape (2n,)
        Stiffnesses [N/m] and damping coefficients [N s/m].

    Returns
    -------
    ndarray of complex, shape (lines, n + 1)
        1 for the table, then the floors.
    """
    return _from_the_table(_story_ratios(s, masses, values)[0])


def transmissibility_changes(
    s: ComplexArray, masses: FloatArray, values: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the same with its derivatives over every stiffness and damping coefficient.

    Parameters
    ----------
    s, masses, values
        As for `floor_transmissibility`.

    Returns
    -------
    transmissibility : ndarray of complex, shape (lines, n + 1)
    changes : ndarray of complex, shape (lines, n + 1, 2n)
    """
    stories = len(masses)
    ratios, dynamic = _story_ratios(s, masses, values)
    floors = _from_the_table(ratios)
    logarithmic = np.zeros((len(s), stories + 1, stories), dtype=complex)
    for j in range(stories):
        # A story changes its own ratio, and by the mass that it carries those below.
        logarithmic[:, j + 1, j] = (1.0 - ratios[:, j]) / (ratios[:, j] * dynamic[:, j])
        carried = (1.0 - ratios[:, j]) ** 2 / s**2
        for i in range(j - 1, -1, -1):
            logarithmic[:, i + 1, j] = -(s**2) * carried / dynamic[:, i]
            carried = carried * ratios[:, i] ** 2
    by_impedance = floors[..., None] * np.cumsum(logarithmic, axis=1)
    return floors, np.concatenate((by_impedance, s[:, None, None] * by_impedance), axis=2)


def _story_ratios(s: ComplexArray, masses: FloatArray, values: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the acceleration above over that below every story, and the dynamic stiffness it has above it."""
    stories = len(masses)
    ratios, dynamic = np.empty((2, len(s), stories), dtype=complex)
    carried: ComplexArray = np.zeros(len(s), dtype=complex)
    for i in range(stories - 1, -1, -1):
        impedance = values[i] + s * values[stories + i]
        carried = carried + masses[i]
        dynamic[:, i] = impedance + s**2 * carried
        ratios[:, i] = impedance / dynamic[:, i]
        carried = carried * ratios[:, i]
    return ratios, dynamic


def _from_the_table(ratios: ComplexArray) -> ComplexArray:
    floors: ComplexArray = np.ones((len(ratios), 1 + ratios.shape[1]), dtype=complex)
    for i in range(ratios.shape[1]):
        floors[:, i + 1] = floors[:, i] * ratios[:, i]
    return floors


def _across(directions: ComplexArray, spectra: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return what of the spectra has not the directions, how much has, and the directions over their square."""
    unit = directions / np.sum(np.abs(directions) ** 2, axis=1, keepdims=True)
    along = np.sum(unit.conj() * spectra, axis=1, keepdims=True)
    return spectra - directions * along, along, unit
