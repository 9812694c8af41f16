"""A headless Chromium, driven through its DevTools protocol with tornado's WebSocket client."""

import asyncio
import base64
import contextlib
import json
import shutil
import subprocess
import time
import urllib.request

from tornado.websocket import websocket_connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
MISSING = "chromium is not installed (Debian: apt install chromium); what the page does in a browser is not tested"

_OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--mute-audio"),
    *("--disable-extensions", "--hide-scrollbars", "--remote-debugging-port=0", "about:blank"),
)


class Page:
    """One page of the browser; `complaints` has every error and every violation of a policy that it told of."""

    def __init__(self, connection):
        self._connection = connection
        self._number = 0
        self.complaints = []

    async def call(self, method, **parameters):
        """Call a method of the protocol and return its result."""
        self._number += 1
        number = self._number
        await self._connection.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            told = json.loads(await asyncio.wait_for(self._connection.read_message(), 30.0))
            if told.get("id") == number:
                assert "error" not in told, told
                return told["result"]
            self._take(told)

    def _take(self, told):
        if told.get("method") == "Log.entryAdded" and told["params"]["entry"]["level"] == "error":
            self.complaints.append(told["params"]["entry"]["text"])
        if told.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(told["params"]["exceptionDetails"]))
        if told.get("method") == "Runtime.consoleAPICalled" and told["params"]["type"] == "error":
            self.complaints.append(json.dumps(told["params"]["args"]))

    async def evaluate(self, code):
        """Return the value of an expression, of a promise when it is one."""
        result = await self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    async def wait_for(self, code, timeout=60.0):
        """Wait until an expression is true, and return its value."""
        end = time.monotonic() + timeout
        while not (value := await self.evaluate(code)):
            assert time.monotonic() < end, f"{code} did not come true; {set(self.complaints)}"
            await asyncio.sleep(0.05)
        return value

    async def set_look(self, width, height, theme):
        """Set size and theme."""
        await self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )
        await self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])

    async def picture(self, path):
        """Write what is seen."""
        told = await self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(told["data"]))


@contextlib.contextmanager
def chromium(folder):
    """Start the browser; return a coroutine function that opens an address."""
    process = subprocess.Popen(
        [CHROMIUM, f"--user-data-dir={folder}", *_OPTIONS], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        address = folder / "DevToolsActivePort"
        end = time.monotonic() + 60.0
        while not (address.exists() and "\n" in address.read_text()):
            assert time.monotonic() < end, "chromium did not begin"
            time.sleep(0.05)
        port = address.read_text().splitlines()[0]

        async def open_page(url, width=1280, height=800, theme="light"):
            request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
            with urllib.request.urlopen(request, timeout=30.0) as answer:
                target = json.load(answer)
            page = Page(await websocket_connect(target["webSocketDebuggerUrl"], max_message_size=100_000_000))
            for domain in ("Page", "Log", "Runtime"):
                await page.call(f"{domain}.enable")
            await page.set_look(width, height, theme)
            await page.call("Page.navigate", url=url)
            return page

        yield open_page
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
