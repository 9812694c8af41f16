"""The least noise that a causal compensator can have with a capture: a Wiener bound, from simulations alone.

Let the models be exact and the table follow exactly. Then only two things are left that make an error: the noise of the
sensors, and a change of the specimen that the models do not know. With the same commands the changed specimen answers
the sensors with r more than the models say, and the building of it has z more at the interface. What a linear
compensator makes of them is h = F r, and F n of the noise n, with a causal F whatever its structure is. A capture of 1
wants h = z; noise wants F = 0. For every weight of the two

    min ‖F n‖² + λ ‖z − F r‖²

is a least-squares problem in the impulse response of F, solved here for the changes that capture is defined with, over
all records together. So a point of the front is a bound: no linear, causal, time-invariant compensator with these
sensors has less noise with as small a distortion ‖z − F r‖, and least of all one that does not know the
records. The highest floor moves with the changed specimen by itself; there z is only what the motion of the interface
has to add.

F is sought among the sums of `TAPS` delays and of resonances at the frequencies of the building, with its own damping
and with those of `DAMPING`. A larger space would lower the bound by what more of them lower it: less than the digits
that are printed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from bmd_rths_core.analysis.capture import CHANGE
from bmd_rths_core.analysis.reference import reference_responses
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.linear_loop import sensor_noise
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.models.simulated import SimulatedTable

#: Delays of every sensor [steps], and damping ratios of the further resonances.
TAPS, DAMPING = 24, (0.02, 0.06, 0.2, 0.6)
#: Length of the responses that the noise is computed from [steps].
LENGTH = 12000
#: Weights of the distortion, relative to the mean power of what a change of the specimen does to a sensor.
WEIGHTS = tuple(np.geomspace(1e-2, 1e5, 12).tolist())


class FrontPoint(NamedTuple):
    """A point of the front of interface or highest floor.

    Parameters
    ----------
    noise : float
        Root mean square [m/s²].
    distortion : float
        ‖z − F r‖ over the whole change of the true building, all records together.
    capture : float
    """

    noise: float
    distortion: float
    capture: float


class Changes(NamedTuple):
    """What a change of the specimen does with one ground motion.

    Parameters
    ----------
    sensors : ndarray, shape (N, q)
        r over the noise of each sensor: table, floors, displacement, and the load cell where there is one.
    wanted : ndarray, shape (N, 2)
        z of interface and highest floor, one step after the sensors [m/s²].
    whole : ndarray, shape (N, 2)
        Change of the true building [m/s²].
    """

    sensors: np.ndarray
    wanted: np.ndarray
    whole: np.ndarray


def changes(config: Config, ground: np.ndarray) -> Changes:
    """Return what capture is defined with, for one ground motion; the commands are those of a run without noise."""
    table = config.simulated_table
    quiet = {f"simulated_table__{name}_noise": 0.0 for name in ("acceleration", "shear", "displacement", "force")}
    motion = GroundMotion("bound", config.run.time_step, ground, "in process", "")
    commands = RthsLoop(config.changed(**quiet), motion).run().command[:, None]
    factor = CHANGE * table.specimen_stiffness_factor
    configs = config, config.changed(simulated_table__specimen_stiffness_factor=factor)
    n = len(config.specimen.masses)
    kept = [*range(n + 1), n + 2] + ([n + 1] if config.shear_estimator.source == "load_cell" else [])
    answers, buildings, floors = [], [], []
    lower = len(config.numerical_substructure.masses)
    for own in configs:
        nominal = own.specimen.building()
        system = SimulatedTable(own.simulated_table, nominal, own.run.time_step, 0).state_space(displacement=True)
        system = DiscreteStateSpace(system.a, system.b, system.c[kept], system.d[kept])
        answers.append(LinearSimulation(system, np.zeros((len(system.a), 1))).advance(commands)[0].T)
        buildings.append(simulated_references_of([ground], own)[0])
        interface = buildings[0][:, lower - 1]
        specimen = own.simulated_table.specimen(nominal)
        floors.append(reference_responses(specimen, [interface], own.run.time_step)[0][:, -1])
    whole = (buildings[1] - buildings[0])[1:, [lower - 1, -1]]
    wanted = whole.copy()
    wanted[:, 1] -= (floors[1] - floors[0])[1:]
    noise = sensor_noise(table, n)[kept]
    return Changes((answers[1] - answers[0])[:-1] / noise, wanted, whole)


def resonances(config: Config) -> np.ndarray:
    """Return the poles that F may have, one of each pair: those of the true building, with several dampings."""
    building = config.simulated_table.specimen(config.specimen.building())
    modes = building.stacked_on(config.numerical_substructure.building()).modes()
    pairs = [(w, z) for w, own in zip(modes.frequencies, modes.damping_ratios, strict=True) for z in (own, *DAMPING)]
    return np.array([np.exp(config.run.time_step * w * (-z + 1j * np.sqrt(1.0 - z**2))) for w, z in pairs])


def filtered(signals: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Return every signal through every delay and resonance, those of the first signal first."""
    columns = []
    for signal in signals.T:
        columns += [np.concatenate((np.zeros(delay), signal[: len(signal) - delay])) for delay in range(TAPS)]
        for pole in poles:
            resonance = lfilter([1.0], [1.0, -pole], signal)
            columns += [resonance.real, resonance.imag]
    return np.column_stack(columns)


