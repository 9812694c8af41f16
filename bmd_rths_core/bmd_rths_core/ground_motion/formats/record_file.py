"""The bytes of a file, read once, and the lines and numbers in them, each refused with one clear line."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.units import UNITS_READ, quoted, unit_factor

#: Largest file that is read [bytes]; an hour of three components in text is smaller.
MAX_BYTES = 100_000_000

# Fortran and C spellings; narrower than float(), which also takes "nan", "infinity" and "1_000".
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([EeDd][+-]?[0-9]+)?")
# Fixed-width columns that are full run together: a sign after a digit begins the next number.
_SEPARATOR = re.compile(r"[\s,]+|(?<=[0-9.])(?=[+-])")
# A line of ordinary numbers, which nearly all are, by what stands between them: read as a whole it takes a fifth of the
# time. Nothing in it can match in two ways, so that a line that is something else is left quickly.
_PLAIN_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[Ee][+-]?[0-9]+)?"
_PLAIN_LINE = {
    separator: re.compile(rf"\s*{_PLAIN_NUMBER}(?:{between}{_PLAIN_NUMBER})*\s*")
    for separator, between in ((None, r"\s+"), (",", r"\s*,\s*"))
}
# Some files went through two DOS conversions and end their lines in CR CR LF.
_LINE_END = re.compile(r"\r*\n|\r")
# What may stand behind the last line; the last character is the end of a file of DOS.
_BLANK = " \t\r\n\f\x1a"


@dataclass(frozen=True)
class RecordFile:
    """The bytes of a file, read once, and the lines and numbers in them.

    Parameters
    ----------
    path : Path
        Where it is.
    content : bytes
        All of it.
    """

    path: Path
    content: bytes

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the bytes, in hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def is_text(self) -> bool:
        """Whether it holds text."""
        return b"\0" not in self.content

    @cached_property
    def lines(self) -> list[str]:
        """Lines without their ends, in UTF-8 or Latin-1; line number n of an editor is ``lines[n - 1]``."""
        if not self.is_text:
            raise InputError(f"{self.path}: a binary file; text is required")
        try:
            text = self.content.decode("utf-8-sig")
        except UnicodeDecodeError:  # names of places in old headers; every byte is a character of Latin-1
            text = self.content.decode("latin-1")
        return _LINE_END.split(text.rstrip(_BLANK))

    def error(self, line_number: int, problem: str) -> InputError:
        """Return an error that names this file and a line of it.

        Parameters
        ----------
        line_number : int
            As an editor counts, from 1.
        problem : str
            What is wrong there.
        """
        return InputError(f"{self.path}: line {line_number}: {problem}")

    def number(self, line_number: int, text: str) -> float:
        """Return the finite number written as `text`, also with a Fortran D exponent.

        Parameters
        ----------
        line_number : int
            Where it is written, for the message.
        text : str
            The number.

        Raises
        ------
        InputError
            The text is anything else.
        """
        value = float(text.upper().replace("D", "E")) if _NUMBER.fullmatch(text) else math.nan
        if not math.isfinite(value):
            raise self.error(line_number, f"{quoted(text)} is not a finite number")
        return value

    def unit(self, line_number: int, text: str) -> float:
        """Return how many m/s² the unit is that `text` begins with.

        Parameters
        ----------
        line_number : int
            Where it is written, for the message.
        text : str
            For example ``"gal. DCoffset(corr)"``.

        Raises
        ------
        InputError
            It is no unit of acceleration.
        """
        factor = unit_factor(re.split(r"[\s(,]", text.strip(), maxsplit=1)[0].rstrip("."))
        if factor is None:
            raise self.error(line_number, f"unit {quoted(text)}; an acceleration in {UNITS_READ} is required")
        return factor

    def numbers(self, first_line: int, end: str = "") -> list[float]:
        """Return all numbers from a line on, in any number of columns.

        Parameters
        ----------
        first_line : int
            Where they begin.
        end : str
            What the line behind the last one begins with, in lower case; empty for the end of the file.

        Raises
        ------
        InputError
            Anything is not a finite number.
        """
        values = []
        for line_number, line in enumerate(self.lines[first_line - 1 :], first_line):
            if end and line.lower().startswith(end):
                break
            values += _plain_numbers(line, None) or [
                self.number(line_number, text) for text in _SEPARATOR.split(line) if text
            ]
        return values

    def fixed_width(self, first_line: int, count: int, columns: int, width: int) -> NDArray[np.float64]:
        """Return numbers in the columns of a Fortran format, 8 of width 10 for 8F10.3; all lines but the last are full.

        Fortran writes numbers at the right of their columns. A line in which they stand elsewhere has been shifted, and
        cutting it at the columns could cut through a number.

        Parameters
        ----------
        first_line : int
            Where they begin.
        count : int
            How many there are.
        columns, width : int
            Numbers in a line and characters of a number, >= 1.

        Raises
        ------
        InputError
            The file ends before the last, a line has more or fewer or is shifted, or one is not a finite number.
        """
        lines = math.ceil(count / columns)
        values: list[float] = []
        for line_number, line in enumerate(self.lines[first_line - 1 : first_line - 1 + lines], first_line):
            text = line.rstrip()
            required = min(columns, count - len(values))
            cells = [text[i : i + width] for i in range(0, len(text), width)]
            if len(text) != required * width or any(cell.endswith(" ") for cell in cells):
                problem = f"{required} numbers in columns of {width} characters are required"
                raise self.error(line_number, f"{quoted(text)}; {problem}")
            values += [self.number(line_number, cell.lstrip()) for cell in cells]
        if len(values) < count:
            problem = f"the file ends after {len(values)} of {count} values that begin in line {first_line}"
            raise self.error(len(self.lines), problem)
        return np.array(values)

    def table(self, first_line: int, columns: int, separator: str | None = None) -> NDArray[np.float64]:
        """Return the rows of numbers from a line to the end of the file.

        Parameters
        ----------
        first_line : int
            Where they begin.
        columns : int
            Numbers in a row.
        separator : str, optional
            What stands between them; blanks when none is given.

        Returns
        -------
        ndarray, shape (N, columns)
            The table.

        Raises
        ------
        InputError
            A row has more or fewer numbers, or one is not finite.
        """
        rows = []
        for line_number, line in enumerate(self.lines[first_line - 1 :], first_line):
            row = _plain_numbers(line, separator)
            if len(row) == columns:
                rows.append(row)
                continue
            cells = line.split(separator)
            if len(cells) != columns:
                raise self.error(line_number, f"{len(cells)} numbers in {quoted(line)}; {columns} are required")
            rows.append([self.number(line_number, cell.strip()) for cell in cells])
        return np.array(rows).reshape(-1, columns)

    def check_count(self, found: int, required: float, source: str) -> None:
        """Check that no value is missing and none is left over.

        Parameters
        ----------
        found : int
            How many values the file has.
        required : float
            How many its header gives.
        source : str
            Where the header says so.

        Raises
        ------
        InputError
            The two differ.
        """
        if found != required:
            raise InputError(f"{self.path}: {found} values up to line {len(self.lines)}, but {source} {required:.9g}")


def _plain_numbers(line: str, separator: str | None) -> list[float]:
    """Return the numbers of a line of ordinary finite ones; none when it has to be looked at number by number."""
    if not _PLAIN_LINE[separator].fullmatch(line):
        return []
    numbers = [float(text) for text in line.split(separator)]
    return numbers if all(map(math.isfinite, numbers)) else []


def read_file(path: str | Path) -> RecordFile:
    """Read a file, once.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    RecordFile
        Its bytes.

    Raises
    ------
    InputError
        It cannot be read, is empty or is larger than any record.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # a path no file system takes, as one with a NUL in it
        raise InputError(f"{str(path)!r}: cannot be read: {error}") from error
    if not content.strip():
        raise InputError(f"{path}: the file is empty")
    if len(content) > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES // 1_000_000} MB; no ground motion is")
    return RecordFile(path, content)
