"""The web server of the page: on 127.0.0.1 only, for pages of its own only, and stops only for who has the token."""

from __future__ import annotations

import hmac
import json
import secrets
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import tornado.web
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.monitor_page.foxglove_relay import FoxgloveRelay
from bmd_rths_nodes.monitor_page.recordings import Recordings

ADDRESS = "127.0.0.1"
STATIC = Path(__file__).parent / "static"
TOKEN_HEADER = "X-Bmd-Rths-Token"

#: Time between two looks at the bags [s]; the recorder of `run --monitor` writes as often.
LOOK_PERIOD = 0.05

#: Time between two looks for new bags, for Foxglove; a page asks itself [s].
BAGS_PERIOD = 0.5

#: What the page may ask of the table. A reset is not one of them: who resets a table stands beside it.
STOP, EMERGENCY_STOP = "stop", "emergency_stop"

#: Passes a request to the table on and returns what comes of it.
Ask = Callable[[str], Awaitable[str]]

#: Nothing from elsewhere, no code or style in the page itself, in no frame of anybody else.
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class MonitorServer:
    """Serve the page of some recordings.

    Parameters
    ----------
    recordings : Recordings
        What can be shown.
    port : int
        Port of `ADDRESS`; 0 for any that is free.
    ask : callable, optional
        Asks the table to stop; without, the page can only watch.
    foxglove : int, optional
        Port on which Foxglove can watch too; it cannot stop anything.

    Attributes
    ----------
    recordings : Recordings
        As given.
    said : list of str
        What was said to the operator since the start, the newest last.
    relay : FoxgloveRelay or None
        What Foxglove watches.
    token : str
        Who has it may stop the table; new at every start.
    port : int
        The port.

    Raises
    ------
    InputError
        The port is in use.
    """

    def __init__(
        self, recordings: Recordings, port: int = 0, ask: Ask | None = None, foxglove: int | None = None
    ) -> None:
        self.recordings = recordings
        self.ask = ask
        self.said: list[str] = []
        self.token = secrets.token_urlsafe(24)
        self.relay = None if foxglove is None else FoxgloveRelay(foxglove)
        try:
            self._sockets = bind_sockets(port, ADDRESS)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"--port {port}: {reason}; a free port of {ADDRESS}, or 0 for any, is required") from error
        self.port = int(self._sockets[0].getsockname()[1])
        application = tornado.web.Application(
            [
                (r"/api/recordings", _Recordings),
                (r"/api/view", _View),
                (rf"/api/({STOP}|{EMERGENCY_STOP})", _Control),
                (r"/(|(?:uplot/)?[a-zA-Z.]+)", _Static, {"path": str(STATIC), "default_filename": "index.html"}),
            ],
            default_handler_class=_Nothing,
            monitor=self,
            log_function=lambda handler: None,
        )
        self._http = HTTPServer(application, max_body_size=1024, max_buffer_size=65536)
        self._http.add_sockets(self._sockets)

    @property
    def url(self) -> str:
        """Address for a browser; the token is behind the #, which no browser sends."""
        token = f"#{self.token}" if self.ask is not None else ""
        return f"http://{ADDRESS}:{self.port}/{token}"

    @property
    def own_hosts(self) -> tuple[str, ...]:
        """What a browser on this computer calls the server."""
        return (f"{ADDRESS}:{self.port}", f"localhost:{self.port}")

    def start(self) -> None:
        """Follow the recordings, within the loop of asyncio that runs."""
        loop = IOLoop.current()

        def look() -> None:
            more = self.recordings.look()
            if self.relay is not None:
                self.relay.look()
            loop.call_later(0.0 if more else LOOK_PERIOD, look)

        def look_for_bags() -> None:
            if self.relay is not None and (newest := self.recordings.newest()) is not None:
                self.relay.follow(newest)
            loop.call_later(BAGS_PERIOD, look_for_bags)

        look_for_bags()
        look()

    def stop(self) -> None:
        """Close the port."""
        self._http.stop()
        if self.relay is not None:
            self.relay.stop()


class _Handler(tornado.web.RequestHandler):
    """Refuse what is not asked by a page of this server: another site may send a browser here."""

    @property
    def server(self) -> MonitorServer:
        """The server this request is for."""
        found: MonitorServer = self.settings["monitor"]
        return found

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        problem = self.problem()
        if problem:
            self.set_status(403)
            self.finish(problem)

    def problem(self) -> str:
        """Return why the request is refused; empty when it is not."""
        host, origin = self.request.host, self.request.headers.get("Origin")
        if host not in self.server.own_hosts:  # a foreign name that leads to this computer
            return "refused: Host"
        if origin is not None and origin != f"http://{host}":
            return "refused: Origin"
        if self.request.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return "refused: Sec-Fetch-Site"
        return ""

    def write_error(self, status_code: int, **_: Any) -> None:
        self.finish(f"{status_code}")

    def reply(self, content: Any) -> None:
        self.set_header("Content-Type", "application/json")
        self.finish(json.dumps(content, allow_nan=False))

    def whole_number(self, name: str) -> int | None:
        text = self.get_query_argument(name, "")
        if not text:
            return None
        if not text.isdecimal() or len(text) > 9:
            raise tornado.web.HTTPError(400)
        return int(text)


class _Static(_Handler, tornado.web.StaticFileHandler):
    """The files of the page; their names have no folder but one."""

    def set_extra_headers(self, path: str) -> None:
        self.set_header("Cache-Control", "no-store")


class _Nothing(_Handler):
    """What is not there."""

    def prepare(self) -> None:
        super().prepare()
        if not self._finished:
            raise tornado.web.HTTPError(404)


class _Recordings(_Handler):
    """What can be shown."""

    def get(self) -> None:
        recordings = self.server.recordings
        self.reply(
            {"bags": recordings.listed(), "campaign": recordings.campaign(), "control": self.server.ask is not None}
        )


class _View(_Handler):
    """One look at one recording."""

    def get(self) -> None:
        key = self.get_query_argument("run", "")
        view = self.server.recordings.view(key) if key else None
        at, since, span = self.whole_number("at"), self.whole_number("since") or 0, self.whole_number("span") or 10
        found: dict[str, Any] = {"banner": None}
        if view is not None:
            found = view.look(at, since, float(span), time.time())
        if view is not None and view.follower.run is not None and self.get_query_argument("overview", ""):
            found["overview"] = view.follower.run.overview()
        self.reply({**found, "said": self.server.said[-5:], "said_count": len(self.server.said)})


class _Control(_Handler):
    """Stop the table."""

    def problem(self) -> str:
        """Refuse also what does not say where it comes from, or has not the token."""
        token = self.request.headers.get(TOKEN_HEADER, "")
        if found := super().problem():
            return found
        if self.request.headers.get("Origin") is None:
            return "refused: Origin"
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return "refused: token"
        return ""

    async def post(self, what: str) -> None:
        if self.server.ask is None:
            raise tornado.web.HTTPError(404)
        self.reply({"answer": await self.server.ask(what)})
