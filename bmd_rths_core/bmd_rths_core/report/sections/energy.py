"""Energy of the numerical substructure over a run, and what the interface brings into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.numerical_motion import NumericalMotion, stability_indicator
from bmd_rths_core.config import Config
from bmd_rths_core.plots.histories import plot_history
from bmd_rths_core.plots.layout import ABOVE, Canvas, grid_in_mm, legend_on_top
from bmd_rths_core.plots.style import BLACK, BLUE, GREEN, ORANGE, VERMILION
from bmd_rths_core.report.document import Block, shown
from bmd_rths_core.report.reported_run import ReportedRun, part

FloatArray = NDArray[np.float64]

TITLE = "Energy and stability"

CAPTION = (
    "Energies of the numerical substructure relative to the ground, and below the stability indicator: the logarithm "
    "of the factor by which the interface has raised the energy."
)


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

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 105.0

    def draw(self, figure: Canvas) -> None:
        """Draw the energies of the numerical substructure, and the stability indicator below."""
        grid = grid_in_mm(figure, 2, height_ratios=(2, 1), between=(7.0, 0.0))
        energies, indicator = grid.subplots(squeeze=False, sharex=True)[:, 0]
        curves = (
            (self.ground_input, "input by the ground", BLACK, "-"),
            (self.interface, "brought by the interface", VERMILION, (0, (5, 2))),
            (self.dampers, "dampers", GREEN, "-"),
            (self.kinetic, "kinetic", ORANGE, "-"),
            (self.springs, "springs", BLUE, (0, (3, 1.5))),
        )
        for values, label, color, dashes in curves:
            width = 1.6 if label == "kinetic" else 0.8  # the springs lie over it where energy goes to and fro
            plot_history(energies, self.time, values, color=color, linestyle=dashes, linewidth=width, label=label)
        legend_on_top(figure, energies, 5)
        energies.set_ylabel("energy [J]")
        largest = f"stability indicator, at most {self.largest_indicator:.3g}"
        plot_history(indicator, self.time, self.indicator, color=BLACK, linewidth=0.8, label=largest, clip_on=False)
        limit = f"limit {self.indicator_limit:g}"
        indicator.axhline(self.indicator_limit, color=VERMILION, linewidth=0.8, linestyle="--", label=limit)
        indicator.legend(ncols=2, **ABOVE)
        highest = max(1.3 * self.indicator_limit, 1.05 * float(np.nanmax(self.indicator, initial=0.0)))
        indicator.set(ylabel="indicator [1]", xlabel="time [s]", ylim=(0.0, highest), xlim=(0.0, self.time[-1]))


def energy_history(motion: NumericalMotion, config: Config) -> EnergyHistory:
    """Return the energies of the numerical substructure, integrated by the trapezoidal rule."""
    building = config.elastic_substructure()
    step, velocities = config.run.time_step, motion.velocities
    dissipated = np.sum(velocities * (velocities @ building.damping_matrix), axis=1)
    per_story = 0.5 * (motion.story_forces[1:] + motion.story_forces[:-1]) * np.diff(motion.drifts, axis=0)
    return EnergyHistory(
        time=step * np.arange(len(velocities), dtype=np.float64),
        ground_input=-_integral(motion.ground_acceleration * (velocities @ building.masses), step),
        interface=_integral(motion.shear * velocities[:, -1], step),
        kinetic=0.5 * np.sum(velocities * (velocities @ building.mass_matrix), axis=1),
        springs=np.concatenate(([0.0], np.cumsum(np.sum(per_story, axis=1))))[: len(velocities)],
        dampers=_integral(dissipated, step),
        indicator=stability_indicator(motion, config),
        indicator_limit=config.safety.stability_limit,
    )


def _integral(power: FloatArray, step: float) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (power[1:] + power[:-1]))))[: len(power)]


def figure(run: ReportedRun) -> EnergyHistory | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_history, lambda: energy_history(run.motion, run.config))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [shown(figure(run), CAPTION)]
