"""Stem maps as GeoPackage: the point layer of an SQLite file to rows, in the reference system that the file names.

OGC 12-128r19, "GeoPackage Encoding Standard": chapters 1.1.2 (reference systems), 2.1 (features; 2.1.3 their geometry).
The file is foreign, and may be hostile: it is read in memory, only ordinary tables are, nothing in it is executed, and
MissionError is all that comes of it.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping
from contextlib import closing
from typing import Any, Final, NamedTuple

from mission.common.files import refused
from mission.common.problems import MissionError, Problem, first_of, printable, shown
from mission.schema.forest import MAX_STAND_TREES
from mission.stems import utm
from mission.stems.columns import NOTHING_MAPPED, Column, columns_of, is_position
from mission.stems.headings import Meaning
from mission.stems.stem_files import MAX_COLUMNS, Row, Rows

MAX_LAYERS: Final = 100
STEMS: Final = "stems"
OURS: Final = {STEMS, "payload"}  # layers of a base station's file: what its vehicles recorded besides is no stem
MAX_STEPS: Final = 2_000  # of PROGRESS_EVERY virtual machine instructions: 20,000 trees of 200 columns take 90
PROGRESS_EVERY: Final = 100_000
WAL_AT: Final = slice(18, 20)  # in SQLite's header: what a file in write-ahead mode says, and no copy in memory can be
ALLOWED: Final = (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_PRAGMA)
UNDEFINED_CARTESIAN: Final = -1  # srs_id
WGS84_CODES: Final = (4326, 4979, 4258)  # with heights; ETRS89: within 1 m of WGS84, the same for all trees
ENVELOPE_BYTES: Final = (0, 32, 48, 48, 64)
POINTS: Final = (1, 1001, 2001, 3001, 0x8000_0001)  # WKB: xy, with z, m, both; z as PostGIS writes it


class Layer(NamedTuple):
    """A table of points, and its frame."""

    table: str
    geometry: str  # its column
    where: tuple[Meaning, Meaning]  # what x and y are
    zone: utm.Zone | None


def gpkg_rows(data: bytes, place: str, mapped: Mapping[str, Column] = NOTHING_MAPPED) -> tuple[Rows, utm.Zone | None]:
    """The trees of a GeoPackage's only layer of points, and their zone where they are eastings and northings."""
    if data[:16] != b"SQLite format 3\0":
        raise refused(place, None, "must be a GeoPackage: an SQLite file")
    with closing(sqlite3.connect(":memory:")) as database:
        try:
            _open(database, data)
            layer = _layer(database, place)
            return _rows(database, layer, place, mapped), layer.zone
        except sqlite3.Error as error:
            raise refused(place, None, f"cannot be read as a GeoPackage: {printable(str(error))}") from None
        except (OverflowError, UnicodeDecodeError):  # a size beyond reason; a name that is no text
            raise refused(place, None, "cannot be read as a GeoPackage: damaged") from None


def _open(database: sqlite3.Connection, data: bytes) -> None:
    if data[WAL_AT] == b"\x02\x02":
        data = data[: WAL_AT.start] + b"\x01\x01" + data[WAL_AT.stop :]
    database.deserialize(data)
    database.text_factory = lambda text: text.decode("utf-8", "replace")
    steps = 0

    def too_long() -> bool:
        nonlocal steps
        steps += 1
        return steps > MAX_STEPS

    database.set_progress_handler(too_long, PROGRESS_EVERY)
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA query_only = ON")
    database.set_authorizer(lambda action, *_: sqlite3.SQLITE_OK if action in ALLOWED else sqlite3.SQLITE_DENY)


def _layer(database: sqlite3.Connection, place: str) -> Layer:
    """The only one of points. MissionError names those that there are."""
    tables = {
        name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0")
    }
    if not {"gpkg_geometry_columns", "gpkg_spatial_ref_sys"} <= tables:
        raise refused(place, None, "must be a GeoPackage: has no gpkg_geometry_columns and gpkg_spatial_ref_sys")
    layers = database.execute(
        "SELECT table_name, column_name, geometry_type_name, srs_id FROM gpkg_geometry_columns LIMIT ?", (MAX_LAYERS,)
    ).fetchall()
    points = [layer for layer in layers if str(layer[2]).upper() in ("POINT", "GEOMETRY") and layer[0] in tables]
    if {layer[0] for layer in points} == OURS:
        points = [layer for layer in points if layer[0] == STEMS]
    if len(points) != 1:
        named = ", ".join(f"{printable(str(name), 30)} ({printable(str(kind), 20)})" for name, _, kind, _ in layers[:8])
        raise refused(place, None, f"must have one layer of points, the trunks' axes (found: {named or 'none'})")
    table, geometry, _, srs_id = points[0]
    where, zone = _frame(database, srs_id, place)
    return Layer(str(table), str(geometry), where, zone)


