"""Tables 2 and 3 of the paper, and which record stands for which of its earthquakes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING

from bmd_rths_core.compensators.schemes import SCHEME_NAMES

if TYPE_CHECKING:
    from bmd_rths_core.config import Config

#: Errors of the paper by earthquake and scheme [%]; None where the test was unstable.
PaperTable = Mapping[str, Mapping[str, float | None]]


def _table(rows: Mapping[str, tuple[float | None, float | None, float, float]]) -> PaperTable:
    return {event: dict(zip(SCHEME_NAMES, values, strict=True)) for event, values in rows.items()}


#: Table 2 of Chen et al. 2020: the substructure. (The body text of the paper swaps the tables, the captions are right.)
TABLE_2 = _table(
    {
        "Cape Mendocino": (89.06, 87.58, 66.52, 66.75),
        "Chi-Chi": (93.43, 90.30, 72.12, 66.94),
        "Christchurch": (None, None, 61.13, 59.81),
        "Chuetsu-oki": (82.01, 79.41, 67.86, 63.52),
        "Darfield": (94.88, 90.91, 70.00, 70.13),
        "El Centro": (95.39, 90.98, 76.65, 69.90),
        "Kobe": (89.36, 80.53, 50.65, 49.54),
        "Kumamoto": (94.78, 92.61, 69.50, 65.72),
        "Montenegro": (95.83, 85.91, 58.48, 56.77),
        "Morgan Hill": (81.30, 77.82, 67.67, 66.33),
        "Northridge": (89.57, 75.88, 50.71, 48.56),
        "Parkfield": (82.72, 76.89, 48.11, 47.08),
        "Taipei": (94.58, 79.18, 48.87, 48.50),
    }
)

#: Table 3: the superstructure.
TABLE_3 = _table(
    {
        "Cape Mendocino": (58.53, 63.41, 49.28, 47.34),
        "Chi-Chi": (57.43, 54.51, 53.30, 51.33),
        "Christchurch": (None, None, 50.67, 48.49),
        "Chuetsu-oki": (65.98, 59.20, 50.29, 48.08),
        "Darfield": (64.93, 57.52, 49.55, 47.33),
        "El Centro": (62.30, 49.61, 53.91, 53.34),
        "Kobe": (59.41, 50.30, 54.87, 50.91),
        "Kumamoto": (53.64, 42.93, 43.56, 42.94),
        "Montenegro": (69.55, 57.34, 58.74, 58.19),
        "Morgan Hill": (52.80, 50.83, 47.78, 48.65),
        "Northridge": (56.61, 49.08, 49.37, 50.47),
        "Parkfield": (53.71, 49.49, 48.71, 48.84),
        "Taipei": (78.37, 65.89, 71.11, 67.46),
    }
)

#: The tables by the name of the error in the results.
PAPER_TABLES: Mapping[str, PaperTable] = {"substructure": TABLE_2, "superstructure": TABLE_3}

EVENTS = tuple(TABLE_2)

#: Sections that make the system of the tables: another building, or another share of its shear, is another one.
_OF_THE_SYSTEM = ("numerical_substructure", "nonlinear", "specimen")

#: What else than its letters in the name of a folder or file stands for an event: the abbreviations of PEER.
_ABBREVIATIONS = {
    "CAPEMEND": "Cape Mendocino",
    "CCHURCH": "Christchurch",
    "CHUETSU": "Chuetsu-oki",
    "IMPVALL": "El Centro",
    "MONTENE": "Montenegro",
    "MORGAN": "Morgan Hill",
    "NORTHR": "Northridge",
    "PARKF": "Parkfield",
}


def event_of(path: str) -> str | None:
    """Return the earthquake of the paper that a record stands for.

    The paper names no stations. So the event is what the folder of the record is called, or else the record itself, and
    any record of an event may stand for it.

    Parameters
    ----------
    path : str
        Path of the record, or its name.

    Returns
    -------
    str or None
        One of `EVENTS`; None when folder and file are called otherwise.
    """
    file = PurePath(path)
    for name in (file.parent.name, file.name):
        letters = re.sub(r"[^A-Z]", "", name.upper())
        known = {re.sub(r"[^A-Z]", "", event.upper()): event for event in EVENTS} | _ABBREVIATIONS
        for key, event in known.items():
            if key in letters:
                return event
    return None


def is_paper_system(config: Config) -> bool:
    """Tell whether a configuration is the simplified BMD, which the tests of the paper's tables are of.

    Parameters
    ----------
    config : Config
        The whole configuration; table, scheme and limits do not matter.
    """
    from bmd_rths_core.config import Config  # numpy, which the help of a command does without

    paper = Config()
    same = all(getattr(config, section) == getattr(paper, section) for section in _OF_THE_SYSTEM)
    return same and config.force_correction.feedback_scale == 1.0


def changes_the_system(parameters: Iterable[str]) -> bool:
    """Tell whether one of some parameters makes another system of the one of the tables.

    Parameters
    ----------
    parameters : iterable of str
        Names, ``section.key``.
    """
    return any(
        name.partition(".")[0] in _OF_THE_SYSTEM or name == "force_correction.feedback_scale" for name in parameters
    )


def paper_mean(table: PaperTable, scheme: str) -> float:
    """Return the mean of a scheme over the tests of the paper that were stable.

    Parameters
    ----------
    table : Mapping
        `TABLE_2` or `TABLE_3`.
    scheme : str
        One of the names of `Scheme`.

    Returns
    -------
    float
        [%].
    """
    values = [value for row in table.values() if (value := row[scheme]) is not None]
    return sum(values) / len(values)
