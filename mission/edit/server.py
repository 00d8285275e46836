"""HTTP for the page of `mission edit`, on loopback: who has its token may see and change the mission, and fly it."""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, unquote, urlsplit

from mission.common.network.connections import Connections, Patience
from mission.common.network.page_server import PageHandler, PageServer
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


class EditServer(PageServer):
    """Serves `api`. `url` has the token, without which nothing is answered. OSError when `port` cannot be had."""

    def __init__(
        self,
        api: Api,
        port: int = 0,
        *,
        patience: Patience = Patience(),  # noqa: B008  frozen
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.api = api
        super().__init__(
            (ADDRESS, port),
            _Handler,
            cookie=COOKIE,
            token=secrets.token_urlsafe(16),
            connections=Connections(of_address=64),
            patience=patience,
            clock=clock,
        )
        self.host = f"{ADDRESS}:{self.server_address[1]}"

    @property
    def url(self) -> str:
        """To be opened in a browser of this computer."""
        return f"http://{self.host}/?token={self.token}"


class _Handler(PageHandler):
    server: EditServer

    def do_GET(self) -> None:  # noqa: N802  http.server calls it so
        """The page, and what it looks at."""
        self.server.mark_asked(self.request)
        asked = urlsplit(self.path)
        if not self._host_is_ours():
            return self._refuse(HTTPStatus.FORBIDDEN, "This server answers to its address only.")
        given = parse_qs(asked.query).get("token", [""])[0]
        if given and asked.path == "/" and self.is_token(given):
            return self.let_in(given, POLICY)
        if not self.is_token(self.cookie()):
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

    def do_POST(self) -> None:  # noqa: N802  http.server calls it so
        """Does what the page asks for. Another page cannot send this Origin, or this type."""
        self.server.mark_asked(self.request)
        if not (self._host_is_ours() and self._is_from_here() and self.is_token(self.cookie())):
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
        return self.read_body(int(said), self.server.clock() + BODY_S)

    def _host_is_ours(self) -> bool:
        """The address itself: a page elsewhere cannot have its own name lead here."""
        hosts = self.headers.get_all("Host") or []
        return len(hosts) == 1 and hosts[0] == self.server.host

    def _is_from_here(self) -> bool:
        return self.headers.get_all("Origin") == [f"http://{self.server.host}"]

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer(f"{why}\n".encode(), "text/plain; charset=utf-8", status=status)

    def _json(self, values: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._answer(json.dumps(values, separators=(",", ":")).encode(), JSON_TYPE, status=status)

    def _answer(self, data: bytes, mime: str, *, status: HTTPStatus = HTTPStatus.OK, policy: str = POLICY) -> None:
        self.send_response(status)
        self.send_header("Content-Type", mime)
        self.send_header("Content-Length", str(len(data)))
        self.send_safety(policy)
        self.end_headers()
        self.wfile.write(data)
