"""What the tests of the core and the codec build from: a mission, beacons, neighbours, each with sensible defaults."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from companion.core.model.beacon import Beacon, Lease
from companion.core.model.events import HeardBeacon
from companion.core.model.neighbour import Neighbour
from companion.core.model.peer_contacts import PeerContacts
from companion.core.model.states import FlightState, Reception, SwarmPhase
from companion.core.model.vectors import ZERO, norm
from companion.core.swarm.picture import Picture
from mission.common.frames import Vec3
from mission.document.model import Mission

MISSION: dict[str, dict[str, Any]] = {
    "origin": {"lat_deg": 47.0, "lon_deg": 8.0, "alt_m": 400.0},
    "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (130.0, 0.0, 8.0), "vel_leader_mps": 3.0},
}
BEACON = Beacon(
    sender=2,
    time_ms=1000,
    vel_ned_mps=ZERO,
    ref_ned_mps=ZERO,
    dest_ned_m=None,
    route_cost=0.0,
    governor=1.0,
    lease=None,
    hop=0,
    agreed=False,
    candidate=None,
    parent=0,
    phase=SwarmPhase.ASSEMBLE,
    state=FlightState.WAITING,
    airborne=False,
    start=False,
    abort=False,
    done=0,
    range_m=30.0,
)


def mission(**tables: dict[str, Any] | list[dict[str, Any]]) -> Mission:
    """A checked mission; each argument changes keys of one table, or is an array of tables."""
    values: dict[str, Any] = {name: dict(table) for name, table in MISSION.items()}
    for name, changes in tables.items():
        values[name] = values.get(name, {}) | changes if isinstance(changes, dict) else changes
    return Mission.model_validate({"schema": 1, **values})


def beacon(sender: int = 2, **changes: Any) -> Beacon:
    return replace(BEACON, sender=sender, **changes)


def heard_beacon(sender: int = 2, *, rel_ned_m: Vec3 = (10.0, 0.0, 0.0), **changes: Any) -> HeardBeacon:
    return HeardBeacon(beacon(sender, **changes), rel_ned_m)


def neighbour(
    sender: int,
    rel_ned_m: Vec3,
    *,
    age_s: float = 0.0,
    late_s: float = 0.0,
    dest_ned_m: Vec3 | None = None,
    share: float = 1.0,
    is_overdue: bool = False,
    **changes: Any,
) -> Neighbour:
    said = beacon(sender, **{"state": FlightState.TRANSIT} | changes)  # steered: it gives way
    return Neighbour(said, rel_ned_m, dest_ned_m, age_s, said.vel_ned_mps, norm(rel_ned_m), late_s, share, is_overdue)


def known_of(neighbour: Neighbour) -> dict[str, Any]:
    """All that is known of a neighbour: neighbours themselves compare by identity."""
    names = ("beacon", "rel_ned_m", "dest_ned_m", "age_s", "late_s", "vel_ned_mps", "distance_m", "share", "is_overdue")
    return {name: getattr(neighbour, name) for name in names}


def lease(
    leader: int,
    seq: int = 1,
    *,
    priority: int = 0,
    score: int = 0,
    established: bool = False,
    heir: int = 0,
    ends: int = 0,
) -> Lease:
    return Lease(leader, seq, priority, score, established, heir, ends)


def is_finite(a: Vec3) -> bool:
    """No NaN and no infinity among the components."""
    return all(map(math.isfinite, a))


def picture(**changes: Any) -> Picture:
    """Of a vehicle on the ground that hears nobody, and lacks nothing."""
    values: dict[str, Any] = {
        "now_s": 0.0,
        "own": None,
        "state": FlightState.WAITING,
        "airborne": False,
        "can_lead": False,
        "settled": False,
        "listens_s": 0.0,
        "battery_percent": 90,
        "lacks": (),
        "neighbours": (),
        "silent": {},
        "misses": False,
        "hovering": {},
        "contacts": PeerContacts(),
        "to_d2_mps": 0.0,
        "dest_ned_m": None,
        "is_localised": True,
        "not_localised": "",
        "reception": Reception.GOOD,
        "may_lose_position": False,
        "is_position_lost": False,
        "offset_ned_m": ZERO,
        "uncertain_peer": 0,
        "is_start_uncertain": False,
        "unconfirmed_peers": (),
    }
    return Picture(**(values | changes))
