"""Units of acceleration as files spell them, and texts of files in messages."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY

_UNITS = {
    "g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01, "gals": 0.01, "mm/s2": 0.001,
    "mg": 0.001 * STANDARD_GRAVITY, "%g": 0.01 * STANDARD_GRAVITY, "in/s2": 0.0254, "ft/s2": 0.3048,
}  # fmt: skip
_OTHER = {
    "velocity": ("m/s", "cm/s", "mm/s", "in/s", "ft/s", "nm/s"),
    "displacement": ("m", "cm", "mm", "in", "ft", "nm"),
}
# Words by which a line says what it is about; a heading that names accelerations too is none of these.
_QUANTITY = re.compile(r"\b(velocit(?:y|ies)|veloc|displacements?|displ|spectr(?:um|a|al))\b", re.IGNORECASE)
_ACCELERATION = re.compile(r"\bacc", re.IGNORECASE)
# "X 1000", "* 10", "/ 10", "times 10", "10^-3", "(x 1000)"
_FACTOR = re.compile(r"^[\s()\[\]]*(?:[x×*/]|times\b|e[+-]?[0-9]|\^)\s*[0-9.]|^\s*[0-9.]+\s*[x×*/]", re.IGNORECASE)

#: The units of acceleration that are read, for error messages.
UNITS_READ = "g, m/s², cm/s² or gal"


def unit_factor(unit: str) -> float | None:
    """Return how many m/s² one `unit` is, or None for text that is no unit of acceleration.

    Parameters
    ----------
    unit : str
        For example ``"G"``, ``"cm/s/s"``, ``"cm/sec**2"``, ``"m/s²"``.
    """
    return _UNITS.get(_spelling(unit))


def other_quantity(unit: str) -> str:
    """Return what a unit of another quantity is of, ``"velocity"`` or ``"displacement"``; "" for any other text.

    Parameters
    ----------
    unit : str
        For example ``"CM/SEC"``.
    """
    return next((name for name, units in _OTHER.items() if _spelling(unit) in units), "")


def named_quantity(line: str) -> str:
    """Return the quantity other than acceleration that a line of a header says the values are, "" without one.

    Parameters
    ----------
    line : str
        For example ``"VELOCITY TIME SERIES IN UNITS OF CM/S"``.
    """
    found = _QUANTITY.search(line)
    if found is None:
        return ""
    word = found[1].lower()
    if word.startswith("spectr"):
        return "spectrum"
    if _ACCELERATION.search(line):
        return ""
    return "velocity" if word.startswith("vel") else "displacement"


def factor_on_unit(unit: str, rest: str) -> bool:
    """Tell whether there is a factor on a unit, as in ``"G X 1000"`` or ``"1000*G"``.

    Parameters
    ----------
    unit : str
        The unit.
    rest : str
        What stands behind it.
    """
    inside = unit_factor(unit) is None and re.search(r"^[0-9.]|[x×*/^][0-9.+-]+$", unit, re.IGNORECASE)
    return bool(inside) or _FACTOR.search(rest) is not None


def _spelling(unit: str) -> str:
    spelling = unit.strip().lower().replace("sec", "s").replace("**", "").replace("^", "").replace("²", "2")
    return re.sub(r"[\s.]*s\^?-2$", "/s2", spelling.replace("/s/s", "/s2").replace("*s-2", "/s2"))


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
