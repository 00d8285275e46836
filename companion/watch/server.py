"""HTTP for the tablet: a page, its map, and a stream of pictures. It answers GET, and takes nothing from anybody;
`companion.watch.orders.server` adds the one thing that is taken, where that is asked for.

The stream is of server-sent events (HTML Living Standard, 9.2): one way, as watching is.
"""

from __future__ import annotations

import contextlib
import hmac
import http.server
import io
import ipaddress
import json
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, ClassVar, Final
from urllib.parse import parse_qs, urlsplit

from mission.basemap.chart import ZOOM_MAX, Chart
from mission.common.network.connections import (
    SEND_BUFFER_BYTES,
    Connections,
    Notices,
    Patience,
    TooSlowError,
    read_body,
    read_head,
    send_within,
)
from mission.common.network.own_addresses import reached_at

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


class WatchServer(http.server.ThreadingHTTPServer):
    """Serves `stream` and `chart` at `address`. OSError when it cannot be bound.

    On another address than loopback it wants a token, which it makes: `urls` have it.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = 128  # with the usual 5, a burst of connections costs the next one seconds

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
        self.patience, self.clock = patience, clock
        self.token = "" if ipaddress.ip_address(address[0]).is_loopback else secrets.token_urlsafe(16)
        self.streams = threading.BoundedSemaphore(STREAMS_MAX)
        self._notices = Notices(say)
        self._connections = Connections[socket.socket]()
        self._lock = threading.Lock()  # of the two above
        super().__init__(address, handler or Handler)
        self.cookie = COOKIE.format(port=self.server_address[1])

    @property
    def urls(self) -> list[str]:
        """URLs to open on the tablet: one of them, by the network that it is in."""
        host, port = self.server_address[:2]
        token = f"?token={self.token}" if self.token else ""
        return [f"http://{address}:{port}/{token}" for address in reached_at(str(host))]

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own, unless there are too many that have asked: those that only hold on make room."""
        with self._lock:
            is_let_in, goes = self._connections.admit(request, client_address[0])
        if goes is not None:
            with contextlib.suppress(OSError):
                goes.shutdown(socket.SHUT_RDWR)  # its own thread closes it
        if goes is not None or not is_let_in:
            self.note(client_address[0], "too many connections")
        if not is_let_in:
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread is to be had
            self._remove(request)
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """As the base."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._remove(request)

    def mark_asked(self, request: socket.socket) -> None:
        """Its request is whole: it is answered."""
        with self._lock:
            self._connections.mark_asked(request)

    def note(self, address: str, what: str) -> None:
        """A client was dropped."""
        with self._lock:
            self._notices.note(address, what, self.clock())

    def _remove(self, request: socket.socket) -> None:
        with self._lock:
            self._connections.remove(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignored: a client that goes away is no news."""


class _Writer(io.BufferedIOBase):
    """Takes what the handler answers, and waits for its client only so long."""

    def __init__(self, connection: socket.socket, server: WatchServer) -> None:
        self._connection, self._server = connection, server

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, data: Any) -> int:
        """TooSlowError, OSError."""
        send_within(self._connection, bytes(data), self._server.clock, self._server.patience)
        return len(data)


class Handler(http.server.BaseHTTPRequestHandler):
    """One connection: one request, and its answer."""

    server: WatchServer
    server_version: ClassVar[str] = "understory"  # type: ignore[misc]
    sys_version: ClassVar[str] = ""  # type: ignore[misc]

    def setup(self) -> None:
        """Reads nothing yet; what waits to be taken is bounded."""
        super().setup()
        self.rfile.close()
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.wfile = _Writer(self.connection, self.server)

    def handle(self) -> None:
        """One request, whole and in time, and its answer."""
        server = self.server
        try:
            self._until_s = server.clock() + server.patience.head_s
            head, self._behind_head = read_head(self._read_some, server.clock, self._until_s)
            if head:
                self.rfile = io.BytesIO(head)
                self.handle_one_request()
        except TooSlowError as error:
            server.note(self.client_address[0], str(error))
        except OSError:  # it has gone
            pass

    def _read_some(self, wait_s: float) -> bytes:
        self.connection.settimeout(wait_s)
        data: bytes = self.connection.recv(4096)
        return data

    def read_body(self, length: int) -> bytes:
        """Of this request, by the deadline of its head. TooSlowError, OSError."""
        return read_body(self._read_some, self._behind_head, length, self.server.clock, self._until_s)

    def do_GET(self) -> None:
        """The page, and what it shows."""
        self.server.mark_asked(self.request)
        asked = urlsplit(self.path)
        given = parse_qs(asked.query).get("token", [""])[0]
        if self.server.token and asked.path == "/" and self._host_is_ours() and self._is_token(given):
            return self._let_in(given)
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
            self._send_safety("no-store")
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
        elif self.server.token and not self._is_token(self._cookie()):
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

    def refuse(self, status: HTTPStatus, why: str) -> None:
        """In a line."""
        self.answer(f"{why}\n".encode(), "text/plain; charset=utf-8", status=status)

    def answer(self, data: bytes, mime: str, *, status: HTTPStatus = HTTPStatus.OK, kept_s: int = 0) -> None:
        """All of an answer."""
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
