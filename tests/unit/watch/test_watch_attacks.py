"""Clients that drip, hold on, ask for too much or take nothing: they are dropped with a line, and keep nobody out."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import cycle

import pytest

from companion.watch.server import STREAMS_MAX, Stream, WatchServer
from mission.common.network.connections import (
    AGAIN_S,
    CONNECTIONS_MAX,
    HEAD_MAX_BYTES,
    LINES_MAX,
    OF_ADDRESS_MAX,
    Connections,
    Notices,
    Patience,
    TooSlowError,
    read_head,
    send_within,
)

GET = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
NEVER = Patience(head_s=3600.0, answer_s=3600.0)


@dataclass
class Clock:
    """Time goes on by what each read takes."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Served:
    """A server, and what it said."""

    server: WatchServer
    lines: list[str] = field(default_factory=list)
    said: threading.Condition = field(default_factory=threading.Condition)

    def say(self, line: str) -> None:
        with self.said:
            self.lines.append(line)
            self.said.notify_all()

    def wait_for_line(self, word: str) -> str:
        with self.said:
            assert self.said.wait_for(lambda: any(word in line for line in self.lines), 20.0), self.lines
            return next(line for line in self.lines if word in line)

    def connect(self, source: str = "127.0.0.1") -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.server.server_address[1]), 20.0, (source, 0))

    def status(self, path: str = "/", source: str = "127.0.0.1") -> int:
        connection = http.client.HTTPConnection(
            "127.0.0.1", self.server.server_address[1], timeout=20.0, source_address=(source, 0)
        )
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer.status


@contextmanager
def served(patience: Patience = NEVER) -> Iterator[Served]:
    found: list[Served] = []
    server = WatchServer(("127.0.0.1", 0), Stream(), patience=patience, say=lambda line: found[0].say(line))
    found.append(Served(server))
    server.stream.show({"vehicles": []})
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield found[0]
    finally:
        server.stream.close()
        server.shutdown()
        thread.join()
        server.server_close()


# --- by a clock of the test's own ---


def dripping(clock: Clock, data: bytes, every_s: float) -> Callable[[float], bytes]:
    rest = iter(data)

    def read(wait_s: float) -> bytes:
        clock.now_s += min(wait_s, every_s)
        if every_s > wait_s:
            raise TimeoutError
        return bytes([next(rest)])

    return read


@pytest.mark.parametrize("every_s", [0.01, 1.0, 4.9, 100.0])
def test_a_request_that_drips_is_over_at_its_deadline_however_often_a_byte_comes(every_s: float) -> None:
    clock = Clock()
    with pytest.raises(TooSlowError, match="no whole request in time"):
        read_head(dripping(clock, GET + b"X" * 9000, every_s), clock, 5.0)
    assert clock.now_s == pytest.approx(5.0, abs=0.02)


def test_a_head_is_read_whole_and_not_beyond_its_bound() -> None:
    clock = Clock()
    assert read_head(dripping(clock, GET + b"\r\nbody", 0.001), clock, 5.0) == (GET + b"\r\n", b"")
    assert read_head(dripping(clock, b"GET /\n\nmore", 0.001), clock, 5.0) == (b"GET /\n\n", b"")
    for head in (GET + b"\r\n", b"GET /\n\n"):
        at_once = iter([head + b"\r\nbody"])
        assert read_head(lambda _, at_once=at_once: next(at_once), clock, 5.0) == (head, b"\r\nbody")  # type: ignore[misc]
    asked = iter([b"A" * 4096] * 4)
    with pytest.raises(TooSlowError, match=f"more than {HEAD_MAX_BYTES} bytes"):
        read_head(lambda _: next(asked), clock, 5.0)
    assert len(list(asked)) == 1  # not more was read than shows it


def test_an_answer_that_is_taken_byte_by_byte_is_over_at_its_deadline() -> None:
    clock, patience = Clock(), Patience(answer_s=10.0, rate_bytes_s=100.0)

    class Slow:
        def settimeout(self, _wait_s: float) -> None:
            pass

        def send(self, _data: memoryview) -> int:
            clock.now_s += 1.0
            return 1

    with pytest.raises(TooSlowError, match="taken too slowly"):
        send_within(Slow(), bytes(1000), clock, patience)  # type: ignore[arg-type]
    assert clock.now_s == pytest.approx(20.0)


def test_who_only_holds_on_makes_room_and_who_is_answered_does_not() -> None:
    table = Connections[int](most=4, of_address=2)
    assert [table.admit(k, f"10.0.0.{k}") for k in range(4)] == [(True, None)] * 4
    table.mark_asked(0)
    assert table.admit(4, "10.0.0.4") == (True, 1)
    for k in (2, 3, 4):
        table.mark_asked(k)
    assert table.admit(5, "10.0.0.5") == (False, None)
    table.remove(2)
    assert table.admit(5, "10.0.0.5") == (True, None)
    assert len(table) == 4


