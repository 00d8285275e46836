"""HTTP for the tablet: a page, its map, and a stream of pictures. It answers GET, and takes nothing from anybody.

The stream is of server-sent events (HTML Living Standard, 9.2): one way, as watching is.
"""

from __future__ import annotations

import hmac
import http.server
import ipaddress
import json
import re
import secrets
import threading
from collections.abc import Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, ClassVar, Final
from urllib.parse import parse_qs, urlsplit

from companion.watch.charts import ZOOM_MAX, Chart
from mission.common.own_addresses import reached_at

BUNDLE: Final = Path(__file__).parent / "bundle"
FILES: Final = {
    "/": ("watch.html", "text/html; charset=utf-8"),
    "/watch.js": ("watch.js", "text/javascript; charset=utf-8"),
    "/watch.css": ("watch.css", "text/css; charset=utf-8"),
}
STREAMS_MAX: Final = 16
CONNECTIONS_MAX: Final = 64
PATIENCE_S: Final = 10.0  # with a connection that neither asks nor takes
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


class WatchServer(http.server.ThreadingHTTPServer):
    """Serves `stream` and `chart` at `address`. OSError when it cannot be bound.

    On another address than loopback it wants a token, which it makes: `urls` have it.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], stream: Stream, chart: Chart | None = None) -> None:
        self.stream, self.chart = stream, chart
        self.token = "" if ipaddress.ip_address(address[0]).is_loopback else secrets.token_urlsafe(16)
        self.streams = threading.BoundedSemaphore(STREAMS_MAX)
        self._connections = threading.BoundedSemaphore(CONNECTIONS_MAX)
        super().__init__(address, _Handler)
        self.cookie = COOKIE.format(port=self.server_address[1])

    @property
    def urls(self) -> list[str]:
        """URLs to open on the tablet: one of them, by the network that it is in."""
        host, port = self.server_address[:2]
        token = f"?token={self.token}" if self.token else ""
        return [f"http://{address}:{port}/{token}" for address in reached_at(str(host))]

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own, unless there are too many."""
        if self._connections.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """As the base."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignored: a client that goes away is no news."""


class _Handler(http.server.BaseHTTPRequestHandler):
    server: WatchServer
    server_version: ClassVar[str] = "understory"  # type: ignore[misc]
    sys_version: ClassVar[str] = ""  # type: ignore[misc]
    timeout: ClassVar[float] = PATIENCE_S

    def do_GET(self) -> None:
        """The only thing that is answered."""
        asked = urlsplit(self.path)
        if not self._host_is_ours():
            return self._refuse(HTTPStatus.FORBIDDEN, "This server answers to its address only.")
        if self.server.token:
            given = parse_qs(asked.query).get("token", [""])[0]
            if given and asked.path == "/" and self._is_token(given):
                return self._let_in(given)
            if not self._is_token(self._cookie()):
                return self._refuse(HTTPStatus.FORBIDDEN, "Open the address that `companion watch` prints, whole.")
        if asked.path in FILES:
            name, mime = FILES[asked.path]
            return self._answer((BUNDLE / name).read_bytes(), mime)
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
            return self._refuse(HTTPStatus.NOT_FOUND, "There is nothing here.")
        return self._answer(data, chart.about.mime, kept_s=3600)

    def _stream(self) -> None:
        if not self.server.streams.acquire(blocking=False):
            return self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "Too many are looking.")
        try:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self._send_safety("no-store")
            self.end_headers()
            count = 0
            while not self.server.stream.closed:
                count, picture = self.server.stream.after(count, PATIENCE_S / 2.0)
                self.wfile.write(b"data: " + picture + b"\n\n")
                self.wfile.flush()
        except OSError:  # it has gone, or takes nothing
            pass
        finally:
            self.server.streams.release()
            self.close_connection = True

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

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.server.token.encode())

    def _cookie(self) -> str:
        try:
            found = SimpleCookie(self.headers.get("Cookie", "")).get(self.server.cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value

    def _let_in(self, token: str) -> None:
        """To the page, with the token out of sight."""
        self.send_response(HTTPStatus.SEE_OTHER)
        self.send_header("Location", "/")
        self.send_header("Set-Cookie", f"{self.server.cookie}={token}; HttpOnly; SameSite=Strict; Path=/")
        self.send_header("Content-Length", "0")
        self._send_safety("no-store")
        self.end_headers()

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer(f"{why}\n".encode(), "text/plain; charset=utf-8", status=status)

    def _answer(self, data: bytes, mime: str, *, status: HTTPStatus = HTTPStatus.OK, kept_s: int = 0) -> None:
        self.send_response(status)
        self.send_header("Content-Type", mime)
        self.send_header("Content-Length", str(len(data)))
        self._send_safety(f"private, max-age={kept_s}" if kept_s else "no-store")
        self.end_headers()
        self.wfile.write(data)

    def _send_safety(self, kept: str) -> None:
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", kept)

    def log_message(self, format: str, *args: Any) -> None:
        """Not: the token would be in it."""
