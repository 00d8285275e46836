"""The book of orders: only what the operator's key has signed, once, for this mission, flight and boot, is obeyed."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable

import pytest

from companion.core.model.states import Order
from companion.mavlink.orders.book import SETTLED_S
from companion.mavlink.orders.order import NO_FLIGHT, OrderKind
from tests.unit.mavlink.orders_kit import (
    BOOTS,
    OTHER_FLIGHT,
    TICK_S,
    VEHICLE_SEED,
    Vehicle,
    frame,
    order,
)

START, HOLD, LAND, ABORT = OrderKind
KINDS = list(OrderKind)


def flying(**book: object) -> Vehicle:
    """In the air, by START 10 of a flight."""
    one = Vehicle(**book)
    assert one.obeys(order(START, 10)) == [Order.START]
    one.airborne = True
    return one


# --- what is genuine, new, and about this flight ---


@pytest.mark.parametrize("kind", KINDS)
def test_genuine_order_is_obeyed_once(kind: OrderKind) -> None:
    one = flying()
    assert one.obeys(order(kind, 11)) == [Order[kind.name]]
    one.now_s += 20.0
    assert one.obeys(*[order(kind, 11)] * 5) == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("airborne", [True, False])
def test_forged_by_a_captured_vehicle_is_not(kind: OrderKind, airborne: bool) -> None:
    """It has its own key, and all that all vehicles share; the operator's it has not."""
    one = flying()
    one.airborne = airborne
    assert one.obeys(order(kind, 11, seed=VEHICLE_SEED)) == []
    assert one.book.refused["forged"] == 1
    assert one.said == ["order refused: not of the operator's key"]
    assert one.obeys(order(kind, 11)) == [Order[kind.name]]


def test_order_of_which_any_byte_was_changed_is_not() -> None:
    one = flying()
    payload = order(ABORT, 11)
    changed = [payload[:at] + bytes([payload[at] ^ 1 << at % 8]) + payload[at + 1 :] for at in range(len(payload))]
    assert one.hear(*changed, ticks=50) == []
    assert one.obeys(payload) == [Order.ABORT]


@pytest.mark.parametrize("kind", KINDS)
def test_of_another_mission_is_not(kind: OrderKind) -> None:
    one = flying()
    assert one.obeys(order(kind, 11, digest=bytes(32))) == []
    assert one.said == ["order refused: other mission file"]
    assert one.obeys(order(kind, 11)) == [Order[kind.name]]


