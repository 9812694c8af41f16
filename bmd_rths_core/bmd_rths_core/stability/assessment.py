"""Whether a specimen may go on the table: three stability analyses of one configuration, side by side.

- *continuous*: the loop of Eqs. 7 and 8 as the paper draws it, the numerical substructure an oscillator of its first
  mode, with the modes and the feedback delay that are asked for;
- *continuous_complete*: the same scheme and table, every mode of both substructures with the damping that couples them,
  and the one step between shear and feedback that the loop really has;
- *discrete*: the loop as it is run, all its stages, from one step to the next.

The first two exist for the compensators of the paper, and are not applicable to others, nor to a numerical substructure
with sub-steps, which they know nothing of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.loop.linear_loop import ClosedLoop
from bmd_rths_core.stability.analysed_loops import AnalysedLoops, AnalysisOptions, analysed_loops
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, LoopTransferFunction, StabilityMargin
from bmd_rths_core.stability.controlled import controlled_margin
from bmd_rths_core.stability.discrete import configured_mass_ratio, discrete_margin, with_feedback_scale
from bmd_rths_core.stability.substepped import substepped_margin


@dataclass(frozen=True)
class Analysis:
    """Result of one analysis.

    Parameters
    ----------
    margin : StabilityMargin
        Allowable mass ratio.
    stable : bool
        The loop is stable at the configured mass ratio.
    """

    margin: StabilityMargin
    stable: bool


@dataclass(frozen=True)
class DiscreteAnalysis(Analysis):
    """Result of the discrete analysis.

    Parameters
    ----------
    margin, stable
        See `Analysis`.
    spectral_radius : float
        At the configured mass ratio.
    """

    spectral_radius: float


@dataclass(frozen=True)
class Assessment:
    """The analyses of one configuration.

    Parameters
    ----------
    mass_ratio : float
        ρ of Eq. 8 with the share of the shear that is fed back.
    whole_mass_ratio : float
        ρ with the whole shear fed back.
    continuous, continuous_complete : Analysis or None
        See the module; None where they are not applicable, because the compensator is none of the paper's or the
        numerical substructure has sub-steps.
    discrete : DiscreteAnalysis or None
        None when it could not be made.
    discrete_reason : str
        Why it could not be made; empty otherwise.
    unknown_modes : str
        Text that says why the table is not known well enough for a verdict; empty otherwise.
    owner : str
        Name of the compensator where it owns the interface: its mass ratios are those of the real specimen, and the
        share of the shear is part of its design. Empty otherwise.
    """

    mass_ratio: float
    whole_mass_ratio: float
    continuous: Analysis | None
    continuous_complete: Analysis | None
    discrete: DiscreteAnalysis | None
    discrete_reason: str
    unknown_modes: str = ""
    owner: str = ""

    @property
    def analyses(self) -> dict[str, Analysis]:
        """Those that could be made, by name."""
        names = ("continuous", "continuous_complete", "discrete")
        analyses = zip(names, (self.continuous, self.continuous_complete, self.discrete), strict=True)
        return {name: analysis for name, analysis in analyses if analysis is not None}

    @property
    def go(self) -> bool:
        """True when every analysis that could be made is stable as configured, and the table is known well enough."""
        made = self.analyses.values()
        return bool(made) and not self.unknown_modes and all(analysis.stable for analysis in made)

    @property
    def gain_margins(self) -> dict[str, float]:
        """Factor by which the shear fed back may grow until an analysis leaves its first stable interval, by name."""
        configured = _mass_quotient(self.mass_ratio)
        return {n: _mass_quotient(a.margin.allowable_mass_ratio) / configured for n, a in self.analyses.items()}

    @property
    def largest_feedback_scale(self) -> float:
        """Largest share of the shear for which all analyses are stable, 1 at most; 0 when there is none.

        NaN where the compensator owns the interface, or no analysis could be made.
        """
        if self.owner or not self.analyses:
            return float("nan")
        whole = _mass_quotient(self.whole_mass_ratio)
        shares = [
            [
                (_mass_quotient(i.lower) / whole, _mass_quotient(i.upper) / whole)
                for i in analysis.margin.stable_intervals
            ]
            for analysis in self.analyses.values()
        ]
        candidates = [1.0, *(upper for intervals in shares for _, upper in intervals if upper < 1.0)]
        return max(
            (
                share
                for share in candidates
                if all(any(lower < share <= upper for lower, upper in intervals) for intervals in shares)
            ),
            default=0.0,
        )

    @property
    def verdict_text(self) -> str:
        """Sentence that states the verdict and the numbers it rests on."""
        if self.unknown_modes:
            return f"NO-GO: {self.unknown_modes}"
        if not self.analyses:
            return f"NO-GO: no analysis could be made: {self.discrete_reason}"
        if self.owner:
            return self._verdict_of_owner()
        if not self.go:
            unstable = {name: analysis for name, analysis in self.analyses.items() if not analysis.stable}
            share = self.largest_feedback_scale
            remedy = (
                f"all analyses are stable up to a feedback scale of {_rounded_down(share)}"
                if share > 0.0
                else "there is no feedback scale at which all analyses are stable"
            )
            return f"NO-GO: mass ratio {self.mass_ratio:.3f} is above the allowable {_listed(unstable)}; {remedy}"
        conditional = {n: a for n, a in self.analyses.items() if self.mass_ratio > a.margin.allowable_mass_ratio}
        if conditional:
            return (
                f"GO: mass ratio {self.mass_ratio:.3f} is stable, but conditionally: above the allowable "
                f"{_listed(conditional)} the loop is unstable and then stable again"
            )
        return (
            f"GO: mass ratio {self.mass_ratio:.3f} is below the allowable {_listed(self.analyses)}; "
            f"the shear could be {min(self.gain_margins.values()):.2f} times as large"
        )

    def _verdict_of_owner(self) -> str:
        analysis = self.discrete
        if analysis is None or not analysis.stable:
            radius = "" if analysis is None else f" (spectral radius {analysis.spectral_radius:.6f})"
            return f"NO-GO: the loop of {self.owner} is not stable at mass ratio {self.mass_ratio:.3f}{radius}"
        interval, configured = analysis.margin.stable_intervals[0], _mass_quotient(self.mass_ratio)
        lower, upper = (_mass_quotient(end) / configured for end in interval[:2])
        return (
            f"GO: the loop of {self.owner} is stable at mass ratio {self.mass_ratio:.3f}, and with a real specimen of "
            f"{lower:.2f}{_at(interval.lower_frequency)} to {upper:.2f}{_at(interval.upper_frequency)} times the mass "
            "that is known"
        )


def assess(config: Config, options: AnalysisOptions, loops: AnalysedLoops | None = None) -> Assessment:
    """Make the three analyses of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    options : AnalysisOptions
        What is not in it.
    loops : AnalysedLoops, optional
        `analysed_loops` of both, where they have been made already.

    Returns
    -------
    Assessment

    Raises
    ------
    InputError
        The options do not fit the configuration, or a substructure has no damping.
    """
    ratio, whole = configured_mass_ratio(config), configured_mass_ratio(with_feedback_scale(config, 1.0))
    # A numerical substructure that is next to nothing is examined too.
    largest = max(LARGEST_MASS_RATIO, 0.5 * (1.0 + whole))
    loops = analysed_loops(config, options) if loops is None else loops
    discrete, reason = _discrete(config, options, loops.discrete, ratio, largest)
    return Assessment(
        ratio,
        whole,
        None if loops.paper is None else _continuous(loops.paper, ratio, largest),
        None if loops.complete is None else _continuous(loops.complete, ratio, largest),
        discrete,
        reason,
        _unknown_modes(config, options),
        config.run.scheme if config.compensator.control is not None else "",
    )


def _continuous(loop: LoopTransferFunction, ratio: float, largest: float) -> Analysis:
    margin = loop.margin(largest)
    return Analysis(margin, any(i.lower < ratio < i.upper for i in margin.stable_intervals))


def _discrete(
    config: Config, options: AnalysisOptions, loop: ClosedLoop | None, ratio: float, largest: float
) -> tuple[DiscreteAnalysis | None, str]:
    if loop is None:
        return None, f"the measured frequency response of the table has no fit: {options.not_fitted}"
    radius = loop.spectral_radius
    if config.compensator.control is not None:
        margin = controlled_margin(config, ratio, largest)
    elif loop.substeps > 1:
        margin = substepped_margin(config, largest)
    else:
        margin = discrete_margin(config, largest, loop)
    return DiscreteAnalysis(margin, radius < 1.0, radius), ""


def _unknown_modes(config: Config, options: AnalysisOptions) -> str:
    """Tell when a mode of the specimen, or the first one of the numerical substructure, is above what was measured."""
    if options.measured_table is None:
        return ""
    buildings = config.specimen.building(), config.numerical_substructure.building()
    highest = max(float(buildings[0].modes().frequencies[-1]), float(buildings[1].modes().frequencies[0]))
    last = options.measured_table.last_frequency
    if last >= highest:
        return ""
    known, needed = last / (2.0 * np.pi), highest / (2.0 * np.pi)
    return (
        f"the table was measured up to {known:.4g} Hz, but the substructures have modes up to {needed:.4g} Hz; "
        "a measurement that covers them is required"
    )


def _mass_quotient(ratio: float) -> float:
    """Return m_E/m_N, which the shear is proportional to, for a mass ratio."""
    return ratio / (1.0 - ratio)


def _listed(analyses: dict[str, Analysis]) -> str:
    return ", ".join(
        f"{a.margin.allowable_mass_ratio:.3f} ({name}{_at(a.margin.critical_frequency)})"
        for name, a in analyses.items()
    )


def _at(frequency: float) -> str:
    return "" if np.isnan(frequency) else f", {frequency / (2.0 * np.pi):.2f} Hz"


def _rounded_down(share: float) -> str:
    return f"{np.floor(share * 1e4) / 1e4:.4f}"
