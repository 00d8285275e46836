"""Stem maps as GeoPackage, as GIS programs write it; and hostile SQLite files."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest

from mission.cli.main import main
from mission.common.problems import MissionError
from mission.schema.forest import MAX_STAND_TREES
from mission.stand.stand import stand_of
from mission.stems.stem_map import read_stems
from mission.stems.utm import Zone
from tests.unit.mission.stems_kit import ORIGIN, mission_with, problems_of, says

UTM_32N = (32632, "EPSG", 32632, "WGS 84 / UTM zone 32N")
WGS84 = (4326, "EPSG", 4326, "WGS 84 geodetic")
OWN = (-1, "NONE", -1, "Undefined Cartesian SRS")
SWISS = (2056, "EPSG", 2056, "CH1903+ / LV95")
TREES = ((500_010.0, 5_205_000.0, 31.5, 21.0, "Picea abies"), (500_020.0, 5_205_007.0, 44.0, None, "oak"))
SCHEMA = """
PRAGMA application_id = 0x47504B47;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY, organization TEXT,
  organization_coordsys_id INTEGER, definition TEXT, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT, identifier TEXT, srs_id INTEGER);
CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER,
  z TINYINT, m TINYINT);
CREATE TABLE trees (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom POINT, "DBH [cm]" REAL, height_m REAL, species TEXT,
  crew TEXT, x REAL);
