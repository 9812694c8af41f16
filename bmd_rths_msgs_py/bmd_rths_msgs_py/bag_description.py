"""The story around the signals of a bag: what was run, with what, and how it ended, as text values.

The same values stand in two MCAP metadata records and in the custom data of ``metadata.yaml``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_core.record import TimingStatistics

#: MCAP metadata records: one before the first message, one behind the last.
START_RECORD = "bmd_rths"
END_RECORD = "bmd_rths_end"

#: What a record tells of its ground motion.
_OF_MOTION = ("name", "sha256", "source")


def start_metadata(
    configuration: Mapping[str, Any], motion: Mapping[str, Any], versions: Mapping[str, str]
) -> dict[str, str]:
    """Return what `BagWriter` has to be given at the start.

    Parameters
    ----------
    configuration, motion, versions : Mapping
        As in `RunRecord`.

    Returns
    -------
    dict of str to str
        Each of them as JSON.
    """
    return {"configuration": _json(configuration), "motion": _json(motion), "versions": _json(versions)}


def end_metadata(
    outcome: str, reason: str, timing: TimingStatistics | None, controller: str | None = None
) -> dict[str, str]:
    """Return what `BagWriter.close` has to be given.

    Parameters
    ----------
    outcome, reason, timing
        As in `RunRecord`.
    controller : str, optional
        ``told_controller`` of `RunRecord`; left out when there is none.

    Returns
    -------
    dict of str to str
        Outcome and reason as they are, timing as JSON (``null`` without one).
    """
    told = {} if controller is None else {"controller": controller}
    return {"outcome": outcome, "reason": reason, "timing": _json(None if timing is None else vars(timing)), **told}


def read_object(story: Mapping[str, str], key: str) -> dict[str, Any]:
    """Return a JSON object of a story.

    Parameters
    ----------
    story : Mapping of str to str
        A metadata record.
    key : str
        Its key.

    Returns
    -------
    dict of str to Any
        The object; empty when the key is missing.

    Raises
    ------
    InputError
        The value is not a JSON object.
    """
    try:
        content = json.loads(story.get(key, "{}"))
    except (TypeError, ValueError) as error:
        raise InputError(f"{key}: not JSON: {error}") from error
    if not isinstance(content, dict):
        raise InputError(f"{key}: {content!r} is not a JSON object")
    return content


def motion_of(story: Mapping[str, str]) -> dict[str, object]:
    """Return what a bag tells of its ground motion, with what it does not tell as unknown."""
    if "motion" not in story:
        raise InputError(f"its record {START_RECORD!r} has no entry 'motion'; the ground motion of the run is unknown")
    told = read_object(story, "motion")
    for key, value in told.items():
        if key in _OF_MOTION and not isinstance(value, str):
            raise InputError(f"motion: {key} is {str(value)[:60]!r}; text is required")
    return {**dict.fromkeys(_OF_MOTION, "unknown"), **told}


def read_timing(story: Mapping[str, str]) -> TimingStatistics | None:
    """Return the timing of a story.

    Parameters
    ----------
    story : Mapping of str to str
        The metadata record of the end.

    Returns
    -------
    TimingStatistics or None
        None when the run did not follow a clock or the record does not say.

    Raises
    ------
    InputError
        The timing is incomplete or not JSON.
    """
    if (story.get("timing") or "null") == "null":
        return None
    content = read_object(story, "timing")
    try:
        return TimingStatistics(
            missed_deadlines=int(content["missed_deadlines"]),
            max_consecutive_misses=int(content["max_consecutive_misses"]),
            missed_steps=tuple(int(step) for step in content["missed_steps"]),
            late_ticks=int(content["late_ticks"]),
            closure_ms={str(name): float(value) for name, value in content["closure_ms"].items()},
            closure_counts=tuple(int(count) for count in content.get("closure_counts", ())),
            slow_integrations=int(content.get("slow_integrations", 0)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"timing: {error!r}") from error


def _json(content: Any) -> str:
    return json.dumps(content, default=dict)  # default: any Mapping that is not a dict
