"""The page in a browser, beside a real run: it shows what is recorded, STOP stops, and nobody else can."""

import asyncio
import json
import os
import re
import signal
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import numpy as np
import pytest
from tornado.httpclient import HTTPClient, HTTPRequest

from bmd_rths_msgs_py.bag_reader import read_bag
from tests.nodes.browser import CHROMIUM, MISSING, chromium
from tests.nodes.conftest import CONFIG, recorded, wait_until
from tests.nodes.test_monitor import PATIENT, settings

pytestmark = [pytest.mark.slow]

NO_CORS = "{method: 'POST', mode: 'no-cors'}"
DRAWN = "Object.fromEntries(Object.entries(monitorPage.charts.plots).map(([name, plot]) => [name, plot.data]))"
TILES = """Object.fromEntries([...document.querySelectorAll("#tiles div")].map(
    (tile) => [tile.dataset.name, tile.querySelector("dd").firstChild.data]
))"""
FRAMED = """new Promise((end) => {
    const frame = document.createElement("iframe");
    frame.src = "%s";
    frame.onload = () => {
        try { end(frame.contentDocument === null ? "foreign" : "its own"); } catch { end("foreign"); }
    };
    document.body.append(frame);
})"""

ADDRESS = re.compile(r"watch the test at (http://127\.0\.0\.1:\d+/)#(\S+)")


def fetched(url, options="{}"):
    """Return code that fetches something."""
    return f"fetch('{url}', {options}).then((answer) => `${{answer.type}} ${{answer.status}}`, () => 'refused')"


def address_of(child):
    """Return address and token of the page of a run."""
    child.wait_for_words("watch the test at")
    return ADDRESS.search(child.errors.read_text()).groups()


