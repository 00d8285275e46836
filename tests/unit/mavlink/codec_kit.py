"""A codec whose frame is tied, and beacons on the wire."""

from __future__ import annotations

import math
from typing import Any

from companion.core.model.events import HeardBeacon
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from mission.common.frames import LocalFrame, Vec3, Wgs84

ORIGIN = Wgs84(47.0, 8.0, 400.0)
FRAME = LocalFrame(ORIGIN)
NAN, INF = math.nan, math.inf
BAD_FLOATS = [NAN, INF, -INF, 1e30]


def home(at_ned_m: Vec3, local_m: Vec3 = (0.0, 0.0, 0.0)) -> Any:
    """HOME_POSITION of a vehicle whose local frame has `local_m` at this point of the mission's."""
    point = FRAME.to_wgs84(at_ned_m)
    return dialect.MAVLink_home_position_message(
        round(point.lat_deg * 1e7),
        round(point.lon_deg * 1e7),
        round(point.alt_m * 1e3),
        *local_m,
        [1, 0, 0, 0],
        0,
        0,
        0,
    )


def local_position(local_m: Vec3, vel: Vec3 = (0.0, 0.0, 0.0)) -> Any:
    return dialect.MAVLink_local_position_ned_message(1000, *local_m, *vel)


def codec_at(pos_ned_m: Vec3, *, start_ned_m: Vec3 = (0.0, 0.0, 0.0), vehicle_id: int = 1) -> Codec:
    """Of a vehicle at a place of the mission's frame, whose own local frame begins at `start_ned_m`."""
    codec = Codec(vehicle_id, FRAME)
    codec.home(home(start_ned_m))
    local = (pos_ned_m[0] - start_ned_m[0], pos_ned_m[1] - start_ned_m[1], pos_ned_m[2] - start_ned_m[2])
    assert codec.position(local_position(local)) is not None
    return codec


def on_wire(payload: bytes | None, sender: int = 2) -> tuple[int, swarm_beacon.WireBeacon]:
    assert payload is not None
    ((system, _, fields),) = swarm_beacon.beacons(
        wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=swarm_beacon.COMPONENT)
    )
    return system, fields


def heard(codec: Codec, sender: int, fields: swarm_beacon.WireBeacon) -> HeardBeacon | None:
    return codec.beacon(swarm_beacon.decode(sender, fields, FRAME))
