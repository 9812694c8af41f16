"""All runs as one table: a row a step, those of the way to rest behind those of the test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bmd_rths_core.export.channels import Channel, ExportedRun, Numbers, numbers_of

#: What the column ``phase`` says.
TEST, WAY_TO_REST = "test", "way_to_rest"


@dataclass(frozen=True)
class FlatTable:
    """Columns of equal length.

    Parameters
    ----------
    runs, phases : list of str
        Which run a row is of, and which part of it.
    columns : dict of str to ndarray
        Numbers by name; NaN where a run, or the way to rest, does not have them.
    units, descriptions : dict of str to str
        Of each column.
    """

    runs: list[str]
    phases: list[str]
    columns: dict[str, Numbers]
    units: dict[str, str]
    descriptions: dict[str, str]


def flat_table(runs: Sequence[ExportedRun]) -> FlatTable:
    """Return some runs as one table.

    Parameters
    ----------
    runs : sequence of ExportedRun
        With as many floors each as they like.
    """
    parts = [
        (run.name, phase, channels)
        for run in runs
        for phase, channels in ((TEST, run.test), (WAY_TO_REST, run.way_to_rest))
    ]
    told = {name: channel for _, _, channels in parts for channel in channels for name, _ in channel.columns()}
    pieces: dict[str, list[Numbers]] = {name: [] for name in told}
    names, phases = [], []
    for run_name, phase, channels in parts:
        numbers = numbers_of(channels)
        rows = len(numbers["step"])
        names += [run_name] * rows
        phases += [phase] * rows
        for name, piece in pieces.items():
            piece.append(numbers.get(name, np.full(rows, np.nan)))
    columns = {name: np.concatenate(piece) for name, piece in pieces.items()}
    units = {name: channel.unit for name, channel in told.items()}
    return FlatTable(names, phases, columns, units, {name: _described(name, told[name]) for name in told})


def _described(name: str, channel: Channel) -> str:
    number = name.removeprefix(channel.name).lstrip("_")
    return f"{channel.kind}: {channel.description}" + (f"; number {number}" if number else "")
