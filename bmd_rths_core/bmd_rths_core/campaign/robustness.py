"""Robustness: one test on many tables and specimens that are not quite what was identified, as a study."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bmd_rths_core.campaign.motions import CampaignMotion
from bmd_rths_core.campaign.study import Piece, Study
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError

#: How often the delay is a step more or less, and how often the table has a further mode, and how much of it.
_DELAYS = (-1, 0, 1)
_WITH_MODE, _MODE = 1.0 / 3.0, 0.1
#: What is scaled by 1 ± share, independently and uniformly.
_SCALED = (
    *("servo_real_pole", "servo_frequency", "servo_damping_ratio", "command_gain"),
    *(
        "specimen_stiffness_factor",
        "specimen_damping_factor",
        "acceleration_noise",
        "shear_noise",
        "displacement_noise",
    ),
)
#: Quantiles that are told.
_P95 = 95.0


@dataclass(frozen=True)
class RobustnessStudy:
    """Every scheme on many drawn plants, which no model of the loop knows.

    Parameters
    ----------
    config : Config
        The nominal test; its section simulated_table is what the plants are drawn around.
    motions : sequence of CampaignMotion
        The ground motions.
    schemes : sequence of str
        The compensators.
    plants : int
        How many are drawn.
    share : float
        Uniform ± share of poles, gain, stiffness, damping and noise; the delay is a step less, the same or a step more,
        and a third of the plants have a further mode at 25 Hz.
    seed : int
        Of the drawing: the first plants of a larger study are those of a smaller one.
    engine : str
        Part of the key of a run, as `CampaignStudy` has it.
    identified : bool
        Draw from the standard deviations of the identified model instead, normally; the share does not matter then.

    Raises
    ------
    InputError
        The share is not between 0 and 1, or there are no standard deviations.
    """

    config: Config
    motions: Sequence[CampaignMotion]
    schemes: Sequence[str]
    plants: int
    share: float = 0.1
    seed: int = 0
    engine: str = ""
    identified: bool = False

    def __post_init__(self) -> None:
        """Check the share."""
        if self.identified and not self.config.identified_model.stiffness_deviations:
            raise InputError(
                "identified_model.stiffness_deviations: none; a model with them, as `bmd-rths identify` writes it, is "
                "required"
            )
        if not 0.0 <= self.share < 1.0:
            raise InputError(f"--share {self.share:g}: is not allowed; >= 0 and < 1 is required")

    @property
    def size(self) -> int:
        """Number of runs."""
        return self.plants * len(self.schemes) * len(self.motions)

    def pieces(self) -> Iterator[Piece]:
        """Return the runs of one plant after the other.

        Yields
        ------
        Piece
            With the drawn parameters as its variation.
        """
        for index in range(self.plants):
            random = np.random.default_rng((self.seed, index))
            drawn = identified_plant(self.config, random) if self.identified else None
            variation = drawn or drawn_plant(self.config, self.share, random)
            changes = {name.replace(".", "__", 1): value for name, value in variation.items()}
            study = Study(self.config.changed(**changes), self.motions, self.schemes, capture=True)
            for piece in study.pieces():
                yield dataclasses.replace(piece, variation=variation)


def drawn_plant(config: Config, share: float, random: np.random.Generator) -> dict[str, object]:
    """Draw a table with a specimen on it.

    Parameters
    ----------
    config : Config
        What is drawn around.
    share : float
        As in `RobustnessStudy`.
    random : numpy.random.Generator
        Where the numbers come from.

    Returns
    -------
    dict of str to object
        Parameters of the section simulated_table, as ``section.key``; a delay is never negative.
    """
    table = config.simulated_table
    factors = 1.0 + share * random.uniform(-1.0, 1.0, len(_SCALED))
    values: dict[str, object] = {
        name: float(factor) * getattr(table, name) for name, factor in zip(_SCALED, factors, strict=True)
    }
    rows = np.array(table.sections, dtype=float).reshape(-1, 6)
    if len(rows):  # s becomes s / r: the poles and zeros of a section r times as fast, its gain as it was
        speeds = 1.0 + share * random.uniform(-1.0, 1.0, len(rows))
        powers = speeds[:, None] ** np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0])
        values["sections"] = (rows * powers).ravel().tolist()
    step = config.run.time_step
    values["command_delay"] = max(0.0, table.command_delay + float(random.choice(_DELAYS)) * step)
    values["unmodelled_mode"] = _MODE if random.uniform() < _WITH_MODE else 0.0
    return {f"simulated_table.{name}": value for name, value in values.items()}


def identified_plant(config: Config, random: np.random.Generator) -> dict[str, object]:
    """Draw a table with a specimen on it from what its identification is not sure of.

    Parameters
    ----------
    config : Config
        What is drawn around, with the standard deviations of an identified model.
    random : numpy.random.Generator
        Where the numbers come from.

    Returns
    -------
    dict of str to object
        Parameters of the section simulated_table, as ``section.key``. All stories have one factor of stiffness and one
        of damping, with the mean of their deviations.
    """
    table, model = config.simulated_table, config.identified_model
    stories = [
        float(np.mean(np.asarray(deviations) / np.asarray(values)))
        for deviations, values in (
            (model.stiffness_deviations, model.stiffnesses),
            (model.damping_deviations, model.damping_coefficients),
        )
    ]
    relative = {"specimen_stiffness_factor": stories[0], "specimen_damping_factor": stories[1]}
    delay = 0.0
    if model.table_deviations and model.table == "interacting_servo":
        names = ("gain", "servo_real_pole", "servo_frequency", "servo_damping_ratio", "platen_mass")
        relative |= {n: d / getattr(model, n) for n, d in zip(names, model.table_deviations, strict=False)}
        relative["command_gain"] = relative.pop("gain")
        delay = model.table_deviations[-1]
    factors = np.exp(np.fromiter(relative.values(), float) * random.standard_normal(len(relative)))
    values: dict[str, object] = {
        name: float(factor) * getattr(table, name) for name, factor in zip(relative, factors, strict=True)
    }
    values["command_delay"] = max(0.0, table.command_delay + delay * float(random.standard_normal()))
    return {f"simulated_table.{name}": value for name, value in values.items()}


#: Words of `RunRecord.stability` that are counted.
BAD_ENDS = ("unstable", "limit", "failed")


def distributions(results: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return what the plants made of every scheme.

    Parameters
    ----------
    results : iterable of Mapping
        Of the runs, as `run_piece` has them.

    Returns
    -------
    dict of str to dict
        By scheme: ``runs``, how many of them were ``unstable`` (the stability limit ended the run, or the spectral
        radius is 1 or more), how many ended at another ``limit``, how many ``failed``, and of every
        measure ``mean``, ``median``, ``p95`` and ``worst`` over the runs that came to their end; None without any.
    """
    by_scheme: dict[str, list[Mapping[str, Any]]] = {}
    for result in results:
        by_scheme.setdefault(result["scheme"], []).append(result)
    return {scheme: _distribution(runs) for scheme, runs in by_scheme.items()}


