"""The building that a test is really of: the specimen on the table, as far as it is known, over the numerical part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import references_of
from bmd_rths_core.analysis.reference import nonlinear_reference_response, softened_reference_response
from bmd_rths_core.config import Config
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.nonlinear_building import nonlinear_building

FloatArray = NDArray[np.float64]


class TrueSpecimen(NamedTuple):
    """What stands on the table, as far as it is known.

    Parameters
    ----------
    building : LinearBuilding
        The specimen.
    origin : str
        ``"simulated"``: that of the simulated table; ``"identified"``: that of the section identified_model.
    """

    building: LinearBuilding
    origin: str


def true_specimen(config: Config) -> TrueSpecimen | None:
    """Return the specimen that errors are judged against.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    TrueSpecimen or None
        None on a table that is not simulated in process, whose specimen nobody identified.

    Raises
    ------
    InputError
        The identified specimen has another number of stories.
    """
    nominal = config.specimen.building()
    if config.table.controller == "simulated":
        return TrueSpecimen(config.simulated_table.specimen(nominal), "simulated")
    if config.identified_model.stiffnesses:
        return TrueSpecimen(config.identified_model.specimen(nominal), "identified")
    return None


def true_references_of(
    grounds: Sequence[FloatArray], config: Config, nominal: Sequence[FloatArray]
) -> list[FloatArray]:
    """Return the responses of the building with the true specimen; all NaN where it is not known.

    Parameters
    ----------
    grounds : sequence of ndarray, each of shape (N,)
        a_g at the steps [m/s²].
    config : Config
        The whole configuration.
    nominal : sequence of ndarray, each of shape (N, n)
        Responses with the nominal specimen: they are the same where the true one is the nominal one.

    Returns
    -------
    list of ndarray, each of shape (N, n)
        Absolute acceleration of every floor [m/s²].
    """
    if config.table.controller == "simulated" and config.simulated_table.damaged:
        return simulated_references_of(grounds, config)
    specimen = true_specimen(config)
    if specimen is None:
        return [np.full_like(reference, np.nan) for reference in nominal]
    if specimen.building == config.specimen.building():
        return list(nominal)
    return references_of(grounds, config, specimen.building)


def simulated_references_of(grounds: Sequence[FloatArray], config: Config) -> list[FloatArray]:
    """Return the responses of the building with the specimen of the simulated table, which may soften or yield.

    Parameters
    ----------
    grounds : sequence of ndarray, each of shape (N,)
        a_g at the steps [m/s²].
    config : Config
        The whole configuration.

    Returns
    -------
    list of ndarray, each of shape (N, n)
        Absolute acceleration of every floor [m/s²].

    Raises
    ------
    InputError
        There is not one yield drift a story.
    """
    table, step = config.simulated_table, config.run.time_step
    specimen = table.specimen(config.specimen.building())
    if not table.damaged:
        return references_of(grounds, config, specimen)
    upper = specimen.scaled(config.force_correction.feedback_scale)
    lower = config.numerical_substructure.building()
    if table.yield_drifts:
        whole = nonlinear_building(lower, config.nonlinear).below(upper, table.springs(upper))
        return [nonlinear_reference_response(whole, ground, step) for ground in grounds]
    before, after = upper.stacked_on(lower), table.softened(upper).stacked_on(lower)
    begin = table.softening_step(step)
    return [softened_reference_response(before, after, begin, ground, step) for ground in grounds]
