"""The server of the page, without a browser: what it shows is what was recorded, and who may ask it for what."""

import asyncio
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPRequest

from bmd_rths_core import RthsLoop, load_config, select_ground_motion
from bmd_rths_core.analysis.supervised_peaks import largest_increment
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import TimingStatistics
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_msgs_py.growing_run import GrowingRun, Told
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.cli.monitor_web import RunPage
from bmd_rths_nodes.monitor_page import banner as banners
from bmd_rths_nodes.monitor_page.banner import banner, looking_back
from bmd_rths_nodes.monitor_page.events import EventLog
from bmd_rths_nodes.monitor_page.recordings import Recordings
from bmd_rths_nodes.monitor_page.server import STATIC, TOKEN_HEADER, MonitorServer
from bmd_rths_nodes.run.graph_state import take_snapshot
from tests.nodes.conftest import CONFIG


@pytest.fixture(scope="module")
def record():
    config = load_config(CONFIG).changed(ground_motion__duration=3.0)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


@pytest.fixture(scope="module")
def folder(record, tmp_path_factory):
    """Make the folder of a campaign with one bag that is kept and one that is not."""
    folder = tmp_path_factory.mktemp("campaign")
    write_record(record, folder / "bags" / "el_centro_1940_ns_plc_fc_0123456789ab")
    (folder / "campaign.csv").write_text(
        "key,motion,scheme,variation,outcome,verdict,rmse_substructure_percent\n"
        "0123456789abcdef,el_centro_1940_ns,plc_fc,'=1+1,finished,good,12.5\n"
        "fedcba9876543210,el_centro_1940_ns,uc,{},limit,bad,\n"
    )
    return folder


def serving(recordings, use, ask=None):
    """Run a coroutine function with a server and a way to fetch from it; return what it returns."""

    async def served():
        server = MonitorServer(recordings, ask=ask)
        server.start()
        client = AsyncHTTPClient(force_instance=True)

        async def fetch(path, method="GET", **headers):
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            body = "" if method == "POST" else None
            request = HTTPRequest(
                f"http://127.0.0.1:{server.port}{path}", method, named, body, allow_nonstandard_methods=True
            )
            return await client.fetch(request, raise_error=False)

        try:
            return await use(server, fetch)
        finally:
            server.stop()

    return asyncio.run(served())


def looked_at(folder, query=""):
    """Return the view of the only bag of a folder."""

    async def use(server, fetch):
        (bag,) = json.loads((await fetch("/api/recordings")).body)["bags"]
        while True:
            view = json.loads((await fetch(f"/api/view?run={bag['id']}{query}")).body)
            if not view.get("live", True):
                return view
            await asyncio.sleep(0.01)

    return serving(Recordings(folder), use)


# ---- what is shown


def test_signals_are_those_of_the_record(folder, record):
    view = looked_at(folder, "&span=2&since=100")
    signals = view["signals"]
    assert (view["steps"], view["at"], signals["first"]) == (record.steps, record.steps, record.steps - 400)
    for name, column in record.signals().items():
        expected = column[-400:]
        found = np.array(signals[name], dtype=float)  # None becomes NaN
        assert np.array_equal(found.T if column.ndim == 2 else found, expected, equal_nan=True), name


def test_only_what_is_new_is_sent(folder, record):
    assert looked_at(folder, f"&since={record.steps - 3}")["signals"]["first"] == record.steps - 3
    assert looked_at(folder, "&since=99999")["signals"]["command"] == []


def test_a_step_in_the_past_is_shown_as_it_was(folder, record):
    view = looked_at(folder, "&at=300&span=1")
    assert (view["at"], view["time"], view["steps"]) == (300, 1.5, record.steps)
    assert view["signals"]["command"] == record.command[100:300].tolist()
    used = {limit["words"]: limit for limit in view["limits"]}
    assert used["displacement"]["peak"] == np.abs(record.table_displacement[:300]).max()
    assert used["actuator force"]["limit"] == 500e3
    assert view["tracking"]["end"] == []  # no window is complete
    assert view["banner"]["word"] == "LOOKING BACK"


def test_limits_outcome_and_reasons_at_the_end(folder, record):
    view = looked_at(folder, "&overview=1")
    used = {limit["words"]: limit for limit in view["limits"]}
    assert used["change of command"]["peak"] == largest_increment(record)
    assert used["stability indicator"] == {
        "words": "stability indicator",
        "unit": "",
        "limit": 0.7,
        "now": None,
        "peak": None,
        "watched": True,
    }
    assert view["banner"] == {"word": "FINISHED", "sentence": record.reason, "colour": "good"}
    assert view["closure"] == {"why": "the test was simulated in process, without a clock"}
    assert view["overview"][1] == record.ground_acceleration.tolist()
    assert view["story"]["scheme"] == "plc_fc"


