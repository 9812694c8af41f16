"""Tables 2 and 3 of the paper for the runs of a campaign or for many bags, beside the paper's numbers."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from bmd_rths_core.campaign.paper_tables import PAPER_TABLES, event_of, paper_mean
from bmd_rths_core.compensators.schemes import SCHEME_NAMES

#: Narrowest output; a terminal that is narrower wraps [characters].
_WIDTH = 120

_TITLES = {"substructure": "Table 2, substructure", "superstructure": "Table 3, superstructure"}
_NOTE = (
    "RMSE of Eq. 12 [%], in brackets that of the paper, which names events but no records. "
    "Means are over the stable runs, whole ones only; the paper's over all its events."
)


class _Mean:
    """Mean of the stable runs, and how many were unstable."""

    def __init__(self) -> None:
        self._sum, self._stable, self._unstable = 0.0, 0, 0

    def add(self, result: Mapping[str, Any], name: str) -> None:
        value = result["rmse_percent"][name]
        if result["outcome"] == "limit":
            self._unstable += 1
        elif result["outcome"] == "finished" and value is not None:
            self._sum, self._stable = self._sum + value, self._stable + 1

    def __str__(self) -> str:
        mean = f"{self._sum / self._stable:.2f}" if self._stable else ""
        unstable = f"{self._unstable} unstable" if self._unstable else ""
        return ", ".join(part for part in (mean, unstable) if part)


def show_error_tables(results: Iterable[Mapping[str, Any]], varied: bool, assumed: Iterable[str]) -> None:
    """Print the errors of many runs.

    Parameters
    ----------
    results : iterable of Mapping
        As `bmd_rths_core.campaign.study.FinishedRun` has them; read once, and not kept where something is varied.
    varied : bool
        A line for the means of each variation, instead of one for each ground motion.
    assumed : iterable of str
        What the results assume, each a sentence.
    """
    means: dict[str, dict[tuple[str, str], _Mean]] = defaultdict(lambda: defaultdict(_Mean))
    rows: list[dict[str, Any]] = []
    for result in results:
        line = json.dumps(result["variation"]) if varied else ""
        for name in PAPER_TABLES:
            means[line][name, result["scheme"]].add(result, name)
        if not varied:
            _add(rows, result)
    found = {scheme for entry in means.values() for _, scheme in entry}
    schemes = [*(s for s in SCHEME_NAMES if s in found), *sorted(found.difference(SCHEME_NAMES))]
    console = Console()
    console.width = max(console.width, _WIDTH)
    for name in PAPER_TABLES:
        table = _table(name, schemes)
        for row in rows:
            table.add_row(*(Text(cell) for cell in _cells(row, name, schemes)))
        for line, entry in means.items():
            label = ", ".join(f"{key}={value}" for key, value in json.loads(line).items()) if line else "mean"
            cells = (f"{entry[name, s]}{_paper_mean(name, s)}" for s in schemes)
            table.add_row(Text(label), *(["(paper: all)"] if not varied else [""]), *cells, style="bold")
        console.print(table)
    click.echo(_NOTE)
    for sentence in assumed:
        click.echo(sentence)


def result_with_event(result: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Return the result of a bag as one of a campaign.

    Parameters
    ----------
    result : Mapping
        See `bmd_rths_nodes.cli.results.result_of`.
    source : str
        Path of its ground motion.
    """
    return {**result, "event": event_of(source) or event_of(result["motion"]), "file": source, "variation": {}}


def _add(rows: list[dict[str, Any]], result: Mapping[str, Any]) -> None:
    """Put a result into the first row of its ground motion that has none of its scheme yet."""
    for row in rows:
        if row["file"] == result["file"] and row["motion"] == result["motion"] and result["scheme"] not in row:
            break
    else:
        row = {name: result[name] for name in ("file", "motion", "event")}
        rows.append(row)
    row[result["scheme"]] = {name: _cell(result, name) for name in PAPER_TABLES}


def _table(name: str, schemes: Iterable[str]) -> Table:
    table = Table(title=_TITLES[name], title_justify="left", title_style="bold")
    table.add_column("ground motion", no_wrap=True)
    table.add_column("event")
    for scheme in schemes:
        table.add_column(f"{scheme} (paper)" if scheme in SCHEME_NAMES else scheme, justify="right")
    return table


def _cells(row: Mapping[str, Any], name: str, schemes: Iterable[str]) -> Iterable[str]:
    yield row["motion"]
    yield row["event"] or ""
    for scheme in schemes:
        ours = row[scheme][name] if scheme in row else ""
        known = row["event"] and scheme in SCHEME_NAMES
        paper = f" ({_percent(PAPER_TABLES[name][row['event']][scheme])})" if known else ""
        yield ours + paper


def _paper_mean(name: str, scheme: str) -> str:
    return f" ({paper_mean(PAPER_TABLES[name], scheme):.2f})" if scheme in SCHEME_NAMES else ""


def _cell(result: Mapping[str, Any], name: str) -> str:
    """Return the text of an error, with a mark where the test ended early."""
    value, outcome = result["rmse_percent"][name], result["outcome"]
    if value is None and outcome != "limit":
        return "no data"
    return _percent(value) + ("" if outcome in ("finished", "limit") else f", {outcome}")


def _percent(value: float | None) -> str:
    return "unstable" if value is None else f"{value:.2f}"
