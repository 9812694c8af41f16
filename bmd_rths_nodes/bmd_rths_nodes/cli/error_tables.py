"""Errors of many runs, a row a record and a variation; of the paper's system beside its Tables 2 and 3."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from bmd_rths_core.campaign.paper_tables import PAPER_TABLES, event_of, paper_mean
from bmd_rths_core.compensators.schemes import SCHEME_NAMES

#: More rows than this tell nobody anything; the means remain.
_MOST_ROWS = 200

#: Wider than any table [characters].
_UNBOUNDED = 100_000

#: Width of the output where it does not go to a terminal [characters].
_WIDTH = 120

_TITLES = {"substructure": "Table 2, substructure", "superstructure": "Table 3, superstructure"}
_NOTE = "RMSE of Eq. 12 [%]. Means are over the stable runs, whole ones only."
_PAPER_NOTE = (
    "RMSE of Eq. 12 [%], in brackets that of the paper, which names events but no records. "
    "Means are over the stable runs, whole ones only; the paper's over all its events."
)


@dataclass
class _Mean:
    """Mean of the stable runs, and how many ended otherwise."""

    total: float = 0.0
    stable: int = 0
    others: Counter[str] = field(default_factory=Counter)

    def add(self, result: Mapping[str, Any], name: str) -> None:
        value, stability = result["rmse_percent"][name], result["stability"]
        if stability != "stable":
            self.others[stability] += 1
        elif result["outcome"] == "finished" and value is not None:
            self.total, self.stable = self.total + value, self.stable + 1

    def __str__(self) -> str:
        mean = f"{self.total / self.stable:.2f}" if self.stable else ""
        return ", ".join(part for part in (mean, *(f"{n} {word}" for word, n in sorted(self.others.items()))) if part)


@dataclass
class _Row:
    """Runs of one record under one variation: their errors by scheme and by table."""

    motion: str
    event: str | None
    file: str
    variation: str
    errors: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass
class _Study:
    """What is shown: rows, and means by variation, scheme and table."""

    rows: list[_Row] = field(default_factory=list)
    means: dict[str, dict[tuple[str, str], _Mean]] = field(default_factory=dict)
    runs: int = 0
    open_rows: dict[tuple[str, str, str], list[_Row]] = field(default_factory=dict)

    def add(self, result: Mapping[str, Any]) -> None:
        """Put a result into the first row of its record and variation that has none of its scheme yet."""
        self.runs += 1
        scheme = result["scheme"]
        variation = _differing(result["variation"])
        means = self.means.setdefault(variation, {})
        for name in PAPER_TABLES:
            means.setdefault((name, scheme), _Mean()).add(result, name)
        same = self.open_rows.setdefault((result["file"], result["motion"], variation), [])
        row = next((row for row in same if scheme not in row.errors), None)
        if row is None:
            row = _Row(result["motion"], result["event"], result["file"], variation)
            same.append(row)
            self.rows.append(row)
        row.errors[scheme] = {name: _cell(result, name) for name in PAPER_TABLES}

    @property
    def schemes(self) -> list[str]:
        """Those of the paper in its order, then the others."""
        found = {scheme for entry in self.means.values() for _, scheme in entry}
        return [*(s for s in SCHEME_NAMES if s in found), *sorted(found.difference(SCHEME_NAMES))]


def show_error_tables(results: Iterable[Mapping[str, Any]], paper: bool, assumed: Iterable[str]) -> None:
    """Print the errors of many runs: a row a record and a variation, and the means of each variation.

    Where a row is wider than the terminal, each scheme has a row of its own.

    Parameters
    ----------
    results : iterable of Mapping
        As `bmd_rths_core.campaign.study.FinishedRun` has them; read once.
    paper : bool
        Put the paper's numbers beside them: the runs are of its system.
    assumed : iterable of str
        What the results assume, each a sentence.
    """
    study = _Study()
    for result in results:
        study.add(result)
    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, _WIDTH)
    unbounded = console.options.update(max_width=_UNBOUNDED)
    for name in PAPER_TABLES:
        wide = _wide_table(study, name, paper)
        fits = Measurement.get(console, unbounded, wide).maximum <= console.width
        console.print(wide if fits else _long_table(study, name, paper))
    if len(study.rows) > _MOST_ROWS:
        click.echo(f"{len(study.rows)} records and variations of {study.runs} runs; the means are shown.")
    click.echo(_PAPER_NOTE if paper else _NOTE)
    for sentence in assumed:
        click.echo(sentence)


def show_bags(results: Sequence[Mapping[str, Any]]) -> None:
    """Print which bag is which test, and in what they differ.

    Parameters
    ----------
    results : sequence of Mapping
        See `result_with_event`; with ``bag`` and ``differs``, all parameters in which it differs from the others.
    """
    table = Table(title="Bags", title_justify="left", title_style="bold")
    for heading in ("bag", "ground motion", "scheme", "outcome", "differs in"):
        table.add_column(heading, overflow="fold")
    for result in results:
        outcome = result["outcome"] if result["stability"] != "unstable" else "limit: unstable"
        cells = (Path(result["bag"]).name, result["motion"], result["scheme"], outcome, _differing(result["differs"]))
        table.add_row(*map(Text, cells))
    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, _WIDTH)
    console.print(table)


def result_with_event(result: Mapping[str, Any], source: str, variation: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a bag as one of a campaign.

    Parameters
    ----------
    result : Mapping
        See `bmd_rths_nodes.cli.results.result_of`.
    source : str
        Path of its ground motion.
    variation : Mapping
        Parameters in which it differs from the other bags, by ``section.key``.
    """
    event = event_of(source) or event_of(result["motion"])
    return {**result, "event": event, "file": source, "variation": dict(variation)}


