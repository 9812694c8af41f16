"""What an identification leaves behind: a model that ROS and every command read, and the measured response."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import yaml

from bmd_rths_core.identification.frequency_response import FrequencyResponse


def model_text(parameters: Mapping[str, Mapping[str, Any]], remarks: Iterable[str]) -> str:
    """Return a partial parameter file: the sections that were identified, and nothing else.

    Parameters
    ----------
    parameters : Mapping
        Section name to parameter name to value.
    remarks : iterable of str
        How they were found, a line of comment each.

    Returns
    -------
    str
        YAML that `Config.merged` and ROS read.
    """
    comments = "".join(f"# {remark}\n" for remark in remarks)
    sections = {"/**": {"ros__parameters": {name: dict(values) for name, values in parameters.items()}}}
    return comments + str(yaml.safe_dump(sections, sort_keys=False, default_flow_style=None))


def frequency_response_text(measured: FrequencyResponse) -> str:
    """Return a measured frequency response as CSV.

    Parameters
    ----------
    measured : FrequencyResponse
        Of one response.

    Returns
    -------
    str
        Columns ``frequency_hz``, ``magnitude``, ``phase_deg`` (followed up from the lowest frequency), ``coherence``.
    """
    response = measured.response.ravel()
    columns = (
        measured.frequencies / (2.0 * np.pi),
        np.abs(response),
        np.degrees(np.unwrap(np.angle(response))),
        measured.coherence.ravel(),
    )
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(("frequency_hz,magnitude,phase_deg,coherence", *rows)) + "\n"
