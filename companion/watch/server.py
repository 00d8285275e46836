"""HTTP for the tablet: a page, its map, and a stream of pictures. It answers GET, and takes nothing from anybody;
`companion.watch.orders.server` adds the one thing that is taken, where that is asked for.

The stream is of server-sent events (HTML Living Standard, 9.2): one way, as watching is.
"""

from __future__ import annotations

import ipaddress
import json
import re
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from mission.basemap.chart import ZOOM_MAX, Chart
from mission.common.network.connections import Connections, Patience
from mission.common.network.own_addresses import reached_at
from mission.common.network.page_server import PageHandler, PageServer

BUNDLE: Final = Path(__file__).parent / "bundle"
FILES: Final = {
    "/": ("watch.html", "text/html; charset=utf-8"),
    "/watch.js": ("watch.js", "text/javascript; charset=utf-8"),
    "/watch.css": ("watch.css", "text/css; charset=utf-8"),
}
STREAMS_MAX: Final = 16
STREAM_WAIT_S: Final = 5.0  # for a picture; then the last one is sent again, and shows whether somebody is there
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
COOKIE: Final = "understory-watch-{port}"  # browsers keep one jar for all ports of a host
_TILE: Final = re.compile(r"/map/(\d{1,2})/(\d{1,8})/(\d{1,8})")


class Stream:
    """The last picture, for whoever looks. A slow one misses some; nobody waits for it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._count = 0
        self._picture = b""
        self.closed = False

    def show(self, picture: Mapping[str, Any]) -> None:
        """The newest."""
        data = json.dumps(picture, separators=(",", ":"), allow_nan=False).encode()
        with self._changed:
            self._picture = data
            self._count += 1
            self._changed.notify_all()

    def after(self, count: int, wait_s: float) -> tuple[int, bytes]:
        """The newest picture once there is one after the `count`-th, and which it is; the same again if none comes."""
        with self._changed:
            self._changed.wait_for(lambda: self._count > count or self.closed, wait_s)
            return self._count, self._picture

    def close(self) -> None:
        """Ends all who wait."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()


class WatchServer(PageServer):
    """Serves `stream` and `chart` at `address`. OSError when it cannot be bound.

    On another address than loopback it wants a token, which it makes: `urls` have it.
    """

    def __init__(
        self,
        address: tuple[str, int],
        stream: Stream,
        chart: Chart | None = None,
        *,
        patience: Patience = Patience(),  # noqa: B008  frozen
        clock: Callable[[], float] = time.monotonic,
        say: Callable[[str], None] = lambda _: None,
        handler: type[Handler] | None = None,
    ) -> None:
        """`say`: takes a line about a client that is dropped. `handler`: of one that answers more than GET."""
        self.stream, self.chart = stream, chart
        self.streams = threading.BoundedSemaphore(STREAMS_MAX)
        super().__init__(
            address,
            handler or Handler,
            cookie=COOKIE,
            token="" if ipaddress.ip_address(address[0]).is_loopback else secrets.token_urlsafe(16),
            connections=Connections(),
            patience=patience,
            clock=clock,
            say=say,
        )

    @property
    def urls(self) -> list[str]:
        """URLs to open on the tablet: one of them, by the network that it is in."""
        host, port = self.server_address[:2]
        token = f"?token={self.token}" if self.token else ""
        return [f"http://{address}:{port}/{token}" for address in reached_at(str(host))]


class Handler(PageHandler):
    """One connection: one request, and its answer."""

    server: WatchServer

    def do_GET(self) -> None:  # noqa: N802  http.server calls it so
        """The page, and what it shows."""
        self.server.mark_asked(self.request)
        asked = urlsplit(self.path)
        given = parse_qs(asked.query).get("token", [""])[0]
        if self.server.token and asked.path == "/" and self._host_is_ours() and self.is_token(given):
            return self.let_in(given, POLICY)
        if not self.is_let_in():
            return None
        if asked.path in FILES:
            name, mime = FILES[asked.path]
            return self.answer((BUNDLE / name).read_bytes(), mime)
        if asked.path == "/heard":
            return self._stream()
        return self._map(asked.path)

    def _map(self, path: str) -> None:
        chart = self.server.chart
        data: bytes | None = None
        if chart is not None and path == "/map/image":
            data = chart.image()
        elif chart is not None and (found := _TILE.fullmatch(path)):
            zoom, x, y = map(int, found.groups())
            if zoom <= ZOOM_MAX and x < 1 << zoom and y < 1 << zoom:
                data = chart.tile(zoom, x, y)
        if chart is None or data is None:
            return self.refuse(HTTPStatus.NOT_FOUND, "There is nothing here.")
        return self.answer(data, chart.about.mime, kept_s=3600)

    def _stream(self) -> None:
        if not self.server.streams.acquire(blocking=False):
            return self.refuse(HTTPStatus.SERVICE_UNAVAILABLE, "Too many are looking.")
        try:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_safety(POLICY, "no-store")
            self.end_headers()
            count = 0
            while not self.server.stream.closed:
                count, picture = self.server.stream.after(count, STREAM_WAIT_S)
                self.wfile.write(b"data: " + picture + b"\n\n")
                self.wfile.flush()
        except OSError:  # it has gone, or takes nothing
            pass
        finally:
            self.server.streams.release()
            self.close_connection = True

    def is_let_in(self) -> bool:
        """It knows the token, where there is one; else it is told, and all is answered."""
        if not self._host_is_ours():
            self.refuse(HTTPStatus.FORBIDDEN, "This server answers to its address only.")
        elif self.server.token and not self.is_token(self.cookie()):
            self.refuse(HTTPStatus.FORBIDDEN, "Open the address that `companion watch` prints, whole.")
        else:
            return True
        return False

    def _host_is_ours(self) -> bool:
        """An address, or localhost: a page elsewhere cannot have its own name lead here."""
        hosts = self.headers.get_all("Host") or []
        if len(hosts) != 1:
            return False
        name = hosts[0].rpartition(":")[0] if hosts[0].rpartition(":")[2].isdecimal() else hosts[0]
        if name == "localhost":
            return True
        try:
            ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return True

    def refuse(self, status: HTTPStatus, why: str) -> None:
        """In a line."""
        self.answer(f"{why}\n".encode(), "text/plain; charset=utf-8", status=status)

    def answer(self, data: bytes, mime: str, *, status: HTTPStatus = HTTPStatus.OK, kept_s: int = 0) -> None:
        """All of an answer."""
        self.send_response(status)
        self.send_header("Content-Type", mime)
        self.send_header("Content-Length", str(len(data)))
        self.send_safety(POLICY, f"private, max-age={kept_s}" if kept_s else "no-store")
        self.end_headers()
        self.wfile.write(data)
