"""Values that are no ground acceleration: marks of missing ones, and a last number that was cut."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: Numbers that programs and agencies write where a value is missing, without their sign.
MISSING_MARKS = (
    99.0, 99.9, 99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 99999.9, 99999.99, 999999.0, 9999999.0,
    99999999.0, 32767.0, 32768.0, 2147483647.0, 2147483648.0, 1e10, 1e20, 1e30, 1.7e38,
)  # fmt: skip

#: How many times as large as any other jump one into a mark is at least, and a mark as any other value.
_JUMP = 2.0
_SIZE = 5.0

_LAST_NUMBER = re.compile(r"[+-]?([0-9]*)(?:\.([0-9]*))?(?:[EeDd]([+-]?[0-9]+))?[\s,;\"]*$")


def check_missing_marks(values: NDArray[np.float64]) -> int | None:
    """Return the index of the first mark of a missing value, None without one.

    A mark is one of `MISSING_MARKS` that does not fit the values beside it: the jumps into it and out of it are larger
    than every other of the record, or it is larger than every other value. A record that has such a value by chance
    comes to it in steps like its others.

    Parameters
    ----------
    values : ndarray, shape (N,)
        Values of one component, in the unit of their file.
    """
    candidates = np.isin(np.abs(values), MISSING_MARKS)
    if len(values) < 3 or not candidates.any():
        return None
    rest = values[~candidates]
    if len(rest) < 2:
        return int(np.argmax(candidates))
    jumps = np.abs(np.diff(values))
    beside = candidates[1:] != candidates[:-1]
    inner = ~(candidates[1:] | candidates[:-1])
    largest = float(np.max(jumps[inner], initial=0.0))
    peak = float(np.max(np.abs(rest)))
    for index in np.flatnonzero(candidates):
        around = [jumps[i] for i in (index - 1, index) if 0 <= i < len(jumps) and beside[i]]
        if abs(values[index]) > _SIZE * peak or (around and min(around) > _JUMP * largest):
            return int(index)
    return None


def is_cut_number(lines: Sequence[str]) -> bool:
    """Tell whether the last number of some lines has fewer digits than the last one of every other line.

    Parameters
    ----------
    lines : sequence of str
        Lines of numbers, without blank ones at their end.
    """
    if len(lines) < 3:
        return False
    last = _digits(lines[-1])
    others = [digits for line in lines[:-1] if (digits := _digits(line)) is not None]
    if last is None or not others:
        return last is None
    if any(last[i] < min(digits[i] for digits in others) for i in (1, 2)):
        return True
    if any(digits[1] or digits[2] for digits in (last, *others)):
        return False
    ends = {tuple(number.end() for number in re.finditer(r"[^\s,;]+", line)) for line in lines[:-1]}
    return len(ends) == 1 and len(lines[-1].rstrip()) not in next(iter(ends))  # columns of one width


def _digits(line: str) -> tuple[int, int, int] | None:
    """Return the digits before and behind the point and in the exponent of the last number of a line."""
    found = _LAST_NUMBER.search(line.rstrip())
    if found is None or not (found[1] or found[2]):
        return None
    return len(found[1]), len(found[2] or ""), min(2, len((found[3] or "").lstrip("+-")))
