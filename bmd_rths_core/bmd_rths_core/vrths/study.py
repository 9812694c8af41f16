"""The whole table of the benchmark problem in pieces: one building, one motion, one scheme, all plants at once."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.vrths.criteria import CRITERIA, criteria
from bmd_rths_core.vrths.loop import reference_motion, required_force, run_lanes
from bmd_rths_core.vrths.problem import (
    CHIRP_AMPLITUDE,
    CHIRP_DURATION,
    CHIRP_FREQUENCIES,
    DISPLACEMENT_NOISE,
    FORCE_LIMIT,
    INTENSITY,
    NOMINAL,
    RATE,
    TIME_STEP,
    perturbed_plants,
)
from bmd_rths_core.vrths.schemes import make_tracker

FloatArray = NDArray[np.float64]

NOMINAL_PLANT = "nominal"


def benchmark_motion(motion: GroundMotion) -> GroundMotion:
    """Return a record as the problem has it: 0.4 of it, linear between its points, at every step of the loop.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    times = TIME_STEP * np.arange(int(motion.duration * RATE * (1.0 + 1e-12)) + 1)
    points = motion.time_step * np.arange(motion.steps)
    acceleration = INTENSITY * np.interp(times, points, motion.acceleration)
    return GroundMotion(motion.name, TIME_STEP, acceleration, motion.source, motion.sha256)


def chirp() -> GroundMotion:
    """Return the chirp, not yet scaled to the intensity of the problem."""
    begin, end = CHIRP_FREQUENCIES
    times = TIME_STEP * np.arange(round(CHIRP_DURATION * RATE) + 1)
    phase = begin * times + 0.5 * (end - begin) / CHIRP_DURATION * times**2
    acceleration = CHIRP_AMPLITUDE * np.sin(2.0 * np.pi * phase)
    return GroundMotion("chirp", TIME_STEP, acceleration, "formula", hashlib.sha256(acceleration.tobytes()).hexdigest())


@dataclass(frozen=True)
class BenchmarkPiece:
    """One building under one motion with one scheme, and all its plants.

    Parameters
    ----------
    case : int
        Building.
    motion : GroundMotion
        As `benchmark_motion` has it.
    scheme : str
        Name of the compensator.
    plants : int
        Perturbed plants beside the nominal one.
    seed : int
        Of the drawing and of the noise.
    """

    case: int
    motion: GroundMotion
    scheme: str
    plants: int
    seed: int


class NominalRun(NamedTuple):
    """Signals of the nominal plant, at the steps.

    Parameters
    ----------
    ground_acceleration : ndarray, shape (N,)
        [m/s²].
    displacement, reference : ndarray, shape (N, 3)
        Of the floors of the numerical substructure, and of the building without partition [m].
    command, measured : ndarray, shape (N,)
        Displacement of the actuator [m].
    force : ndarray, shape (N,)
        Measured force of the experimental substructure [N].
    """

    ground_acceleration: FloatArray
    displacement: FloatArray
    reference: FloatArray
    command: FloatArray
    measured: FloatArray
    force: FloatArray


class FinishedPiece(NamedTuple):
    """What a piece gave.

    Parameters
    ----------
    piece : BenchmarkPiece
    runs : list of dict
        One a plant: ``case``, ``plant``, ``motion``, ``scheme``, ``J1`` [ms], ``J2`` to ``J9`` [%], ``noise_floor``,
        the part of J2 that is the noise of the transducer [%], ``force_limited``, and ``required_force`` of its
        building [N], see `required_force`.
    nominal : NominalRun
    """

    piece: BenchmarkPiece
    runs: list[dict[str, Any]]
    nominal: NominalRun


def pieces(
    cases: Sequence[int], motions: Sequence[GroundMotion], schemes: Sequence[str], plants: int, seed: int
) -> Iterator[BenchmarkPiece]:
    """Return every building with every motion and scheme.

    Parameters
    ----------
    cases, motions, schemes : sequence
        As `BenchmarkPiece` has them.
    plants, seed : int
        As `BenchmarkPiece` has them.
    """
    for motion in motions:
        for scheme in schemes:
            for case in cases:
                yield BenchmarkPiece(case, motion, scheme, plants, seed)


def run_piece(piece: BenchmarkPiece) -> FinishedPiece:
    """Run a piece.

    Parameters
    ----------
    piece : BenchmarkPiece
        The piece.

    Raises
    ------
    InputError
        There is no such building or scheme.
    """
    plants = (NOMINAL, *perturbed_plants(piece.plants, piece.seed))
    seeds = [1000 * (piece.seed + 1) + lane for lane in range(len(plants))]
    tracker = make_tracker(piece.scheme, piece.case, len(plants))
    ground = piece.motion.acceleration
    found = run_lanes(piece.case, plants, tracker, ground, seeds)
    whole = reference_motion(piece.case, ground)
    reference, required = whole[:, :3], required_force(piece.case, ground, whole)
    runs = []
    for lane in range(len(plants)):
        motion, measured = found.displacement[:, :, lane], found.measured[:, lane]
        runs.append(
            {
                "case": piece.case,
                "plant": f"perturbed_{lane}" if lane else NOMINAL_PLANT,
                "motion": piece.motion.name,
                "scheme": piece.scheme,
                **criteria(motion[:, 0], measured, reference, motion[:, 1:]),
                "noise_floor": 100.0 * float(np.sqrt(DISPLACEMENT_NOISE * RATE) / motion[:, 0].std()),
                "force_limited": bool(found.limited[lane]),
                "required_force": required,
            }
        )
    first = found.displacement[:, :, 0].copy(), reference, found.command, found.measured[:, 0].copy(), found.force
    return FinishedPiece(piece, runs, NominalRun(np.asarray(ground), *first))


class Summary(NamedTuple):
    """The plants of one building, motion and scheme.

    Parameters
    ----------
    motion, scheme, case
        Which.
    nominal, mean, worst : Mapping of str to float
        J1 to J9 of the nominal plant, and over the perturbed ones; empty where there are none.
    perturbed : int
        Number of perturbed plants.
    noise_floor : float
        Of the nominal plant [%].
    required_force : float
        See `required_force` [N].
    limited : int
        Plants whose actuator was at its force limit.
    """

    motion: str
    scheme: str
    case: int
    nominal: Mapping[str, float]
    mean: Mapping[str, float]
    worst: Mapping[str, float]
    perturbed: int
    noise_floor: float
    required_force: float
    limited: int

    @property
    def infeasible(self) -> str:
        """Why no compensator can follow; empty where one can."""
        if self.required_force <= FORCE_LIMIT:
            return ""
        return (
            f"{self.motion}, building {self.case}: its motion without partition needs {self.required_force:.0f} N, "
            f"more than the {FORCE_LIMIT:g} N of the actuator; no compensator can follow it"
        )


def summarise(runs: Sequence[Mapping[str, Any]]) -> Summary:
    """Return nominal, mean and worst of the runs of a piece.

    Parameters
    ----------
    runs : sequence of Mapping
        As `FinishedPiece` has them, the nominal plant first.
    """
    first, others = runs[0], runs[1:]
    mean = {name: float(np.mean([run[name] for run in others])) for name in CRITERIA} if others else {}
    worst = {name: max(run[name] for run in others) for name in CRITERIA} if others else {}
    nominal = {name: first[name] for name in CRITERIA}
    limited = sum(run["force_limited"] for run in runs)
    known = first["noise_floor"], first["required_force"], limited
    return Summary(first["motion"], first["scheme"], first["case"], nominal, mean, worst, len(others), *known)
