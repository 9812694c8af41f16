"""Capture: the share of a change of the specimen that the result of a hybrid test follows.

1 is a hybrid test, 0 a simulation of the model of the specimen, whatever the errors of the two are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.clean_motion import clean_motion
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.safety import SafetyConfig
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

FloatArray = NDArray[np.float64]

#: Factor on the stiffness of every story of the specimen.
CHANGE = 1.01


class Capture(NamedTuple):
    """⟨δh, δr⟩ / ⟨δr, δr⟩ with δh the change of the hybrid test and δr that of the true building.

    Parameters
    ----------
    substructure : float
        Of the desired acceleration of the interface.
    superstructure : float
        Of the acceleration of the highest floor.
    """

    substructure: float
    superstructure: float


#: Of what was not computed.
UNKNOWN = Capture(float("nan"), float("nan"))


def captured(change: FloatArray, true_change: FloatArray) -> float:
    """Return ⟨δh, δr⟩ / ⟨δr, δr⟩; NaN where nothing changes or a value is not finite."""
    power = float(np.sum(true_change**2))
    share = float(np.sum(change * true_change)) / power if power > 0.0 else float("nan")
    return share if np.isfinite(share) else float("nan")


def is_cheap(config: Config) -> bool:
    """Tell whether capture follows from the matrices of the loop, in a fraction of the time of a run."""
    exact = config.nonlinear.integration == "exact" and not config.simulated_table.damaged
    return exact and has_matrices(config)


def captures(config: Config, grounds: Sequence[FloatArray]) -> list[Capture]:
    """Return the capture of a test with some ground motions, by two more runs without noise and without limits.

    Parameters
    ----------
    config : Config
        The whole configuration.
    grounds : sequence of ndarray, each of shape (N,)
        a_g at the steps [m/s²].

    Returns
    -------
    list of Capture
        NaN for a table that is not simulated in process, or a run that does not come to its end.

    Notes
    -----
    The change of the specimen is `CHANGE` on the stiffness of every story of the specimen on the simulated table; every
    model that the loop knows stays what it was.
    """
    if config.table.controller != "simulated" or not grounds:
        return [UNKNOWN] * len(grounds)
    table = _without_noise(config.simulated_table)
    try:
        changed = dataclasses.replace(table, specimen_stiffness_factor=CHANGE * table.specimen_stiffness_factor)
    except InputError:  # stiffer than allowed
        return [UNKNOWN] * len(grounds)
    before, after = (
        dataclasses.replace(config, simulated_table=simulated, safety=_without_limits(config))
        for simulated in (table, changed)
    )
    run = _by_matrices if is_cheap(config) else _by_stages
    runs, references = (
        (run(before, grounds), run(after, grounds)),
        (simulated_references_of(grounds, before), simulated_references_of(grounds, after)),
    )
    found = []
    lower = len(config.numerical_substructure.masses)
    for one, other, reference, changed_reference in zip(*runs, *references, strict=True):
        if one is None or other is None:
            found.append(UNKNOWN)
            continue
        true_change = changed_reference - reference
        with np.errstate(over="ignore", invalid="ignore"):
            found.append(
                Capture(
                    captured(other.interface - one.interface, true_change[:, lower - 1]),
                    captured((other.top - one.top)[:-1], true_change[1:, -1]),
                )
            )
    return found


def capture_of(config: Config, motion: GroundMotion) -> Capture:
    """Return the capture of a test with one ground motion; see `captures`."""
    return captures(config, [motion.acceleration])[0]


class _Response(NamedTuple):
    interface: FloatArray
    top: FloatArray


def _without_noise(table: SimulatedTableConfig) -> SimulatedTableConfig:
    return dataclasses.replace(
        table,
        acceleration_noise=0.0,
        acceleration_resolution=0.0,
        shear_noise=0.0,
        displacement_noise=0.0,
        force_noise=0.0,
    )


def _without_limits(config: Config) -> SafetyConfig:
    """Return the safety section without limits: what they would cut off is not asked here."""
    return dataclasses.replace(
        config.safety,
        displacement_action="ignore",
        velocity_action="ignore",
        acceleration_action="ignore",
        force_action="ignore",
        increment_action="ignore",
        tracking_action="ignore",
        stability_action="ignore",
    )


def _by_matrices(config: Config, grounds: Sequence[FloatArray]) -> list[_Response | None]:
    loop = closed_loop(config, displacement=True)
    rows = [loop.outputs.index(name) for name in ("desired_acceleration", f"floor_{len(config.specimen.masses)}")]
    system = loop.system
    asked = DiscreteStateSpace(system.a, system.b[:, :1], system.c[rows], system.d[rows, :1])
    known = loop.start.shape[1]
    own = np.zeros((max(map(len, grounds)) + max(known, loop.preview), len(grounds)))
    for i, ground in enumerate(grounds):
        own[: len(ground), i] = ground
    with np.errstate(over="ignore", invalid="ignore"):
        outputs = LinearSimulation(asked, loop.start @ own[:known]).advance(own[loop.preview :])
    return [_Response(*output[:, : len(ground)]) for output, ground in zip(outputs, grounds, strict=True)]


def _by_stages(config: Config, grounds: Sequence[FloatArray]) -> list[_Response | None]:
    found: list[_Response | None] = []
    for ground in grounds:
        motion = GroundMotion("capture", config.run.time_step, ground, "in process", "")
        record = RthsLoop(config, motion).run()
        whole = record.steps == len(ground)
        found.append(
            _Response(record.desired_acceleration, clean_motion(record, config).floors[:, -1]) if whole else None
        )
    return found