"""


def point(x: float, y: float, *, envelope: int = 0, big: bool = False, kind: int = 1, more: bytes = b"") -> bytes:
    """A point as the standard has it: header, envelope, WKB."""
    order = ">" if big else "<"
    header = b"GP\0" + bytes([(envelope << 1) | (0 if big else 1)]) + struct.pack(f"{order}i", 0)
    box = struct.pack(f"{order}{(0, 4, 6, 6, 8)[envelope]}d", *[0.0] * (0, 4, 6, 6, 8)[envelope])
    return header + box + bytes([0 if big else 1]) + struct.pack(f"{order}Idd", kind, x, y) + more


def geopackage(
    folder: Path,
    trees: Iterable[Sequence[Any]] = TREES,
    srs: tuple[int, str, int, str] = UTM_32N,
    *,
    script: str = "",
    kind: str = "POINT",
) -> Path:
    """A file with one layer, `trees`: x and y or a geometry, diameter, height, species."""
    file = folder / "s.gpkg"
    file.unlink(missing_ok=True)
    database = sqlite3.connect(file)
    database.executescript(SCHEMA)
    srs_id, organization, code, name = srs
    database.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, '', '')", (name, srs_id, organization, code))
    database.execute("INSERT INTO gpkg_contents VALUES ('trees', 'features', 'trees', ?)", (srs_id,))
    database.execute("INSERT INTO gpkg_geometry_columns VALUES ('trees', 'geom', ?, ?, 0, 0)", (kind, srs_id))
    for tree in trees:
        geometry, told = (tree[0], tree[1:]) if not isinstance(tree[0], float) else (point(tree[0], tree[1]), tree[2:])
        database.execute(
            'INSERT INTO trees (geom, "DBH [cm]", height_m, species, crew, x) VALUES (?, ?, ?, ?, ?, 7)',
            (geometry, *told, "Ada"),
        )
    database.commit()
    database.executescript(script)
    database.close()
    return file


def test_trees_of_a_zone_are_placed_as_those_of_a_csv_in_it(tmp_path: Path) -> None:
    stems = read_stems(geopackage(tmp_path))
    (tmp_path / "s.csv").write_text("easting,northing,dbh_cm\n500010,5205000,31.5\n500020,5205007,44\n")
    same = read_stems(tmp_path / "s.csv", zone=Zone(32, south=False))
    assert stems.origin == same.origin
    assert [(t.east_m, t.north_m, t.radius_m) for t in stems.trees] == [
        (t.east_m, t.north_m, t.radius_m) for t in same.trees
    ]
    assert (stems.trees[0].height_m, stems.trees[0].species) == (21.0, "Picea abies")
    notes = "\n".join(stems.notes)
    assert "converted from UTM 32N" in notes
    assert "not read: fid, crew" in notes
    assert "filled in the height of 1 of 2 trees" in notes


@pytest.mark.parametrize("shape", [{"envelope": 1}, {"envelope": 4}, {"big": True}, {"kind": 1001, "more": b"\0" * 8}])
def test_points_come_with_envelopes_heights_and_in_both_orders_of_bytes(tmp_path: Path, shape: dict[str, Any]) -> None:
    stems = read_stems(geopackage(tmp_path, [(point(8.0001, 47.0, **shape), 30.0, 20.0, "")], WGS84), origin=ORIGIN)
    assert stems.trees[0].east_m == pytest.approx(7.61, abs=0.01)
    assert stems.trees[0].north_m == 0.0


def test_metres_of_an_undefined_frame_count_from_the_missions_origin(tmp_path: Path) -> None:
    stems = read_stems(geopackage(tmp_path, [(12.5, -3.0, 30.0, 20.0, "pine")], OWN))
    assert [(t.east_m, t.north_m) for t in stems.trees] == [(12.5, -3.0)]
    assert stems.origin is None


def test_a_mission_names_one_and_flies_in_it(tmp_path: Path) -> None:
    file = geopackage(tmp_path, [(8.0006, 47.0, 30.0, 12.0, "pine")], WGS84)
    mission = mission_with(file=file.name, origin={"lat_deg": 47.0, "lon_deg": 8.0, "alt_m": 400.0})
    (tree,) = stand_of(mission, tmp_path).trees
    assert tree.east_m == pytest.approx(45.64, abs=0.02)


def test_one_in_write_ahead_mode_is_read(tmp_path: Path) -> None:
    file = geopackage(tmp_path, script="PRAGMA journal_mode = WAL;")
    assert file.read_bytes()[18:20] == b"\x02\x02"
    assert len(read_stems(file).trees) == 2


def test_it_is_imported_by_the_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.csv"
    assert main(["forest", "import", str(geopackage(tmp_path)), "--out", str(out)]) == 0
    assert "2 trees" in capsys.readouterr().out
    assert len(read_stems(out).trees) == 2
    assert main(["forest", "import", str(geopackage(tmp_path)), "--utm", "33N", "--out", str(out)]) == 2
    assert "is in UTM 32N, as it says itself: not UTM 33N" in capsys.readouterr().err


def test_one_of_ours_is_what_the_standard_asks_for(tmp_path: Path) -> None:
    out = tmp_path / "out.gpkg"
    command = ["forest", "import", str(geopackage(tmp_path)), "--out", str(out), "--origin", "46.9985", "9.0002"]
    assert main(command) == 0
    with contextlib.closing(sqlite3.connect(out)) as database:

        def one(query: str) -> Any:
            return database.execute(query).fetchone()

        assert one("PRAGMA application_id") == (0x47504B47,)
        assert one("PRAGMA integrity_check") == ("ok",)
        assert one("PRAGMA foreign_key_check") is None
        systems = database.execute("SELECT srs_id FROM gpkg_spatial_ref_sys").fetchall()
        assert set(systems) == {(-1,), (0,), (4326,)}
        name, srs_id, min_x, min_y, max_x, max_y = one(
            "SELECT table_name, srs_id, min_x, min_y, max_x, max_y FROM gpkg_contents WHERE data_type = 'features'"
        )
        assert (name, srs_id) == ("trees", 4326)
        assert (min_x, min_y) == pytest.approx((9.00013, 46.99857), abs=1e-4)
        assert max_x > min_x
        assert max_y > min_y
        assert one("SELECT * FROM gpkg_geometry_columns") == ("trees", "geom", "POINT", 4326, 0, 0)
        header = struct.unpack_from("<2sBBi", one("SELECT geom FROM trees")[0])
        assert header == (b"GP", 0, 1, 4326)
    assert len(read_stems(out).trees) == 2


def test_another_reference_system_is_refused_by_its_name(tmp_path: Path) -> None:
    said = says(geopackage(tmp_path, srs=SWISS))
    assert said.startswith("s.gpkg: gpkg_geometry_columns.srs_id = EPSG:2056 (CH1903+ / LV95): must be EPSG:4326")
    assert "must be EPSG:4326" in says(geopackage(tmp_path, srs=(0, "NONE", 0, "Undefined geographic SRS")))


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ((None, 30.0, 20.0, ""), "s.gpkg: trees[1].geom: must be a point, as GeoPackages have it"),
        ((b"GP\0", 30.0, 20.0, ""), "s.gpkg: trees[1].geom: must be a point, as GeoPackages have it"),
        ((b"GP\0\x11" + bytes(25), 30.0, 20.0, ""), "s.gpkg: trees[1].geom: is empty: where does it stand?"),
        ((b"GP\0\x01" + bytes(9), 30.0, 20.0, ""), "s.gpkg: trees[1].geom: must be a point: it breaks off"),
        ((b"GP\0\x0f" + bytes(99), 30.0, 20.0, ""), "s.gpkg: trees[1].geom: must be a point: an extended geometry"),
        ((point(5e5, 5e6, kind=4), 30.0, 20.0, ""), "s.gpkg: trees[1].geom: must be a point, the trunk's axis"),
        ((5e5, 5e6, "thick", 20.0, ""), 's.gpkg: trees[1].DBH [cm] = "thick": must be a number from 0.5 to 500 cm'),
        ((5e5, 5e6, b"\1\2", 20.0, ""), "s.gpkg: trees[1].DBH [cm] = b'\\x01\\x02': must be a number from 0.5"),
        ((9e9, 5e6, 30.0, 20.0, ""), "s.gpkg: trees[1].geom.x = 9000000000.0: must be a number from 100000 to"),
        ((float("inf"), 5e6, 30.0, 20.0, ""), "s.gpkg: trees[1].geom.x = inf: must be a number"),
        ((5e5, 5e6, 30.0, 20.0, 7), None),
    ],
)
def test_what_is_wrong_with_a_tree_is_named_with_its_row(tmp_path: Path, tree: tuple[Any, ...], message: str) -> None:
    file = geopackage(tmp_path, [tree])
    if message is None:  # SQLite makes text of a number in a column of text
        assert read_stems(file).trees[0].species == "7"
    else:
        assert says(file).startswith(message)


SCRIPTS = {
    "no layer": ("DELETE FROM gpkg_geometry_columns", "must have one layer of points, the trunks' axes (found: none)"),
    "two layers": (
        "CREATE TABLE plots (geom); INSERT INTO gpkg_geometry_columns VALUES ('plots', 'geom', 'POINT', 32632, 0, 0)",
        "must have one layer of points, the trunks' axes (found: trees (POINT), plots (POINT))",
    ),
    "no geometry": ("UPDATE gpkg_geometry_columns SET column_name = 'shape'", 'has no column "shape"'),
    "no diameter": ('ALTER TABLE trees DROP COLUMN "DBH [cm]"', "must have a column dbh_cm, dbh_mm or dbh_m"),
    "no trees": ("DELETE FROM trees", "holds no tree"),
    "not a GeoPackage": ("DROP TABLE gpkg_spatial_ref_sys", "must be a GeoPackage: has no gpkg_geometry_columns and"),
    "a view": (
        "ALTER TABLE trees RENAME TO kept; CREATE VIEW trees AS SELECT * FROM kept, kept AS b, kept AS c",
        "must have one layer of points",
    ),
    "a computed column": (  # it is not shown, and not computed
        'ALTER TABLE trees DROP COLUMN "DBH [cm]";'
        "ALTER TABLE trees ADD COLUMN dbh_cm GENERATED ALWAYS AS (length(zeroblob(900000000)))",
        "must have a column dbh_cm, dbh_mm or dbh_m",
    ),
    "a quoted name": (
        "ALTER TABLE trees RENAME TO 'a\"; DROP TABLE b; --';"
        "UPDATE gpkg_geometry_columns SET table_name = 'a\"; DROP TABLE b; --'",
        None,
    ),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_file_that_is_no_map_of_points_is_refused(tmp_path: Path, name: str) -> None:
    script, message = SCRIPTS[name]
    file = geopackage(tmp_path, script=script)
    if message is None:
        assert len(read_stems(file).trees) == 2
    else:
        assert message in says(file)


def test_too_many_trees_are_refused(tmp_path: Path) -> None:
    many = [(5e5 + k, 5e6, 30.0, 20.0, "") for k in range(MAX_STAND_TREES + 1)]
    assert says(geopackage(tmp_path, many)) == f"s.gpkg: holds more than {MAX_STAND_TREES} trees"


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    whole = geopackage(tmp_path).read_bytes()
    file = tmp_path / "s.gpkg"
    for data in (b"", b"no SQLite", whole[:100], whole[:4096], whole[:-5000], whole[:16] + b"\xff" * 84 + whole[100:]):
        file.write_bytes(data)
        assert problems_of(file)
    for at in range(0, len(whole), 397):  # a byte in each part of the file
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        with contextlib.suppress(MissionError):
            read_stems(file, lenient=True)
