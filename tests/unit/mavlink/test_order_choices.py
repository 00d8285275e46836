"""Which order is passed on, which counts on the ground, and which of too many is looked at."""

from __future__ import annotations

import pytest

from companion.core.model.states import Order
from companion.mavlink.orders.candidates import BAD_MAX, SLOTS, Candidates
from companion.mavlink.orders.order import OrderKind
from tests.unit.mavlink.orders_kit import BOOTS, OTHER_FLIGHT, Vehicle, order

START, HOLD, LAND, ABORT = OrderKind.START, OrderKind.HOLD, OrderKind.LAND, OrderKind.ABORT


def carried(one: Vehicle) -> set[bytes]:
    one.now_s += 60.0  # it is time for each again
    return set(one.book.payloads(one.now_s))


def test_a_start_of_another_flight_takes_the_place_of_an_abort_that_was_not_for_this_one() -> None:
    one = Vehicle()
    assert one.obeys(order(ABORT, 5, boots={})) == []
    assert one.said == ["order refused: other flight"]
    assert carried(one) == {order(ABORT, 5, boots={})}
    start = order(START, 9, flight=OTHER_FLIGHT)
    assert one.obeys(start) == [Order.START]
    assert carried(one) == {start}


def test_an_abort_that_comes_late_takes_the_place_of_a_later_hold() -> None:
    one = Vehicle()
    one.obeys(order(START, 4), order(HOLD, 9))
    assert carried(one) == {order(HOLD, 9)}
    one.airborne = True
    assert one.obeys(order(ABORT, 5)) == [Order.ABORT]
    assert carried(one) == {order(ABORT, 5)}
    one.obeys(order(START, 20, flight=OTHER_FLIGHT))  # nothing takes that of one that has landed
    assert carried(one) == {order(ABORT, 5)}


@pytest.mark.parametrize("kind", [HOLD, LAND, ABORT])
def test_on_the_ground_an_order_of_a_flight_that_is_known_counts_without_its_boot(kind: OrderKind) -> None:
    one = Vehicle()
    assert one.obeys(order(kind, 3, boots={})) == []
    assert one.obeys(order(START, 4)) == [Order.START]
    assert one.obeys(order(kind, 5, boots={})) == [Order[kind.name]]


def test_what_is_obeyed_in_the_air_and_not_written_is_said_once() -> None:
    one = Vehicle()
    one.obeys(order(START, 4, boots=BOOTS))
    one.airborne, one.disk.is_full = True, True
    assert one.obeys(order(HOLD, 5)) == [Order.HOLD]
    assert one.said == ["order obeyed, but not written to the disk"]


def test_a_newcomer_takes_the_slot_of_one_that_came_in_one_tick_and_not_of_one_that_came_in_two() -> None:
    for ticks, taken in ((1, True), (2, False)):
        waiting = Candidates(7)
        for _ in range(ticks):
            for k in range(SLOTS):
                waiting.offer(b"%d" % k, is_proven=False)
            assert waiting.take_likeliest(0) == []
        waiting.offer(b"new", is_proven=False)
        found = waiting.take_likeliest(SLOTS + 1)
        assert len(found) == SLOTS
        assert (b"new" in found) is taken
        assert waiting.dropped == 1


def test_newcomers_wear_out_one_that_came_in_two_ticks_but_none_that_is_proven() -> None:
    for is_proven, left in ((False, 0), (True, SLOTS)):
        waiting = Candidates(7)
        for _ in range(2):
            for k in range(SLOTS):
                waiting.offer(b"%d" % k, is_proven=is_proven)
            waiting.take_likeliest(0)
        for k in range(40 * SLOTS):
            waiting.offer(b"new %d" % k, is_proven=False)
        found = waiting.take_likeliest(SLOTS + 1)
        assert sum(not one.startswith(b"new") for one in found) == left


def test_so_many_that_were_forged_are_remembered_and_the_oldest_forgotten() -> None:
    waiting = Candidates(7)
    for k in range(BAD_MAX):
        waiting.add_bad(b"%d" % k)
    assert waiting.is_bad(b"0")
    waiting.add_bad(b"one more")
    assert not waiting.is_bad(b"0")
    assert waiting.is_bad(b"1")
    assert waiting.is_bad(b"one more")
