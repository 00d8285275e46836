"""Signed swarms in lockstep: point masses, books of orders, and an operator who has the key."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from companion.core.model.states import FlightState
from companion.keys.crypto import public_key
from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.order import OrderKind
from companion.order.station import OpenStationGuard
from mission.common.frames import Vec3
from mission.document.load import dump_mission
from mission.stand.stand import stand_of
from sim_bridge.drive.fly import LINKS
from sim_bridge.drive.lockstep.lockstep import InProcess, Lockstep
from sim_bridge.drive.operator import SignedOperator
from sim_bridge.world.world import World
from tests.flights import point_masses, short_mission
from tests.unit.mavlink.orders_kit import Disk

SEED = bytes([7]) * 32
READY_S = 20.0


class SignedSwarm:
    """Vehicles 1..n on the ground, ready within READY_S; the operator's antenna stands at d1."""

    def __init__(self, size: int = 4, **tables: dict[str, Any]) -> None:
        self.mission = short_mission(swarm={"size": size, **tables.pop("swarm", {})}, **tables)
        self.digest = hashlib.sha256(dump_mission(self.mission).encode()).digest()
        keyring = Keyring(OPERATOR, SEED, {0: bytes(32)}, 0, public_key(SEED), {})
        guard = OpenStationGuard()
        self.boots = guard.known
        self.disks = {k: Disk() for k in range(1, size + 1)}
        world = World(self.mission, point_masses, links=LINKS, stand=stand_of(self.mission, None))
        self.operator = SignedOperator(keyring, self.digest, size, seed=1, pos_ned_m=(0.0, 0.0, -2.0), guard=guard)
        world.radio.set_range(self.operator.id, 1e4)
        self.lockstep = Lockstep(world, [self.open_companion(k) for k in self.disks], operator=self.operator)

    def open_companion(self, vehicle: int) -> InProcess:
        boot = self.boots[vehicle] = self.boots.get(vehicle, 1000 * vehicle) + 1
        disk = self.disks[vehicle]
        book = OrderBook(
            operator=public_key(SEED),
            digest=self.digest,
            me=vehicle,
            size=len(self.disks),
            boot=boot,
            marks=disk,
            kept=disk.kept,
        )
        return InProcess(self.mission, vehicle, orders=book)

    @property
    def now_s(self) -> float:
        return self.lockstep.world.now_s

    def agent(self, vehicle: int) -> Any:
        companion = self.lockstep.companions[vehicle]
        assert isinstance(companion, InProcess)
        return companion.endpoint.agent

    def states(self) -> list[FlightState]:
        return [self.agent(k).flight.state for k in self.lockstep.companions]

    def places(self) -> list[Vec3]:
        return [pos for vehicle, pos in self.lockstep.world.positions().items() if vehicle != self.operator.id]

    def order(self, kind: OrderKind) -> None:
        self.operator.order(kind, self.now_s)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-6:
            self.lockstep.tick()

    def until(self, state: str, limit_s: float, among: Iterable[int] | None = None) -> None:
        ids = list(among or self.lockstep.companions)
        end_s = self.now_s + limit_s
        while any(self.agent(k).flight.state.name != state for k in ids):
            assert self.now_s < end_s, {k: self.agent(k).flight.state.name for k in ids}
            self.lockstep.tick()

    def start(self) -> None:
        """On the ground, then allowed by the key."""
        self.until("READY", READY_S)
        self.order(OrderKind.START)
