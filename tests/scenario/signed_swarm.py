"""Signed swarms in lockstep: point masses, books of orders, and an operator who has the key."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from companion.core.model.states import FlightState
from companion.mavlink.orders.order import OrderKind
from mission.common.frames import Vec3
from mission.stand.stand import stand_of
from sim_bridge.drive.fly import LINKS
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess, Lockstep
from sim_bridge.world.world import World
from tests.flights import point_masses, short_mission

READY_S = 20.0


class SignedSwarm:
    """Vehicles 1..n on the ground, ready within READY_S; the operator stands beside them."""

    def __init__(self, size: int = 4, **tables: dict[str, Any]) -> None:
        self.mission = short_mission(swarm={"size": size, **tables.pop("swarm", {})}, **tables)
        self.keys = FleetKeys(self.mission)
        world = World(self.mission, point_masses, links=LINKS, stand=stand_of(self.mission, None))
        self.operator = self.keys.operator(world)
        companions = [self.open_companion(k) for k in world.vehicles]
        self.lockstep = Lockstep(world, companions, operator=self.operator)

    def open_companion(self, vehicle: int) -> InProcess:
        guard = self.keys.guard(vehicle)
        return InProcess(self.mission, vehicle, guard=guard, orders=self.keys.orders(vehicle))

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
