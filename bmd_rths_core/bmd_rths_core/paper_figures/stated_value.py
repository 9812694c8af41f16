"""A number of this project beside what the paper states about it."""

from __future__ import annotations

from typing import NamedTuple


class Comparison(NamedTuple):
    """One computed number and the statement of the paper it belongs to.

    Parameters
    ----------
    quantity : str
        Name of the quantity.
    value : float
        The computed number.
    unit : str
        Its unit; ``"1"`` for a ratio.
    paper : str
        Text of the value that the paper states.
    """

    quantity: str
    value: float
    unit: str
    paper: str
