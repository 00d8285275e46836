"""HTTP for a page of ours: bounded connections, one whole request in time each, and a token that becomes a cookie."""

from __future__ import annotations

import contextlib
import hmac
import http.server
import io
import socket
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any, ClassVar

from mission.common.network.connections import (
    CHUNK_BYTES,
    SEND_BUFFER_BYTES,
    Connections,
    Notices,
    Patience,
    TooSlowError,
    read_body,
    read_head,
    send_within,
)


class PageServer(http.server.ThreadingHTTPServer):
    """A thread for each connection that is let in. OSError when `address` cannot be bound."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = 128  # with the usual 5, a burst of connections costs the next one seconds

    def __init__(
        self,
        address: tuple[str, int],
        handler: type[PageHandler],
        *,
        cookie: str,
        token: str,
        connections: Connections[socket.socket],
        patience: Patience,
        clock: Callable[[], float],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`cookie`: its name, in which `{port}` is the port: browsers keep one jar for all ports of a host. `token`:
        what it must be; empty: whoever asks is answered. `say`: takes a line about a client that is dropped.
        """
        self.token, self.patience, self.clock = token, patience, clock
        self._notices = Notices(say)
        self._connections = connections
        self._lock = threading.Lock()  # of the two above
        super().__init__(address, handler)
        self.cookie = cookie.format(port=self.server_address[1])

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

    def __init__(self, connection: socket.socket, server: PageServer) -> None:
        self._connection, self._server = connection, server

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, data: Any) -> int:
        """TooSlowError, OSError."""
        send_within(self._connection, bytes(data), self._server.clock, self._server.patience)
        return len(data)


class PageHandler(http.server.BaseHTTPRequestHandler):
    """One connection: one request, and its answer."""

    server: PageServer
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
            self.until_s = server.clock() + server.patience.head_s
            head, self._behind_head = read_head(self._read_some, server.clock, self.until_s)
            if head:
                self.rfile = io.BytesIO(head)
                self.handle_one_request()
        except TooSlowError as error:
            server.note(self.client_address[0], str(error))
        except OSError:  # it has gone
            pass

    def _read_some(self, wait_s: float) -> bytes:
        self.connection.settimeout(wait_s)
        data: bytes = self.connection.recv(CHUNK_BYTES)
        return data

    def read_body(self, length: int, until_s: float) -> bytes:
        """Of this request. TooSlowError, OSError."""
        return read_body(self._read_some, self._behind_head, length, self.server.clock, until_s)

    def is_token(self, given: str) -> bool:
        """In constant time."""
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.server.token.encode())

    def cookie(self) -> str:
        """Of this server; empty: none."""
        try:
            found = SimpleCookie(self.headers.get("Cookie", "")).get(self.server.cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value

    def let_in(self, token: str, policy: str) -> None:
        """To the page, with the token out of sight."""
        self.send_response(HTTPStatus.SEE_OTHER)
        self.send_header("Location", "/")
        self.send_header("Set-Cookie", f"{self.server.cookie}={token}; HttpOnly; SameSite=Strict; Path=/")
        self.send_header("Content-Length", "0")
        self.send_safety(policy)
        self.end_headers()

    def send_safety(self, policy: str, kept: str = "no-store") -> None:
        """Headers of every answer. `policy`: of its content; `kept`: how a browser may."""
        self.send_header("Content-Security-Policy", policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", kept)

    def log_message(self, format: str, *args: Any) -> None:
        """Not: the token would be in it."""
