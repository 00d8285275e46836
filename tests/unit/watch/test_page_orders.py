"""What an order of the page must prove, and what becomes of it: without sockets."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import pytest

from companion.core.model.states import FlightState
from companion.mavlink.orders.order import OrderKind
from companion.order.station import Numbered, OrderFileError
from companion.watch.orders import order_key
from companion.watch.orders.desk import WAITING_MAX, WRONG_MAX, WRONG_S, Answer, Asked, OrderDesk
from companion.watch.orders.order_key import NONCE_EVERY_S, NONCE_S, NONCES_MAX, OrderKey
from companion.watch.orders.page_order import PageOrder, read_page_order
from companion.watch.orders.radio import CHANGED, OrderClerk
from tests.unit.order.test_station import Ground
from tests.unit.watch.page_orders_kit import SIZE, body, key_of, mac_of

OLD = "0" * 24


@dataclass
class Clock:
    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


class Desk:
    """A desk, and a loop that orders whatever comes."""

    def __init__(self, *, wait_s: float = 20.0) -> None:
        self.clock, self.key = Clock(), OrderKey()
        self.desk = OrderDesk(self.key, SIZE, self.clock, wait_s=wait_s)
        self.ordered: list[Asked] = []
        self._over = threading.Event()

    def ask(self, data: bytes) -> Answer:
        return self.desk.answer_request(data, "10.0.0.1")

    def body(self, kind: str = "HOLD", **changes: object) -> bytes:
        return body(key_of(self.key), str(changes.pop("nonce", self.desk.nonce())), kind, **changes)

    @contextmanager
    def looping(self) -> Iterator[Desk]:
        def loop() -> None:
            while not self._over.is_set():
                for asked in self.desk.take_asked():
                    self.ordered.append(asked)
                    asked.answer.set_result(Answer(HTTPStatus.OK))

        thread = threading.Thread(target=loop)
        thread.start()
        try:
            yield self
        finally:
            self._over.set()
            thread.join()

    def kinds(self) -> list[str]:
        return [asked.order.kind.name for asked in self.ordered]


@pytest.fixture
def desk() -> Iterator[Desk]:
    with Desk().looping() as one:
        yield one


# --- the proof ---


def test_each_order_of_the_key_is_ordered_once(desk: Desk) -> None:
    for kind in OrderKind.__members__:
        assert desk.ask(desk.body(kind)).status == HTTPStatus.OK
    assert desk.kinds() == ["START", "HOLD", "LAND", "ABORT"]
    assert desk.ask(desk.body("START", hand_back=2, without=[1, 3])).status == HTTPStatus.OK
    last = desk.ordered[-1].order
    assert (last.kind, last.hand_back, last.without) == (OrderKind.START, 2, (1, 3))
    assert desk.ordered[-1].address == "10.0.0.1"


@pytest.mark.parametrize(
    "changes",
    [
        {"then_kind": "ABORT"},
        {"kind": "START", "then_hand_back": 1},
        {"kind": "START", "then_without": [1]},
        {"kind": "START", "without": [1, 2], "then_without": [1]},
        {"then_mac": "0" * 64},
        {"then_mac": "0" * 16},
    ],
)
def test_forged_order_is_refused_and_uses_no_nonce_up(desk: Desk, changes: dict[str, Any]) -> None:
    nonce = desk.desk.nonce()
    answer = desk.ask(desk.body(**changes))
    assert (answer.status, answer.notice) == (HTTPStatus.FORBIDDEN, "an order with a wrong key")
    assert desk.ask(body("another key", nonce)).status == HTTPStatus.FORBIDDEN
    assert desk.kinds() == []
    assert desk.ask(desk.body(nonce=nonce)).status == HTTPStatus.OK


def test_nonce_is_of_the_macs_text(desk: Desk) -> None:
    """What was recorded cannot be sent with another nonce."""
    first, _ = desk.desk.nonce(), desk.ask(desk.body())
    second = desk.desk.nonce()
    assert first != second
    assert desk.ask(desk.body(nonce=first, then_nonce=second)).status == HTTPStatus.FORBIDDEN


def test_recorded_order_is_refused_and_told(desk: Desk) -> None:
    recorded = desk.body("ABORT")
    assert desk.ask(recorded).status == HTTPStatus.OK
    again = desk.ask(recorded)
    assert (again.status, again.notice) == (HTTPStatus.CONFLICT, "ABORT: the same request a second time")
    desk.clock.now_s += 1000.0
    assert desk.ask(recorded).status == HTTPStatus.CONFLICT
    assert desk.kinds() == ["ABORT"]


def test_order_that_somebody_held_back_is_refused(desk: Desk) -> None:
    held_back = desk.body("LAND")
    desk.clock.now_s += NONCE_S - 0.01
    in_time = desk.body("HOLD")
    desk.clock.now_s += 0.02
    answer = desk.ask(held_back)
    assert (answer.status, answer.notice) == (HTTPStatus.CONFLICT, "")
    assert desk.ask(desk.body(nonce=OLD)).status == HTTPStatus.CONFLICT
    assert desk.ask(in_time).status == HTTPStatus.OK


def test_key_and_nonces_of_another_start_are_worth_nothing(desk: Desk) -> None:
    before = OrderKey()
    assert key_of(before) != key_of(desk.key)
    assert desk.ask(body(key_of(before), desk.desk.nonce())).status == HTTPStatus.FORBIDDEN
    assert desk.ask(desk.body(nonce=before.nonce(desk.clock.now_s))).status == HTTPStatus.CONFLICT


def test_check_tells_the_key_and_is_no_orders_mac() -> None:
    key = OrderKey()
    assert key.check == mac_of(key_of(key), "understory order 1 check")
    assert key_of(key) not in json.dumps(OrderDesk(key, SIZE, Clock()).picture())


def test_macs_are_compared_in_constant_time(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[tuple[str, str]] = []
    key = OrderKey()
    mac = key.mac_of("text")
    monkeypatch.setattr(order_key.hmac, "compare_digest", lambda a, b: compared.append((a, b)))
    assert not key.proves("text", mac)
    assert compared == [(mac, mac)]


def test_who_asks_for_nonces_gets_no_more_of_them_and_takes_none_away() -> None:
    key, drawn = OrderKey(), set()
    first = key.nonce(0.0)
    for k in range(100_000):
        drawn.add(key.nonce(k * (NONCE_S - 0.001) / 100_000))
    assert len(drawn) <= NONCE_S / NONCE_EVERY_S
    assert key.use_nonce(first, NONCE_S - 0.001) is order_key.Nonce.FRESH


def test_nonces_are_bounded() -> None:
    key = OrderKey()
    for k in range(1000):
        nonce = key.nonce(k * 1e-3)
        assert key.use_nonce(nonce, k * 1e-3) is order_key.Nonce.FRESH
    assert len(key._issued) <= NONCES_MAX
    key.nonce(1000.0)
    assert len(key._issued) == 1


# --- the form ---

GOOD: dict[str, Any] = {"kind": "START", "hand_back": 1, "without": [2], "nonce": OLD, "mac": "a" * 64}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"kind": "LAUNCH"}, "kind: must be one of START, HOLD, LAND, ABORT"),
        ({"kind": ["START"]}, "kind"),
        ({"hand_back": 5}, "hand_back: must be 0, or of a START a vehicle, 1 to 4"),
        ({"hand_back": -1}, "hand_back"),
        ({"hand_back": True}, "hand_back"),
        ({"hand_back": 1.0}, "hand_back"),
        ({"kind": "HOLD", "hand_back": 1, "without": []}, "hand_back"),
        ({"kind": "HOLD", "hand_back": 0}, "without"),
        ({"without": "2"}, "without: must be a list"),
        ({"without": [0]}, "without"),
        ({"without": [5]}, "without"),
        ({"nonce": "0" * 15}, "nonce: must be 16 to 64 digits"),
        ({"nonce": OLD + "\n"}, "nonce"),
        ({"nonce": 7}, "nonce"),
        ({"mac": "é" * 64}, "mac"),
        ({"more": 1}, "an order must have hand_back, kind, mac, nonce, without"),
    ],
)
def test_order_that_is_none_is_refused_with_its_field(desk: Desk, change: dict[str, Any], why: str) -> None:
    assert read_page_order(json.dumps(GOOD).encode(), SIZE).without == (2,)
    answer = desk.ask(json.dumps({**GOOD, **change}).encode())
    assert answer.status == HTTPStatus.BAD_REQUEST
    assert why in answer.why


@pytest.mark.parametrize("data", [b"", b"{", b"[]", b"null", b"\xff", b"[" * 4000, b"{}", b'"START"'])
def test_what_is_no_json_object_is_refused(desk: Desk, data: bytes) -> None:
    assert desk.ask(data).status == HTTPStatus.BAD_REQUEST


# --- many ---


def test_wrong_keys_are_limited_and_lock_nobody_out(desk: Desk) -> None:
    wrong = body("another key", desk.desk.nonce())
    statuses = [desk.ask(wrong).status for _ in range(WRONG_MAX + 100)]
    assert statuses == [HTTPStatus.FORBIDDEN] * WRONG_MAX + [HTTPStatus.TOO_MANY_REQUESTS] * 100
    assert desk.ask(desk.body("ABORT")).status == HTTPStatus.OK
    desk.clock.now_s += WRONG_S
    assert desk.ask(body("another key", desk.desk.nonce())).status == HTTPStatus.FORBIDDEN
    assert desk.kinds() == ["ABORT"]


def test_order_that_the_loop_does_not_take_in_time_is_not_ordered_later() -> None:
    desk = Desk(wait_s=0.0)
    answer = desk.ask(desk.body())
    assert answer.status == HTTPStatus.SERVICE_UNAVAILABLE
    assert list(desk.desk.take_asked()) == []


def test_orders_that_wait_are_bounded() -> None:
    desk = Desk(wait_s=0.0)
    statuses = {desk.ask(desk.body()).status for _ in range(WAITING_MAX + 5)}
    assert statuses == {HTTPStatus.SERVICE_UNAVAILABLE}
    assert desk.desk._asked.qsize() == WAITING_MAX


# --- the station ---


class Clerk:
    """A clerk with a station on the ground, and what it says to the terminal."""

    def __init__(self) -> None:
        self.ground, self.lines = Ground(), list[str]()
        self.clerk = OrderClerk(self.ground.station, SIZE, self.lines.append)

    def order(self, kind: OrderKind, *, hand_back: int = 0, without: tuple[int, ...] = ()) -> Answer:
        asked = PageOrder(kind, hand_back, without, OLD, "a" * 64)
        return self.clerk.order(asked, "10.0.0.1", self.ground.now_s)

    def picture(self) -> dict[str, Any]:
        return self.clerk.picture(self.ground.now_s)

    def is_sending(self) -> bool:
        return bool(self.ground.station.datagrams(self.ground.now_s))


def test_start_goes_only_without_those_that_the_page_had_named() -> None:
    one = Clerk()
    for k in (1, 2, 4):
        one.ground.hear(k, state=FlightState.READY, airborne=False)
    assert one.picture()["ready"] == [1, 2, 4]
    assert one.picture()["missing"] == {3: "not heard"}
    for without in ((), (2, 3), (1,)):
        assert one.order(OrderKind.START, without=without) == Answer(HTTPStatus.PRECONDITION_FAILED, CHANGED)
    assert not one.is_sending()
    assert one.order(OrderKind.START, without=(3,)).status == HTTPStatus.OK
    assert one.is_sending()
    assert one.lines == ["START, without 3: ordered on the page, from 10.0.0.1"]


def test_start_of_nobody_is_refused() -> None:
    one = Clerk()
    answer = one.order(OrderKind.START, without=(1, 2, 3, 4))
    assert (answer.status, answer.why) == (
        HTTPStatus.PRECONDITION_FAILED,
        "no vehicle is heard: nothing was ordered",
    )
    assert one.order(OrderKind.ABORT).status == HTTPStatus.OK  # always


def test_page_is_told_who_acts_on_it_and_who_does_not() -> None:
    one = Clerk()
    for k in (1, 2):
        one.ground.hear(k, state=FlightState.TRANSIT, airborne=True)
    assert one.picture()["sent"] is None
    assert one.order(OrderKind.ABORT).status == HTTPStatus.OK
    one.ground.hear(1, state=FlightState.LANDING, airborne=True, abort=True)
    one.ground.now_s += 1.5
    assert one.picture()["sent"] == {
        "kind": "ABORT",
        "hand_back": 0,
        "number": 1,
        "age_s": 1.5,
        "acting": [1],
        "aborted": [],
        "waits_for": [2],
        "not_heard": [3, 4],
    }
    json.dumps(one.picture(), allow_nan=False)


def test_land_behind_an_abort_is_not_told_as_acted_on() -> None:
    """Whoever gave the abort: the page, or another program of the operator."""
    one = Clerk()
    one.ground.hear(1, state=FlightState.TRANSIT, airborne=True)
    assert one.order(OrderKind.LAND).status == HTTPStatus.OK
    one.ground.hear(1, state=FlightState.LANDING, airborne=True, abort=True)
    one.ground.hear(2, state=FlightState.LANDING, airborne=True)
    sent = one.picture()["sent"]
    assert (sent["kind"], sent["acting"], sent["aborted"], sent["waits_for"]) == ("LAND", [2], [1], [])


def test_vehicle_that_is_handed_back_is_told() -> None:
    one = Clerk()
    for k in (1, 2, 3, 4):
        one.ground.hear(k, state=FlightState.TRANSIT, airborne=True)
    assert one.order(OrderKind.START, hand_back=2).status == HTTPStatus.OK
    assert one.lines == ["START, and vehicle 2 handed back: ordered on the page, from 10.0.0.1"]
    assert one.picture()["sent"]["hand_back"] == 2


@pytest.mark.parametrize(
    ("error", "words"),
    [(OSError(28, "No space left on device"), "No space left"), (OrderFileError("k: is none"), "k:")],
)
def test_order_whose_count_cannot_be_written_is_not_sent_and_said(
    error: Exception, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_digest: bytes, _choose: Callable[[bytes], bytes], *, only_stops: bool) -> Numbered:  # noqa: ARG001
        raise error

    one = Clerk()
    for k in (1, 2, 3, 4):
        one.ground.hear(k, state=FlightState.READY, airborne=False)
    monkeypatch.setattr(one.ground.station._file, "next_order", fail)
    answer = one.order(OrderKind.START)
    assert answer.status == HTTPStatus.INTERNAL_SERVER_ERROR
    assert words in answer.why
    assert "nothing was ordered" in answer.why
    assert not one.is_sending()
    assert one.picture()["sent"] is None
