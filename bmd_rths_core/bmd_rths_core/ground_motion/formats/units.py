"""Units of acceleration as files spell them, and texts of files in messages."""

from __future__ import annotations

from collections.abc import Sequence

from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY

_UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01}

#: The units of acceleration that are read, for error messages.
UNITS_READ = "g, m/s², cm/s² or gal"


def unit_factor(unit: str) -> float | None:
    """Return how many m/s² one `unit` is, or None for text that is no unit of acceleration.

    Parameters
    ----------
    unit : str
        For example ``"G"``, ``"cm/s/s"``, ``"cm/sec**2"``, ``"m/s²"``.
    """
    spelling = unit.strip().lower().replace("sec", "s").replace("**", "").replace("^", "").replace("²", "2")
    return _UNITS.get(spelling.replace("/s/s", "/s2"))


def quoted(text: str) -> str:
    """Return `text` in quotes, on one line and of a length fit for a message.

    Parameters
    ----------
    text : str
        Any text.
    """
    text = text.strip()
    return repr(text if len(text) <= 60 else text[:60] + "...")


def listed(names: Sequence[str]) -> str:
    """Return names in quotes, with commas, for a message.

    Parameters
    ----------
    names : sequence of str
        Any texts.
    """
    return ", ".join(quoted(name) for name in names)
