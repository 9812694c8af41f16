"""The bytes of a file, read once, and the lines and numbers in them, each refused with one clear line."""

from __future__ import annotations

import codecs
import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.plausible_values import check_missing_marks, is_cut_number
from bmd_rths_core.ground_motion.formats.stated import Stated
from bmd_rths_core.ground_motion.formats.units import UNITS_READ, factor_on_unit, other_quantity, quoted, unit_factor

#: Largest file that is read [bytes]; an hour of three components in text is smaller.
MAX_BYTES = 100_000_000

# Fortran and C spellings; narrower than float(), which also takes "nan", "infinity" and "1_000".
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([EeDd][+-]?[0-9]+)?")
# Fixed-width columns that are full run together: a sign after a digit begins the next number.
_SEPARATOR = re.compile(r"[\s,]+|(?<=[0-9.])(?=[+-])")
# A line of ordinary numbers, which nearly all are, by what stands between them: read as a whole it takes a fifth of the
# time. Nothing in it can match in two ways, so that a line that is something else is left quickly.
_PLAIN_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[Ee][+-]?[0-9]+)?"
# Four control characters are blanks to everybody but `float`.
_SPACE = r"[^\S\x1c-\x1f]"
_PLAIN_LINE = {
    separator: re.compile(rf"{_SPACE}*{_PLAIN_NUMBER}(?:{between}{_PLAIN_NUMBER})*{_SPACE}*")
    for separator, between in ((None, rf"{_SPACE}+"), (",", rf"{_SPACE}*,{_SPACE}*"))
}
# "0,0050 -0,0123": numbers with decimal commas, which are not two numbers each
_DECIMAL_COMMAS = re.compile(
    r"\s*[+-]?[0-9]*,[0-9]+(?:[EeDd][+-]?[0-9]+)?(?:\s+[+-]?[0-9]*,[0-9]+(?:[EeDd][+-]?[0-9]+)?)*\s*"
)
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
    stated : Stated
        What a person says of it.
    """

    path: Path
    content: bytes
    stated: Stated = field(default_factory=Stated)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the bytes, in hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()

    @cached_property
    def text(self) -> str:
        """The text it holds, in UTF-16 or UTF-8 with or without a byte order mark or in Latin-1; none: it is binary."""
        if self.content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return self._decoded("utf-16")
        # Every other byte of ASCII in UTF-16 is zero, also without a byte order mark.
        for encoding, zeros in (("utf-16-le", 1), ("utf-16-be", 0)):
            beginning = self.content[:200]
            if len(beginning) >= 4 and not any(beginning[zeros::2]) and all(beginning[1 - zeros :: 2]):
                return self._decoded(encoding)
        if b"\0" in self.content:
            return ""
        try:
            return self.content.decode("utf-8-sig")
        except UnicodeDecodeError:  # names of places in old headers; every byte is a character of Latin-1
            return self.content.decode("latin-1")

    def _decoded(self, encoding: str) -> str:
        try:
            text = self.content.decode(encoding)
        except UnicodeDecodeError:
            return ""
        return "" if "\0" in text else text

    @property
    def is_text(self) -> bool:
        """Whether it holds text."""
        return bool(self.text)

    @cached_property
    def lines(self) -> list[str]:
        """Lines without their ends; line number n of an editor is ``lines[n - 1]``."""
        if not self.is_text:
            raise InputError(f"{self.path}: a binary file; text is required")
        return _LINE_END.split(self.text.rstrip(_BLANK))

    @cached_property
    def first_line(self) -> int:
        """Number of the first line that is not blank."""
        return next((n for n, line in enumerate(self.lines, 1) if line.strip()), 1)

    @cached_property
    def head(self) -> str:
        """The first 8000 characters in lower case from the first that is not blank, for recognition; none of bytes."""
        return self.text[:20000].lstrip()[:8000].lower()

    def begins_with(self, beginning: str, *line_beginnings: str) -> bool:
        """Tell whether the text begins with some words, and lines near its beginning with others, in any case.

        Parameters
        ----------
        beginning, *line_beginnings : str
            In lower case.
        """
        return self.head.startswith(beginning) and all(
            re.search(rf"^[ \t]*{re.escape(words)}", self.head, re.MULTILINE) for words in line_beginnings
        )

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
        if _DECIMAL_COMMAS.fullmatch(text):
            raise self.error(line_number, f"{quoted(text)} has a decimal comma; a decimal point is required")
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
        name, rest = re.fullmatch(r"([^\s(,]*)(.*)", text.strip(), re.DOTALL).groups()  # type: ignore[union-attr]
        if factor_on_unit(name.rstrip("."), rest):
            raise self.error(
                line_number, f"a factor on the unit, {quoted(text)}; values in the unit itself are required"
            )
        factor = unit_factor(name.rstrip("."))
        if factor is None:
            known = other_quantity(name.rstrip("."))
            found = f"a {known}, in {quoted(text)}" if known else f"unit {quoted(text)}"
            raise self.error(line_number, f"{found}; an acceleration in {UNITS_READ} is required")
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
        values: list[float] = []
        line_numbers: list[int] = []
        for line_number, line in enumerate(self.lines[first_line - 1 :], first_line):
            if end and line.lower().startswith(end):
                break
            found = _plain_numbers(line, None)
            if not found and _DECIMAL_COMMAS.fullmatch(line):
                raise self.error(line_number, f"{quoted(line)} has decimal commas; decimal points are required")
            found = found or [self.number(line_number, text) for text in _SEPARATOR.split(line) if text]
            values += found
            line_numbers += [line_number] * len(found)
        else:
            self.check_last_number(first_line)
        self.check_marks(np.array(values), line_numbers)
        return values

    def fixed_width(
        self, first_line: int, count: int, columns: int, width: int, header: bool = False
    ) -> NDArray[np.float64]:
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
        header : bool
            They are numbers of a header, in which any may be unknown.

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
        if not header:
            self.check_marks(np.array(values), [first_line + i // columns for i in range(count)])
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
        self.check_last_number(first_line)
        table = np.array(rows).reshape(-1, columns)
        for column in table.T:
            self.check_marks(column, range(first_line, first_line + len(rows)))
        return table

    def check_marks(self, values: NDArray[np.float64], line_numbers: Sequence[int]) -> None:
        """Check that no value is a mark of one that is missing, as -999 is beside values that are much smaller.

        Parameters
        ----------
        values : ndarray, shape (N,)
            Values of one component.
        line_numbers : sequence of int
            The line of each.

        Raises
        ------
        InputError
            One is.
        """
        found = check_missing_marks(values)
        if found is not None:
            problem = f"{values[found]:g} is a mark of a missing value: it does not fit the values beside it"
            raise self.error(line_numbers[found], problem)

    def check_last_number(self, first_line: int) -> None:
        """Check that the last number of the file was not cut: no line end behind it, and fewer digits than all others.

        Parameters
        ----------
        first_line : int
            Where the numbers begin.

        Raises
        ------
        InputError
            It was.
        """
        if self.text[-1:] not in _BLANK and is_cut_number(self.lines[first_line - 1 :]):
            problem = f"{quoted(self.lines[-1])}: the last line has no end and its number fewer digits than the others"
            raise self.error(len(self.lines), f"{problem}; the file is cut off")

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


def read_file(path: str | Path, stated: Stated = Stated()) -> RecordFile:  # noqa: B008  (it is frozen)
    """Read a file, once.

    Parameters
    ----------
    path : str or Path
        The file.
    stated : Stated
        What a person says of it.

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
    return RecordFile(path, content, stated)
