"""Run a configuration under many ground motions: as one linear system where no limit is near, else stage by stage."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.numerical_motion import peak_drifts
from bmd_rths_core.campaign.limits import BOUNDED, SENSED, LimitBounds, SignalChunk, in_rows
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import GroundMotionConfig
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.linear_loop import sensor_noise
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import RunRecord, empty_signals, provenance
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_core.table.models.simulated import SimulatedTable

FloatArray = NDArray[np.float64]

#: Steps after which the runs that touch a bound of a limit are taken out.
_CHUNK = 2048


class SelectedMotion(NamedTuple):
    """A ground motion of a test and how it was selected.

    Parameters
    ----------
    selection : GroundMotionConfig
        Section of the configuration.
    motion : GroundMotion
        One sample a step.
    """

    selection: GroundMotionConfig
    motion: GroundMotion


class CampaignRun(NamedTuple):
    """A run and how it was computed.

    Parameters
    ----------
    record : RunRecord
        The run, as `RthsLoop` gives it.
    engine : str
        ``"linear"``: as one linear system, equal to `RthsLoop` but for rounding; ``"stages"``: by `RthsLoop`, as every
        run that passes a limit, be it on its way to rest.
    spectral_radius : float
        Of the linear loop; NaN where there is none.
    peak_drifts : tuple of float
        Largest drift of every numerical story, from the ground up [m].
    """

    record: RunRecord
    engine: str
    spectral_radius: float = float("nan")
    peak_drifts: tuple[float, ...] = ()


def is_linear(config: Config) -> bool:
    """Tell whether the loop of a configuration is a linear system until a limit ends it.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    table = config.simulated_table
    exact = config.nonlinear.integration == "exact" and table.acceleration_resolution == 0.0 and not table.damaged
    return exact and has_matrices(config)


def run_motions(config: Config, motions: Sequence[SelectedMotion]) -> list[CampaignRun]:
    """Run one configuration under many ground motions, with the simulated table.

    Parameters
    ----------
    config : Config
        The whole configuration; the section of the ground motion is replaced by that of each motion.
    motions : sequence of SelectedMotion
        The ground motions.

    Returns
    -------
    list of CampaignRun
        In the order of the motions. Signals, outcome and reason are those of `RthsLoop`.
    """
    if not is_linear(config) or not motions:
        return [_by_stages(config, selected) for selected in motions]
    group = _LinearGroup(config, [selected.motion for selected in motions])
    touched = group.run()
    radius = closed_loop(config).spectral_radius
    return [
        _by_stages(config, selected, radius)
        if i in touched
        else CampaignRun(group.record(i, _under(config, selected)), "linear", radius, group.peak_drifts(i))
        for i, selected in enumerate(motions)
    ]


