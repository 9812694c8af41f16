"""What the commands that read bags begin with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.options import log

if TYPE_CHECKING:
    from bmd_rths_core.analysis.run_analysis import RunAnalysis


def analysed_bag(bag: str, capture: bool | None) -> RunAnalysis:
    """Return the analysis of a bag; that its recorder was cut off is told, and no obstacle.

    Parameters
    ----------
    bag : str
        Path of the bag.
    capture : bool or None
        Whether capture is computed; None is where it is cheap.

    Raises
    ------
    InputError
        The bag is none, or nothing can be computed with the configuration in it.
    """
    from bmd_rths_core.analysis.run_analysis import analysed
    from bmd_rths_msgs_py.bag_reader import read_bag

    record = read_bag(bag)
    if record.outcome == "cut":
        log(f"warning: {bag}: {record.reason}")
    try:
        return analysed(record, capture)
    except InputError as error:
        raise InputError(f"{bag}: configuration: {error}") from error
