"""Sensitivity of the stability to every parameter that enters the loop, 10 % down and 10 % up.

There is no list of such parameters. Every number that is declared in the configuration is changed, and those that leave
the loop as it is, to the last bit, do not enter it.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import SECTIONS, Config, compensation_sections
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs
from bmd_rths_core.stability.analysed_loops import AnalysedLoops, AnalysisOptions, analysed_loops
from bmd_rths_core.stability.assessment import Assessment, assess
from bmd_rths_core.table.models.dynamics import SECTION_LENGTH

#: Relative change of every parameter.
CHANGE = 0.1
#: Frequencies at which two loops are compared [rad/s].
_PROBE = np.geomspace(1.0, 1000.0, 16)


@dataclass(frozen=True)
class ChangedParameter:
    """The loop with one parameter changed.

    Parameters
    ----------
    value : float
        Changed value, in the unit of the parameter.
    assessment : Assessment or None
        None when the value is not allowed.
    problem : str
        Why it is not allowed; empty otherwise.
    flips_verdict : bool
        The verdict is another one.
    """

    value: float
    assessment: Assessment | None
    problem: str
    flips_verdict: bool


@dataclass(frozen=True)
class ParameterSensitivity:
    """What one parameter does to the stability.

    Parameters
    ----------
    parameter : str
        ``section.parameter``, with the index of the entry of a list.
    value : float
        Configured value, in the unit of the parameter.
    decreased, increased : ChangedParameter
        The loop at 0.9 and 1.1 of it.
    effect : float
        Largest relative change of a gain margin, of any of the analyses.
    """

    parameter: str
    value: float
    decreased: ChangedParameter
    increased: ChangedParameter
    effect: float


def sensitivity(
    config: Config, options: AnalysisOptions, progress: Callable[[float], None] | None = None
) -> list[ParameterSensitivity]:
    """Return the effect of every parameter that enters the loop and is not 0.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        What of the analyses is not in it.
    progress : callable, optional
        Is told the share of the work that is done, up to 1.

    Returns
    -------
    list of ParameterSensitivity
        The largest effect first.

    Raises
    ------
    InputError
        See `assessment.assess`.
    """
    loops, sections = _watched_loops(config, options)
    base = _Base(assess(config, options, loops), _probe(loops), sections)
    candidates = list(_candidates(config))
    found = []
    for done, (name, index) in enumerate(candidates, 1):
        entry = _sensitivity(config, options, base, name, index)
        if entry is not None:
            found.append(entry)
        if progress is not None:
            progress(done / len(candidates))
    return sorted(found, key=lambda entry: -entry.effect)


class _Base(NamedTuple):
    """The configuration as it is: its analyses, its probe, and the sections its loops are made from."""

    assessment: Assessment
    probe: NDArray[np.complex128]
    sections: set[str]


def _watched_loops(config: Config, options: AnalysisOptions) -> tuple[AnalysedLoops, set[str]]:
    """Return the loops, and the sections that were read to make them: no other one enters."""
    read = set()

    class Watched(Config):
        def __getattribute__(self, name: str) -> Any:
            read.add(name)
            return super().__getattribute__(name)

        def section(self, name: str) -> Any:
            read.add(name)
            return config.section(name)

    watched = Watched(**{field.name: getattr(config, field.name) for field in fields(Config)})
    read.clear()
    loops = analysed_loops(watched, options)
    if "compensation" in read:
        read.update(compensation_sections())
    return loops, read & set(SECTIONS)


def _candidates(config: Config) -> Iterator[tuple[str, int | None]]:
    """Yield name and entry of every number that is not 0, except coefficients that are 1 because a section says so."""
    for section, values in config.as_mapping().items():
        hints = typing.get_type_hints(SECTIONS[section])
        for key in specs(SECTIONS[section]):
            name, value = f"{section}.{key}", values[key]
            if hints[key] is float and value != 0.0:
                yield name, None
            elif isinstance(value, list):
                skipped = _leading_ones(value) if name == "simulated_table.sections" else set()
                yield from ((name, i) for i, entry in enumerate(value) if entry != 0.0 and i not in skipped)


def _leading_ones(sections: list[float]) -> set[int]:
    """Return where a polynomial of the sections begins with 1."""
    half = SECTION_LENGTH // 2
    polynomials = (range(begin, begin + half) for begin in range(0, len(sections), half))
    leading = (next((i for i in polynomial if sections[i] != 0.0), polynomial[-1]) for polynomial in polynomials)
    return {i for i in leading if sections[i] == 1.0}


def _sensitivity(
    config: Config, options: AnalysisOptions, base: _Base, name: str, index: int | None
) -> ParameterSensitivity | None:
    section, _, key = name.partition(".")
    value = getattr(config.section(section), key)
    configured = value if index is None else value[index]
    changes = []
    for factor in (1.0 - CHANGE, 1.0 + CHANGE):
        changed: Any = factor * configured
        if index is not None:
            changed = [*value[:index], changed, *value[index + 1 :]]
        try:
            other = config.changed(**{f"{section}__{key}": changed})
            if all(other.section(own) is config.section(own) for own in base.sections):
                return None
            loops = analysed_loops(other, options)
            if np.array_equal(_probe(loops), base.probe):
                return None
            result = assess(other, options, loops)
        except InputError as error:
            changes.append(ChangedParameter(factor * configured, None, str(error), False))
        else:
            changes.append(ChangedParameter(factor * configured, result, "", result.go != base.assessment.go))
    shown = name if index is None else f"{name}[{index}]"
    return ParameterSensitivity(shown, configured, changes[0], changes[1], _effect(base.assessment, changes))


def _effect(base: Assessment, changes: list[ChangedParameter]) -> float:
    def relative(before: float, after: float) -> float:
        if before == 0.0:
            return math.inf if after > 0.0 else 0.0
        return abs(after / before - 1.0)

    assessments = [change.assessment for change in changes if change.assessment is not None]
    margins = base.gain_margins
    return max((relative(margins[n], other.gain_margins[n]) for other in assessments for n in margins), default=0.0)


def _probe(loops: AnalysedLoops) -> NDArray[np.complex128]:
    """Return numbers that are the same, to the last bit, for configurations with the same loop."""
    continuous = (loop for loop in (loops.paper, loops.complete) if loop is not None)
    numbers = [loop.response(_PROBE, 0.5) for loop in continuous]
    if loops.discrete is not None:
        numbers.append(loops.discrete.system.a.ravel().astype(complex))
    return np.concatenate(numbers) if numbers else np.zeros(0, dtype=complex)
