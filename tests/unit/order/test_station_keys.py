"""The operator's station on a radio with keys: whose copy of an order counts, and whose beacon."""

from __future__ import annotations

import pytest

from companion.core.model.states import FlightState, SwarmPhase
from companion.keys.keyring import OPERATOR
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import ORDER_ID, OrderKind, order_payload
from companion.mavlink.peers.frame_mac import UNITS_PER_S, seal
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.session import OPERATOR_ID, open_session
from companion.order.station import OperatorStation
from sim_bridge.drive.operator import OrderCount
from tests.unit.mavlink.signing_kit import MISSION, PERIOD_S, Node, beacon_frame, keyring

START, HOLD, LAND, _ = OrderKind
FLIES = {"state": FlightState.TRANSIT, "phase": SwarmPhase.TRANSIT, "airborne": True}
SHOWN = [
    (START, {**FLIES, "start": True}),
    (HOLD, {**FLIES, "state": FlightState.HOLD}),
    (LAND, {**FLIES, "phase": SwarmPhase.LAND}),
]


class Field:
    """The station, vehicle 1 in the air, and vehicle 2, whose key another has."""

    def __init__(self, says: dict[str, object]) -> None:
        ring = keyring(OPERATOR)
        self.guard = SignedGuard(open_session(ring, OPERATOR_ID, MISSION, 77))
        self.station = OperatorStation(ring.seed, MISSION, 2, file=OrderCount(), draw=bytes, guard=self.guard)
        self.one, self.two = Node(1), Node(2)
        self.one.says = self.two.says = dict(says)
        self.now_s = 100.0
        self.payload = b""
        self.run(2.0)

    def run(self, seconds: float) -> None:
        """All hear one another; vehicle 2 is out of the station's reach."""
        for _ in range(round(seconds / PERIOD_S)):
            sent = {node: node.send(self.now_s) for node in (self.one, self.two)}
            self.one.receive(sent[self.two], self.now_s)
            self.two.receive(sent[self.one], self.now_s)
            self.station.receive(b"".join(sent[self.one]), self.now_s)
            for datagram in self.station.datagrams(self.now_s):
                self.payload = order_payload(datagram) or self.payload
                for node in (self.one, self.two):
                    node.receive([datagram], self.now_s)
            self.now_s = round(self.now_s + PERIOD_S, 6)

    def order(self, kind: OrderKind) -> None:
        self.station.send_order(kind, self.now_s)
        self.run(PERIOD_S)

    def copy(self, flags: int) -> bytes:
        """The order's frame as vehicle 1 passes it on; without flags, as anybody can send it."""
        return wire.frame(ORDER_ID, self.payload, seq=0, system=1, component=191, flags=flags)

    def waits_for(self) -> list[int]:
        return self.station.waits_for(self.now_s)


@pytest.mark.parametrize(("kind", "says"), SHOWN)
def test_unsigned_copy_in_a_vehicles_name_is_not_its_own(kind: OrderKind, says: dict[str, object]) -> None:
    field = Field(says)
    field.order(kind)
    assert field.waits_for() == [1]
    field.station.receive(field.copy(0), field.now_s)
    assert field.waits_for() == [1]
    field.station.receive(field.one.guard.seal_proof(field.copy(1)), field.now_s)
    assert field.waits_for() == []


def test_copy_is_of_the_vehicle_that_its_key_was_used_for() -> None:
    """Whoever changes the sender of a copy that it has recorded breaks its MAC."""
    field = Field({**FLIES, "state": FlightState.HOLD})
    field.order(HOLD)
    recorded = field.two.guard.seal_proof(wire.frame(ORDER_ID, field.payload, seq=0, system=2, component=191, flags=1))
    renamed = bytearray(recorded)
    whole = field.copy(1)
    renamed[: len(whole)] = whole  # with a checksum that holds
    field.station.receive(bytes(renamed), field.now_s)
    assert field.waits_for() == [1]


def test_beacon_that_a_member_forges_shows_nothing_of_the_other() -> None:
    field = Field(FLIES)
    field.order(LAND)
    field.station.receive(field.one.guard.seal_proof(field.copy(1)), field.now_s)
    assert field.waits_for() == [1]  # it has the order, and goes on
    session = open_session(keyring(2), 2, MISSION, 1002)
    key = session.stream_key(0, 1, 1001)
    assert key is not None
    forged = beacon_frame(1, **{**FLIES, "phase": SwarmPhase.LAND})
    field.station.receive(seal(forged, key, 0, int((field.now_s + 0.01) * UNITS_PER_S)), field.now_s)
    assert [field.station.vehicles(field.now_s)[1].phase, field.waits_for()] == [SwarmPhase.LAND, [1]]
    field.one.says = {**FLIES, "phase": SwarmPhase.LAND}
    field.run(5.0)  # after a frame that it has not made, its word is in dispute for three seconds
    assert field.waits_for() == []


def test_vehicles_own_beacon_shows_it_within_two_periods() -> None:
    field = Field(FLIES)
    field.order(LAND)
    field.station.receive(field.one.guard.seal_proof(field.copy(1)), field.now_s)
    field.one.says = {**FLIES, "phase": SwarmPhase.LAND}
    field.run(2 * PERIOD_S)
    assert field.waits_for() == []
