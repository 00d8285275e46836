"""Signed flights with orders and a liar among the members: run again of the logs alone, and no key is in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from companion.core.model.beacon import Beacon
from companion.journal.reading import find_flights
from companion.journal.replay import replay_flight
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import OrderKind
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.guard import SignedGuard
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.links.insider import Insider
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from tests.flights import flown, short_mission

LIAR = 4
LIES_S = 24.0  # from then on
OBEYED = {(3, 1): ["START", "HOLD", "START"], (3, 2): ["START", "LAND"]}  # by the one that is started again
ORDERS = {20.0: OrderKind.HOLD, 23.0: OrderKind.START, 45.0: OrderKind.LAND}


class InsiderGuard:
    """Of a member with all its keys: what it seals is not what its companion says."""

    def __init__(self, guard: SignedGuard, insider: Insider, places: dict[int, Any]) -> None:
        self._guard, self._insider, self._places = guard, insider, places

    def __getattr__(self, name: str) -> Any:
        return getattr(self._guard, name)

    def seal(self, frame: bytes, now_s: float, said: Beacon | None = None, *, named: bool = True) -> bytes:
        if said is not None and now_s >= LIES_S:
            fields = swarm_beacon.unpack(beacon_frame(frame, flags=0))  # as yet it has no signature
            assert fields is not None
            lie = self._insider.rewrite_beacon(frame, fields, now_s, self._places)
            lied = swarm_beacon.unpack(lie)
            assert lied is not None
            frame, said = beacon_frame(lie, flags=frame[2]), decode_beacon(LIAR, lied)
        return self._guard.seal(frame, now_s, said, named=named)


def beacon_frame(frame: bytes, *, flags: int) -> bytes:
    """The same, with these incompatibility flags."""
    payload = frame[wire.HEADER_BYTES : -wire.CRC_BYTES]
    return wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=frame[4], system=frame[5], component=frame[6], flags=flags)


class InsiderKeys(FleetKeys):
    """Of a fleet in which one member lies."""

    def __init__(self, mission: Mission, lie: Lie) -> None:
        super().__init__(mission)
        self.insider, self.places = Insider(mission, LIAR, lie), dict[int, Any]()
        self.guards: list[SignedGuard] = []  # of each start

    def guard(self, node: int) -> SignedGuard:
        guard = super().guard(node)
        self.guards.append(guard)
        return cast(SignedGuard, InsiderGuard(guard, self.insider, self.places)) if node == LIAR else guard


def test_a_signed_flight_with_orders_and_a_liar_replays_bit_for_bit(tmp_path: Path) -> None:
    faults = [{"kind": "restart", "vehicles": [3], "at_s": 30.0, "for_s": 2.0}]
    mission = short_mission(sim={"seed": 8, "radio_loss": 0.2, "faults": faults})
    keys = InsiderKeys(mission, Lie.USURPER)
    given: list[OrderKind] = []

    def watch(flight: Flight) -> None:
        now_s = flight.world.now_s
        keys.places.update(flight.world.positions())
        assert flight.keyholder is not None
        while len(given) < len(ORDERS) and now_s >= list(ORDERS)[len(given)]:
            given.append(list(ORDERS.values())[len(given)])
            flight.keyholder.order(given[-1], now_s)

    outcome, _ = flown(mission, tmp_path, keys=keys, watch=watch, black_box=True)
    assert given == list(ORDERS.values())
    assert outcome.summary["contacts"] == 0
    flights = find_flights(tmp_path / FOLDER_NAME)
    assert len(flights) == 5
    for flight in flights:
        said: list[str] = []
        replayed = replay_flight(
            flight, show=lambda body, _since_s, said=said: said.extend(say["text"] for say in body["said"])
        )
        assert (replayed.difference, replayed.breaks, replayed.stopped) == ([], [], "")
        assert replayed.same == replayed.summary.ticks > 100
        obeyed = [text.rpartition(" ")[2] for text in said if text.startswith("order obeyed: ")]
        assert obeyed == OBEYED.get((flight.vehicle_id, flight.number), ["START", "HOLD", "START", "LAND"])
        if flight.vehicle_id != LIAR and (flight.vehicle_id, flight.number) not in OBEYED:
            assert any(text.startswith(f"vehicle {LIAR} blocked: ") for text in said)
    check_no_key(keys, tmp_path / FOLDER_NAME)


def check_no_key(keys: InsiderKeys, folder: Path) -> None:
    """Neither raw nor in hex: of the group, of any vehicle, of the operator, or what a session draws of them."""
    secrets: set[bytes] = set()
    for owner in range(5):
        ring = keys.keyring(owner)
        secrets |= {ring.seed, *ring.secrets.values()}
    for guard in keys.guards:
        secrets |= {guard._own_key, *guard._session.keys.values()}
    data = b"".join(path.read_bytes() for path in folder.iterdir())
    assert len(secrets) > 10
    for secret in secrets:
        assert secret not in data
        assert secret.hex().encode() not in data