class _LinearGroup:
    """The runs of one linear loop, advanced together chunk by chunk."""

    def __init__(self, config: Config, motions: Sequence[GroundMotion]) -> None:
        self._config, self._motions = config, motions
        self._loop = closed_loop(config, displacement=True)
        specimen, seed = config.specimen.building(), config.run.seed
        self._table = SimulatedTable(config.simulated_table, specimen, config.run.time_step, seed)
        self._noise = _Noise(config)
        self._rows = {name: row for row, name in enumerate(self._loop.outputs)}
        self._floors = slice(self._rows["floor_1"], self._rows["base_shear"])
        self._displacements = slice(self._rows["displacement_1"], None)
        self._outputs = [np.empty((len(self._rows), motion.steps)) for motion in motions]
        self._drifts = np.zeros((len(motions), len(config.numerical_substructure.masses)))

    def run(self) -> set[int]:
        """Advance all runs to their ends, and return those that touch a bound of a limit: they are given up there."""
        touched: set[int] = set()
        active = np.arange(len(self._motions))
        steps = np.array([motion.steps for motion in self._motions])
        simulation = LinearSimulation(self._loop.system, self._loop.start @ self._first())
        bounds = LimitBounds(self._config, len(active))
        begin = 0
        while len(active):
            length = min(_CHUNK, int(steps[active].min()) - begin)
            outputs = simulation.advance(self._ground(active, begin, length), self._noise.of(begin, length))
            for i, output in zip(active, outputs, strict=True):
                kept = self._outputs[i][:, begin : begin + length]
                kept[:] = output
                drifts = np.abs(np.diff(kept[self._displacements], axis=0, prepend=0.0))
                self._drifts[i] = np.maximum(self._drifts[i], drifts.max(axis=1, initial=0.0))
            near = bounds.touched(self._chunk(outputs))
            begin += length
            ended = ~near & (steps[active] == begin)
            tables = simulation.state[np.ix_(self._loop.table, ended)]
            near[ended] = self._touched_on_the_way(bounds, ended, tables, begin)
            touched.update(active[near].tolist())
            goes_on = ~near & ~ended
            active = active[goes_on]
            simulation.keep(goes_on)
            bounds.keep(goes_on)
        return touched

    def record(self, i: int, config: Config) -> RunRecord:
        """Return a run that touched no bound."""
        motion, outputs = self._motions[i], self._outputs[i]
        sources = {name: outputs[row] for name, row in self._rows.items()}
        sources |= {"ground_acceleration": motion.acceleration, "floor_accelerations": outputs[self._floors].T}
        sources["applied_command"] = sources["command"]
        signals: dict[str, Any] = dict(empty_signals(motion.steps, len(config.specimen.masses)))
        for name, signal in signals.items():
            signal[:] = sources[name]
        return RunRecord(
            time_step=config.run.time_step,
            outcome="finished",
            reason="end of the ground motion",
            **signals,
            **provenance(config.as_mapping(), motion),
        )

    def peak_drifts(self, i: int) -> tuple[float, ...]:
        """Return the largest drift of every numerical story of a run [m]."""
        return tuple(self._drifts[i].tolist())

    def _first(self) -> FloatArray:
        """Return the ground accelerations that the state before step 0 depends on, a column a run."""
        return self._known(np.arange(len(self._motions)), 0, self._loop.start.shape[1])

    def _ground(self, active: NDArray[np.intp], begin: int, length: int) -> FloatArray:
        return self._known(active, begin + self._loop.preview, length)

    def _known(self, active: NDArray[np.intp], begin: int, length: int) -> FloatArray:
        ground = np.zeros((length, len(active)))
        for column, i in enumerate(active):
            part = self._motions[i].acceleration[begin : begin + length]
            ground[: len(part), column] = part
        return ground

    def _chunk(self, outputs: FloatArray) -> SignalChunk:
        signals = {name: outputs[:, self._rows[name]] for name in BOUNDED}
        signals["corrected_force"] = outputs[:, self._rows["acting_force"]]
        return SignalChunk(signals, outputs[:, self._displacements])

    def _touched_on_the_way(
        self, bounds: LimitBounds, ended: NDArray[np.bool_], tables: FloatArray, begin: int
    ) -> NDArray[np.bool_]:
        """Tell which of the runs that have ended could pass a limit on their way to rest."""
        ways = bounds.ways_to_rest(ended)
        steps = max((len(way) for way in ways), default=0)
        if steps == 0:
            return np.zeros(len(ways), dtype=bool)
        table = self._noise.added_to(self._table.state_space(displacement=True))
        outputs = LinearSimulation(table, tables).advance(in_rows(ways, steps).T, self._noise.of(begin, steps))
        first = self._rows["table_acceleration"]  # of the sensors, which stand together
        sensors = {name: outputs[:, self._rows[name] - first] for name in SENSED}
        return bounds.touched_on_the_way(ended, ways, sensors)


class _Noise:
    """Noise of the sensors, step by step as the simulated table draws it."""

    def __init__(self, config: Config) -> None:
        self._amplitudes = sensor_noise(config.simulated_table, len(config.specimen.masses))
        self._random, self._drive_random = noise_streams(config.run.seed)
        self._first, self._drawn = 0, np.zeros((0, len(self._amplitudes)))

    def of(self, begin: int, length: int) -> FloatArray:
        """Return the noise of some steps, (N, s), in parts of its root mean square; they never go back."""
        self._first, self._drawn = begin, self._drawn[begin - self._first :]
        missing = length - len(self._drawn)
        if missing > 0:
            sensors = self._random.standard_normal((missing, len(self._amplitudes) - 2))
            drives = self._drive_random.standard_normal((missing, 2))
            self._drawn = np.vstack((self._drawn, np.hstack((sensors, drives))))
        return self._drawn[:length]

    def added_to(self, table: DiscreteStateSpace) -> DiscreteStateSpace:
        """Return a table with the noise as further inputs."""
        through = np.diag(self._amplitudes)
        return table._replace(
            b=np.hstack((table.b, np.zeros((len(table.a), len(through))))), d=np.hstack((table.d, through))
        )


def _under(config: Config, selected: SelectedMotion) -> Config:
    return dataclasses.replace(config, ground_motion=selected.selection)


def _by_stages(config: Config, selected: SelectedMotion, radius: float = float("nan")) -> CampaignRun:
    record = RthsLoop(_under(config, selected), selected.motion).run()
    return CampaignRun(record, "stages", radius, peak_drifts(record, config))
