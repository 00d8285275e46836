"""What one vehicle of a small swarm is sent in a flight, tick by tick: what genuine bytes are, to make others of."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight, fly
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import Companion
from sim_bridge.judge.progress import Progress
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.world import DEFAULT_ORIGIN

TAPPED = 2  # a follower, which hears a leader
TREES = [{"base_enu_m": (x, y), "trunk_radius_m": 0.2, "height_m": 15.0} for x in (14, 26) for y in (-9, -3, 4, 9)]
OPEN: dict[str, Any] = {
    "schema": 1,
    "name": "fuzzed in the open",
    "route": {"d1_enu_m": (0, 0, 6), "d2_enu_m": (40, 0, 6), "vel_leader_mps": 3.0, "at_end": "return"},
    "coverage": {"duration_s": 4.0, "radius_m": 10.0},
    "swarm": {"size": 4},
}
STAND: dict[str, Any] = {
    **OPEN,
    "name": "fuzzed in a stand",
    "swarm": {"size": 4, "leader_priority": [1], "gnss": "leader"},
    "ranging": {
        "start_enu_m": [(-4.0, 0.0, 0.0), (4.0, 0.0, 0.0), (-4.0, -8.0, 0.0), (-4.0, 8.0, 0.0)],
        "reach_m": 25.0,
        "rate_hz": 10.0,
    },
    "sensing": {"sensor": "multi-layer", "range_m": 12.0},
    "survey": {},
    "forest": {"trees": TREES},
}
MISSIONS = {"open": OPEN, "stand": STAND, "signed": {**OPEN, "name": "fuzzed with keys"}}


@dataclass(frozen=True, slots=True)
class Heard:
    """One tick of one companion: its links' bytes, and when."""

    now_s: float
    peers: bytes
    sensor: bytes
    autopilot: bytes


@dataclass(slots=True)
class _Tap:
    """A companion, and what it is handed."""

    companion: Companion
    heard: list[Heard] = field(default_factory=list)

    @property
    def id(self) -> int:
        return self.companion.id

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self.heard.append(Heard(now_s, from_peers, from_sensor, from_autopilot))
        self.companion.send(from_peers, from_autopilot, now_s, from_sensor)

    def receive(self) -> tuple[bytes, bytes]:
        return self.companion.receive()

    def kill(self) -> None:
        self.companion.kill()

    def fill_disk(self, *, full: bool) -> None:
        self.companion.fill_disk(full=full)

    def close(self) -> None:
        self.companion.close()


def mission_of(name: str) -> Mission:
    """One of MISSIONS, on Earth."""
    return Mission.model_validate(MISSIONS[name]).with_origin(DEFAULT_ORIGIN)


@cache
def heard_in(name: str) -> tuple[Heard, ...]:
    """All that vehicle TAPPED is sent in a flight of one of MISSIONS, which takes some seconds to fly."""
    taps: list[_Tap] = []

    def tap(flight: Flight) -> None:
        if not taps:
            taps.append(_Tap(flight.lockstep.companions[TAPPED]))
            flight.lockstep.companions[TAPPED] = taps[0]

    flown, quiet = mission_of(name), Progress(io.StringIO())
    keys = FleetKeys(flown) if name == "signed" else None
    fly(flown, None, quiet, in_process=True, airframes=point_mass, watch=tap, keys=keys)
    return tuple(taps[0].heard)


def point_mass(_frame: object, pos_ned_m: Vec3, _seed: int) -> PointMass:
    """Cheap: what is wanted is the traffic."""
    return PointMass(pos_ned_m, 0.0)