def test_folder_of_a_campaign_lists_its_runs_and_which_of_them_can_be_shown(folder):
    recordings = Recordings(folder)
    (bag,) = recordings.listed()
    campaign = recordings.campaign()
    assert campaign["rows"][0][:5] == ["el_centro_1940_ns", "plc_fc", "=1+1", "finished", "12.5"]
    assert campaign["ids"][0] == bag["id"]
    assert campaign["ids"][1] not in {bag["id"]}
    assert Recordings(folder / "bags").campaign() is None


def test_one_bag_its_folder_and_a_bag_that_is_added_later(folder, tmp_path):
    (bag,) = (folder / "bags").iterdir()
    assert [found["name"] for found in Recordings(bag).listed()] == [bag.name]
    assert [found["name"] for found in Recordings(next(bag.glob("*.mcap"))).listed()] == [f"{bag.name}_0.mcap"]
    recordings = Recordings()
    assert recordings.listed() == []
    recordings.add(tmp_path / "not_there_yet")
    recordings.add(bag)
    newest, older = recordings.listed()
    assert newest["name"] == bag.name
    assert recordings.view(older["id"]) is None
    assert recordings.view("../../etc") is None
    assert recordings.view(newest["id"]) is not None


def test_a_bag_that_cannot_be_read_says_why(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x0c" + (17).to_bytes(8, "little") + bytes(17))
    recordings = Recordings(tmp_path)
    (bag,) = recordings.listed()
    view = recordings.view(bag["id"])
    view.problem = "configuration: not JSON"
    assert view.look(None, 0, 10.0, 0.0)["banner"]["sentence"] == "configuration: not JSON"


# ---- who may ask


def test_every_answer_forbids_what_the_page_does_not_need(folder):
    async def use(server, fetch):
        for path in ("/", "/page.js", "/api/recordings", "/nothing", "/uplot/uPlot.iife.min.js"):
            headers = (await fetch(path)).headers
            policy = headers["Content-Security-Policy"]
            assert "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'" in policy
            assert "frame-ancestors 'none'" in policy
            assert "unsafe" not in policy
            assert headers["X-Content-Type-Options"] == "nosniff"
            assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert "Access-Control-Allow-Origin" not in headers
            assert "Server" not in headers

    serving(Recordings(folder), use)


@pytest.mark.parametrize(
    ("headers", "refused"),
    [
        ({"Host": "example.org"}, "refused: Host"),  # a name that was made to lead to this computer
        ({"Host": "127.0.0.1"}, "refused: Host"),
        ({"Origin": "http://example.org"}, "refused: Origin"),
        ({"Origin": "null"}, "refused: Origin"),
        ({"Origin": "http://127.0.0.1:1"}, "refused: Origin"),
        ({"Sec_Fetch_Site": "cross-site"}, "refused: Sec-Fetch-Site"),
        ({"Sec_Fetch_Site": "same-site"}, "refused: Sec-Fetch-Site"),
    ],
    ids=str,
)
@pytest.mark.parametrize("path", ["/", "/api/view", "/api/recordings", "/page.css"])
def test_pages_of_others_get_nothing(folder, path, headers, refused):
    async def use(server, fetch):
        answer = await fetch(path, **headers)
        return answer.code, answer.body.decode()

    assert serving(Recordings(folder), use) == (403, refused)


def test_who_has_the_token_can_stop_and_nobody_else(folder):
    asked = []

    async def ask(what):
        asked.append(what)
        return f"did {what}"

    async def use(server, fetch):
        own = {"Origin": f"http://127.0.0.1:{server.port}", TOKEN_HEADER: server.token}
        for what in ("stop", "emergency_stop"):
            for problem, change in {
                "token": {TOKEN_HEADER: "guessed"},
                "Origin": {"Origin": "http://example.org"},
                "Host": {"Host": "example.org"},
                "Sec-Fetch-Site": {"Sec-Fetch-Site": "cross-site"},
            }.items():
                answer = await fetch(f"/api/{what}", "POST", **{**own, **change})
                assert (answer.code, answer.body.decode()) == (403, f"refused: {problem}")
            for name in own:
                answer = await fetch(f"/api/{what}", "POST", **{key: own[key] for key in own if key != name})
                assert answer.code == 403
            assert (await fetch(f"/api/{what}", **own)).code == 405  # a link or a picture cannot
            assert (await fetch(f"/api/{what}", "OPTIONS", Origin="http://example.org")).code == 403
            assert asked == []
            assert json.loads((await fetch(f"/api/{what}", "POST", **own)).body) == {"answer": f"did {what}"}
            assert asked.pop() == what
        for never in ("reset", "start", "shutdown"):
            assert (await fetch(f"/api/{never}", "POST", **own)).code in (404, 405)
        assert asked == []
        assert server.url == f"http://127.0.0.1:{server.port}/#{server.token}"

    serving(Recordings(folder), use, ask)


def test_recordings_have_no_table_to_stop(folder):
    async def use(server, fetch):
        own = {"Origin": f"http://127.0.0.1:{server.port}", TOKEN_HEADER: server.token}
        assert json.loads((await fetch("/api/recordings")).body)["control"] is False
        assert "#" not in server.url
        return (await fetch("/api/stop", "POST", **own)).code

    assert serving(Recordings(folder), use) == 404


def test_hostile_requests_come_to_nothing(folder):
    async def use(server, fetch):
        paths = (
            "/../server.py",
            "/uplot/../../server.py",
            "/%2e%2e/server.py",
            "/page.js%00",
            "/api/view/x",
        )
        assert [(await fetch(path)).code for path in paths] == [404] * 5
        for query in ("at=-1", "since=1e9", "span=9999999999", "since=x"):
            assert (await fetch(f"/api/view?{query}")).code == 400
        assert (await fetch("/api/view?run=../../../etc/passwd")).code == 200  # there is no such recording

    serving(Recordings(folder), use)


def test_two_servers_do_not_share_a_port(folder):
    async def use(server, fetch):
        with pytest.raises(InputError, match=f"--port {server.port}: "):
            MonitorServer(Recordings(folder), server.port)

    serving(Recordings(folder), use)


def test_page_has_no_code_or_style_in_itself_and_brings_everything_along():
    html = (STATIC / "index.html").read_text()
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script>|javascript:|https?://", html)
    for name in re.findall(r'(?:src|href)="([^"]+)"', html):
        assert (STATIC / name).is_file(), name
    for script in STATIC.glob("*.js"):
        assert not re.search(r"innerHTML|insertAdjacentHTML|document\.write|\beval\(|https?://", script.read_text())
    assert "MIT License" in (STATIC / "uplot" / "LICENSE").read_text()


# ---- what is said


def told(role, state, message="", level=b"\x00", after=0, **values):
    return Told(after, 100.0, NodeStatus(f"/rths/{role}", NodeState(state), level, message or state, values))


def test_events_are_changes():
    log = EventLog()
    entries = [
        told("table_driver", "ready"),
        told("table_driver", "ready", after=3),
        told("numerical_substructure", "running", missed_deadlines="0"),
        told("numerical_substructure", "running", missed_deadlines="2", after=7),
        told("numerical_substructure", "running", missed_deadlines="2", after=8),
        told("numerical_substructure", "running", missed_deadlines="5", after=9),
        told("table_driver", "tripped", "safety.force_limit", b"\x02", 9, trips="force"),
        told("table_driver", "tripped", "safety.force_limit", b"\x02", 10, trips="force | displacement"),
    ]
    log.update(entries[:3])
    log.update(entries)
    assert [event.as_mapping() for event in log.events] == [
        {"step": 0, "level": "info", "text": "table driver ready"},
        {"step": 0, "level": "info", "text": "numerical substructure running"},
        {"step": 9, "level": "warning", "text": "5 deadlines missed"},
        {"step": 9, "level": "error", "text": "table driver tripped: safety.force_limit"},
        {"step": 9, "level": "error", "text": "supervisor: force"},
        {"step": 10, "level": "error", "text": "supervisor: displacement"},
    ]


@pytest.fixture
def run(record, tmp_path):
    follower = BagFollower(write_record(replace(record, outcome="stopped", reason="by hand"), tmp_path / "bag"))
    while follower.look():
        pass
    assert isinstance(follower.run, GrowingRun)
    return follower.run


def said(run, *entries, used=None, ago=0.1, signal_ago=0.1):
    statuses = {entry.status.role: entry.status for entry in entries}
    snapshot = take_snapshot(statuses, dict.fromkeys(statuses, 0.1), statuses)
    run.last_heard, run.last_signal = 1000.0 - ago, 1000.0 - signal_ago
    return tuple(banner(run, snapshot, used or {}, 1000.0))


RUNNING = told("numerical_substructure", "running", after=5)


def test_banner_says_how_a_test_has_ended(run):
    assert said(run, RUNNING) == ("STOPPED", "by hand", "care")


@pytest.mark.parametrize(("missed", "late_ticks", "colour"), [(6, 0, "good"), (7, 0, "care"), (0, 7, "care")])
def test_a_finished_test_that_did_not_keep_real_time_is_not_green(run, missed, late_ticks, colour):
    """One step in a hundred may be late, of the 600 of this run."""
    run.outcome, run.reason = "finished", "end of the ground motion"
    run.timing = TimingStatistics(missed, 1, (), late_ticks, {})
    word, sentence, found = said(run, RUNNING)
    assert (word, found) == ("FINISHED", colour)
    assert ("not in real time: 7 of" in sentence) == (colour == "care")


def test_banner_of_a_test_that_is_under_way(run):
    run.outcome = ""
    assert said(run, RUNNING) == ("RUNNING", "", "good")
    near = said(run, RUNNING, used={"displacement": 0.5, "actuator force": 0.85})
    assert near == ("NEAR A LIMIT", "actuator force at 85 % of its limit", "care")
    tripped = told("table_driver", "tripped", "safety.force_limit")
    assert said(run, RUNNING, tripped) == ("TRIPPED", "table driver: safety.force_limit", "alarm")
    ended = told("numerical_substructure", "ended")
    assert said(run, ended, told("table_driver", "ended", supervisor="ramping", table="moving"))[1] == (
        "the table is brought to rest"
    )
    waiting = told("numerical_substructure", "waiting", step="0", waiting_for="table_driver")
    assert said(run, waiting) == ("WAITING", "for table driver", "care")


def test_banner_never_shows_old_data_as_if_they_were_new(run):
    run.outcome = ""
    assert said(run, RUNNING, signal_ago=banners.STALE_SIGNALS + 0.5)[0] == "NO DATA"
    assert said(run, RUNNING, ago=banners.STALE + 0.5, signal_ago=10.0)[0] == "NO DATA"
    assert said(run, RUNNING, ago=math.inf, signal_ago=math.inf) == (
        "CUT",
        f"the recording has no end; it holds {run.shown_steps} steps",
        "alarm",
    )


def test_banner_never_says_running_of_the_past_and_shows_an_alarm_all_the_same():
    running, limit = banners.Banner("RUNNING", "", "good"), banners.Banner("LIMIT", "force", "alarm")
    back = looking_back(running, live=True, time=8.0)
    assert back == ("LOOKING BACK", "what is shown was at 8.00 s; now: running", "quiet")
    assert looking_back(limit, live=True, time=8.0) == ("LIMIT", "force; what is shown was at 8.00 s", "alarm")
    assert looking_back(limit, live=False, time=8.0).sentence == "what is shown was at 8.00 s; in the end: limit"


# ---- the buttons of `run --monitor`


@pytest.fixture
def buttons(monkeypatch):
    """Return the page of a run without its process."""
    monkeypatch.setattr("bmd_rths_nodes.cli.monitor_web.PageProcess", lambda *_: Silent())
    return RunPage(0)


class Silent:
    url = "http://127.0.0.1:1/"


@pytest.mark.parametrize(
    ("asked", "presses"),
    [
        (["stop"], 1),
        (["stop", "stop", "stop"], 1),  # never more: a second Ctrl-C is an emergency stop
        (["emergency_stop"], 2),
        (["stop", "emergency_stop"], 2),
        (["emergency_stop", "emergency_stop", "stop"], 2),  # never three: that would leave at once
    ],
    ids=str,
)
def test_buttons_are_as_many_presses_of_ctrl_c(buttons, asked, presses):
    interrupts = []
    assert buttons._on_ask("stop") == "no test is running"
    buttons.follow(interrupts)
    for what in asked:
        buttons._on_ask(what)
    assert len(interrupts) == presses
    buttons.leave()
    assert buttons._on_ask("emergency_stop") == "no test is running"
    assert len(interrupts) == presses


def test_ctrl_c_and_buttons_together(buttons):
    interrupts = [2]
    buttons.follow(interrupts)
    buttons._on_ask("stop")
    assert len(interrupts) == 1
    buttons._on_ask("emergency_stop")
    assert len(interrupts) == 2


def test_at_the_end_the_table_is_on_its_way_to_rest_and_only_an_emergency_stop_is_more(buttons):
    """`Supervisor.stop` has asked every process once; a further interrupt is an emergency stop."""
    for before in ([], [2], [2, 2]):
        interrupts = list(before)
        buttons._ending = False
        buttons.follow(interrupts)
        buttons.end()
        buttons._on_ask("stop")
        assert interrupts == before
        buttons._on_ask("emergency_stop")
        buttons._on_ask("emergency_stop")
        assert len(interrupts) == len(before) + 1
