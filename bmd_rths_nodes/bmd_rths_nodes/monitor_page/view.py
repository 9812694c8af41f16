"""One look at a run, at its end or at any step, as plain values for the page."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from typing import Any

from bmd_rths_core.analysis.limit_use import WATCHED
from bmd_rths_core.safety.trips import Action
from bmd_rths_core.signals import SIGNALS
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_msgs_py.growing_run import GrowingRun, Told
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE
from bmd_rths_nodes.monitor_page.banner import ALARM, Banner, banner, loading, looking_back, no_run
from bmd_rths_nodes.monitor_page.events import EventLog
from bmd_rths_nodes.run.graph_state import number, numbers, take_snapshot

#: Longest time that signals are sent of [s].
LONGEST_SPAN = 60.0

#: What counts as now in a bar of a limit [s].
RECENT = 0.5

#: Most events that are sent.
MOST_EVENTS = 80


class RunView:
    """Look at a bag that is followed.

    Parameters
    ----------
    follower : BagFollower
        The bag.

    Attributes
    ----------
    problem : str
        Why it cannot be read any further; empty when it can.
    loading : bool
        True until everything that was there was read once: what is known until then is of the past.
    """

    def __init__(self, follower: BagFollower) -> None:
        self.follower = follower
        self.problem = ""
        self.loading = True
        self._events = EventLog()

    def look(self, at: int | None, since: int, span: float, now: float) -> dict[str, Any]:
        """Return what the page shows.

        Parameters
        ----------
        at : int, optional
            Number of steps that count; all by default.
        since : int
            First step whose signals are wanted.
        span : float
            Time before the last step that is shown [s].
        now : float
            Wall time [s].

        Returns
        -------
        dict
            For JSON; what is not known is None.
        """
        run = self.follower.run
        if run is None:
            nothing_yet = loading(self.follower.path.name) if self.loading else no_run()
            found = Banner("CANNOT BE READ", self.problem, ALARM) if self.problem else nothing_yet
            return {"banner": found._asdict()}
        self._events.update(run.told)
        steps = run.shown_steps
        shown = steps if at is None else max(0, min(at, steps))
        time_step = run.config.run.time_step
        first = max(since, shown - math.ceil(min(span, LONGEST_SPAN) / time_step), 0)
        told = run.told if shown == steps else run.told[: bisect_right(run.told, shown, key=lambda entry: entry.step)]
        live = not (self.follower.ended or self.follower.damaged)
        begin = shown * time_step - span
        said = (
            loading(self.follower.path.name)
            if self.loading
            else _banner(run, None if shown == steps else shown * time_step, live, now)
        )
        return {
            "story": _story(run, told),
            "banner": said._asdict(),
            "live": live,
            "steps": steps,
            "at": shown,
            "time": shown * time_step,
            "signals": {"first": min(first, shown), **_signals(run, min(first, shown), shown)},
            "tracking": _tracking(run, begin, shown * time_step),
            "stability": _stability(told, begin, time_step),
            "limits": _limits(run, shown, told),
            "closure": _closure(run, told),
            "snapshot": _snapshot(told, now),
            "events": [event.as_mapping() for event in self._events.events if event.step <= shown][-MOST_EVENTS:],
        }


def _banner(run: GrowingRun, back_at: float | None, live: bool, now: float) -> Banner:
    """Return what is said of the run; `back_at` is the test time that is shown if it is not the last [s]."""
    limits = _limits(run, run.shown_steps, run.told)
    used = {limit["words"]: limit["now"] / limit["limit"] for limit in limits if limit["watched"] and limit["now"]}
    found = banner(run, _snapshot(run.told, now), used, now)
    return found if back_at is None else looking_back(found, live, back_at)


def _story(run: GrowingRun, told: Iterable[Told]) -> dict[str, Any]:
    config = run.config
    planned = next((number(t.status.values["steps"]) for t in told if "steps" in t.status.values), None)
    return {
        "motion": run.motion["name"],
        "scheme": config.run.scheme,
        "controller": config.table.controller,
        "time_step": config.run.time_step,
        "planned_steps": planned,
        "floors": run.signals.floors,
        "outcome": run.outcome or None,
        "malformed": run.malformed,
    }


def _snapshot(told: Iterable[Told], now: float) -> dict[str, Any]:
    """Return what the nodes told last, as ``bmd-rths monitor --json`` has it."""
    latest = {entry.status.role: entry for entry in told}
    return take_snapshot(
        {role: entry.status for role, entry in latest.items()},
        {role: now - entry.heard for role, entry in latest.items()},
        latest,
    )


def _signals(run: GrowingRun, first: int, last: int) -> dict[str, Any]:
    columns = run.signals.columns
    found: dict[str, Any] = {}
    for signal in SIGNALS:
        if signal.per_floor:
            floors = columns[signal.name][first:last] if run.signals.floors else None
            found[signal.name] = [] if floors is None else [plain(column) for column in floors.T.tolist()]
        else:
            found[signal.name] = plain(columns[signal.name][first:last].tolist())
    return found


def plain(values: list[float]) -> list[float | None]:
    """Return numbers with None for what is none: JSON has no NaN."""
    return [value if math.isfinite(value) else None for value in values]


def _tracking(run: GrowingRun, begin: float, end: float) -> dict[str, list[float | None]]:
    windows = run.tracking.windows
    first = bisect_right(windows, begin, key=lambda window: window.end)
    last = bisect_right(windows, end + 1e-9, key=lambda window: window.end)
    found = windows[first:last]
    names = ("end", "error_percent", "amplitude", "delay_ms", "frequency_hz", "indicator")
    return {name: plain([getattr(window, name) for window in found]) for name in names}


def _stability(told: Iterable[Told], begin: float, time_step: float) -> dict[str, list[float | None]]:
    """Return the stability indicator as the numerical substructure told it, about once a second."""
    points = [(entry.step * time_step, _indicator(entry)) for entry in told]
    known = [(time, value) for time, value in points if value is not None and time >= begin]
    return {"time": [time for time, _ in known], "value": [value for _, value in known]}


def _indicator(entry: Told) -> float | None:
    if entry.status.role != NUMERICAL_SUBSTRUCTURE:
        return None
    return number(entry.status.values.get("stability_indicator"))


def _limits(run: GrowingRun, steps: int, told: Iterable[Told]) -> list[dict[str, Any]]:
    safety = run.config.safety
    used = run.limits.use(steps, RECENT)
    found = [
        _limit(watched.words, watched.unit, used[watched.name]._asdict(), safety.action(watched.name))
        for watched in WATCHED
    ]
    values = [value for value in map(_indicator, told) if value is not None]
    stability = {
        "limit": safety.stability_limit,
        "now": values[-1] if values else math.nan,
        "peak": max(values, default=math.nan),
    }
    return [*found, _limit("stability indicator", "", stability, safety.action("stability"))]


def _limit(words: str, unit: str, use: Mapping[str, float], action: Action) -> dict[str, Any]:
    plainly = {name: value if math.isfinite(value) else None for name, value in use.items()}
    return {"words": words, "unit": unit, **plainly, "watched": action is not Action.IGNORE}


def _closure(run: GrowingRun, told: Iterable[Told]) -> dict[str, Any]:
    """Return how long the steps took to close, as the numerical substructure counted, or why that is not known."""
    if run.config.run.lockstep:
        return {"why": "the test runs in lockstep, without deadlines"}
    if "rclpy" not in run.versions:
        return {"why": "the test was simulated in process, without a clock"}
    values = next((t.status.values for t in reversed([*told]) if "closure_counts" in t.status.values), {})
    counts = numbers(values.get("closure_counts"))
    late = number(values.get("missed_deadlines"))
    if not any(counts) and not late:
        return {"why": "nothing was told of it yet"}
    deadline = 1e3 * run.config.run.time_step
    edges = [deadline * part / len(counts) for part in range(len(counts))]
    return {"edges_ms": edges, "counts": counts, "late": late or 0, "deadline_ms": deadline}
