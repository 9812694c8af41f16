"""The largest words of the page: what the test does, in a colour that can be told from three metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import LARGEST_LATE_SHARE
from bmd_rths_msgs_py.growing_run import GrowingRun
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE

#: Colours of the banner, by what they mean.
QUIET, GOOD, CARE, ALARM = "quiet", "good", "care", "alarm"

#: Silence after which the page says so, of the signals of a running test and of all nodes: they tell their status once
#: a second; and silence after which the recording is taken for cut [s].
STALE_SIGNALS, STALE, CUT = 1.0, 3.0, 20.0

#: Share of a limit from which the banner says how near it is.
NEAR = 0.8

_OUTCOMES = {
    "finished": ("FINISHED", GOOD),
    "stopped": ("STOPPED", CARE),
    "limit": ("LIMIT", ALARM),
    "failed": ("FAILED", ALARM),
    "cut": ("CUT", ALARM),
}


class Banner(NamedTuple):
    """A word, a sentence and a colour."""

    word: str
    sentence: str
    colour: str


def no_run() -> Banner:
    """Return the banner of a page without a run."""
    return Banner("NO TEST", "waiting for a recording", QUIET)


def loading(name: str) -> Banner:
    """Return the banner of a recording of which not everything that is there was read yet."""
    return Banner("LOADING", f"the recording {name} is being read", QUIET)


def banner(run: GrowingRun, snapshot: Mapping[str, Any], used: Mapping[str, float], now: float) -> Banner:
    """Return what the page says of a run as it is now.

    Parameters
    ----------
    run : GrowingRun
        The run.
    snapshot : Mapping
        What its nodes have told, as `run.graph_state.take_snapshot` has it.
    used : Mapping of str to float
        Share of each limit that is used, by what it limits.
    now : float
        Wall time [s].
    """
    silence = now - run.last_heard
    if run.outcome:
        word, colour = _OUTCOMES.get(run.outcome, (run.outcome.upper(), ALARM))
        if colour == GOOD and (late := _late_steps(run)):
            return Banner(word, f"{run.reason}; not in real time: {late} of {run.shown_steps} steps were late", CARE)
        return Banner(word, run.reason, colour)
    if silence > CUT:
        return Banner("CUT", f"the recording has no end; it holds {run.shown_steps} steps", ALARM)
    test, table, nodes = snapshot["test"] or {}, snapshot["table"] or {}, snapshot["nodes"]
    tripped = {role: node for role, node in nodes.items() if node["state"] == NodeState.TRIPPED}
    state = nodes.get(NUMERICAL_SUBSTRUCTURE, {}).get("state")
    if state == NodeState.RUNNING and now - run.last_signal > STALE_SIGNALS:
        return Banner("NO DATA", f"no signal has come for {now - run.last_signal:.1f} s", ALARM)
    if silence > STALE:
        return Banner("NO DATA", f"nothing has come for {silence:.1f} s", ALARM)
    for role, node in tripped.items():
        return Banner("TRIPPED", f"{role.replace('_', ' ')}: {node['message']}", ALARM)
    if state == NodeState.ENDED:
        moves = table.get("table") == "moving"
        sentence = "the table is brought to rest" if moves else "the recording is being closed"
        return Banner("ENDING", sentence, CARE)
    if state == NodeState.RUNNING or (state is None and run.shown_steps):
        return _running(used)
    if state == NodeState.WAITING or test.get("waiting_for"):
        return Banner("WAITING", f"for {test.get('waiting_for') or 'the nodes'}".replace("_", " "), CARE)
    if state == NodeState.READY:
        return Banner("READY", "the test begins", CARE)
    return Banner("STARTING", "the nodes find each other", QUIET)


def _late_steps(run: GrowingRun) -> int:
    """Return how many steps were late where that is more than a test may have that kept real time; otherwise 0."""
    late = 0 if run.timing is None else max(run.timing.missed_deadlines, run.timing.late_ticks)
    return late if late > LARGEST_LATE_SHARE * run.shown_steps else 0


def looking_back(now: Banner, live: bool, time: float) -> Banner:
    """Return what the page says while it shows a time in the past: never that the test runs, and an alarm as ever.

    Parameters
    ----------
    now : Banner
        What it would say of the run as it is.
    live : bool
        True while the run is recorded.
    time : float
        Test time that is shown [s].
    """
    shown = f"what is shown was at {time:.2f} s"
    if live and now.colour == ALARM:
        return Banner(now.word, f"{now.sentence}; {shown}", ALARM)
    return Banner("LOOKING BACK", f"{shown}; {'now' if live else 'in the end'}: {now.word.lower()}", QUIET)


def _running(used: Mapping[str, float]) -> Banner:
    nearest = max(used, key=lambda words: used[words], default="")
    if nearest and used[nearest] >= NEAR:
        return Banner("NEAR A LIMIT", f"{nearest} at {100.0 * used[nearest]:.0f} % of its limit", CARE)
    return Banner("RUNNING", "", GOOD)
