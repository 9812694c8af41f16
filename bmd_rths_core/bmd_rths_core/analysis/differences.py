"""In which parameters some tests differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: What is told of a test anyway, or says nothing of it.
_TOLD = ("run.scheme", "ground_motion.record", "recorder.directory")

#: How a file is read: every record has its own.
_OF_THE_FILE = (
    "ground_motion.component",
    "ground_motion.unit",
    "ground_motion.columns",
    "ground_motion.record_time_step",
)

#: How a test is run, which its result does not depend on.
_OF_THE_HOST = ("run.lockstep", "run.record", "run.preflight", "run.settling_time", "recorder.flush_period")


def differences(configurations: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the parameters of each test that are not the same in all of them.

    Parameters
    ----------
    configurations : sequence of Mapping
        Resolved configurations, as nested plain values.

    Returns
    -------
    list of dict
        By ``section.key``; None where a test does not have the parameter. Without scheme and record, which every
        result tells.
    """
    flat = [dict(_parameters(configuration)) for configuration in configurations]
    names = {name: None for parameters in flat for name in parameters if name not in _TOLD}
    differing = [name for name in names if any(parameters.get(name) != flat[0].get(name) for parameters in flat)]
    return [{name: parameters.get(name) for name in differing} for parameters in flat]


def of_the_result(differs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the differences that make another test of it, and not the same one by another host or of another file.

    Parameters
    ----------
    differs : Mapping
        As `differences` has them.
    """
    return {name: value for name, value in differs.items() if name not in _OF_THE_FILE and name not in _OF_THE_HOST}


def _parameters(configuration: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in configuration.items():
        if isinstance(value, Mapping):
            yield from _parameters(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", list(value) if isinstance(value, tuple) else value
