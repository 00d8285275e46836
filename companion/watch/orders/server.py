"""The page's server where it takes orders: POST /order besides, of a page of its own, whole and in time."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import urlsplit

from companion.watch.orders.desk import OrderDesk
from companion.watch.orders.page_order import BODY_MAX_BYTES
from companion.watch.server import Handler, WatchServer

PATH: Final = "/order"


class OrderServer(WatchServer):
    """As its base; its `urls` end with the key of orders, and `watch_urls` do not."""

    def __init__(self, address: tuple[str, int], *arguments: Any, desk: OrderDesk, **options: Any) -> None:
        """As the base. `desk`: takes the orders. OSError."""
        self.desk: Final = desk
        super().__init__(address, *arguments, handler=_OrderHandler, **options)

    @property
    def watch_urls(self) -> list[str]:
        """For who is to look alone."""
        return super().urls

    @property
    def urls(self) -> list[str]:
        """For who is to order: secrets, for the terminal alone."""
        return [f"{url}#{self.desk.fragment}" for url in self.watch_urls]


class _OrderHandler(Handler):
    server: OrderServer

    def do_POST(self) -> None:  # noqa: N802  http.server calls it so
        """An order, from this server's own page."""
        if not self.is_let_in():
            return
        refused = self._refusal_of_head()
        if refused:
            self.refuse(*refused)
            return
        body = self.read_body(int(self.headers["Content-Length"]), self.until_s)
        self.server.mark_asked(self.request)
        answer = self.server.desk.answer_request(body, self.client_address[0])
        if answer.notice:
            self.server.note(self.client_address[0], answer.notice)
        told = {"why": answer.why, "nonce": self.server.desk.nonce()}
        self.answer(json.dumps(told).encode(), "application/json", status=answer.status)

    def _refusal_of_head(self) -> tuple[HTTPStatus, str] | None:
        """Of a request whose body is not worth reading."""
        headers = self.headers
        length = headers.get_all("Content-Length") or []
        if urlsplit(self.path).path != PATH:
            return HTTPStatus.NOT_FOUND, "There is nothing here."
        if headers.get_all("Origin") != [f"http://{headers['Host']}"]:  # a browser tells which page asks
            return HTTPStatus.FORBIDDEN, "Orders are taken from this server's own page."
        if headers.get_all("Content-Type") != ["application/json"]:  # which a form of another page cannot send
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "An order must be application/json."
        if len(length) != 1 or "Transfer-Encoding" in headers or not (length[0].isascii() and length[0].isdecimal()):
            return HTTPStatus.LENGTH_REQUIRED, "An order must have one Content-Length."
        if len(length[0]) > 5 or int(length[0]) > BODY_MAX_BYTES:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"An order must have at most {BODY_MAX_BYTES} bytes."
        return None
