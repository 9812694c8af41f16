"""Headers of keys and values, one pair in a line."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile


@dataclass(frozen=True)
class Header:
    """Keys and values in the first lines of a file, one pair in a line.

    Parameters
    ----------
    file : RecordFile
        The file.
    pattern : re.Pattern
        What a line of the header is; group 1 is the key, group 2 the value. The first line that is none ends it.
    """

    file: RecordFile
    pattern: re.Pattern[str]

    @cached_property
    def entries(self) -> dict[str, tuple[int, str]]:
        """Line number and value of each key in upper case; the first of two wins."""
        entries: dict[str, tuple[int, str]] = {}
        for line_number, line in enumerate(self.file.lines, 1):
            if line_number < self.file.first_line:
                continue
            found = self.pattern.fullmatch(line)
            if found is None:
                break
            entries.setdefault(_key(found[1]), (line_number, found[2].strip()))
        return entries

    @property
    def first_line_behind(self) -> int:
        """Number of the line behind the header."""
        first = self.file.first_line
        ends = (n for n, line in enumerate(self.file.lines[first - 1 :], first) if self.pattern.fullmatch(line) is None)
        return next(ends, len(self.file.lines) + 1)

    def text(self, key: str) -> tuple[int, str]:
        """Return line number and value of a key.

        Parameters
        ----------
        key : str
            As the file spells it, in any case.

        Raises
        ------
        InputError
            The header does not have it.
        """
        if _key(key) not in self.entries:
            raise InputError(f"{self.file.path}: no header line {key!r} before line {self.first_line_behind}")
        return self.entries[_key(key)]

    def positive(self, key: str, unit: str = "") -> float:
        """Return the number > 0 of a key.

        Parameters
        ----------
        key : str
            As the file spells it.
        unit : str
            What may stand behind the number.

        Raises
        ------
        InputError
            The header does not have it, or it is no finite number > 0.
        """
        line_number, text = self.text(key)
        without_unit = text[: -len(unit)] if unit and text.lower().endswith(unit.lower()) else text
        value = self.file.number(line_number, without_unit.strip())
        if value <= 0.0:
            raise self.file.error(line_number, f"{key} {text}; a number > 0 is required")
        return value

    def unit(self, key: str) -> float:
        """Return how many m/s² the unit of a key is; what follows its first word is passed over.

        Parameters
        ----------
        key : str
            As the file spells it.

        Raises
        ------
        InputError
            The header does not have it, or it is no unit of acceleration.
        """
        line_number, text = self.text(key)
        return self.file.unit(line_number, text)


def _key(text: str) -> str:
    """Return a key as it is compared: in upper case, with single blanks."""
    return " ".join(text.upper().split())