def test_one_address_has_so_many_and_drops_its_own_oldest() -> None:
    table = Connections[int](most=100, of_address=3)
    for k in range(3):
        table.admit(k, "10.0.0.1")
    assert table.admit(3, "10.0.0.1") == (True, 0)
    assert table.admit(4, "10.0.0.2") == (True, None)
    for k in (1, 2, 3):
        table.mark_asked(k)
    assert table.admit(5, "10.0.0.1") == (False, None)
    assert len(table) == 4


def test_the_address_that_holds_most_makes_room_for_another() -> None:
    table = Connections[int](most=4, of_address=3)
    table.admit(0, "10.0.0.1")
    for k in (1, 2, 3):
        table.admit(k, "10.0.0.2")
    assert table.admit(4, "10.0.0.3") == (True, 1)


def test_a_line_is_said_once_in_a_while_and_few_are_remembered() -> None:
    lines: list[str] = []
    notices = Notices(lines.append)
    for k in range(100):
        notices.note("10.0.0.1", f"answer: taken too slowly ({k} bytes left)", k / 100.0)
    assert lines == ["10.0.0.1: answer: taken too slowly (0 bytes left): dropped"]
    notices.note("10.0.0.1", "answer: taken too slowly (1 bytes left)", AGAIN_S)
    assert len(lines) == 2
    for k in range(500):
        notices.note(f"10.0.{k >> 8}.{k & 255}", "too many connections", 20.0)
    assert len(notices._said_s) == LINES_MAX


# --- over sockets ---


def test_connections_that_hold_on_from_many_addresses_keep_nobody_out() -> None:
    with served() as one, ExitStack() as held:
        sources = [f"127.0.1.{k}" for k in range(1, 3 + CONNECTIONS_MAX // OF_ADDRESS_MAX)]
        for _, source in zip(range(2 * CONNECTIONS_MAX), cycle(sources), strict=False):
            held.enter_context(one.connect(source)).sendall(GET)
        assert one.status(source="127.0.0.2") == 200
        assert one.status("/watch.js", source=sources[0]) == 200
        one.wait_for_line("too many connections: dropped")


def test_streams_of_one_address_leave_room_for_another() -> None:
    with served() as one, ExitStack() as held:
        for _ in range(OF_ADDRESS_MAX + 4):
            stream = held.enter_context(one.connect("127.0.1.1"))
            stream.sendall(GET.replace(b"GET /", b"GET /heard") + b"\r\n")
        assert STREAMS_MAX <= OF_ADDRESS_MAX
        assert one.status(source="127.0.0.2") == 200


def test_a_request_that_drips_is_dropped_with_a_line() -> None:
    with served(Patience(head_s=0.2, answer_s=20.0)) as one, one.connect() as client:
        client.sendall(GET)
        assert client.recv(100) == b""
        assert one.wait_for_line("no whole request") == (
            f"127.0.0.1: no whole request in time ({len(GET)} bytes): dropped"
        )


def test_endless_headers_are_dropped_with_a_line() -> None:
    with served() as one, one.connect() as client:
        with pytest.raises(OSError, match=r"reset|Broken"):
            client.sendall((b"X-Header: " + b"a" * 1000 + b"\r\n") * 20_000)
        one.wait_for_line(f"more than {HEAD_MAX_BYTES} bytes of headers: dropped")


def test_a_stream_that_nobody_reads_is_dropped_with_a_line_and_makes_room() -> None:
    with served(Patience(head_s=20.0, answer_s=0.2, rate_bytes_s=1e9)) as one, one.connect() as client:
        one.server.streams = threading.BoundedSemaphore(1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.server.stream.show({"much": "x" * (8 << 20)})  # more than the kernel keeps for it
        client.sendall(GET.replace(b"GET /", b"GET /heard") + b"\r\n")
        one.wait_for_line("taken too slowly")
        assert one.server.streams.acquire(timeout=20.0)


@pytest.mark.parametrize(
    "request_", [b"\r\n\r\n", b"\0" * 100 + b"\n\n", b"GET\n\n", b"GET / HTTP/9.9\r\n\r\n", b"\n\n"]
)
def test_a_malformed_request_ends_its_connection_and_nothing_else(request_: bytes) -> None:
    with served() as one, one.connect() as client:
        client.sendall(request_)
        while client.recv(4096):
            pass
        assert one.status() == 200
