"""Frequency responses of a recorded run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.identification.frequency_response import FrequencyResponse, estimate_frequency_response
from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]

#: Lengths of a spectral segment [s]; the longest the record allows is taken.
_SEGMENTS = (20.48, 10.24, 5.12, 2.56)

#: Highest frequency that is shown [rad/s].
_HIGHEST = 2.0 * np.pi * 25.0


def recorded_response(excitation: FloatArray, response: FloatArray, record: RunRecord) -> FrequencyResponse:
    """Estimate a frequency response from two signals of a record, whose gaps are bridged by straight lines.

    Parameters
    ----------
    excitation : ndarray, shape (N,)
        What moved.
    response : ndarray, shape (N,) or (N, n)
        What followed.
    record : RunRecord
        The run they are from.

    Raises
    ------
    InputError
        The record is too short, or the excitation is zero.
    """
    x = filled(excitation)
    y = np.apply_along_axis(filled, 0, response) if len(response) else response
    available = 0.5 * len(x) * record.time_step  # four segments with their overlap need 1.75 of one
    segment = next((length for length in _SEGMENTS if length <= available), _SEGMENTS[-1])
    return estimate_frequency_response(x, y, record.time_step, segment).between(0.0, _HIGHEST)
