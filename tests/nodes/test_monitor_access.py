"""Who may ask the server of the page for what, and what others get."""

import json
import re

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.monitor_page.recordings import Recordings
from bmd_rths_nodes.monitor_page.server import STATIC, TOKEN_HEADER, MonitorServer
from tests.nodes.monitor_view import serving


def test_every_answer_forbids_what_the_page_does_not_need(campaign_folder):
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

    serving(Recordings(campaign_folder), use)


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
def test_pages_of_others_get_nothing(campaign_folder, path, headers, refused):
    async def use(server, fetch):
        answer = await fetch(path, **headers)
        return answer.code, answer.body.decode()

    assert serving(Recordings(campaign_folder), use) == (403, refused)


def test_who_has_the_token_can_stop_and_nobody_else(campaign_folder):
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

    serving(Recordings(campaign_folder), use, ask)


def test_recordings_have_no_table_to_stop(campaign_folder):
    async def use(server, fetch):
        own = {"Origin": f"http://127.0.0.1:{server.port}", TOKEN_HEADER: server.token}
        assert json.loads((await fetch("/api/recordings")).body)["control"] is False
        assert "#" not in server.url
        return (await fetch("/api/stop", "POST", **own)).code

    assert serving(Recordings(campaign_folder), use) == 404


def test_hostile_requests_come_to_nothing(campaign_folder):
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

    serving(Recordings(campaign_folder), use)


def test_two_servers_do_not_share_a_port(campaign_folder):
    async def use(server, fetch):
        with pytest.raises(InputError, match=f"--port {server.port}: "):
            MonitorServer(Recordings(campaign_folder), server.port)

    serving(Recordings(campaign_folder), use)


def test_page_has_no_code_or_style_in_itself_and_brings_everything_along():
    html = (STATIC / "index.html").read_text()
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script>|javascript:|https?://", html)
    for name in re.findall(r'(?:src|href)="([^"]+)"', html):
        assert (STATIC / name).is_file(), name
    for script in STATIC.glob("*.js"):
        assert not re.search(r"innerHTML|insertAdjacentHTML|document\.write|\beval\(|https?://", script.read_text())
    assert "MIT License" in (STATIC / "uplot" / "LICENSE").read_text()
