"""HTTP for the page of `mission edit`, on loopback: who has its token may see and change the mission, and fly it."""

from __future__ import annotations

import contextlib
import hmac
import http.server
import io
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, ClassVar, Final
from urllib.parse import parse_qs, unquote, urlsplit

from mission.common.network.connections import (
    CHUNK_BYTES,
    SEND_BUFFER_BYTES,
    Connections,
    Patience,
    TooSlowError,
    read_body,
    read_head,
    send_within,
)
from mission.edit.api import Api, RefusalError
from mission.stems.stem_files import MAX_STEM_BYTES

ADDRESS: Final = "127.0.0.1"
BUNDLE: Final = Path(__file__).parent / "bundle"
FILES: Final = {
    "/": ("edit.html", "text/html; charset=utf-8"),
    "/edit.js": ("edit.js", "text/javascript; charset=utf-8"),
    "/edit.css": ("edit.css", "text/css; charset=utf-8"),
}
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# A replay is a page by itself: it has no origin, so that nothing in it reaches this server
REPORT_POLICY: Final = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
COOKIE: Final = "understory-edit-{port}"  # browsers keep one jar for all ports of a host
BODY_MAX_BYTES: Final = MAX_STEM_BYTES
BODY_S: Final = 10.0  # for a body to be here
JSON_TYPE: Final = "application/json"


class EditServer(http.server.ThreadingHTTPServer):
    """Serves `api`. `url` has the token, without which nothing is answered. OSError when `port` cannot be had."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 128

    def __init__(
        self,
        api: Api,
        port: int = 0,
        *,
        patience: Patience = Patience(),  # noqa: B008  frozen
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.api, self.patience, self.clock = api, patience, clock
        self.token = secrets.token_urlsafe(16)
        self._connections = Connections[socket.socket](of_address=64)
        self._lock = threading.Lock()
        super().__init__((ADDRESS, port), _Handler)
        self.host = f"{ADDRESS}:{self.server_address[1]}"
        self.cookie = COOKIE.format(port=self.server_address[1])

    @property
    def url(self) -> str:
        """To be opened in a browser of this computer."""
        return f"http://{self.host}/?token={self.token}"

    def process_request(self, request: Any, client_address: Any) -> None:
        """In a thread of its own, unless there are too many that have asked: those that only hold on make room."""
        with self._lock:
            is_let_in, goes = self._connections.admit(request, client_address[0])
        if goes is not None:
            with contextlib.suppress(OSError):
                goes.shutdown(socket.SHUT_RDWR)  # its own thread closes it
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

    def _remove(self, request: socket.socket) -> None:
        with self._lock:
            self._connections.remove(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignored: a client that goes away is no news."""


class _Writer(io.BufferedIOBase):
    """Takes what the handler answers, and waits for its client only so long."""

    def __init__(self, connection: socket.socket, server: EditServer) -> None:
        self._connection, self._server = connection, server

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, data: Any) -> int:
        """TooSlowError, OSError."""
        send_within(self._connection, bytes(data), self._server.clock, self._server.patience)
        return len(data)


class _Handler(http.server.BaseHTTPRequestHandler):
    server: EditServer
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
            until_s = server.clock() + server.patience.head_s
            head, self._behind_head = read_head(self._read_some, server.clock, until_s)
            if head:
                server.mark_asked(self.request)
                self.rfile = io.BytesIO(head)
                self.handle_one_request()
        except (TooSlowError, OSError):  # it has gone, or dawdles
            pass

    def _read_some(self, wait_s: float) -> bytes:
        self.connection.settimeout(wait_s)
        data: bytes = self.connection.recv(CHUNK_BYTES)
        return data

    def do_GET(self) -> None:
        """The page, and what it looks at."""
        asked = urlsplit(self.path)
        if not self._host_is_ours():
            return self._refuse(HTTPStatus.FORBIDDEN, "This server answers to its address only.")
        given = parse_qs(asked.query).get("token", [""])[0]
        if given and asked.path == "/" and self._is_token(given):
            return self._let_in(given)
        if not self._is_token(self._cookie()):
            return self._refuse(HTTPStatus.FORBIDDEN, "Open the address that `mission edit` prints, whole.")
        if asked.path in FILES:
            name, mime = FILES[asked.path]
            return self._answer((BUNDLE / name).read_bytes(), mime)
        if asked.path == "/flight/report.html":
            report = self.server.api.report()
            if report is None:
                return self._refuse(HTTPStatus.NOT_FOUND, "There is no replay yet.")
            return self._answer(report, "text/html; charset=utf-8", policy=REPORT_POLICY)
        answer = self.server.api.view(asked.path)
        if answer is None:
            return self._refuse(HTTPStatus.NOT_FOUND, "There is nothing here.")
        return self._answer(answer, JSON_TYPE)

    def do_POST(self) -> None:
        """Does what the page asks for. Another page cannot send this Origin, or this type."""
        if not (self._host_is_ours() and self._is_from_here() and self._is_token(self._cookie())):
            return self._refuse(HTTPStatus.FORBIDDEN, "Only this server's own page may ask for this.")
        try:
            body = self._body()
            path = urlsplit(self.path).path
            kind = self.headers.get_content_type()
            if path == "/stems" and kind == "application/octet-stream":
                return self._json(self.server.api.upload(unquote(self.headers.get("X-Name", "")), body))
            if kind != JSON_TYPE:
                raise RefusalError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"must be {JSON_TYPE}")
            return self._json(self.server.api.do(path, body))
        except RefusalError as refusal:
            return self._json(refusal.body, refusal.status)

    def _body(self) -> bytes:
        """RefusalError for one that is too long, or that does not say how long it is; TooSlowError."""
        said = self.headers.get("Content-Length", "")
        if not (said.isascii() and said.isdecimal() and len(said) < 12):
            raise RefusalError(HTTPStatus.LENGTH_REQUIRED, "must have a Content-Length")
        if int(said) > BODY_MAX_BYTES:
            raise RefusalError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"must be at most {BODY_MAX_BYTES >> 20} MiB")
        clock = self.server.clock
        return read_body(self._read_some, self._behind_head, int(said), clock, clock() + BODY_S)

    def _host_is_ours(self) -> bool:
        """The address itself: a page elsewhere cannot have its own name lead here."""
        hosts = self.headers.get_all("Host") or []
        return len(hosts) == 1 and hosts[0] == self.server.host

    def _is_from_here(self) -> bool:
        return self.headers.get_all("Origin") == [f"http://{self.server.host}"]

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
        self._send_safety(POLICY)
        self.end_headers()

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer(f"{why}\n".encode(), "text/plain; charset=utf-8", status=status)

    def _json(self, values: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._answer(json.dumps(values, separators=(",", ":")).encode(), JSON_TYPE, status=status)

    def _answer(self, data: bytes, mime: str, *, status: HTTPStatus = HTTPStatus.OK, policy: str = POLICY) -> None:
        self.send_response(status)
        self.send_header("Content-Type", mime)
        self.send_header("Content-Length", str(len(data)))
        self._send_safety(policy)
        self.end_headers()
        self.wfile.write(data)

    def _send_safety(self, policy: str) -> None:
        self.send_header("Content-Security-Policy", policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")

    def log_message(self, format: str, *args: Any) -> None:
        """Not: the token would be in it."""
