"""Stability margins of the loops of a study: one for every scheme and variation, whatever the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bmd_rths_core.campaign.study import varied, with_scheme
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess


def margins_of(config: Config, scheme: str, variation: Mapping[str, object]) -> dict[str, float | None]:
    """Return the margins of a loop by the analysis in discrete time, as ``bmd-rths stability`` has them.

    Parameters
    ----------
    config : Config
        Of what is not varied.
    scheme : str
        The compensator.
    variation : Mapping of str to object
        What is varied, by ``section.key``.

    Returns
    -------
    dict of str to float
        ``mass_ratio``, the ``allowable_mass_ratio`` up to which the loop is stable, and ``gain_margin``, the factor by
        which m_E/m_N may grow until then; None where the analysis cannot be made.
    """
    try:
        assessment = assess(with_scheme(varied(config, variation), scheme), AnalysisOptions())
    except InputError:
        return dict.fromkeys(("mass_ratio", "allowable_mass_ratio", "gain_margin"))
    discrete = assessment.discrete
    allowable = math.nan if discrete is None else discrete.margin.allowable_mass_ratio
    gain = assessment.gain_margins.get("discrete", math.nan)
    told = {"mass_ratio": assessment.mass_ratio, "allowable_mass_ratio": allowable, "gain_margin": gain}
    return {name: value if math.isfinite(value) else None for name, value in told.items()}
