"""Orders as the page sends them, made by another code than the server's: `hmac` over the text that the docs give; and a
server that takes them."""

from __future__ import annotations

import hashlib
import hmac
import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus

from companion.watch.orders.desk import Answer, Asked, OrderDesk
from companion.watch.orders.order_key import OrderKey
from companion.watch.orders.server import OrderServer
from companion.watch.server import Stream
from mission.common.network.connections import Patience
from tests.unit.watch.test_watch_attacks import NEVER, Served

SIZE = 4


def mac_of(key: str, text: str) -> str:
    return hmac.new(key.encode(), text.encode(), hashlib.sha256).hexdigest()


def key_of(key: OrderKey) -> str:
    return key.fragment.removeprefix("orders=")


def body(key: str, nonce: str, kind: str = "HOLD", **changes: object) -> bytes:
    """Signed with these fields; a field of `changes` named `then_...` is changed after that."""
    later = {name.removeprefix("then_"): value for name, value in changes.items() if name.startswith("then_")}
    said: dict[str, object] = {"kind": kind, "hand_back": 0, "without": [], "nonce": nonce}
    said |= {name: value for name, value in changes.items() if not name.startswith("then_")}
    without = ",".join(map(str, said["without"]))  # type: ignore[call-overload]
    text = f"understory order 1\n{said['nonce']}\n{said['kind']}\n{said['hand_back']}\n{without}"
    return json.dumps({**said, "mac": mac_of(key, text), **later}).encode()


@dataclass
class Ordering(Served):
    """A server that takes orders, and those that it took."""

    key: OrderKey = field(default_factory=OrderKey)
    kinds: list[str] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.server.server_address[1])

    def headers(self, length: int, **changes: str | None) -> dict[str, str]:
        """As Chromium sends them; None: without it."""
        usual = {
            "Content-Length": str(length),
            "Host": f"127.0.0.1:{self.port}",
            "Origin": f"http://127.0.0.1:{self.port}",
            "Content-Type": "application/json",
            "Cookie": f"{self.server.cookie}={self.server.token}",
        }
        changed = {**usual, **{name.replace("_", "-"): value for name, value in changes.items()}}
        return {name: value for name, value in changed.items() if value is not None}

    def head(self, length: int) -> bytes:
        lines = [f"{name}: {value}" for name, value in self.headers(length).items()]
        return "\r\n".join(["POST /order HTTP/1.1", *lines, "\r\n"]).encode()

    def genuine(self, kind: str = "HOLD", **changes: object) -> bytes:
        return body(key_of(self.key), self.key.nonce(time.monotonic()), kind, **changes)

    def post(self, data: bytes, path: str = "/order", **changes: str | None) -> tuple[int, str]:
        """Status, and why; `changes`: of the headers."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20.0)
        connection.putrequest("POST", path, skip_host=True)
        for name, value in self.headers(len(data), **changes).items():
            connection.putheader(name, value)
        connection.endheaders(data)
        answer = connection.getresponse()
        told = answer.read()
        connection.close()
        return answer.status, told.decode()


@contextmanager
def ordering(
    patience: Patience = NEVER,
    address: str = "127.0.0.1",
    order: Callable[[Asked], Answer] = lambda _: Answer(HTTPStatus.OK),
) -> Iterator[Ordering]:
    """`order`: what the loop does with each."""
    key, found = OrderKey(), list[Ordering]()
    desk = OrderDesk(key, SIZE, time.monotonic)
    say = lambda line: found[0].say(line)  # noqa: E731
    server = OrderServer((address, 0), Stream(), desk=desk, patience=patience, say=say)
    one = Ordering(server, key=key)
    found.append(one)
    over = threading.Event()

    def loop() -> None:
        while not over.is_set():
            for asked in desk.take_asked():
                one.kinds.append(asked.order.kind.name)
                asked.answer.set_result(order(asked))

    threads = [
        threading.Thread(target=loop),
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}),
    ]
    for thread in threads:
        thread.start()
    try:
        yield one
    finally:
        over.set()
        server.stream.close()
        server.shutdown()
        for thread in threads:
            thread.join()
        server.server_close()