def front(config: Config, grounds: list[np.ndarray]) -> tuple[list[FrontPoint], list[FrontPoint]]:
    """Return the fronts of interface and highest floor, those with the least noise first.

    Parameters
    ----------
    config : Config
        With a scheme that tracks well without noise, and its models.
    grounds : list of ndarray
        a_g at the steps of every record [m/s²].
    """
    known = [changes(config, ground) for ground in grounds]
    poles = resonances(config)
    impulse = np.zeros((LENGTH, 1))
    impulse[0] = 1.0
    responses = filtered(impulse, poles)
    scales = np.linalg.norm(responses, axis=0)
    of_noise = (responses / scales).T @ (responses / scales)
    sensors = known[0].sensors.shape[1]
    scales = np.tile(scales, sensors)
    size = len(scales)
    normal, right, crossed = np.zeros((size, size)), np.zeros((size, 2)), np.zeros((size, 2))
    power, whole, free = np.zeros(2), np.zeros(2), np.zeros(2)
    for own in known:
        # Every record counts alike, whatever its strength is.
        scale = 1.0 / np.sqrt(np.sum(own.whole**2, axis=0).mean())
        regressors = scale * filtered(own.sensors, poles) / scales
        normal += regressors.T @ regressors
        right += regressors.T @ (scale * own.wanted)
        crossed += regressors.T @ (scale * own.whole)
        power += np.sum((scale * own.wanted) ** 2, axis=0)
        whole += np.sum((scale * own.whole) ** 2, axis=0)
        free += np.sum(scale**2 * (own.whole - own.wanted) * own.whole, axis=0)
    noise_power = np.kron(np.eye(sensors), of_noise) + 1e-9 * np.eye(size)
    fronts: tuple[list[FrontPoint], list[FrontPoint]] = ([], [])
    strength = np.trace(normal) / size
    for weight in WEIGHTS:
        share = weight / strength
        taken = np.linalg.solve(share * normal + noise_power, share * right)
        left = power - 2.0 * np.sum(taken * right, axis=0) + np.sum(taken * (normal @ taken), axis=0)
        shares = (free + np.sum(taken * crossed, axis=0)) / whole
        for i in range(2):
            noise = float(np.sqrt(taken[:, i] @ noise_power @ taken[:, i]))
            fronts[i].append(FrontPoint(noise, float(np.sqrt(max(0.0, left[i]) / whole[i])), float(shares[i])))
    return fronts


def least_noise(points: list[FrontPoint], capture: float) -> float:
    """Return the noise of the front at a capture [m/s²], between its ends.

    Parameters
    ----------
    points : list of FrontPoint
        Of the interface or of the highest floor.
    capture : float
        Mean of the records.
    """
    ordered = sorted((point.capture, point.noise) for point in points)
    shares, noises = np.array(ordered).T
    return float(np.interp(capture, shares, noises, left=0.0))
