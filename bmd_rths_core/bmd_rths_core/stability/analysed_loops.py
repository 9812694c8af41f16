"""Which loops are analysed: the one of Eqs. 7 and 8 as the paper draws it, and the one with everything in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bmd_rths_core.compensators.schemes import PHASE_LEAD, SCHEME_NAMES
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.linear_loop import ClosedLoop
from bmd_rths_core.stability.continuous import LoopTransferFunction, MarginCurve, margin_curve
from bmd_rths_core.stability.loop_elements import LoopElement, MeasuredResponse
from bmd_rths_core.stability.models import (
    IdentifiedMode,
    elastic_numerical_building,
    experimental_building,
    experimental_modes,
    first_effective_mass,
    numerical_oscillator,
    phase_lead_compensator,
    simulated_table,
    uncoupled_modes,
)

#: Values of `AnalysisOptions.modes` besides a number.
IDENTIFIED, ALL = "identified", "all"
#: Range of the sweep, relative to the configured frequency, and its points.
_SWEEP = (0.25, 2.0, 200)


@dataclass(frozen=True)
class AnalysisOptions:
    """What of the analyses is not in the configuration.

    Parameters
    ----------
    modes : int or str
        Modes of the experimental substructure in *continuous*: ``"identified"`` (the identified first mode of the
        configuration), ``"all"`` (all modes of the stories, uncoupled), or how many of the latter.
    feedback_delay_steps : int
        k ≥ 0 of *continuous*: the shear is fed back k steps late. 0 is Eq. 7.
    measured_table : MeasuredResponse, optional
        Table, in place of the simulated one; the discrete analysis is of its fit, which the configuration has then.
    not_fitted : str
        Why the measured table has no fit, so that there is no discrete analysis.
    """

    modes: int | str = ALL
    feedback_delay_steps: int = 0
    measured_table: MeasuredResponse | None = None
    not_fitted: str = ""


def has_continuous_loops(config: Config) -> bool:
    """Tell whether the compensator is one of the paper's, whose transfer functions are known, and nothing sub-stepped.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return config.run.scheme in SCHEME_NAMES and config.numerical_substructure.substeps == 1


def refuse_substeps(config: Config) -> None:
    """Refuse a loop with sub-steps, which no analysis in continuous time knows of.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        It has sub-steps.
    """
    substeps = config.numerical_substructure.substeps
    if substeps > 1:
        raise InputError(
            f"numerical_substructure.substeps: {substeps}, which the analyses in continuous time know nothing of; "
            "1 is required"
        )


def paper_loop(config: Config, options: AnalysisOptions) -> LoopTransferFunction:
    """Return the loop of the analysis *continuous*: Eq. 7 with one mode of the numerical substructure.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        Modes, feedback delay and table.

    Returns
    -------
    LoopTransferFunction

    Raises
    ------
    InputError
        The modes do not fit the configuration, or a substructure has no damping.
    """
    return _paper_loop(config, options, _shared(config, options))


def complete_loop(config: Config, options: AnalysisOptions) -> LoopTransferFunction:
    """Return the loop of the analysis *continuous_complete*: Eq. 7 with every mode and one step of feedback delay.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        Only its table matters.

    Returns
    -------
    LoopTransferFunction
        It knows no hold, no estimator and no force correction; `discrete` does. A numerical substructure that may yield
        is taken for small motion about rest.
    """
    return _complete_loop(config, _shared(config, options))


class AnalysedLoops(NamedTuple):
    """The loops of one configuration.

    Parameters
    ----------
    paper, complete : LoopTransferFunction or None
        `paper_loop` and `complete_loop`; None where `has_continuous_loops` says no.
    discrete : ClosedLoop or None
        `closed_loop`; None where the measured table has no fit.
    """

    paper: LoopTransferFunction | None
    complete: LoopTransferFunction | None
    discrete: ClosedLoop | None


def analysed_loops(config: Config, options: AnalysisOptions) -> AnalysedLoops:
    """Return all loops of a configuration that are analysed.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        What is not in it.

    Raises
    ------
    InputError
        The options do not fit the configuration, or a substructure has no damping.
    """
    discrete = None if options.not_fitted else closed_loop(config)
    if not has_continuous_loops(config):
        return AnalysedLoops(None, None, discrete)
    shared = _shared(config, options)
    return AnalysedLoops(_paper_loop(config, options, shared), _complete_loop(config, shared), discrete)


def sweep(config: Config, options: AnalysisOptions) -> MarginCurve:
    """Return the allowable mass ratio of *continuous* over the frequency of the numerical substructure.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        As for `paper_loop`.

    Returns
    -------
    MarginCurve
        From a quarter to twice the configured frequency, as Figures 7 and 11 of the paper.
    """
    frequency, damping_ratio = _first_mode(config)
    begin, end, points = _SWEEP
    loop = paper_loop(config, options)
    rest = (loop.experimental, loop.table, loop.compensator, loop.feedback_delay)
    return margin_curve(np.linspace(begin * frequency, end * frequency, points), damping_ratio, *rest)


def _first_mode(config: Config) -> tuple[float, float]:
    modes = config.elastic_substructure().modes()
    return float(modes.frequencies[0]), float(modes.damping_ratios[0])


class _Shared(NamedTuple):
    """What both loops of the scheme have in common; the delay is that of the table [s]."""

    table: LoopElement
    compensator: LoopElement | None
    delay: float


def _shared(config: Config, options: AnalysisOptions) -> _Shared:
    refuse_substeps(config)
    leads, measured = config.run.scheme in PHASE_LEAD, options.measured_table
    return _Shared(
        measured or simulated_table(config.simulated_table, config.specimen.building()),
        phase_lead_compensator(config.command_shaper, config.run.time_step) if leads else None,
        0.0 if measured else config.simulated_table.command_delay,
    )


def _paper_loop(config: Config, options: AnalysisOptions, shared: _Shared) -> LoopTransferFunction:
    return LoopTransferFunction(
        numerical_oscillator(*_first_mode(config)),
        experimental_modes(_modes(config, options.modes)),
        shared.table,
        shared.compensator,
        options.feedback_delay_steps * config.run.time_step + shared.delay,
    )


def _complete_loop(config: Config, shared: _Shared) -> LoopTransferFunction:
    effective_mass = first_effective_mass(config.numerical_substructure.building())
    return LoopTransferFunction(
        elastic_numerical_building(config.elastic_substructure(), effective_mass),
        experimental_building(config.specimen.building()),
        shared.table,
        shared.compensator,
        config.run.time_step + shared.delay,
    )


def _modes(config: Config, choice: int | str) -> tuple[IdentifiedMode, ...]:
    stories = uncoupled_modes(config.specimen.building())
    if choice == ALL:
        return stories
    if choice == IDENTIFIED:
        specimen, first = config.specimen, stories[0]
        frequency = specimen.identified_frequency or first.frequency
        return (IdentifiedMode(frequency, specimen.identified_damping_ratio or first.damping_ratio),)
    if isinstance(choice, int) and 1 <= choice <= len(stories):
        return stories[:choice]
    allowed = f"{IDENTIFIED}, {ALL} or a number from 1 to {len(stories)}"
    raise InputError(f"modes: {choice} is not allowed; {allowed} is required")
