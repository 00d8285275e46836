"""Writes the genuine part of the corpus anew: `python -m tests.fuzz --write-seeds`. A few KB each, all from our own."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Final

import mission
from companion.keys.key_file import render_keyring
from companion.keys.keyring import OPERATOR
from companion.records.node import open_records
from companion.records.record import RecordKind
from mission.document.load import dump_mission
from mission.plan.qgc_plan import to_plan
from mission.schema.trees import StandTree
from mission.stems.geopackage_write import to_gpkg
from mission.stems.write import to_csv, to_geojson
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from tests.fuzz.companion import links_of, part_of
from tests.fuzz.flights import Heard, heard_in, mission_of
from tests.fuzz.tape import Kind, Step, tick, write_tape
from tests.fuzz.targets import CORPUS, FLIGHTS, PNG

WINDOWS: Final = {"start": 0.0, "climb": 0.12, "transit": 0.3, "coverage": 0.5, "return": 0.8}  # shares of a flight
TICKS: Final = 10


def write_seeds() -> None:
    """All of them."""
    for name, files in seeds().items():
        folder = CORPUS / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, data in files.items():
            (folder / file).write_bytes(data)


def seeds() -> dict[str, dict[str, bytes]]:
    """By target, then by file."""
    flights = {name: heard_in(name) for name in FLIGHTS}
    found = {
        name: {f"{window}.tape": write_tape(_window(heard, share)) for window, share in WINDOWS.items()}
        for name, heard in flights.items()
    }
    every = [now for heard in flights.values() for now in heard[::97]]
    found["frames"] = {
        f"{k:02}.bin": b"".join(part_of(Random(k), data) for _, data in links_of(now))
        for k, now in enumerate(every[::3])
    }
    for name, heard in (("watch", flights["open"]), ("base", flights["stand"])):
        found[name] = {"radio.tape": write_tape(_radio(heard[200:1200:50]))}
    trees = [StandTree(x, 3.0, 0.2, 15.0, 9.0, 2.5, "spruce") for x in (4.0, 9.0, 14.0)]
    planned = mission_of("open")
    assert planned.origin is not None
    origin = planned.origin.wgs84
    found["mission"] = {f"{name}.toml": dump_mission(mission_of(name), all_keys=False).encode() for name in flights}
    examples = Path(mission.__file__).parent / "examples"
    found["mission"] |= {name: (examples / name).read_bytes() for name in ("lone_tree.toml", "managed_stand.toml")}
    found["plan"] = {"open.plan": to_plan(planned, "open").encode()}
    found["stems-csv"] = {"stems.csv": to_csv(trees).encode()}
    found["stems-geojson"] = {"stems.geojson": to_geojson(trees, origin).encode()}
    found["stems-gpkg"] = {"stems.gpkg": _small(to_gpkg(trees, origin))}
    found["mbtiles"] = {"map.mbtiles": _mbtiles()}
    found["picture"] = {"map.png": PNG}
    found["world-file"] = {
        "degrees.pgw": b"0.001\n0\n0\n-0.002\n8.0005\n46.999\n",
        "utm.pgw": b"10 0 0 -10 500005 5205995",
    }
    keys = FleetKeys(planned)
    found["key-file"] = {f"{owner}.key": render_keyring(keys.keyring(owner)).encode() for owner in (OPERATOR, 2)}
    found["records"] = {"records.db": _records()}
    found["rplidar"], found["ld19"], found["mid360"] = _lidars()
    return found


def _window(heard: tuple[Heard, ...], share: float) -> Iterator[Step]:
    first = int(share * len(heard))
    for now in (*heard[:2], *heard[first : first + TICKS]):
        for kind, data in links_of(now):
            if data:
                yield Step(kind, part_of(Random(1), data))
        yield tick()


def _radio(heard: tuple[Heard, ...]) -> Iterator[Step]:
    for now in heard:
        yield Step(Kind.PEERS, now.peers)
        yield tick(0.5)


def _mbtiles() -> bytes:
    with closing(sqlite3.connect(":memory:")) as db:
        db.execute("PRAGMA page_size = 512")
        db.execute("CREATE TABLE metadata (name text, value text)")
        db.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
        db.execute("CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row)")
        db.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", "png"), ("bounds", "8,47,9,48")])
        db.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(0, 0, 0, PNG), (1, 0, 1, PNG)])
        db.commit()
        return db.serialize()


def _small(database: bytes) -> bytes:
    """The same database on small pages: empty ones make most of a file of three trees."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "small"
        path.write_bytes(database)
        with closing(sqlite3.connect(path)) as db:
            db.execute("PRAGMA page_size = 512")
            db.execute("VACUUM")
        return path.read_bytes()


def _records() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "records.db"
        one = open_records(mission_of("stand"), 2, path, lambda: 7, is_synced=False)
        for k in range(3):
            one.append(RecordKind.PAYLOAD, bytes([k]) * 20, float(k))
        for k in range(20):
            one.frames(float(k), 0)
        one.store.close()
        return path.read_bytes()


def _lidars() -> tuple[dict[str, bytes], ...]:
    from tests.unit.lidar.lidar_kit import everywhere, ld_revolution, mid360_points, rplidar_revolution

    return (
        {"turn.bin": rplidar_revolution(everywhere(4.0))[:1000]},
        {"turn.bin": ld_revolution(everywhere(4.0))[:1000]},
        {"points.bin": mid360_points(3, [(2.0, 0.0, 0.0), (3.0, 1.0, 0.5)])},
    )