def _frame(database: sqlite3.Connection, srs_id: object, place: str) -> tuple[tuple[Meaning, Meaning], utm.Zone | None]:
    """Meaning of x and y in this reference system are. MissionError names it where it is none of ours."""
    if srs_id == UNDEFINED_CARTESIAN:
        return (Meaning.EAST, Meaning.NORTH), None
    found = database.execute(
        "SELECT organization, organization_coordsys_id, srs_name FROM gpkg_spatial_ref_sys WHERE srs_id = ?", (srs_id,)
    ).fetchone()
    organization, code, name = found or ("", srs_id, "")
    if str(organization).upper() == "EPSG":
        if code in WGS84_CODES:
            return (Meaning.LON, Meaning.LAT), None
        zone = utm.zone_of(f"EPSG:{code}")
        if zone is not None:
            return (Meaning.EASTING, Meaning.NORTHING), zone
    told = f"{organization}:{code} ({name})"
    message = "must be EPSG:4326 (WGS84), a UTM zone, or undefined Cartesian for metres of your own: convert it"
    raise MissionError([Problem(place, None, "gpkg_geometry_columns.srs_id", printable(told), message)])


def _rows(database: sqlite3.Connection, layer: Layer, place: str, mapped: Mapping[str, Column]) -> Rows:
    names = [str(row[1]) for row in database.execute(f"PRAGMA table_info({_quoted(layer.table)})")]
    if len(names) > MAX_COLUMNS:
        raise refused(place, None, f"has {len(names)} columns: must have at most {MAX_COLUMNS}")
    if layer.geometry not in names:
        raise refused(place, None, f"layer {shown(layer.table)} has no column {shown(layer.geometry)}")
    told = [name for name in names if name != layer.geometry and (name in mapped or not is_position(name))]
    columns = columns_of([*_POSITION_NAMES[layer.where], *told], mapped)
    if columns.fault:
        raise refused(place, None, columns.fault)
    known = dict(columns.known)
    for meaning, axis in zip(layer.where, "xy", strict=True):
        known[meaning] = Column(f"{layer.geometry}.{axis}", meaning, 1.0, False)
    columns = columns._replace(known=known)
    wanted = [(meaning, column.name) for meaning, column in known.items() if meaning not in layer.where]
    selected = ", ".join(_quoted(name) for name in ("rowid", layer.geometry, *(name for _, name in wanted)))
    found = database.execute(
        f"SELECT {selected} FROM {_quoted(layer.table)} LIMIT ?", (MAX_STAND_TREES + 1,)
    ).fetchall()
    if len(found) > MAX_STAND_TREES:
        raise refused(place, None, f"holds more than {MAX_STAND_TREES} trees")
    if not found:
        raise refused(place, None, "holds no tree")
    rows = []
    problems = []
    for number, blob, *values in found:
        key = f"{printable(layer.table, 30)}[{number}]"
        at = _point(blob)
        if isinstance(at, str):
            problems.append(Problem(place, None, f"{key}.{printable(layer.geometry, 30)}", "", at))
            continue
        measured = dict(zip([meaning for meaning, _ in wanted], values, strict=True))
        rows.append(Row(None, f"{key}.", {**measured, layer.where[0]: at[0], layer.where[1]: at[1]}))
    if problems:
        raise MissionError(first_of(problems, place))
    return Rows(columns, rows, decimal=".")


_POSITION_NAMES: Final = {
    (Meaning.EAST, Meaning.NORTH): ("east", "north"),
    (Meaning.LON, Meaning.LAT): ("lon", "lat"),
    (Meaning.EASTING, Meaning.NORTHING): ("easting", "northing"),
}


def _point(blob: Any) -> tuple[float, float] | str:
    """x and y of a GeoPackage geometry, or why there is none."""
    if not isinstance(blob, bytes) or len(blob) < 8 or blob[:2] != b"GP":
        return "must be a point, as GeoPackages have it"
    flags = blob[3]
    envelope = flags >> 1 & 7
    if flags & 0x20 or envelope >= len(ENVELOPE_BYTES):
        return "must be a point: an extended geometry"
    if flags & 0x10:
        return "is empty: where does it stand?"
    wkb = blob[8 + ENVELOPE_BYTES[envelope] :]
    if len(wkb) < 21:
        return "must be a point: it breaks off"
    order = "<" if wkb[0] else ">"
    kind, x, y = struct.unpack_from(f"{order}Idd", wkb, 1)
    return (x, y) if kind in POINTS else "must be a point, the trunk's axis"


def _quoted(name: str) -> str:
    """An identifier of SQL."""
    return '"' + name.replace('"', '""') + '"'
