"""POST /order: only of the server's own page, with its token, whole and in time; and only where orders are taken."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from http import HTTPStatus

import pytest

from companion.watch.orders.desk import Answer, Asked
from companion.watch.orders.page_order import BODY_MAX_BYTES
from companion.watch.orders.server import OrderServer
from mission.common.network.connections import Patience, TooSlowError, read_body
from tests.unit.watch.page_orders_kit import Ordering, body, key_of, ordering
from tests.unit.watch.test_watch_attacks import Clock, dripping


@pytest.fixture(scope="module")
def everywhere() -> Iterator[Ordering]:
    """On all addresses: with a token."""
    with ordering(address="0.0.0.0") as one:
        yield one


def test_order_of_the_own_page_is_taken(everywhere: Ordering) -> None:
    status, told = everywhere.post(everywhere.genuine("LAND"))
    assert status == HTTPStatus.OK
    assert json.loads(told) == {"why": "", "nonce": everywhere.key.nonce(time.monotonic())}
    assert everywhere.kinds[-1] == "LAND"


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"Origin": None}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
        ({"Host": "evil.example", "Origin": "http://evil.example"}, 403),
        ({"Host": "evil.example:80", "Origin": "http://evil.example:80"}, 403),
        ({"Cookie": None}, 403),
        ({"Cookie": "understory-watch=guess"}, 403),
        ({"Content_Type": None}, 415),
        ({"Content_Type": "text/plain"}, 415),  # what a form sends without being asked about
        ({"Content_Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content_Length": None}, 411),
        ({"Content_Length": "x"}, 411),
        ({"Content_Length": "-1"}, 411),
        ({"Content_Length": "²"}, 411),
        ({"Content_Length": None, "Transfer_Encoding": "chunked"}, 411),
        ({"Transfer_Encoding": "chunked"}, 411),
        ({"Content_Length": str(BODY_MAX_BYTES + 1)}, 413),
        ({"Content_Length": "9" * 5000}, 413),
    ],
)
def test_whatever_another_page_or_program_sends_is_not(
    everywhere: Ordering, changes: dict[str, str | None], status: int
) -> None:
    before, data = len(everywhere.kinds), everywhere.genuine("ABORT")
    found, why = everywhere.post(data, **changes)
    assert found == status
    assert why.endswith(".\n")
    assert len(everywhere.kinds) == before


def test_there_is_one_path_and_its_key_is_in_no_answer(everywhere: Ordering) -> None:
    for path in ("/", "/heard", "/orders", "/order/"):
        assert everywhere.post(everywhere.genuine(), path)[0] == 404
    assert everywhere.post(everywhere.genuine(), "/order?x")[0] == 200
    secret = key_of(everywhere.key)
    for data in (b"{}", everywhere.genuine(), body("another key", "0" * 24)):
        assert secret not in everywhere.post(data)[1]


def test_addresses_for_the_terminal_end_with_the_key_on_loopback_too(everywhere: Ordering) -> None:
    with ordering() as local:
        for one in (local, everywhere):
            assert isinstance(one.server, OrderServer)
            assert one.server.urls == [f"{url}#orders={key_of(one.key)}" for url in one.server.watch_urls]
            assert not any("#" in url for url in one.server.watch_urls)
        assert local.server.urls[0].startswith(f"http://127.0.0.1:{local.port}/#orders=")
        assert everywhere.server.urls[0].partition("#")[0].endswith(f"/?token={everywhere.server.token}")
        assert local.post(local.genuine())[0] == 200


def test_a_wrong_key_and_a_recorded_order_are_told_in_the_terminal() -> None:
    with ordering() as one:
        recorded = one.genuine("ABORT")
        assert [one.post(recorded)[0] for _ in range(3)] == [200, 409, 409]
        assert one.wait_for_line("ABORT") == "127.0.0.1: ABORT: the same request a second time: dropped"
        for _ in range(20):
            one.post(body("another key", "0" * 24))
        assert one.wait_for_line("wrong") == "127.0.0.1: an order with a wrong key: dropped"
        assert len(one.lines) == 2  # each once in a while
        assert one.kinds == ["ABORT"]


def test_an_order_that_drips_is_dropped_with_a_line() -> None:
    with ordering(Patience(head_s=0.3, answer_s=20.0)) as one, one.connect() as client:
        data = one.genuine()
        client.sendall(one.head(len(data)) + data[:-1])
        assert client.recv(100) == b""
        assert f"({len(data) - 1} of {len(data)} bytes of its body): dropped" in one.wait_for_line("no whole request")
        assert one.kinds == []


def test_bodies_that_wait_keep_no_genuine_order_out() -> None:
    """More connections of one address than it may have: the oldest that have not asked make room."""
    with ordering() as one:
        held: list[socket.socket] = []
        for _ in range(40):
            held.append(one.connect("127.0.0.5"))
            held[-1].sendall(one.head(4000) + b"{")
        connection = http.client.HTTPConnection("127.0.0.1", one.port, timeout=20.0, source_address=("127.0.0.5", 0))
        data = one.genuine("ABORT")
        connection.request("POST", "/order", data, one.headers(len(data)))
        assert connection.getresponse().status == 200
        connection.close()
        for client in held:
            client.close()
        assert one.kinds == ["ABORT"]


def test_an_order_that_waits_for_the_loop_is_not_dropped_for_those_that_only_hold_on() -> None:
    taken, go_on = threading.Event(), threading.Event()

    def order(_: Asked) -> Answer:
        taken.set()
        assert go_on.wait(20.0)
        return Answer(HTTPStatus.OK)

    with ordering(order=order) as one, ExitStack() as held:
        data = one.genuine("ABORT")
        client = held.enter_context(one.connect())
        client.sendall(one.head(len(data)) + data)
        assert taken.wait(20.0)
        for _ in range(40):
            held.enter_context(one.connect()).sendall(b"GET / HTTP/1.1\r\n")
        one.wait_for_line("too many connections")
        assert one.status() == 200
        go_on.set()
        assert client.recv(15) == b"HTTP/1.0 200 OK"


@pytest.mark.parametrize("every_s", [0.01, 1.0, 4.9, 100.0])
def test_a_body_that_drips_is_over_at_its_deadline(every_s: float) -> None:
    clock = Clock()
    with pytest.raises(TooSlowError, match="of 9000 bytes of its body"):
        read_body(dripping(clock, b"x" * 9000, every_s), b"xx", 9000, clock, 5.0)
    assert clock.now_s == pytest.approx(5.0, abs=0.02)


def test_a_body_is_read_to_its_length_and_not_beyond() -> None:
    clock = Clock()
    assert read_body(dripping(clock, b"", 1.0), b"body and more", 4, clock, 5.0) == b"body"
    assert read_body(dripping(clock, b"dy and more", 0.01), b"bo", 4, clock, 5.0) == b"body"
    with pytest.raises(ConnectionError, match="gone after 2 of 4"):
        read_body(lambda _: b"", b"bo", 4, clock, 5.0)