@pytest.mark.parametrize("loses", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_recorded_in_an_earlier_flight_is_not(kind: OrderKind, loses: bool) -> None:
    one = Vehicle()
    one.disk.loses = loses
    recorded = [order(START, 10), order(HOLD, 11), order(START, 12), order(kind, 13)]
    one.hear(*recorded)
    one.restart()
    assert one.obeys(*recorded) == []
    assert one.obeys(order(START, 20, flight=OTHER_FLIGHT, boots={1: one.boot})) == [Order.START]
    one.airborne = True
    assert one.obeys(*recorded) == []


@pytest.mark.parametrize("kind", [HOLD, LAND, ABORT])
def test_newer_than_its_start_counts_in_the_air_whatever_flight_it_names(kind: OrderKind) -> None:
    """The operator has begun another with those on the ground: these must hear it, too."""
    one = flying()
    assert one.obeys(order(kind, 11, flight=OTHER_FLIGHT, boots={})) == [Order[kind.name]]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_refused_makes_all_older_orders_dead(kind: OrderKind) -> None:
    """Held back from this vehicle, and let through once the flight is over: a recorded START launches nobody."""
    one = Vehicle()
    assert one.obeys(order(kind, 11, boots={})) == []
    assert one.obeys(order(START, 10)) == []
    assert one.obeys(order(START, 12)) == [Order.START]


@pytest.mark.parametrize("kind", [START, HOLD])
def test_replayed_within_its_flight_is_not(kind: OrderKind) -> None:
    one = flying()
    assert one.obeys(order(kind, 11)) == [Order[kind.name]]
    assert one.obeys(order(START, 12)) == [Order.START]
    one.now_s += SETTLED_S + 1.0
    assert one.obeys(order(kind, 11)) == []
    assert one.said == ["order refused: replayed"]


@pytest.mark.parametrize("landing", [LAND, ABORT])
@pytest.mark.parametrize("kind", KINDS)
def test_an_order_that_is_sent_on_behind_a_landing_is_no_replay(kind: OrderKind, landing: OrderKind) -> None:
    """It is not passed on instead of what lands, and its operator repeats it for 15 s."""
    one = flying()
    one.hear(order(landing, 11))
    one.now_s += SETTLED_S + 1.0
    one.hear(order(kind, 12))
    one.said.clear()
    for _ in range(300):
        assert one.obeys(order(kind, 12)) == []
    assert (one.said, one.book.refused["replayed"]) == ([], 0)
    one.hear(order(START, 10))  # an older one is one
    assert one.said == ["order refused: replayed"]


def test_land_and_abort_that_come_after_a_later_order_are_obeyed() -> None:
    """Latched: acting twice changes nothing, and not acting once does."""
    one = flying()
    assert one.obeys(order(HOLD, 14)) == [Order.HOLD]
    assert one.obeys(order(LAND, 12)) == [Order.LAND]
    assert one.obeys(order(ABORT, 11)) == [Order.ABORT]
    assert one.obeys(order(LAND, 13), order(ABORT, 11)) == []


@pytest.mark.parametrize(("first", "then"), [(ABORT, LAND), (ABORT, HOLD), (LAND, HOLD)])
def test_an_order_below_what_stays_in_force_is_not_told_as_obeyed(first: OrderKind, then: OrderKind) -> None:
    one = flying()
    one.hear(order(first, 11))
    one.said.clear()
    one.hear(order(then, 12))
    assert one.said == [f"{then.name} changes nothing: {first.name} stays in force"]


def test_two_that_come_at_once_are_obeyed_in_the_operators_order() -> None:
    one = flying()
    assert one.obeys(order(START, 13), order(HOLD, 11)) == [Order.HOLD, Order.START]


def test_no_start_takes_back_what_lands() -> None:
    one = flying()
    one.hear(order(LAND, 11))
    assert one.obeys(order(START, 12)) == []
    assert one.said == ["START refused: this flight was landed"]
    assert set(one.book.payloads(one.now_s)) == {order(LAND, 11)}
    assert one.obeys(order(ABORT, 13)) == [Order.ABORT]


def test_hold_land_and_abort_count_before_any_start_for_the_boots_that_they_name() -> None:
    for kind in (HOLD, LAND, ABORT):
        one = Vehicle()
        assert one.obeys(order(kind, 1, flight=NO_FLIGHT, boots={})) == []
        assert one.obeys(order(kind, 2, flight=NO_FLIGHT)) == [Order[kind.name]]


def test_start_hands_back_the_vehicle_that_it_names() -> None:
    one, other = flying(), flying(me=2)
    payload = order(START, 11, hand_back=2)
    assert [event.hands_back for event in one.hear(payload) + other.hear(payload)] == [False, True]


# --- replayed after a reboot, and after a power cut ---


@pytest.mark.parametrize("loses", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_of_a_flight_counts_on_the_ground_after_a_reboot(kind: OrderKind, loses: bool) -> None:
    """Also where the write of its counter was lost."""
    one = Vehicle()
    one.disk.loses = loses
    start, last = order(START, 10), order(kind, 11)
    assert one.obeys(start, last)[0] is Order.START
    one.restart()
    one.said.clear()
    assert one.obeys(start) == []
    assert one.obeys(last) == []
    assert one.obeys(order(kind, 12, boots={1: one.boot})) == [Order[kind.name]]


def test_without_boot_nonces_a_lost_write_would_let_a_recorded_start_launch() -> None:
    """What the defence is for: the same boot, and no disk."""
    one = Vehicle()
    one.disk.loses = True
    one.hear(order(START, 10))
    one.open_book()
    assert one.obeys(order(START, 10)) == [Order.START]


def test_counter_is_written_before_a_start_is_obeyed() -> None:
    """Power is cut at the write: either it was written, or nothing was obeyed."""

    class CutError(Exception):
        pass

    one = Vehicle()

    def cut(_state: bytes, *, wait: bool) -> bool:
        assert wait
        raise CutError

    one.book._marks.save = cut  # type: ignore[method-assign]
    with pytest.raises(CutError):
        one.hear(order(START, 10))
    assert one.book.take_says() == []


def test_full_disk_refuses_a_start_and_says_so_but_holds_and_lands_all_the_same() -> None:
    one = Vehicle()
    one.disk.is_full = True
    assert one.obeys(order(START, 10)) == []
    assert one.said == ["START refused: cannot write to the disk"]
    one.disk.is_full = False
    assert one.obeys(order(START, 11)) == [Order.START]
    one.airborne, one.disk.is_full = True, True
    assert one.obeys(order(HOLD, 12)) == [Order.HOLD]
    assert one.obeys(order(START, 13)) == [Order.START]
    assert one.obeys(order(LAND, 14)) == [Order.LAND]
    assert one.obeys(order(ABORT, 15)) == [Order.ABORT]


def test_in_the_air_no_order_waits_for_the_disk() -> None:
    one = flying()
    one.hear(order(HOLD, 11), order(ABORT, 12))
    assert one.disk.waited == [True, False, False]


@pytest.mark.parametrize("kind", KINDS)
def test_started_again_in_the_air_it_goes_by_what_it_obeyed(kind: OrderKind) -> None:
    one = flying()
    one.hear(order(kind, 11))
    one.airborne = None
    one.restart()
    assert one.obeys() == []
    one.airborne = True
    assert one.obeys() == [Order[kind.name]]
    assert one.hear(order(kind, 11), order(START, 10), ticks=5) == []


@pytest.mark.parametrize("kind", KINDS)
def test_started_again_in_the_air_without_its_file_it_learns_from_the_others(kind: OrderKind) -> None:
    one = flying()
    one.hear(order(kind, 11))
    one.disk.kept = b""
    one.restart()
    assert one.obeys(order(kind, 11)) == [Order[kind.name]]


@pytest.mark.parametrize("damage", [lambda kept: kept[:-1], lambda kept: kept[1:], lambda kept: bytes(len(kept))])
def test_file_that_cannot_be_read_is_as_none_and_is_said(damage: Callable[[bytes], bytes]) -> None:
    one = Vehicle()
    one.hear(order(START, 10))
    one.disk.kept = damage(one.disk.kept)
    one.restart()
    assert one.obeys(order(START, 10)) == []
    assert "orders seen before: file cannot be read" in one.said


def test_file_of_another_mission_keeps_the_counter_alone() -> None:
    one = Vehicle()
    one.hear(order(START, 10))
    one._more = {"digest": b"other mission file, 32 bytes...."}
    one.open_book()
    assert one.book.payloads(one.now_s) == []
    assert one.obeys(order(START, 10, digest=one._more["digest"])) == []
    assert one.obeys(order(START, 11, digest=one._more["digest"])) == [Order.START]


# --- passed on ---


def test_passed_on_as_it_came_twice_a_tick_then_once_a_period_then_once_a_second() -> None:
    one = flying()
    payload = order(HOLD, 11)
    one.hear(payload)
    begun_s, sent = one.now_s, Counter[float]()
    for tick in range(100):
        out = one.book.payloads(begun_s + tick * TICK_S)
        assert set(out) <= {payload}
        sent[round(tick * TICK_S, 2)] = len(out)
    assert [sent[round(k * TICK_S, 2)] for k in range(10)] == [2] * 10
    assert [sent[round(0.5 + k * TICK_S, 2)] for k in range(30)] == [0, 1] * 15
    assert [at for at, count in sent.items() if at >= 2.0 and count] == [2.95, 3.95, 4.95]


def test_a_vehicle_that_a_start_does_not_name_passes_it_on() -> None:
    one = Vehicle()
    payload = order(START, 10, boots={2: BOOTS[2]})
    assert one.obeys(payload) == []
    assert set(one.book.payloads(one.now_s)) == {payload}


def test_abort_is_passed_on_though_later_orders_come() -> None:
    one = flying()
    abort = order(ABORT, 11)
    one.hear(abort, order(HOLD, 12), order(LAND, 13), order(START, 14))
    assert set(one.book.payloads(one.now_s)) == {abort}


# --- floods ---


def flood(rng: random.Random, count: int, *, repeats: int) -> list[bytes]:
    """Forged orders, each so often, that only their signature tells from a genuine one."""
    template = order(ABORT, 11, seed=VEHICLE_SEED)
    forged = [(1 << 40 | rng.getrandbits(39)).to_bytes(8, "little") + template[8:] for _ in range(count // repeats)]
    return [payload for payload in forged for _ in range(repeats)]


@pytest.mark.parametrize("repeats", [1, 2, 10])
def test_ten_thousand_forged_a_second_keep_no_genuine_order_out(repeats: int) -> None:
    rng = random.Random(repeats)
    one, genuine = flying(), order(ABORT, 11)
    for _ in range(40):  # 2 s
        datagrams = flood(rng, 500, repeats=repeats)
        datagrams.insert(rng.randrange(500), genuine)
        if Order.ABORT in one.obeys(*datagrams):
            return
    pytest.fail("not obeyed")


def test_same_forged_orders_again_and_again_keep_no_genuine_order_out() -> None:
    rng = random.Random(3)
    one, genuine = flying(), order(ABORT, 11)
    forged = flood(rng, 500, repeats=1)
    for _ in range(80):
        if Order.ABORT in one.obeys(*forged, genuine):
            return
    pytest.fail("not obeyed")


def test_one_frame_with_the_swarms_mac_gets_past_any_flood_without() -> None:
    rng = random.Random(4)
    one, genuine = flying(), order(ABORT, 11)
    one.hear(*flood(rng, 2000, repeats=1))
    one.book.receive(frame(genuine), one.now_s, is_proven=True)
    assert one.obeys(*flood(rng, 2000, repeats=1)) == [Order.ABORT]


def test_what_is_checked_in_a_tick_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    one, rng = flying(), random.Random(5)
    checks = []
    monkeypatch.setattr("companion.mavlink.orders.book.order_holds", lambda *_: checks.append(1))
    for _ in range(10):
        before = len(checks)
        one.hear(*flood(rng, 1000, repeats=1))
        assert len(checks) - before <= 8


def test_what_is_refused_is_said_at_a_bounded_rate() -> None:
    one, rng = flying(), random.Random(6)
    for _ in range(400):  # 20 s
        one.hear(*flood(rng, 5, repeats=1))
    assert one.said == ["order refused: not of the operator's key"] * 2
    assert one.book.counters()["orders refused, forged"] == 2000


def test_same_forged_order_again_costs_no_second_check(monkeypatch: pytest.MonkeyPatch) -> None:
    one, forged, checks = flying(), order(ABORT, 11, seed=VEHICLE_SEED), []
    monkeypatch.setattr("companion.mavlink.orders.book.order_holds", lambda *_: checks.append(1))
    for _ in range(20):
        one.hear(forged)
    assert len(checks) == 1
