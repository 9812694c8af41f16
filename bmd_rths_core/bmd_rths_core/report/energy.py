"""Energy of the numerical substructure over a run, and what the interface brings into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.report.numerical_motion import NumericalMotion, stability_indicator
from bmd_rths_core.structure.nonlinear_building import nonlinear_building

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyHistory:
    """Energies relative to the ground, from rest: input + interface = kinetic + springs + dampers.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    ground_input : ndarray, shape (N,)
        −∫ Σ mᵢ a_g u̇ᵢ dt [J].
    interface : ndarray, shape (N,)
        Work of the shear fed back, ∫ f u̇ₙ dt [J]. A passive specimen on a perfect table takes energy.
    kinetic : ndarray, shape (N,)
        ½ u̇ᵀ M u̇ [J].
    springs : ndarray, shape (N,)
        Work into the stories: stored, and dissipated where they yield [J].
    dampers : ndarray, shape (N,)
        ∫ u̇ᵀ C u̇ dt [J].
    indicator : ndarray, shape (N,)
        Stability indicator [1].
    indicator_limit : float
        Its limit [1].
    """

    time: FloatArray
    ground_input: FloatArray
    interface: FloatArray
    kinetic: FloatArray
    springs: FloatArray
    dampers: FloatArray
    indicator: FloatArray
    indicator_limit: float

    @property
    def largest_indicator(self) -> float:
        """Largest stability indicator [1]."""
        return float(np.max(self.indicator, initial=0.0))


def energy_history(motion: NumericalMotion, config: Config) -> EnergyHistory:
    """Return the energies of the numerical substructure, integrated by the trapezoidal rule.

    Parameters
    ----------
    motion : NumericalMotion
        The numerical substructure.
    config : Config
        Its configuration.
    """
    building = nonlinear_building(config.numerical_substructure.building(), config.nonlinear)
    step, velocities = config.run.time_step, motion.velocities
    dissipated = np.sum(velocities * (velocities @ building.damping_matrix), axis=1)
    per_story = 0.5 * (motion.story_forces[1:] + motion.story_forces[:-1]) * np.diff(motion.drifts, axis=0)
    return EnergyHistory(
        time=step * np.arange(len(velocities), dtype=np.float64),
        ground_input=-_integral(motion.ground_acceleration * (velocities @ building.masses), step),
        interface=_integral(motion.shear * velocities[:, -1], step),
        kinetic=0.5 * velocities**2 @ building.masses,
        springs=np.concatenate(([0.0], np.cumsum(np.sum(per_story, axis=1))))[: len(velocities)],
        dampers=_integral(dissipated, step),
        indicator=stability_indicator(motion, config),
        indicator_limit=config.safety.stability_limit,
    )


def _integral(power: FloatArray, step: float) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (power[1:] + power[:-1]))))[: len(power)]
