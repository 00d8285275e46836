"""Layers of points as GeoPackage, stem maps of ours among them: on Earth, or in metres of an undefined Cartesian frame.

OGC 12-128r19, "GeoPackage Encoding Standard": tables of chapters 1.1.2, 1.1.3 and 2.1.5, geometry of 2.1.3.
"""

from __future__ import annotations

import math
import re
import sqlite3
import struct
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Final, NamedTuple

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.schema.trees import StandTree

APPLICATION_ID: Final = 0x47504B47  # "GPKG"
USER_VERSION: Final = 10300  # of the standard: 1.3
LAYER: Final = "trees"
LAST_CHANGE: Final = "2026-01-01T00:00:00.000Z"  # the same trees give the same file
WGS84_ID: Final = 4326
CARTESIAN_ID: Final = -1
WGS84_WKT: Final = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]'
)
SYSTEMS: Final = (  # those that the standard wants in every file
    ("Undefined Cartesian SRS", CARTESIAN_ID, "NONE", -1, "undefined"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined"),
    ("WGS 84 geodetic", WGS84_ID, "EPSG", 4326, WGS84_WKT),
)
SCHEMA: Final = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {USER_VERSION};
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL, min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
  srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents (table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
"""
COLUMNS: Final = {
    "dbh_cm": "DOUBLE",
    "height_m": "DOUBLE",
    "crown_base_m": "DOUBLE",
    "crown_radius_m": "DOUBLE",
    "species": "TEXT",
    "id": "TEXT",
}
_NAME: Final = re.compile(r"[a-z][a-z0-9_]*")
_POINT: Final = struct.Struct("<2sBBiBIdd")
_LITTLE_ENDIAN: Final = 1


Cell = float | int | str | None


def to_gpkg(trees: Sequence[StandTree], origin: Wgs84 | None, ids: Sequence[str] = ()) -> bytes:
    """On Earth where the origin is; without one in metres east and north of it. ids: of the trees, in their order."""
    places = [(tree.east_m, tree.north_m) for tree in trees]
    named = ids or [""] * len(trees)
    rows = [(*_measures(tree), name or None) for tree, name in zip(trees, named, strict=True)]
    return points_gpkg([PointLayer(LAYER, COLUMNS, places, rows)], origin)


class PointLayer(NamedTuple):
    """A layer of points."""

    name: str
    columns: Mapping[str, str]  # names, and types of GeoPackage
    places_m: Sequence[tuple[float, float]]  # east, north of the origin
    rows: Sequence[Sequence[Cell]]  # as `columns`


def points_gpkg(layers: Sequence[PointLayer], origin: Wgs84 | None) -> bytes:
    """A file of these layers. ValueError: a name that is none of SQL."""
    srs_id = CARTESIAN_ID if origin is None else WGS84_ID
    frame = None if origin is None else LocalFrame(origin)
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(SCHEMA)
        database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, '')", SYSTEMS)
        for layer in layers:
            _insert_layer(database, layer, [_position(place, frame) for place in layer.places_m], srs_id)
        database.commit()
        return database.serialize()


def _insert_layer(
    database: sqlite3.Connection, layer: PointLayer, points: Sequence[tuple[float, float]], srs_id: int
) -> None:
    name = layer.name
    for word in (name, *layer.columns):
        if not _NAME.fullmatch(word):
            raise ValueError(f"{word!r} is no name of a layer or column")
    columns = "".join(f", {column} {kind}" for column, kind in layer.columns.items())
    database.execute(f"CREATE TABLE {name} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT{columns})")
    xs, ys = [x for x, _ in points], [y for _, y in points]
    extent = (min(xs), min(ys), max(xs), max(ys)) if points else (None,) * 4
    contents = (name, "features", name, "", LAST_CHANGE, *extent, srs_id)
    database.execute(f"INSERT INTO gpkg_contents VALUES ({', '.join('?' * len(contents))})", contents)
    database.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POINT', ?, 0, 0)", (name, srs_id))
    database.executemany(
        f"INSERT INTO {name} (geom, {', '.join(layer.columns)}) VALUES ({', '.join('?' * (1 + len(layer.columns)))})",
        [(_blob(point, srs_id), *row) for point, row in zip(points, layer.rows, strict=True)],
    )


def _position(place_m: tuple[float, float], frame: LocalFrame | None) -> tuple[float, float]:
    if frame is None:
        return place_m
    at = frame.to_wgs84(enu_to_ned((*place_m, 0.0)))
    return math.remainder(at.lon_deg, 360.0), at.lat_deg


def _measures(tree: StandTree) -> tuple[float, float, float, float, str]:
    return (
        round(200.0 * tree.radius_m, 2),
        tree.height_m,
        tree.crown_base_m,
        round(tree.crown_radius_m, 3),
        tree.species,
    )


def _blob(point: tuple[float, float], srs_id: int) -> bytes:
    """Header without an envelope, then WKB."""
    return _POINT.pack(b"GP", 0, _LITTLE_ENDIAN, srs_id, _LITTLE_ENDIAN, 1, *point)