def _wide_table(study: _Study, name: str, paper: bool) -> Table:
    """Return a table with a column a scheme."""
    schemes, varied = study.schemes, any(study.means)
    headings = [f"{s} (paper)" if paper and s in SCHEME_NAMES else s for s in schemes]
    table = _table(name, paper, [*_first(varied, paper), *headings])
    for row in _shown(study):
        cells = (row.errors[s][name] + _of_paper(row, name, s, paper) if s in row.errors else "" for s in schemes)
        table.add_row(*map(Text, (*_about(row, varied, paper), *cells)))
    for variation, entry in study.means.items():
        cells = (f"{entry.get((name, s), '')}{_paper_mean(name, s, paper)}" for s in schemes)
        table.add_row(*map(Text, (*_about(_Row("mean", "", "", variation), varied, paper), *cells)), style="bold")
    return table


def _long_table(study: _Study, name: str, paper: bool) -> Table:
    """Return a table with a row a scheme, for a narrow terminal: what a run is, folded, and its error."""
    varied = any(study.means)
    table = _table(name, paper, ["run"])
    table.add_column("RMSE (paper)" if paper else "RMSE", justify="right", no_wrap=True)
    for row in _shown(study):
        for scheme in (s for s in study.schemes if s in row.errors):
            run = ", ".join(filter(None, (*_about(row, varied, paper), scheme)))
            table.add_row(Text(run), Text(row.errors[scheme][name] + _of_paper(row, name, scheme, paper)))
    for variation, entry in study.means.items():
        for scheme in (s for s in study.schemes if (name, s) in entry):
            run = ", ".join(filter(None, ("mean", variation, scheme)))
            error = f"{entry[name, scheme]}{_paper_mean(name, scheme, paper)}"
            table.add_row(Text(run), Text(error), style="bold")
    return table


def _differing(variation: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}={value}" for key, value in variation.items())


def _shown(study: _Study) -> Sequence[_Row]:
    return study.rows if len(study.rows) <= _MOST_ROWS else ()


def _first(varied: bool, paper: bool) -> list[str]:
    return ["ground motion", *(["event"] if paper else []), *(["variation"] if varied else [])]


def _about(row: _Row, varied: bool, paper: bool) -> list[str]:
    return [row.motion, *([row.event or ""] if paper else []), *([row.variation] if varied else [])]


def _table(name: str, paper: bool, headings: Sequence[str]) -> Table:
    title = _TITLES[name] if paper else f"RMSE, {name}"
    table = Table(title=title, title_justify="left", title_style="bold")
    texts = ("ground motion", "event", "variation", "run")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in texts else "right", overflow="fold")
    return table


def _of_paper(row: _Row, name: str, scheme: str, paper: bool) -> str:
    told = PAPER_TABLES[name].get(row.event or "")  # a campaign.csv of somebody else may name any event
    if not paper or told is None or scheme not in SCHEME_NAMES:
        return ""
    value = told[scheme]
    return " (unstable)" if value is None else f" ({value:.2f})"


def _paper_mean(name: str, scheme: str, paper: bool) -> str:
    return f" ({paper_mean(PAPER_TABLES[name], scheme):.2f})" if paper and scheme in SCHEME_NAMES else ""


def _cell(result: Mapping[str, Any], name: str) -> str:
    """Return the text of an error, with a mark where the test ended early."""
    value, outcome, stability = result["rmse_percent"][name], result["outcome"], result["stability"]
    if value is None:
        return "no data" if stability in ("stable", "failed") else stability
    return f"{value:.2f}" + ("" if outcome == "finished" else f", {outcome}")
