"""The plan of a campaign: every motion with every scheme and variation, cut into pieces that run at once."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from bmd_rths_core.analysis.benchmark_criteria import BenchmarkCriteria, benchmark_criteria
from bmd_rths_core.analysis.capture import UNKNOWN, captures
from bmd_rths_core.analysis.metrics import RunMetrics, compare, references_of
from bmd_rths_core.analysis.quality import RunQuality, run_quality, told_quality
from bmd_rths_core.analysis.table_peaks import peak, table_peaks
from bmd_rths_core.analysis.true_building import true_references_of
from bmd_rths_core.campaign.engine import CampaignRun, SelectedMotion, run_motions
from bmd_rths_core.campaign.motions import CampaignMotion
from bmd_rths_core.campaign.paper_tables import event_of
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import prepare_ground_motion
from bmd_rths_core.version import __version__

#: Most motions of a piece: enough to be fast together, few enough to be shared among processes.
PIECE = 4

#: What a campaign varies by other means: parameter, and how.
_RESERVED = {
    "run.scheme": "--schemes",
    "ground_motion.record": "--motions",
    "ground_motion.component": "--motions",
    "ground_motion.unit": "--motions",
}

#: What of the quality of a run a campaign tells.
_TOLD = (
    *("rmse_true_percent", "rmse_clean_percent", "noise_floor_percent", "capture"),
    *("tracking_error_percent", "delay_ms", "verdict"),
)


class PlannedRun(NamedTuple):
    """One run of a campaign.

    Parameters
    ----------
    key : str
        What the run is: hash of configuration, record and version of this project.
    scheme : str
        Compensation scheme.
    motion : int
        Index of the motion in its piece.
    """

    key: str
    scheme: str
    motion: int


@dataclass(frozen=True)
class Piece:
    """Runs that are computed together: some motions under one variation, with every scheme.

    Parameters
    ----------
    config : Config
        Configuration of the variation.
    variation : Mapping of str to object
        What was varied, by ``section.key``.
    motions : tuple of CampaignMotion
        The motions.
    runs : tuple of PlannedRun
        The runs, those of a scheme beside each other.
    capture : bool
        Compute the capture of every run, by two more runs.
    """

    config: Config
    variation: Mapping[str, object]
    motions: tuple[CampaignMotion, ...]
    runs: tuple[PlannedRun, ...]
    capture: bool = False


class FinishedRun(NamedTuple):
    """A run and what is told about it.

    Parameters
    ----------
    result : dict
        Plain values, see `result_of_run`.
    run : CampaignRun
        The run itself.
    """

    result: dict[str, Any]
    run: CampaignRun


@dataclass(frozen=True)
class Study:
    """A campaign: every motion, scheme and variation of one configuration.

    Parameters
    ----------
    config : Config
        Configuration of what is not varied; the table is the simulated one.
    motions : sequence of CampaignMotion
        The ground motions.
    schemes : sequence of str
        The compensation schemes.
    vary : Mapping of str to sequence
        Values of every parameter that is varied, by ``section.key``; all combinations are run.
    engine : str
        What runs the study, part of every key; empty for `run_piece`.
    capture : bool
        Compute the capture of every run too, which takes about twice as long again; part of every key.

    Raises
    ------
    InputError
        A parameter is unknown or not to be varied, or a value is not allowed.
    """

    config: Config
    motions: Sequence[CampaignMotion]
    schemes: Sequence[str]
    vary: Mapping[str, Sequence[object]] = dataclasses.field(default_factory=dict)
    engine: str = ""
    capture: bool = False

    def __post_init__(self) -> None:
        """Check every value that is varied, by itself."""
        for name, values in self.vary.items():
            if name in _RESERVED:
                raise InputError(f"--vary {name}: is varied by {_RESERVED[name]}")
            for value in values:
                varied(self.config, {name: value})

    @property
    def size(self) -> int:
        """Number of runs."""
        combinations = 1
        for values in self.vary.values():
            combinations *= len(values)
        return combinations * len(self.schemes) * len(self.motions)

    def pieces(self) -> Iterator[Piece]:
        """Return the study in pieces, one after the other.

        Yields
        ------
        Piece
            With at least one run.
        """
        for values in itertools.product(*self.vary.values()):
            variation = dict(zip(self.vary, values, strict=True))
            config = varied(self.config, variation)
            hashes = {
                scheme: _configuration_hash(with_scheme(config, scheme), self.engine, self.capture)
                for scheme in self.schemes
            }
            for begin in range(0, len(self.motions), PIECE):
                motions = tuple(self.motions[begin : begin + PIECE])
                runs = (
                    PlannedRun(_run_key(hashes[scheme], motion.motion.sha256, motion.component, motion.unit), scheme, i)
                    for scheme in self.schemes
                    for i, motion in enumerate(motions)
                )
                yield Piece(config, variation, motions, tuple(runs), self.capture)


def run_piece(piece: Piece) -> Iterator[FinishedRun]:
    """Compute the runs of a piece.

    Parameters
    ----------
    piece : Piece
        The piece.

    Yields
    ------
    FinishedRun
        In the order of the piece.
    """
    config, step = piece.config, piece.config.run.time_step
    needed = sorted({run.motion for run in piece.runs})
    selected = {}
    for i in needed:
        selection = piece.motions[i].select(config.ground_motion)
        selected[i] = SelectedMotion(selection, prepare_ground_motion(piece.motions[i].motion, selection, step))
    grounds = [selected[i].motion.acceleration for i in needed]
    lower = len(config.numerical_substructure.masses)
    nominal = references_of(grounds, config)
    references = dict(zip(needed, nominal, strict=True))
    true_references = dict(zip(needed, true_references_of(grounds, config, nominal), strict=True))
    for scheme, group in itertools.groupby(piece.runs, key=lambda run: run.scheme):
        planned = list(group)
        chosen = with_scheme(config, scheme)
        finished = run_motions(chosen, [selected[run.motion] for run in planned])
        shares = [UNKNOWN] * len(planned)
        if piece.capture:
            shares = captures(chosen, [selected[run.motion].motion.acceleration for run in planned])
        for plan, run, share in zip(planned, finished, shares, strict=True):
            steps = run.record.steps
            metrics = compare(run.record, references[plan.motion][:steps], lower)
            quality = run_quality(run.record, chosen, true_references[plan.motion][:steps], share)
            criteria = benchmark_criteria(run.record, references[plan.motion][:steps], lower)
            yield FinishedRun(result_of_run(plan, piece, run, metrics, quality, criteria), run)


def result_of_run(
    plan: PlannedRun,
    piece: Piece,
    run: CampaignRun,
    metrics: RunMetrics,
    quality: RunQuality,
    criteria: BenchmarkCriteria,
) -> dict[str, Any]:
    """Return what is told about a run, as plain values.

    Parameters
    ----------
    plan : PlannedRun
        The run as planned.
    piece : Piece
        The piece it belongs to.
    run : CampaignRun
        The run.
    metrics : RunMetrics
        Errors of Eq. 12, against the nominal building.
    quality : RunQuality
        What it is judged by.
    criteria : BenchmarkCriteria
        Those of the vRTHS benchmark.

    Returns
    -------
    dict
        Errors of a run that a limit ended are None, and so is what cannot be computed.
    """
    record, motion, peaks = run.record, piece.motions[plan.motion], table_peaks(run.record)
    return {
        "key": plan.key,
        "motion": record.motion["name"],
        "event": event_of(motion.record),
        "file": motion.record,
        "component": motion.component,
        "scheme": plan.scheme,
        "variation": dict(piece.variation),
        "stable": record.stable,
        "stability": record.stability,
        "outcome": record.outcome,
        "reason": record.reason,
        "steps": record.steps,
        "rmse_percent": {n: _known(v) if record.stable else None for n, v in metrics.rmse_percent.items()},
        "tracking_delay_ms": _known(metrics.tracking_delay_ms),
        **{name: _plain(value) for name, value in told_quality(quality, record.stable).items() if name in _TOLD},
        "criteria": {symbol: _known(value) for symbol, value in criteria.told(record.stable).items()},
        "spectral_radius": _known(run.spectral_radius),
        "peak_command": _known(peak(record.command)),
        **{f"peak_{name}": _known(value) for name, value in peaks._asdict().items()},
        "peak_drifts": [_known(value) for value in run.peak_drifts],
        "engine": run.engine,
    }


def key_of_run(config: Config, sha256: str, engine: str, capture: bool = False) -> str:
    """Return the key that a study gives a run.

    Parameters
    ----------
    config : Config
        Configuration of the run; where its record lies does not matter.
    sha256 : str
        SHA-256 of its record.
    engine, capture
        As in `Study`.
    """
    selection = config.ground_motion
    return _run_key(_configuration_hash(config, engine, capture), sha256, selection.component, selection.unit)


def with_scheme(config: Config, scheme: str) -> Config:
    """Return a configuration with another compensation scheme.

    Parameters
    ----------
    config : Config
        The whole configuration.
    scheme : str
        Its name.
    """
    return dataclasses.replace(config, run=dataclasses.replace(config.run, scheme=scheme))


def _known(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _plain(value: Any) -> Any:
    """Return a value without NaN."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    return _known(value) if isinstance(value, float) else value


def varied(config: Config, variation: Mapping[str, object]) -> Config:
    """Return a configuration with other values of some parameters.

    Parameters
    ----------
    config : Config
        The whole configuration.
    variation : Mapping of str to object
        Values by ``section.key``.

    Raises
    ------
    InputError
        A parameter is unknown, or a value is not allowed.
    """
    try:
        return config.changed(**{name.replace(".", "__", 1): value for name, value in variation.items()})
    except InputError as error:
        given = ", ".join(f"{name}={value}" for name, value in variation.items())
        raise InputError(f"--vary {given}: {error}") from error


def _configuration_hash(config: Config, engine: str, capture: bool) -> str:
    """Return a hash of everything that is configured but which record it is."""
    mapping = config.as_mapping()
    for name in ("record", "component", "unit"):
        del mapping["ground_motion"][name]
    content = [__version__, mapping, *([engine] if engine else []), *(["capture"] if capture else [])]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _run_key(configuration_hash: str, sha256: str, component: str, unit: str) -> str:
    return hashlib.sha256("\n".join((configuration_hash, sha256, component, unit)).encode()).hexdigest()
