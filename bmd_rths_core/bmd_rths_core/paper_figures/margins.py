"""Allowable mass ratio over the frequency of the numerical substructure (Figures 7, 8 and 11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.paper_figures.stated_value import Comparison
from bmd_rths_core.paper_figures.systems import EIGHT_STORY, SIMPLIFIED, PaperSystem, table_name
from bmd_rths_core.stability.continuous import MarginCurve, margin_curve
from bmd_rths_core.stability.discrete import configured_mass_ratio
from bmd_rths_core.stability.loop_elements import Delay, LoopElement, Rational
from bmd_rths_core.stability.models import (
    EQUATION_9,
    IdentifiedMode,
    experimental_modes,
    phase_lead_compensator,
    simulated_table,
    table_sections,
    uncoupled_modes,
)

FloatArray = NDArray[np.float64]

#: Largest deviation of the mass ratio from the straight line between two points of a curve.
TOLERANCE = 1e-3

#: Points of a curve to begin with, and the distance at which a jump is taken for one [rad/s].
_FIRST_POINTS, _NARROWEST = 400, 1e-3

#: Range of ω_N that is shown [rad/s]; chosen here, as the text of the paper does not give the axes of its figures.
_HIGHEST = {EIGHT_STORY: 100.0, SIMPLIFIED: 150.0}


class LoopCase(NamedTuple):
    """One loop whose margin is shown.

    Parameters
    ----------
    label : str
        What distinguishes it.
    table : LoopElement
        Table.
    compensator : LoopElement or None
        Compensator.
    feedback_delay : float
        Delay of the shear that is fed back [s].
    """

    label: str
    table: LoopElement
    compensator: LoopElement | None = None
    feedback_delay: float = 0.0


class LabelledCurve(NamedTuple):
    """One curve of a margin figure.

    Parameters
    ----------
    label : str
        What distinguishes it from the other curves.
    curve : MarginCurve
        Allowable mass ratio over ω_N.
    at_system : float
        Allowable mass ratio at the ω_N of the system.
    """

    label: str
    curve: MarginCurve
    at_system: float


class MarginPanel(NamedTuple):
    """The curves for one model of the experimental substructure.

    Parameters
    ----------
    title : str
        Which modes it has.
    curves : tuple of LabelledCurve
        Curves.
    """

    title: str
    curves: tuple[LabelledCurve, ...]


class Mark(NamedTuple):
    """A mass ratio at the ω_N of the system.

    Parameters
    ----------
    mass_ratio : float
        ρ of Eq. 8.
    label : str
        What it is and who says so.
    """

    mass_ratio: float
    label: str


@dataclass(frozen=True)
class MarginFigure:
    """What Figure 7, 8 or 11 shows.

    Parameters
    ----------
    number : int
        Number of the figure.
    title : str
        What is shown.
    system : PaperSystem
        The system.
    highest : float
        Highest ω_N of the curves [rad/s].
    panels : tuple of MarginPanel
        One for each model of the experimental substructure.
    marks : tuple of Mark
        Mass ratios at the ω_N of the system: its own, and those the paper states.
    comparisons : tuple of Comparison
        Computed numbers beside those of the paper.
    """

    number: int
    title: str
    system: PaperSystem
    highest: float
    panels: tuple[MarginPanel, ...]
    marks: tuple[Mark, ...]
    comparisons: tuple[Comparison, ...]


def figure_7(config: Config) -> MarginFigure:
    """Return Figure 7: margin of the 8-story system with the dynamics of the table, with and without compensation."""
    table, delay = (
        simulated_table(config.simulated_table, config.specimen.building()),
        config.simulated_table.command_delay,
    )
    compensator = phase_lead_compensator(config.command_shaper, config.run.time_step)
    name = table_name(config)
    cases = (LoopCase(name, table, None, delay), LoopCase(f"{name} + PLC", table, compensator, delay))
    marks = (
        _mark_of(config, "paper: 0.65"),
        Mark(0.15, "paper: around 0.15, without PLC"),
        Mark(0.20, "paper: to 0.2, with PLC"),
    )
    return _figure(7, "with table dynamics", EIGHT_STORY, config, cases, marks, ("around 0.15", "to 0.2"), "0.65")


def figure_8(config: Config) -> MarginFigure:
    """Return Figure 8: margin of the 8-story system with a perfect table and one step of delay."""
    step = config.run.time_step
    cases = (LoopCase(f"perfect table, one step ({1e3 * step:g} ms) of delay", table_sections(), None, step),)
    marks = (_mark_of(config, 'paper: 0.65, "very close"'),)
    return _figure(8, "with a perfect table", EIGHT_STORY, config, cases, marks, ('"very close" to 0.65',), "0.65")


def figure_11(config: Config) -> MarginFigure:
    """Return Figure 11: margin of the simplified system with the dynamics of the table, without compensation.

    Parameters
    ----------
    config : Config
        The simplified system.

    Returns
    -------
    MarginFigure

    Notes
    -----
    The paper does not give the coefficients of the table it identified with the simplified specimen on it. Three others
    take its place: the pure delay of 25 ms it states, Eq. 9, which is the table of the 8-story system, and the table of
    the configuration.
    """
    configured = simulated_table(config.simulated_table, config.specimen.building())
    cases = (
        LoopCase("pure delay of 25 ms", Delay(0.025)),
        LoopCase("Eq. 9, the table of the 8-story system", table_sections(EQUATION_9)),
        LoopCase(f"configured: {table_name(config)}", configured, None, config.simulated_table.command_delay),
    )
    marks = (_mark_of(config, "configured"), Mark(0.20, "paper: 0.2, with its own table"))
    stated = ("0.2, its own table",) * len(cases)
    return _figure(
        11, "with table dynamics, without compensation", SIMPLIFIED, config, cases, marks, stated, "1.53 t, 8 t"
    )


def resolved_curve(highest: float, curve: Callable[[FloatArray], MarginCurve]) -> MarginCurve:
    """Return a margin curve with points wherever a straight line would not do.

    Parameters
    ----------
    highest : float
        Highest ω_N [rad/s].
    curve : callable
        Margin curve at some ω_N [rad/s].

    Returns
    -------
    MarginCurve
        In the middle between two points it is within `TOLERANCE` of the straight line, except at a jump.
    """
    parts = [curve(np.linspace(highest / _FIRST_POINTS, highest, _FIRST_POINTS))]
    omega, ratio = parts[0].frequencies, parts[0].allowable_mass_ratios
    ends = np.array([omega[:-1], ratio[:-1], omega[1:], ratio[1:]])
    while ends.size:
        middle = curve(0.5 * (ends[0] + ends[2]))
        parts.append(middle)
        here = np.array([middle.frequencies, middle.allowable_mass_ratios])
        bent = (np.abs(here[1] - 0.5 * (ends[1] + ends[3])) > TOLERANCE) & (ends[2] - ends[0] > _NARROWEST)
        halves = np.vstack((ends[:2], here)), np.vstack((here, ends[2:]))
        ends = np.hstack([half[:, bent] for half in halves])
    together = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(together[0])
    return MarginCurve(*(column[order] for column in together))


def _figure(
    number: int,
    title: str,
    system: PaperSystem,
    config: Config,
    cases: tuple[LoopCase, ...],
    marks: tuple[Mark, ...],
    stated: tuple[str, ...],
    own_ratio: str,
) -> MarginFigure:
    panels = tuple(
        MarginPanel(name, tuple(_labelled(case, config, experimental, _HIGHEST[system]) for case in cases))
        for name, experimental in _experimental_substructures(config).items()
    )
    comparisons = tuple(
        Comparison(f"margin, {curve.label}, {panel.title}", curve.at_system, "1", paper)
        for panel in panels
        for curve, paper in zip(panel.curves, stated, strict=True)
    )
    return MarginFigure(
        number,
        f"Allowable mass ratio of the {system.name} {title}",
        system,
        _HIGHEST[system],
        panels,
        marks,
        (*comparisons, Comparison("mass ratio of the system", marks[0].mass_ratio, "1", own_ratio)),
    )


def _labelled(case: LoopCase, config: Config, experimental: Rational, highest: float) -> LabelledCurve:
    modes = config.numerical_substructure.building().modes()
    frequency, damping_ratio = float(modes.frequencies[0]), float(modes.damping_ratios[0])

    def curve(omega: FloatArray) -> MarginCurve:
        return margin_curve(omega, damping_ratio, experimental, case.table, case.compensator, case.feedback_delay)

    at_system = float(curve(np.array([frequency])).allowable_mass_ratios[0])
    return LabelledCurve(case.label, resolved_curve(highest, curve), at_system)


def _experimental_substructures(config: Config) -> dict[str, Rational]:
    modes = uncoupled_modes(config.specimen.building())
    first = IdentifiedMode(
        config.specimen.identified_frequency or modes[0].frequency,
        config.specimen.identified_damping_ratio or modes[0].damping_ratio,
    )
    return {"identified first mode": experimental_modes([first]), "all modes": experimental_modes(modes)}


def _mark_of(config: Config, source: str) -> Mark:
    ratio = configured_mass_ratio(config)
    return Mark(ratio, f"system: {ratio:.3g} ({source})")
