"""The recordings the page can show: one bag, or those of a folder, with the results of a campaign if it is one."""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_nodes.campaign.results import CSV_NAME
from bmd_rths_nodes.monitor_page.view import RunView

#: Most bags of a folder that are listed, the newest first, and most lines of a campaign.
MOST_BAGS, MOST_LINES = 1000, 5000

#: Bags that are kept open at the same time.
MOST_OPEN = 4

#: What is shown of a run of a campaign.
_COLUMNS = (
    *("motion", "scheme", "variation", "outcome", "rmse_substructure_percent", "rmse_superstructure_percent"),
    *("tracking_delay_ms", "capture_superstructure", "verdict"),
)


class Recordings:
    """Bags by an id that says nothing of where they are.

    Parameters
    ----------
    path : Path, optional
        A bag, or a folder of bags; without, only what is added is known.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._added: list[Path] = []
        self._by_id: dict[str, Path] = {}
        self._views: dict[str, RunView] = {}

    def add(self, bag: Path) -> None:
        """Add a bag; it is the newest one.

        Parameters
        ----------
        bag : Path
            The bag; it need not be there yet.
        """
        if bag not in self._added:
            self._added.append(bag)

    def newest(self) -> Path | None:
        """Return the newest bag; None when there is none."""
        bags = [*reversed(self._added), *self._found()]
        return bags[0] if bags else None

    def listed(self) -> list[dict[str, str]]:
        """Return id and name of every bag, the newest first."""
        bags = [*reversed(self._added), *(bag for bag in self._found() if bag not in self._added)]
        self._by_id = {_id(bag): bag for bag in bags}
        return [{"id": key, "name": bag.name} for key, bag in self._by_id.items()]

    def _found(self) -> list[Path]:
        if self._path is None:
            return []
        if self._path.is_file() or any(self._path.glob("*.mcap")):
            return [self._path]
        bags = {file.parent for pattern in ("*/*.mcap", "*/*/*.mcap") for file in self._path.glob(pattern)}
        visible = (bag for bag in bags if not bag.name.startswith("."))  # a campaign renames what is whole
        return sorted(visible, key=_age)[:MOST_BAGS]

    def campaign(self) -> dict[str, Any] | None:
        """Return the results of a campaign with the ids of their bags, None when the folder has none."""
        if self._path is None or not (self._path / CSV_NAME).is_file():
            return None
        with open(self._path / CSV_NAME, newline="", encoding="utf-8", errors="replace") as file:
            lines = [line for _, line in zip(range(MOST_LINES), csv.DictReader(file), strict=False)]
        return {
            "columns": _COLUMNS,
            "rows": [[(line.get(name) or "").removeprefix("'") for name in _COLUMNS] for line in lines],
            "ids": [_id(self._bag_of(line)) for line in lines],
        }

    def _bag_of(self, line: dict[str, str]) -> Path:
        name = f"{line.get('motion')}_{line.get('scheme')}_{(line.get('key') or '')[:12]}"
        return (self._path or Path()) / "bags" / name

    def view(self, key: str) -> RunView | None:
        """Return the view of a bag that was listed; None when there is no such bag, or not yet.

        Parameters
        ----------
        key : str
            Its id.
        """
        if key in self._views:
            self._views[key] = self._views.pop(key)  # used last
            return self._views[key]
        if key not in self._by_id:
            self.listed()
        try:
            follower = BagFollower(self._by_id[key])
        except (KeyError, InputError):
            return None
        self._views[key] = RunView(follower)
        while len(self._views) > MOST_OPEN:
            self._views.pop(next(iter(self._views)))
        return self._views[key]

    def look(self) -> bool:
        """Take what is new in every bag that is open; tell whether there may be more at once."""
        more = False
        for view in self._views.values():
            more |= self._look(view)
        return more

    def _look(self, view: RunView) -> bool:
        more = False
        try:
            more = view.follower.look()
        except InputError as error:
            view.problem = str(error)
            view.follower.damaged = True
        view.loading = view.loading and more
        return more


def _age(bag: Path) -> tuple[float, str]:
    try:
        return -bag.stat().st_mtime, bag.name
    except OSError:
        return 0.0, bag.name


def _id(bag: Path) -> str:
    return hashlib.sha256(str(bag.absolute()).encode("utf-8", "surrogateescape")).hexdigest()[:16]
