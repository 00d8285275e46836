"""A flight of point masses: the bridge's world and radio, its lockstep, and a companion for each vehicle."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.states import SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.beacon import Reader
from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.drive.lockstep.lockstep import InProcess, Lockstep
from sim_bridge.drive.operator import Operator, operator_order
from sim_bridge.judge.recording import Trace
from sim_bridge.judge.tick import Tick
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import World

LINKS: Final = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}  # as fly's
BEACONS_REMEMBERED: Final = 1024  # as fly's
TIME_LIMIT_S: Final = 400.0  # of a flight of 130 m


class PageFlight:
    """One flight, from the ground to the end of its coverage. `tick` until `ended` says why it is over.

    Its ticks are those of `sim-bridge fly --airframe point-mass`.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.stand: Final = stand_of(mission)
        self.world: Final = World(mission, point_mass_airframes(mission), links=LINKS, stand=self.stand)
        beacons = Reader(self.world.frame, remembers=BEACONS_REMEMBERED)
        companions = [InProcess(mission, k, beacons=beacons) for k in self.world.vehicles]
        self._lockstep: Final = Lockstep(self.world, companions)
        self._operator: Final = Operator(mission)
        self.trace: Final = Trace()
        self.ticks = 0
        self.kills: Final = list[tuple[int, int]]()  # (before which tick, vehicle)
        self.ended: str | None = None
        self._covers_since_s = math.inf

    @property
    def last(self) -> Tick:
        """How things stand."""
        return self._lockstep.last

    @property
    def leader(self) -> int | None:
        """The vehicle that acts as leader."""
        return self.last.leader(self.last.answered)

    @property
    def phase(self) -> SwarmPhase:
        """As that one announces it, else the furthest that anyone has."""
        return self.last.phase(self.last.answered)

    def kill(self, vehicle_id: int) -> None:
        """End this vehicle's companion before the next tick. ValueError where it has ended."""
        if vehicle_id not in self._lockstep.companions:
            raise ValueError(f"vehicle {vehicle_id} has no companion")
        self.kills.append((self.ticks, vehicle_id))
        self._lockstep.kill(vehicle_id)

    def tick(self) -> None:
        """One tick of 50 ms."""
        now_s = self.world.now_s
        if self._operator.orders_start(now_s, self._lockstep.companions, self.last.said):
            for vehicle in self.world.vehicles.values():
                order = operator_order(vehicle.id, dialect.MAV_CMD_MISSION_START)
                vehicle.autopilot.receive(Link.GROUND, order, now_s)
        self._lockstep.tick()
        self.trace.add(self.last)
        self.ticks += 1
        self.ended = self._end()

    def _end(self) -> str | None:
        now_s = self.last.time_s
        if not self.last.alive:
            return "no companion left"
        if now_s >= TIME_LIMIT_S:
            return f"time limit of {TIME_LIMIT_S:.0f} s reached"
        if self.phase is SwarmPhase.COVERAGE:
            self._covers_since_s = min(self._covers_since_s, now_s)
        if now_s - self._covers_since_s >= self.mission.coverage.duration_s:
            return f"coverage of {self.mission.coverage.duration_s:g} s flown"
        if self.phase is SwarmPhase.LAND and not any(self.last.armed[k - 1] for k in self.last.alive):
            return "landed"
        return None
