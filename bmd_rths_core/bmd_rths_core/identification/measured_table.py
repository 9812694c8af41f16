"""A table that is known by its measured frequency response: fitted once, and from then on a table of sections."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.frequency_response import FrequencyResponse
from bmd_rths_core.identification.spectral_lines import LEAST_COHERENCE, SpectralLines
from bmd_rths_core.identification.table_model import LARGEST_ORDER, TableModel, fitted_model
from bmd_rths_core.table.response_file import ResponseFile, read_response

#: Number of coherent frequencies that a fit needs, and how many of them for each pole.
LEAST_FREQUENCIES, _PER_POLE = 12, 4

#: Smallest standard deviation of a line over its size: no measurement is better.
_LEAST_NOISE = 1e-4

#: Band over which the delay is taken, where it was measured there [rad/s].
_DELAY_BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 8.0)


def fit_response(measured: ResponseFile, time_step: float) -> TableModel:
    """Fit a model to a measured frequency response, with the fit of `identify_table`.

    Parameters
    ----------
    measured : ResponseFile
        Achieved from commanded acceleration; without coherence every frequency counts by its relative error.
    time_step : float
        Δt of the loop, for the delay in steps [s].

    Returns
    -------
    TableModel

    Raises
    ------
    InputError
        Too few frequencies are coherent, or the table moves against its command.
    """
    size = np.abs(measured.response)
    coherence = np.ones(len(size)) if measured.coherence is None else measured.coherence
    used = coherence >= LEAST_COHERENCE
    if np.count_nonzero(used) < LEAST_FREQUENCIES:
        raise InputError(
            f"{np.count_nonzero(used)} frequencies have a coherence of {LEAST_COHERENCE:g} or more; "
            f"{LEAST_FREQUENCIES} are required"
        )
    # The share 1 − γ² of the response is not explained, that is (1 − γ²)/γ² of the explained part.
    share = np.sqrt((1.0 - coherence) / np.maximum(coherence, LEAST_COHERENCE))
    weight = np.where(used, 1.0 / (size * np.maximum(share, _LEAST_NOISE)), 0.0)
    lines = SpectralLines(measured.frequencies, measured.response[:, None], weight[:, None])
    response = FrequencyResponse(measured.frequencies, measured.response[:, None], coherence[:, None])
    known = response.between(*_DELAY_BAND).frequencies
    band = _DELAY_BAND if len(known) else (float(measured.frequencies[0]), float(measured.frequencies[-1]))
    highest = min(LARGEST_ORDER, np.count_nonzero(used) // _PER_POLE)
    return fitted_model(lines, response, band, time_step, highest=highest)


def with_fitted_table(config: Config) -> Config:
    """Return a configuration whose table, where it is known by a measured frequency response, is fitted to it.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    Config
        With ``simulated_table.sections``, ``command_delay`` and ``fit_error``; the same one where no table is to be
        fitted, or has been before.

    Raises
    ------
    InputError
        The file is wrong, or does not bear a fit; it is named.
    """
    table = config.simulated_table
    if table.dynamics != "measured" or table.sections:
        return config
    try:
        model = fit_response(read_response(table.frequency_response), config.run.time_step)
    except InputError as error:
        told = str(error).removeprefix(f"{table.frequency_response}: ")
        raise InputError(f"simulated_table.frequency_response: {table.frequency_response}: {told}") from error
    return config.changed(
        simulated_table__sections=list(model.sections),
        simulated_table__command_delay=model.rational.delay,
        simulated_table__fit_error=float(f"{model.fit_error:.6g}"),
    )
