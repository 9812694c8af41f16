"""One thing that was looked at."""

from __future__ import annotations

from typing import Any, NamedTuple

GOOD, NOTE, WARNING, PROBLEM = "good", "note", "warning", "problem"

#: From the best to the worst.
LEVELS = (GOOD, NOTE, WARNING, PROBLEM)


class Finding(NamedTuple):
    """What was found of one thing, and what to do about it.

    Parameters
    ----------
    name : str
        What was looked at.
    level : str
        One of `LEVELS`.
    found : str
        What was found.
    advice : str
        What to change; empty when nothing.
    """

    name: str
    level: str
    found: str
    advice: str = ""

    def as_mapping(self) -> dict[str, Any]:
        """Return it as plain values."""
        return self._asdict()


def change_first(findings: list[Finding]) -> str:
    """Return what to change first, a problem before a warning, a cause before the test that suffers from it."""
    for level in (PROBLEM, WARNING):
        found = [finding for finding in findings if finding.level == level and finding.name != "loop"]
        if found:
            return f"{found[0].name}: {found[0].advice}"
    return next((f.advice for f in findings if f.name == "loop" and f.level in (PROBLEM, WARNING)), "")


def worst(findings: list[Finding]) -> str:
    """Return the worst level of some findings."""
    return max((finding.level for finding in findings), key=LEVELS.index, default=GOOD)
