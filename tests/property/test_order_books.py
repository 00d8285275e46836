"""Books of orders under any course of events: what is obeyed was ordered, once, and an old START arms nobody."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.states import Order
from companion.mavlink.orders.order import OrderKind
from tests.unit.mavlink.orders_kit import NO_FLIGHT, VEHICLE_SEED, Vehicle, order

KINDS = st.sampled_from(list(OrderKind))


@dataclass
class Course:
    """A vehicle, all that its operator has ever ordered, and what must not be obeyed any more."""

    one: Vehicle = field(default_factory=Vehicle)
    ordered: list[tuple[OrderKind, int, bytes, int]] = field(default_factory=list)  # kind, counter, payload, boot
    counter: int = 0
    flight: bytes = NO_FLIGHT
    seen: int = 0  # the highest counter that came in this boot, or before it on a disk that kept it

    def order(self, kind: OrderKind) -> bytes:
        self.counter += 1
        if kind is OrderKind.START and not self.one.airborne:
            self.flight = self.counter.to_bytes(8, "little")
        payload = order(kind, self.counter, flight=self.flight, boots={1: self.one.boot})
        self.ordered.append((kind, self.counter, payload, self.one.boot))
        return payload

    def hear(self, payload: bytes) -> list[Order]:
        """It comes, genuine or not."""
        obeyed = self.one.obeys(payload)
        known = {made: (kind, counter, boot) for kind, counter, made, boot in self.ordered}
        for what in obeyed:
            assert payload in known, "forged"
            kind, counter, boot = known[payload]
            assert what.name == kind.name
            if kind is OrderKind.START and not self.one.airborne:
                assert boot == self.one.boot, "of another boot"
                assert counter > self.seen, "replayed"
            if kind in (OrderKind.START, OrderKind.HOLD):
                assert counter > self.seen, "replayed"
        if payload in known:
            self.seen = max(self.seen, known[payload][1])
        return obeyed


@given(st.data())
def test_whatever_comes_in_whatever_order_only_new_orders_of_the_operator_are_obeyed(data: st.DataObject) -> None:
    course = Course()
    steps = st.sampled_from(["order", "order", "hold back", "replay", "replay", "forge", "reboot", "fly", "disk"])
    for step in data.draw(st.lists(steps, max_size=25)):
        one = course.one
        match step:
            case "order":
                course.hear(course.order(data.draw(KINDS)))
            case "hold back":
                course.order(data.draw(KINDS))
            case "replay" if course.ordered:
                course.hear(data.draw(st.sampled_from(course.ordered))[2])
            case "forge":
                course.hear(order(data.draw(KINDS), course.counter + 1, flight=course.flight, seed=VEHICLE_SEED))
            case "reboot":
                one.airborne = False
                if one.disk.loses or one.disk.is_full:
                    course.seen = 0  # it may have lost all: boot nonces must do
                one.restart()
            case "fly":
                one.airborne = not one.airborne
            case "disk":
                one.disk.loses, one.disk.is_full = data.draw(st.booleans()), data.draw(st.booleans())


@given(st.data())
def test_newest_abort_is_obeyed_in_the_air_whatever_came_before(data: st.DataObject) -> None:
    course = Course()
    for kind in data.draw(st.lists(KINDS, max_size=8)):
        payload = course.order(kind)
        if data.draw(st.booleans()):
            course.hear(payload)
    course.one.airborne = True
    abort = course.order(OrderKind.ABORT)
    assert course.hear(abort) == [Order.ABORT]


@given(st.binary(max_size=300), st.booleans())
def test_no_bytes_raise(data: bytes, is_proven: bool) -> None:
    one = Vehicle()
    header = bytes([0xFD, len(data) % 256, 0, 0, 0, 1, 191]) + (52106).to_bytes(3, "little")
    for frame in (data, header + data):
        one.book.receive(frame, one.now_s, is_proven=is_proven)
    assert one.obeys() == []
