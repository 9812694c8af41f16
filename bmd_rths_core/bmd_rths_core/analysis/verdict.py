"""The verdict of a run: green only where it ended as planned, in time, with error, delay and capture within bands."""

from __future__ import annotations

import math
from typing import NamedTuple

from bmd_rths_core.analysis.capture import Capture
from bmd_rths_core.record import LARGEST_LATE_SHARE, RunRecord
from bmd_rths_core.verdict_bands import VerdictConfig

GREEN, RED, UNJUDGED = "green", "red", "unjudged"


class Judgement(NamedTuple):
    """What a run is called, and why.

    Parameters
    ----------
    verdict : str
        ``"green"``; ``"red"`` where the run did not come to its end or a band does not hold; ``"unjudged"`` where
        nothing is wrong, but a band could not be looked at.
    reasons : tuple of str
        Sentences, one for each band that does not hold or could not be looked at.
    """

    verdict: str
    reasons: tuple[str, ...]


def judge(
    record: RunRecord, error_percent: float, delay_ms: float, capture: Capture, bands: VerdictConfig
) -> Judgement:
    """Judge the quality of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    error_percent, delay_ms : float
        Tracking error [%] and delay [ms] of the table; NaN where they are not known.
    capture : Capture
        NaN where it was not computed.
    bands : VerdictConfig
        What is good.
    """
    wrong, unknown = [], []
    if record.outcome != "finished":
        wrong.append(f"The run did not come to its end: {record.outcome}.")
    if record.kept_time is False and record.late_share is not None:
        allowed = f"at most {100.0 * LARGEST_LATE_SHARE:g} % is allowed"
        wrong.append(f"It was not in real time: {100.0 * record.late_share:.1f} % of the steps were late; {allowed}.")
    longest = 1e3 * bands.largest_delay
    lowest = min(capture) if all(map(math.isfinite, capture)) else float("nan")
    for name, value, holds, band in (
        (
            "tracking error",
            f"{error_percent:.1f} %",
            error_percent <= bands.largest_tracking_error,
            f"at most {bands.largest_tracking_error:g} %",
        ),
        ("delay", f"{delay_ms:.1f} ms", abs(delay_ms) <= longest, f"within {longest:g} ms"),
        ("capture", f"{lowest:.2f}", lowest >= bands.smallest_capture, f"at least {bands.smallest_capture:g}"),
    ):
        if value.startswith("nan"):
            unknown.append(f"The {name} is not known; {band} is required.")
        elif not holds:
            wrong.append(f"The {name} is {value}; {band} is required.")
    verdict = RED if wrong else UNJUDGED if unknown else GREEN
    return Judgement(verdict, (*wrong, *unknown))
