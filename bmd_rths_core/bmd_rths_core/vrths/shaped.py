"""Compensators of shake tables on the benchmark problem: a shaper makes one quantity follow, here a displacement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.adaptive_model_based import AdaptiveModelBasedConfig
from bmd_rths_core.compensators.adaptive_time_series import AdaptiveTimeSeriesConfig
from bmd_rths_core.compensators.feedforward_lqg import FeedforwardLqgConfig
from bmd_rths_core.compensators.inverse import InverseConfig
from bmd_rths_core.compensators.phase_lead import CommandShaperConfig
from bmd_rths_core.compensators.protocol import Compensator, Known, SensorNoise, Shaper
from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.compensators.tuned_phase_lead import TunedPhaseLeadConfig
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.table.models.plant import Plant
from bmd_rths_core.vrths.problem import (
    DISPLACEMENT_NOISE,
    FORCE_NOISE,
    NOMINAL,
    RATE,
    SPECIMEN_MASS,
    TIME_STEP,
    actuator_model,
)
from bmd_rths_core.vrths.trackers import Asked, Tracker

FloatArray = NDArray[np.float64]

#: Delay of the nominal plant at 1 to 4 Hz [s].
DELAY = 0.024

#: Settings where those of a shake table do not suit: metres where it has metres per square second, and a higher rate.
_SETTINGS = {
    "plc": CommandShaperConfig(lead_time=DELAY),
    "plc_tuned": TunedPhaseLeadConfig(),
    "inverse": InverseConfig(low_pass_frequency=300.0),
    "ff_lqg": FeedforwardLqgConfig(low_pass_frequency=300.0, error=2e-5, error_frequency=2.0, command_weight=0.1),
    "ats": AdaptiveTimeSeriesConfig(memory=1.0, quiet_acceleration=2e-5),
    "amb": AdaptiveModelBasedConfig(quiet_acceleration=2e-5),
}


def shaped_names() -> list[str]:
    """Return the names of the compensators that shape a command and leave the force as it is."""
    return [name for name, entry in compensators().items() if entry.shaper is not None and not entry.force_correction]


def known_plant(settings: object) -> Known:
    """Return what a shaper may know: the nominal plant, with the displacement in the place of the acceleration.

    Parameters
    ----------
    settings : object
        Section of the compensator.
    """
    model = actuator_model(NOMINAL)
    size = len(model.a) + 2
    a, b, output = np.zeros((size, size)), np.zeros((size, 1)), np.zeros((3, size))
    a[:-2, :-2], a[-2, -1], b[:-2] = model.a, 1.0, model.b
    output[:, :-2] = model.displacement
    specimen = ShearBuilding((SPECIMEN_MASS,), (NOMINAL.specimen_stiffness,), (NOMINAL.specimen_damping,))
    displacement, force = math.sqrt(DISPLACEMENT_NOISE * RATE), math.sqrt(FORCE_NOISE * RATE)
    return Known(
        time_step=TIME_STEP,
        numerical=specimen,
        linear=True,
        specimen=specimen,
        table=Plant(a, b, output, np.zeros(3)),
        command_delay=0.0,
        feedback_scale=1.0,
        load_cell=True,
        noise=SensorNoise(displacement, displacement, force),
        settings=settings,
    )


def shaped_tracker(name: str, lanes: int) -> Tracker:
    """Return a compensator of shake tables as a tracker.

    Parameters
    ----------
    name : str
        Of the registry.
    lanes : int
        Number of plants p.

    Raises
    ------
    InputError
        It shapes no command, or corrects the force.
    """
    entry: Compensator = compensators()[name]
    if entry.shaper is None or entry.force_correction:
        does = "controls an acceleration" if entry.shaper is None else "corrects the force of a shake table"
        raise InputError(f"scheme {name}: {does}, and tracks no displacement; one of {', '.join(shaped_names())} does")
    settings = _SETTINGS.get(name, None if entry.settings is None else entry.settings())
    first = entry.shaper(known_plant(settings))
    system = first.state_space()
    if system is not None:
        return LinearLanes(system)
    others = [entry.shaper(known_plant(settings)) for _ in range(lanes - 1)]
    return LanesOfShapers([first, *others])


class LinearLanes:
    """A linear shaper, the same in every lane.

    Parameters
    ----------
    system : DiscreteStateSpace
        As `Shaper.state_space` has it; of the sensors only the first, here the displacement.
    """

    def __init__(self, system: DiscreteStateSpace) -> None:
        inputs = min(2, system.b.shape[1])
        self._matrix = np.vstack(
            (np.hstack((system.c, system.d[:, :inputs])), np.hstack((system.a, system.b[:, :inputs])))
        )
        self._size, self._learns = len(system.a), inputs == 2
        self.reset()

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._state: FloatArray | None = None

    def step(self, asked: Asked) -> FloatArray:
        """Return the command of this step."""
        desired, measured = asked.motion[0], asked.measurement.displacement
        state = np.zeros((self._size, len(desired))) if self._state is None else self._state
        inputs = (desired[None], measured[None]) if self._learns else (desired[None],)
        result = self._matrix @ np.vstack((state, *inputs))
        self._state = result[1:]
        return np.asarray(result[0])


class LanesOfShapers:
    """One shaper for each lane, one after the other.

    Parameters
    ----------
    shapers : sequence of Shaper
        p shapers.
    """

    def __init__(self, shapers: Sequence[Shaper]) -> None:
        self._shapers = shapers
        self.reset()

    def reset(self) -> None:
        """Return to rest before step 0."""
        for shaper in self._shapers:
            shaper.reset()
        self._commands: list[float] | None = None

    def step(self, asked: Asked) -> FloatArray:
        """Return the command of this step."""
        step, displacements, forces = asked.measurement
        sensors = zip(displacements.tolist(), forces.tolist(), strict=True)
        if self._commands is not None:
            for shaper, command, (displacement, force) in zip(self._shapers, self._commands, sensors, strict=True):
                seen = TableMeasurement(
                    step, command, displacement, displacement, force, force, np.array([displacement])
                )
                shaper.learn(seen)
        desired = asked.motion[0].tolist()
        self._commands = [shaper.step(value) for shaper, value in zip(self._shapers, desired, strict=True)]
        return np.array(self._commands)