def _distribution(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    words = Counter("unstable" if (run["spectral_radius"] or 0.0) >= 1.0 else run["stability"] for run in runs)
    stable = [run for run in runs if run["stability"] == "stable" and (run["spectral_radius"] or 0.0) < 1.0]
    measures = {
        "substructure_percent": [run["rmse_true_percent"]["substructure"] for run in stable],
        "superstructure_clean_percent": [run["rmse_clean_percent"]["superstructure"] for run in stable],
        "capture_substructure": [run["capture"]["substructure"] for run in stable],
        "capture_superstructure": [run["capture"]["superstructure"] for run in stable],
        "spectral_radius": [run["spectral_radius"] for run in runs],
        "peak_command": [run["peak_command"] for run in stable],
        "peak_displacement": [run["peak_displacement"] for run in stable],
    }
    summary: dict[str, Any] = {"runs": len(runs), **{word: words[word] for word in BAD_ENDS}}
    for name, values in measures.items():
        summary[name] = _summary([value for value in values if value is not None], small="capture" in name)
    return summary


def _summary(values: Sequence[float], small: bool) -> dict[str, float | None]:
    """Return mean and quantiles; of a measure whose small values are bad, p95 is what 95 % have at least."""
    if not values:
        return dict.fromkeys(("mean", "median", "p95", "worst"))
    bad, worst = (100.0 - _P95, min(values)) if small else (_P95, max(values))
    quantile, median = np.percentile(values, (bad, 50.0)).tolist()
    return {"mean": float(np.mean(values)), "median": median, "p95": quantile, "worst": worst}
