"""A monitor server in the loop of a test, and what it shows of a bag."""

import asyncio
import json

from tornado.httpclient import AsyncHTTPClient, HTTPRequest

from bmd_rths_nodes.monitor_page.recordings import Recordings
from bmd_rths_nodes.monitor_page.server import MonitorServer


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
