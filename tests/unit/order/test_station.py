"""The operator's station: which flight an order names, and who acts on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.core.model.states import FlightState, SwarmPhase
from companion.keys.crypto import Verifier, public_key
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import (
    NO_FLIGHT,
    ORDER_ID,
    OrderKind,
    SignedOrder,
    names_boot,
    order_holds,
    order_payload,
    read_order,
)
from companion.mavlink.peers.guard import Guard, OpenGuard
from companion.order.station import OperatorStation
from mission.common.frames import Wgs84
from sim_bridge.drive.operator import OrderCount
from tests.unit.core.core_kit import BEACON
from tests.unit.mavlink.orders_kit import BOOTS, DIGEST, OPERATOR_SEED, SIZE, TICK_S

START, HOLD, LAND, ABORT = OrderKind


class KnownBoots:
    """A guard that lets all in, of one key, and knows boots."""

    def __init__(self, known: dict[int, int]) -> None:
        self.known = known
        self._open: Guard = OpenGuard()

    def boots(self) -> dict[int, int]:
        return self.known

    def holds_mac(self, frame: bytes) -> bool:  # noqa: ARG002
        return True

    def __getattr__(self, name: str) -> Any:
        return getattr(self._open, name)


class Ground:
    """A station, and what it hears."""

    def __init__(self) -> None:
        self.guard = KnownBoots(dict(BOOTS))
        self.drawn = 0
        self.station = OperatorStation(
            OPERATOR_SEED, DIGEST, SIZE, file=OrderCount(), draw=self._draw, guard=self.guard
        )
        self.now_s = 50.0

    def _draw(self, size: int) -> bytes:
        self.drawn += 1
        return bytes([self.drawn]) * size

    def hear(self, vehicle: int, *, passes_on: bytes = b"", **said: object) -> None:
        beacon = replace(BEACON, sender=vehicle, **said)
        payload = swarm_beacon.encode(beacon, Wgs84(47.0, 8.0, 400.0))
        data = wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=vehicle, component=191)
        if passes_on:
            data += wire.frame(ORDER_ID, passes_on, seq=1, system=vehicle, component=191)
        self.station.receive(data, self.now_s)

    def order(self, kind: OrderKind, *, hand_back: int = 0) -> SignedOrder:
        self.station.send_order(kind, self.now_s, hand_back=hand_back)
        payload = order_payload(self.station.datagrams(self.now_s)[0])
        assert payload is not None
        assert order_holds(payload, Verifier(public_key(OPERATOR_SEED)))
        order = read_order(payload)
        assert order is not None
        return order


def test_start_on_the_ground_begins_a_flight_which_all_after_it_name() -> None:
    ground = Ground()
    ground.hear(1, state=FlightState.READY, airborne=False)
    before = ground.order(ABORT)
    start = ground.order(START)
    ground.hear(1, state=FlightState.TRANSIT, airborne=True)
    hold, again, abort = ground.order(HOLD), ground.order(START, hand_back=2), ground.order(ABORT)
    assert before.flight == NO_FLIGHT
    assert start.flight == hold.flight == again.flight == abort.flight != NO_FLIGHT
    assert [one.counter for one in (before, start, hold, again, abort)] == [1, 2, 3, 4, 5]
    assert (start.hand_back, again.hand_back) == (0, 2)
    ground.hear(1, state=FlightState.READY, airborne=False)
    assert ground.order(START).flight != start.flight


def test_order_names_the_boots_that_are_proven() -> None:
    ground = Ground()
    del ground.guard.known[3]
    order = ground.order(START)
    assert [names_boot(order.boots, k, SIZE, BOOTS[k]) for k in BOOTS] == [True, True, False, True]


def test_it_names_who_is_not_ready() -> None:
    ground = Ground()
    del ground.guard.known[4]
    ground.hear(1, state=FlightState.READY, airborne=False)
    ground.hear(2, state=FlightState.WAITING, airborne=False)
    ground.hear(4, state=FlightState.READY, airborne=False)
    assert ground.station.not_ready(ground.now_s) == {
        2: "waiting",
        3: "not heard",
        4: "heard, but does not prove who it is",
    }
    ground.hear(2, state=FlightState.TRANSIT, airborne=True)
    assert 2 not in ground.station.not_ready(ground.now_s)


ACTS = [
    (START, {"start": True}, True),
    (HOLD, {"state": FlightState.HOLD}, True),
    (HOLD, {"state": FlightState.READY}, True),
    (LAND, {"phase": SwarmPhase.LAND}, True),
    (LAND, {"state": FlightState.LANDED}, False),
    (ABORT, {"abort": True}, False),
]


def test_one_that_waits_does_not_act_on_a_start_whatever_it_has_obeyed() -> None:
    """It is grounded, or not ready, and goes nowhere: it is named."""
    ground = Ground()
    ground.hear(1, state=FlightState.WAITING, airborne=False)
    payload = ground.order(START).payload
    for state, left in ((FlightState.WAITING, [1]), (FlightState.TAKING_OFF, [])):
        ground.hear(1, passes_on=payload, state=state, airborne=False, start=True)
        assert ground.station.waits_for(ground.now_s) == left


@pytest.mark.parametrize(("kind", "shown", "must_pass_on"), ACTS)
def test_vehicle_acts_on_an_order_when_it_shows_it(
    kind: OrderKind, shown: dict[str, object], must_pass_on: bool
) -> None:
    """A HOLD could have another reason, and a START be an earlier one: there it must also pass on this order."""
    ground = Ground()
    quiet = {"state": FlightState.TRANSIT, "start": False, "abort": False, "phase": SwarmPhase.TRANSIT}
    ground.hear(1, **quiet)
    payload = ground.order(kind).payload
    assert ground.station.waits_for(ground.now_s) == [1]
    ground.hear(1, passes_on=payload, **quiet)
    assert ground.station.waits_for(ground.now_s) == [1]
    other = Ground()
    other.hear(1, **quiet)
    other.order(kind)
    other.hear(1, **{**quiet, **shown})
    assert (other.station.waits_for(other.now_s) == [1]) is must_pass_on
    ground.hear(1, passes_on=payload, **{**quiet, **shown})
    assert ground.station.waits_for(ground.now_s) == []


def test_a_land_is_overruled_by_an_abort_and_not_waited_for() -> None:
    ground = Ground()
    ground.hear(1, state=FlightState.TRANSIT, abort=True)
    ground.hear(2, state=FlightState.TRANSIT, abort=False)
    ground.order(LAND)
    assert (ground.station.overruled(ground.now_s), ground.station.waits_for(ground.now_s)) == ([1], [2])
    ground.order(HOLD)
    assert ground.station.overruled(ground.now_s) == []


def test_vehicle_that_is_not_heard_any_more_is_not_waited_for() -> None:
    ground = Ground()
    ground.hear(1)
    ground.order(ABORT)
    ground.now_s += 3.5
    assert ground.station.waits_for(ground.now_s) == []
    assert ground.station.vehicles(ground.now_s) == {}


def test_order_is_sent_twice_a_tick_then_with_every_period_as_long_as_it_is_asked_to() -> None:
    ground = Ground()
    ground.station.send_order(HOLD, ground.now_s)
    counts = [len(ground.station.datagrams(ground.now_s + k * TICK_S)) for k in range(200)]
    assert counts[:10] == [2] * 10
    assert counts[10:] == [0, 1] * 95


def test_what_is_no_beacon_raises_nothing() -> None:
    ground = Ground()
    for data in (b"", b"\xfd" * 300, bytes(64)):
        ground.station.receive(data, ground.now_s)
    assert ground.station.vehicles(ground.now_s) == {}
