"""Rows of cells in text: what stands between them, and numbers with a decimal comma."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

from bmd_rths_core.ground_motion.formats.record_file import RecordFile

_NUMBER = re.compile(r"[+-]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[EeDd][+-]?[0-9]+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[EeDd][+-]?[0-9]+)?")


@dataclass(frozen=True)
class Rows:
    """The rows of a text: lines that are neither blank nor comments.

    A semicolon anywhere makes semicolons the separator, and commas decimal ones; otherwise tabs, commas or blanks are,
    in this order, as the first row that may hold numbers or names has them.

    Parameters
    ----------
    file : RecordFile
        The file.
    """

    file: RecordFile

    @cached_property
    def numbered(self) -> list[tuple[int, str]]:
        """Line number and text of each row."""
        return [(n, line) for n, line in enumerate(self.file.lines, 1) if is_row(line)]

    def separator(self, line: str) -> str | None:
        """Return what stands between the cells of a line, None for blanks.

        Parameters
        ----------
        line : str
            A row.
        """
        return next((mark for mark in (";", "\t", ",") if mark in line.strip()), None)

    def cells(self, line: str, separator: str | None) -> list[str]:
        """Return the cells of a row; empty ones at the end, behind a last separator, are left out.

        Parameters
        ----------
        line : str
            The row.
        separator : str or None
            As `separator` returns it.
        """
        if separator is None:
            line = re.sub(r"\s+(?=[\[(])", "", line)  # "Time (s)" is one cell
        cells = [cell.strip(' \t"') for cell in line.split(separator)]
        while separator not in (None, ",") and len(cells) > 1 and not cells[-1]:
            cells.pop()
        return cells

    def number(self, line_number: int, cell: str, separator: str | None) -> float:
        """Return the number in a cell.

        Parameters
        ----------
        line_number : int
            For the message.
        cell : str
            Its text.
        separator : str or None
            Between semicolons, a comma is a decimal one.

        Raises
        ------
        InputError
            It is no finite number.
        """
        decimal_comma = separator == ";" and _DECIMAL_COMMA.fullmatch(cell)
        return self.file.number(line_number, cell.replace(",", ".") if decimal_comma else cell)


def is_row(line: str) -> bool:
    """Tell whether a line is neither blank nor a comment.

    Parameters
    ----------
    line : str
        Any line.
    """
    return bool(line.strip()) and not line.lstrip().startswith(("#", "%"))


def are_numbers(cells: list[str]) -> bool:
    """Tell whether every cell is a number.

    Parameters
    ----------
    cells : list of str
        Cells of a row.
    """
    return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)
