"""What the header row of a file of columns says: times, components of acceleration, and their units."""

from __future__ import annotations

import re
from dataclasses import dataclass

from bmd_rths_core.ground_motion.formats.units import unit_factor

#: Seconds, and how many of them a unit of time is.
TIME_UNITS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3}

# "acceleration [m/s^2]", "Time (sec)"
_BRACKETS = re.compile(r"(.*?)[\s_,]*[\[(]([^\])]*)[\])]?\s*")
_SPECTRAL = re.compile(r"\bp?s[avd]\b|spectr|pseudo", re.IGNORECASE)


@dataclass(frozen=True)
class Column:
    """One column, by its name in the header.

    Parameters
    ----------
    name : str
        As the file has it.
    quantity : str
        ``"time"``, ``"acceleration"``, ``"period"``, ``"spectrum"``, ``"velocity"``, ``"displacement"`` or ``"other"``.
    component : str
        What stands between quantity and unit, "" for nothing.
    unit : str
        Its unit as the file spells it, "" without one.
    """

    name: str
    quantity: str
    component: str
    unit: str

    @property
    def factor(self) -> float | None:
        """How many s or m/s² the unit is, None without a unit that is known."""
        if self.quantity == "time":
            return TIME_UNITS.get(self.unit.strip().lower().rstrip("."))
        return unit_factor(self.unit)


def column_of(name: str, unit_row: str = "") -> Column:
    """Return what a cell of the header says.

    Parameters
    ----------
    name : str
        The cell, for example ``"acc_ns_g"`` or ``"Time (sec)"``.
    unit_row : str
        The cell below it in a row of units, "" without one.
    """
    words, unit = _words_and_unit(name.strip())
    unit = unit or unit_row.strip(' \t"[]()')
    first = words[0] if words else ""
    lower = first.lower()
    if words == ["T"] or lower in ("period", "periods", "tn"):
        return Column(name, "period", "", unit)
    if _SPECTRAL.search(" ".join(words)):
        return Column(name, "spectrum", "", unit)
    if lower in ("time", "t", "times"):
        return Column(name, "time", "", unit)
    accelerations = [word for word in words if word.lower().startswith("acc")]
    if accelerations:
        return Column(name, "acceleration", " ".join(word for word in words if word is not accelerations[0]), unit)
    for quantity in ("velocity", "displacement"):
        if any(word.lower().startswith(quantity[:3]) for word in words):
            return Column(name, quantity, "", unit)
    # "NS [cm/s2]": only accelerations have such a unit; a bare g may be grams
    if unit and unit_factor(unit) is not None and _BRACKETS.fullmatch(name) and unit.strip().lower() != "g":
        return Column(name, "acceleration", " ".join(words), unit)
    return Column(name, "other", "", unit)


def _words_and_unit(name: str) -> tuple[list[str], str]:
    found = _BRACKETS.fullmatch(name)
    if found is not None and found[1]:
        return _words(found[1]), found[2]
    words = _words(name)
    for count in (3, 2, 1):  # "acceleration_cm_s_s", "acceleration_m_s2", "time_s"
        unit = "/".join(words[-count:])
        if len(words) > count and (unit_factor(unit) is not None or unit.lower() in TIME_UNITS):
            return words[:-count], unit
    if len(words) == 2 and words[0].lower().startswith("acc") and re.fullmatch(r".*/.*", words[1]):
        return words[:1], words[1]
    return words, ""


def _words(text: str) -> list[str]:
    return [word for word in re.split(r"[\s_,]+", text) if word]
