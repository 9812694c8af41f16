"""Force and drift of every story: of the numerical ones as computed, of the specimen from its accelerometers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bmd_rths_core.analysis.numerical_motion import NumericalMotion
from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.plots.layout import LABELS, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE, VERMILION
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, Table, shown
from bmd_rths_core.report.reported_run import ReportedRun, part
from bmd_rths_core.report.wording import number
from bmd_rths_core.structure.config import BuildingConfig

FloatArray = NDArray[np.float64]

TITLE = "Hysteresis"

#: Stories beside each other.
STORIES_IN_A_ROW = 3

#: High-pass of the drifts of the specimen, as a share of the first frequency of the whole building.
HIGH_PASS_SHARE = 0.25

_NUMERICAL = (
    "Numerical stories: restoring force of the springs, computed again from the recorded ground motion and shear. "
    "Dashed is the initial stiffness, dotted the yield drift."
)
_SPECIMEN = (
    "Specimen: the shear is the sum of mass times measured acceleration above the story, damping included; the drift "
    f"is integrated twice from accelerometers, behind a high-pass at {HIGH_PASS_SHARE:g} of the first frequency of the "
    "building. Slow and permanent drifts cannot be seen. Dashed is the configured stiffness."
)

#: Periods of that frequency a run has to last.
_PERIODS = 3.0


@dataclass(frozen=True)
class StoryLoop:
    """Force against drift of one story.

    Parameters
    ----------
    name : str
        Which story.
    drift, force : ndarray, shape (N,)
        [m, N].
    stiffness : float
        Configured initial stiffness [N/m].
    yield_drift : float
        Drift at first yield [m]; 0 for a story that cannot yield.
    """

    name: str
    drift: FloatArray
    force: FloatArray
    stiffness: float
    yield_drift: float = 0.0


@dataclass(frozen=True)
class Hysteresis:
    """The loops of all stories.

    Parameters
    ----------
    stories : tuple of StoryLoop
        From the ground up.
    """

    stories: tuple[StoryLoop, ...]

    @property
    def height(self) -> float:
        """Height [mm]."""
        return min(58.0 * -(-len(self.stories) // STORIES_IN_A_ROW), 250.0)

    def draw(self, figure: Canvas) -> None:
        """Draw force against drift of every story."""
        rows = -(-len(self.stories) // STORIES_IN_A_ROW)
        grid = grid_in_mm(figure, rows, STORIES_IN_A_ROW, between=(LABELS + 5.0, 18.0))
        for i, story in enumerate(self.stories):
            _draw_story(figure.add_subplot(grid[divmod(i, STORIES_IN_A_ROW)]), story)


def numerical_loops(motion: NumericalMotion, config: Config) -> Hysteresis:
    """Return the loops of the numerical stories: restoring force without damping."""
    stiffnesses = _stiffnesses(config.numerical_substructure)
    yields = config.nonlinear.yield_drifts if config.nonlinear.story_model != "linear" else (0.0,) * len(stiffnesses)
    stories = zip(motion.drifts.T, motion.story_forces.T, stiffnesses, yields, strict=True)
    return Hysteresis(tuple(StoryLoop(f"numerical story {i}", *story) for i, story in enumerate(stories, 1)))


def _stiffnesses(section: BuildingConfig) -> tuple[float, ...]:
    """Return the stiffness of each story; of a building by matrices none is known."""
    return section.stiffnesses or (float("nan"),) * len(section.masses)


def specimen_loops(record: RunRecord, config: Config) -> Hysteresis:
    """Return the loops of the stories of the specimen.

    Parameters
    ----------
    record : RunRecord
        The run, with accelerometers on the table and every floor.
    config : Config
        Its configuration.

    Returns
    -------
    Hysteresis
        The shear of a story is −Σ mᵢ aᵢ of the floors above it with configured masses and measured accelerations, with
        the sign of a restoring force, and includes damping. The drift is the difference of the accelerations above and
        below, integrated twice behind a high-pass at `high_pass_frequency`: what is slower, and any permanent drift,
        cannot be seen.

    Raises
    ------
    InputError
        The run is too short for the high-pass.
    """
    corner = high_pass_frequency(config)
    needed = _PERIODS * 2.0 * np.pi / corner
    if record.steps * record.time_step < needed:
        raise InputError(
            f"a run of {record.steps * record.time_step:g} s is too short for drifts of the specimen; "
            f"{needed:.3g} s and more are required"
        )
    floors = np.column_stack([filled(signal) for signal in record.floor_accelerations.T])
    motions = np.column_stack((filled(record.table_acceleration), floors))
    relative = np.diff(motions, axis=1)
    forces = -np.cumsum((floors * config.specimen.masses)[:, ::-1], axis=1)[:, ::-1]
    drifts = [twice_integrated(signal, record.time_step, corner) for signal in relative.T]
    stories = zip(drifts, forces.T, _stiffnesses(config.specimen), strict=True)
    return Hysteresis(tuple(StoryLoop(f"specimen story {i}", *story) for i, story in enumerate(stories, 1)))


def high_pass_frequency(config: Config) -> float:
    """Return the corner of the high-pass of the drifts of the specimen [rad/s]."""
    whole = config.specimen.building().stacked_on(config.elastic_substructure())
    return HIGH_PASS_SHARE * float(whole.modes().frequencies[0])


def twice_integrated(acceleration: FloatArray, time_step: float, corner: float) -> FloatArray:
    """Return the displacement that belongs to an acceleration, without what is slow.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        [m/s²], zero before its first and after its last sample.
    time_step : float
        Δt [s].
    corner : float
        Frequency ω_c at which half is left [rad/s].

    Returns
    -------
    ndarray, shape (N,)
        The spectrum times −ω² / (ω⁴ + ω_c⁴): a twofold integration where ω is well above ω_c, without any phase [m].
    """
    padded = 2 * len(acceleration)
    frequencies = 2.0 * np.pi * np.fft.rfftfreq(padded, time_step)
    weight = -(frequencies**2) / (frequencies**4 + corner**4)
    return np.asarray(np.fft.irfft(weight * np.fft.rfft(acceleration, padded), padded)[: len(acceleration)])


def _draw_story(axes: Axes, story: StoryLoop) -> None:
    drift, force = 1e3 * story.drift, story.force / 1e3
    axes.plot(drift, force, color=BLUE, linewidth=0.5, rasterized=True)
    largest = float(np.max(np.abs(drift), initial=0.0))
    if story.yield_drift:
        largest = min(largest, 1e3 * story.yield_drift)
        for sign in (-1.0, 1.0):
            axes.axvline(sign * 1e3 * story.yield_drift, color=VERMILION, linewidth=0.6, linestyle=":")
    ends = np.array([-largest, largest])
    axes.plot(ends, story.stiffness * ends / 1e6, color=BLACK, linewidth=0.6, linestyle="--")
    axes.set(title=story.name, xlabel="drift [mm]", ylabel="force [kN]")


def numerical_figure(run: ReportedRun) -> Hysteresis | str:
    """Return the loops of the numerical stories, or why there are none."""
    return part(run.no_history, lambda: numerical_loops(run.motion, run.config))


def specimen_figure(run: ReportedRun) -> Hysteresis | str:
    """Return the loops of the stories of the specimen, or why there are none."""
    return part(run.no_floors, lambda: specimen_loops(run.record, run.config))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    ductility = run.analysis.ductility
    table = [] if ductility is None else [ductility_table(run.analysis, ductility)]
    return [shown(numerical_figure(run), _NUMERICAL), *table, shown(specimen_figure(run), _SPECIMEN)]


def ductility_table(analysis: RunAnalysis, ductility: Sequence[float]) -> Table:
    """Return the ductility of the numerical stories."""
    pairs = zip(ductility, analysis.config.nonlinear.yield_drifts, strict=True)
    rows = tuple(
        (f"numerical story {i}", number(1e3 * value * drift, 3), number(1e3 * drift, 3), number(value, 2))
        for i, (value, drift) in enumerate(pairs, 1)
    )
    return Table(("story", "peak drift [mm]", "yield drift [mm]", "ductility [1]"), rows)