@pytest.fixture
def other_site(tmp_path):
    """Serve an empty page of another origin, and return its address."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "index.html").write_text("<!doctype html><title>another site</title>")

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=tmp_path / "site"))
    Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://localhost:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
def test_values_are_those_of_the_bag_and_stop_stops_but_not_from_another_site(bmd_rths, tmp_path, other_site):
    endless = settings(ground_motion__free_vibration=600.0, run__preflight="skip", **PATIENT)
    run = bmd_rths("run", CONFIG, "--composed", "--monitor", *endless, "--output", tmp_path, "--json")
    address, token = address_of(run)
    wait_until(lambda: recorded(tmp_path, 500_000))

    async def watch(open_page):
        page = await open_page(f"{address}#{token}")
        await page.wait_for(
            "globalThis.monitorPage?.page.view?.at > 450 && monitorPage.charts.plots.closure !== undefined"
        )
        assert await page.evaluate("location.href") == address  # the token is out of sight
        assert await page.evaluate("document.getElementById('control').hidden") is False
        # Everything at one time, a step in the past, so that nothing changes meanwhile.
        await page.evaluate("monitorPage.seek(400)")
        await page.wait_for("monitorPage.page.view.at === 400 && monitorPage.page.buffer.end === 400")
        shown = await page.evaluate("({...monitorPage.page.buffer, view: monitorPage.page.view})")
        drawn, tiles = await page.evaluate(DRAWN), await page.evaluate(TILES)
        await page.evaluate("monitorPage.seek(null)")
        await page.wait_for("/^(RUNNING|NEAR A LIMIT)$/.test(document.getElementById('word').textContent)")

        foreign = await open_page(other_site)
        await foreign.wait_for("document.title === 'another site'")
        for what in ("stop", "emergency_stop"):
            for options in (f"{{method: 'POST', headers: {{'X-Bmd-Rths-Token': '{token}'}}}}", NO_CORS):
                assert await foreign.evaluate(fetched(f"{address}api/{what}", options)) in ("refused", "opaque 0")
        assert await foreign.evaluate(fetched(f"{address}api/recordings")) == "refused"
        assert await foreign.evaluate(FRAMED % address) == "foreign"
        await asyncio.sleep(0.5)
        assert await page.evaluate("document.getElementById('word').textContent") in ("RUNNING", "NEAR A LIMIT")
        assert run.process.poll() is None

        await page.evaluate("document.getElementById('stop').click()")
        # The run may end, and its page with it, before the last word is fetched.
        while run.process.poll() is None:
            if await page.evaluate("document.getElementById('word').textContent") not in ("RUNNING", "NEAR A LIMIT"):
                break
            await asyncio.sleep(0.05)
        return shown, drawn, tiles, page.complaints

    (tmp_path / "browser").mkdir()
    with chromium(tmp_path / "browser") as open_page:
        shown, drawn, tiles, complaints = asyncio.run(watch(open_page))
    result = run.wait(60.0)
    told = json.loads(result.output)
    assert told["outcome"] == "stopped", result.errors
    assert "emergency stop" not in result.errors.replace("again for an emergency stop", "")
    # Once the run has ended there is no page any more, which the browser tells; it has nothing else to complain of.
    assert [text for text in complaints if "ERR_CONNECTION_REFUSED" not in text] == []

    record = read_bag(told["bag"])
    first, last = shown["first"], shown["end"]
    assert (first, last) == (0, 400)
    for name, column in record.signals().items():
        found = shown["floors"] if name == "floor_accelerations" else shown["scalars"][name]
        assert np.array_equal(np.array(found, dtype=float).T, column[:last], equal_nan=True), name
    numbers = {name: np.array(data, dtype=float) for name, data in drawn.items()}
    time, ground, command, achieved, desired = numbers["acceleration"]
    assert np.array_equal(time, record.time[:last])
    assert np.array_equal(desired, record.desired_acceleration[:last])
    assert np.array_equal(achieved[1:], record.table_acceleration[: last - 1])  # at the end of its step
    assert np.array_equal(ground, record.ground_acceleration[:last])
    assert np.array_equal(command, record.command[:last])
    assert numbers["forces"][4][1:] == pytest.approx(1e-3 * record.corrected_force[: last - 1], rel=1e-12)
    assert tiles["test time"] == "2.0"
    limits = {limit["words"]: limit for limit in shown["view"]["limits"]}
    assert limits["displacement"]["peak"] == np.abs(record.table_displacement[:last]).max()


def test_killing_the_page_changes_no_bit(bmd_rths, tmp_path, composed_run):
    """`composed_run` is the same test without a page."""
    arguments = ("--lockstep", "--composed", "--set", "ground_motion.duration=3.0", "--output", tmp_path, "--json")
    run = bmd_rths("run", CONFIG, *arguments, "--monitor")
    address_of(run)
    (page,) = children_of(run.process.pid, "monitor_page.child")
    wait_until(lambda: recorded(tmp_path, 20_000))
    os.kill(page, signal.SIGKILL)
    result = run.wait(120.0)
    assert result.status == 0, result.errors
    with_page, without = (read_bag(told["bag"]) for told in (json.loads(result.output), composed_run.told))
    assert with_page.same_signals(without)


def children_of(parent, words):
    """Return the process ids of the children of a process whose command has some words."""
    found = []
    for task in os.listdir("/proc"):
        if not task.isdigit():
            continue
        try:
            with open(f"/proc/{task}/stat") as stat, open(f"/proc/{task}/cmdline") as command:
                if int(stat.read().rpartition(")")[2].split()[1]) == parent and words in command.read():
                    found.append(int(task))
        except OSError:
            continue
    return found


def test_pages_of_a_graph_stop_the_table_and_end_with_their_commands(bmd_rths, tmp_path):
    """Nodes that somebody else has started: one page finds the bag, the other listens; services do the stop."""
    by_bag, by_topics = (bmd_rths("monitor", "--web", *options) for options in ((), ("--topics", CONFIG)))
    endless = settings(ground_motion__free_vibration=600.0, run__preflight="skip", **PATIENT)
    pages = [address_of(watching) for watching in (by_bag, by_topics)]
    run = bmd_rths("run", CONFIG, "--composed", *endless, "--output", tmp_path, "--json")
    wait_until(lambda: recorded(tmp_path, 100_000))
    bags = [wait_until(lambda a=address: fetch(f"{a}api/recordings")["bags"])[0]["id"] for address, _ in pages]
    views = [f"{address}api/view?run={bag}" for (address, _), bag in zip(pages, bags, strict=True)]
    seen = [wait_until(lambda v=view: (found := fetch(v)).get("at", 0) > 100 and found)["signals"] for view in views]

    address, token = pages[0]
    headers = {"Origin": address.rstrip("/"), "X-Bmd-Rths-Token": token}
    answer = fetch(f"{address}api/stop", method="POST", headers=headers, body="")
    assert answer == {"answer": "asked the table driver: stop"}
    said = wait_until(lambda: fetch(views[0])["said"])
    assert said[0].startswith("table driver, stop: the table is brought to rest, after step ")
    told = json.loads(run.wait(60.0).output)
    assert told["outcome"] == "stopped"
    for view in views:
        wait_until(lambda v=view: fetch(v)["banner"]["word"] == "STOPPED", 20.0)
    for watching in (by_bag, by_topics):
        watching.interrupt()
        assert watching.wait(20.0).status == 0

    record = read_bag(told["bag"])
    for signals, least in zip(seen, (90, 1), strict=True):  # topics are best effort: on a busy machine many are missing
        shown, first = signals["desired_acceleration"], signals["first"]
        expected = record.desired_acceleration[first : first + len(shown)].tolist()
        assert sum(value is not None for value in shown) >= least
        assert all(value is None or value == wanted for value, wanted in zip(shown, expected, strict=True))


def fetch(url, **options):
    """Return what a page answers."""
    http = HTTPClient()
    try:
        return json.loads(http.fetch(HTTPRequest(url, **options)).body)
    finally:
        http.close()
