"""Beacons as vehicles of a swarm send them, and maps, for `companion watch`."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from companion.core.model.beacon import Beacon, Lease
from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from mission.common.frames import Wgs84

HERE = Wgs84(47.0, 8.0, 450.0)
LEADS = Lease(1, 7, 0, 9, established=True)


def frame(message_id: int, payload: bytes, sender: int, component: int = swarm_beacon.COMPONENT) -> bytes:
    return wire.Sender(sender, component).frame(message_id, payload)


def said(sender: int, **changes: object) -> Beacon:
    told: dict[str, object] = {
        "sender": sender,
        "time_ms": 1000,
        "vel_ned_mps": (1.0, 0.0, 0.0),
        "ref_ned_mps": (1.0, 0.0, 0.0),
        "dest_ned_m": None,
        "route_cost": 0.0,
        "governor": 1.0,
        "lease": LEADS,
        "hop": 0,
        "agreed": True,
        "candidate": None,
        "parent": 0,
        "phase": SwarmPhase.TRANSIT,
        "state": FlightState.TRANSIT,
        "airborne": True,
        "start": True,
        "abort": False,
        "done": 0,
        "range_m": 55.0,
    }
    return Beacon(**{**told, **changes})  # type: ignore[arg-type]


def beacon(sender: int, here: Wgs84 = HERE, **changes: object) -> bytes:
    return frame(swarm_beacon.MESSAGE_ID, swarm_beacon.encode(said(sender, **changes), here), sender)


def mbtiles(path: Path, tiles: dict[tuple[int, int, int], bytes], **metadata: str) -> Path:
    """A map of these tiles, by zoom, x and y from the north."""
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE metadata (name text, value text)")
    db.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
    db.executemany("INSERT INTO metadata VALUES (?, ?)", {"format": "png", **metadata}.items())
    db.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(z, x, 2**z - 1 - y, d) for (z, x, y), d in tiles.items()])
    db.commit()
    db.close()
    return path
