"""Maps that are damaged, or made to harm: each is refused by name, file and value, and none holds the watch up."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from itertools import count
from pathlib import Path

import pytest

from companion.watch.command import about
from mission.basemap.chart import About, ChartError
from mission.basemap.charts import open_chart
from mission.basemap.mbtiles import HEAP_MAX_BYTES, TILE_MAX_BYTES, MbTiles
from mission.stems.utm import zone_of
from tests.unit.watch.watch_kit import mbtiles

PNG = b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR\0\0\0\x1e\0\0\0\x14"
TABLE = "CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)"
TILE = f"x'{PNG.hex()}'"
ENDLESS = "WITH RECURSIVE t(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM t) SELECT"
CROSS = ", ".join(f"many AS m{k}" for k in range(8))


def database(path: Path, *statements: str) -> Path:
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE metadata (name text, value text)")
        db.execute("INSERT INTO metadata VALUES ('format', 'png')")
        for statement in statements:
            db.execute(statement)
        db.commit()
    return path


def many(*statements: str) -> tuple[str, ...]:
    """Beside a table of 100 rows."""
    rows = ", ".join(f"({k}, {TILE})" for k in range(100))
    return "CREATE TABLE many (n, data)", f"INSERT INTO many VALUES {rows}", *statements


def refusal(path: Path) -> str:
    with pytest.raises(ChartError) as refused:
        open_chart(path).close()
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "bounds",
    [
        *(
            "nan,nan,nan,nan",
            "-inf,0,inf,1",
            "9,48,8,47",
            "8,47,8,48",
            "-181,0,0,1",
            "0,0,1,91",
            "1,2,3",
            "a,b,c,d",
            "",
        ),
        *("8,47,9,48,10", "1e999,0,1,1"),
    ],
)
def test_bounds_that_are_none_are_refused_with_their_value(bounds: str, tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG}, bounds=bounds)
    assert f"bounds = {bounds!r}: must be west, south, east, north in degrees" in refusal(path)


def test_bounds_that_a_tool_has_rounded_are_taken(tmp_path: Path) -> None:
    bounds = "-180.00000000000003,-85.05,180.0,85.05"
    chart = open_chart(mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG}, bounds=bounds))
    with closing(chart):
        json.dumps(about(None, chart), allow_nan=False)


@pytest.mark.parametrize("zoom", ["31", "-1", "9223372036854775807", "1e300", "'12'", "x'00'", "0.5"])
def test_a_zoom_that_is_none_is_refused_with_its_value(zoom: str, tmp_path: Path) -> None:
    path = database(tmp_path / "m.mbtiles", TABLE, f"INSERT INTO tiles VALUES ({zoom}, 0, 0, {TILE})")
    assert "zoom_level = " in refusal(path)
    assert "must be a whole number, 0 to 30" in refusal(path)


@pytest.mark.parametrize("name", ["minzoom", "maxzoom"])
@pytest.mark.parametrize("zoom", ["999999999", "-5", "31", "0.5", "nan", "1e999", "", "all"])
def test_a_zoom_of_the_metadata_that_is_none_is_refused_with_its_value(name: str, zoom: str, tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG}, **{name: zoom})
    assert f"{name} = {zoom!r}: must be a whole number, 0 to 30" in refusal(path)


def test_zooms_of_the_metadata_the_wrong_way_round_are_refused(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG}, minzoom="9", maxzoom="8")
    assert "minzoom = 9: must be at most maxzoom = 8" in refusal(path)


def test_zooms_of_the_metadata_do_not_change_what_is_shown(tmp_path: Path) -> None:
    with closing(open_chart(mbtiles(tmp_path / "m.mbtiles", {(3, 0, 0): PNG}, minzoom="0", maxzoom="30"))) as chart:
        assert (chart.about.min_zoom, chart.about.max_zoom) == (3, 3)


def test_a_zoom_that_the_page_cannot_show_is_cut_or_refused(tmp_path: Path) -> None:
    path = database(tmp_path / "m.mbtiles", TABLE, f"INSERT INTO tiles VALUES (28, 0, 0, {TILE})")
    assert "zoom_level = 28: has no tile up to 24" in refusal(path)
    path = database(tmp_path / "n.mbtiles", TABLE, *(f"INSERT INTO tiles VALUES ({z}, 0, 0, {TILE})" for z in (3, 28)))
    with closing(open_chart(path)) as chart:
        assert (chart.about.min_zoom, chart.about.max_zoom) == (3, 24)


def test_tiles_that_are_stored_once_and_joined_by_a_view_are_shown(tmp_path: Path) -> None:
    path = database(
        tmp_path / "m.mbtiles",
        "CREATE TABLE map (zoom_level, tile_column, tile_row, tile_id)",
        "CREATE UNIQUE INDEX map_index ON map (zoom_level, tile_column, tile_row)",
        "CREATE TABLE images (tile_id PRIMARY KEY, tile_data)",
        f"INSERT INTO images VALUES ('a', {TILE})",
        "INSERT INTO map VALUES (2, 1, 3, 'a'), (2, 2, 3, 'a')",
        "CREATE VIEW tiles AS SELECT zoom_level, tile_column, tile_row, tile_data "
        "FROM map JOIN images ON images.tile_id = map.tile_id",
    )
    with closing(open_chart(path)) as chart:
        assert chart.tile(2, 1, 0) == chart.tile(2, 2, 0) == PNG
        assert chart.tile(2, 0, 0) is None


@pytest.mark.parametrize(
    "view",
    [
        f"{ENDLESS} n AS zoom_level, 0 AS tile_column, 0 AS tile_row, {TILE} AS tile_data FROM t",
        f"SELECT 0 AS zoom_level, 0 AS tile_column, 0 AS tile_row, randomblob(1000000000) AS tile_data",  # noqa: F541
        f"SELECT 0 AS zoom_level, 0 AS tile_column, 0 AS tile_row, load_extension('x') AS tile_data",  # noqa: F541
        f"SELECT 'a' LIKE 'b' AS zoom_level, 0 AS tile_column, 0 AS tile_row, {TILE} AS tile_data",
    ],
)
def test_a_view_that_recurs_or_calls_functions_is_refused(view: str, tmp_path: Path) -> None:
    message = refusal(database(tmp_path / "m.mbtiles", f"CREATE VIEW tiles AS {view}"))
    assert "not authorized" in message or "unsafe use of load_extension" in message


def test_a_view_of_itself_is_refused(tmp_path: Path) -> None:
    path = database(
        tmp_path / "m.mbtiles", "CREATE VIEW tiles AS SELECT * FROM twin", "CREATE VIEW twin AS SELECT * FROM tiles"
    )
    assert "circularly defined" in refusal(path)


def test_a_view_that_runs_long_is_refused_at_its_deadline(tmp_path: Path) -> None:
    view = f"SELECT m0.n * 0 AS zoom_level, m1.n AS tile_column, m2.n AS tile_row, m3.data AS tile_data FROM {CROSS}"
    path = database(tmp_path / "m.mbtiles", *many(f"CREATE VIEW tiles AS {view}"))
    ticks = count()
    with pytest.raises(ChartError, match=r"m\.mbtiles: takes more than 2 s to be read: are its tiles a view"):
        MbTiles(path, clock=lambda: next(ticks) / 1000.0)
    assert next(ticks) < 2100


def test_a_tile_that_takes_long_is_none_and_the_next_is_there(tmp_path: Path) -> None:
    slow = f"CASE zoom_level WHEN 1 THEN (SELECT max(m0.n + m1.n + m2.n + m3.n) FROM {CROSS}) ELSE data END"
    path = database(
        tmp_path / "m.mbtiles",
        *many("CREATE TABLE stored (zoom_level, tile_column, tile_row, data)"),
        f"INSERT INTO stored VALUES (0, 0, 0, {TILE}), (1, 0, 0, {TILE}), (2, 0, 0, {TILE})",
        f"CREATE VIEW tiles AS SELECT zoom_level, tile_column, tile_row, {slow} AS tile_data FROM stored",
    )
    ticks = count()
    with closing(MbTiles(path, clock=lambda: next(ticks) / 1000.0)) as chart:
        before = next(ticks)
        assert chart.tile(1, 0, 1) is None
        assert next(ticks) - before < 200
        assert chart.tile(0, 0, 0) == PNG


def test_what_wants_too_much_memory_is_refused(tmp_path: Path) -> None:
    big = f"CREATE TABLE big AS SELECT zeroblob({TILE_MAX_BYTES >> 2}) AS data"
    view = (
        "SELECT DISTINCT 0 AS zoom_level, m0.n AS tile_column, m1.n AS tile_row, big.data || m0.n || m1.n AS tile_data "
        "FROM many AS m0, many AS m1, big ORDER BY tile_data"
    )
    path = database(tmp_path / "m.mbtiles", *many(big, f"CREATE VIEW tiles AS {view}"))
    with pytest.raises(ChartError, match=rf"takes more than {HEAP_MAX_BYTES >> 20} MiB to be read"):
        MbTiles(path, clock=lambda: 0.0)


@pytest.mark.parametrize("where", ["first", "later"])
def test_a_blob_that_is_too_large_is_refused_or_is_no_tile(where: str, tmp_path: Path) -> None:
    rows = [f"INSERT INTO tiles VALUES (1, 0, 0, zeroblob({TILE_MAX_BYTES + 5000}))"]
    if where == "later":
        rows.insert(0, f"INSERT INTO tiles VALUES (0, 0, 0, {TILE})")
    index = "CREATE UNIQUE INDEX at ON tiles (zoom_level, tile_column, tile_row)"
    path = database(tmp_path / "m.mbtiles", TABLE, *rows, index)
    if where == "first":
        assert "holds a value of more than 4 MiB" in refusal(path)
        return
    with closing(open_chart(path)) as chart:
        assert chart.tile(1, 0, 1) is None
        assert chart.tile(0, 0, 0) == PNG


def test_virtual_tables_are_refused(tmp_path: Path) -> None:
    path = database(
        tmp_path / "m.mbtiles",
        TABLE,
        f"INSERT INTO tiles VALUES (0, 0, 0, {TILE})",
        "CREATE VIRTUAL TABLE v USING rtree(id, a, b)",
    )
    assert "has a virtual table, 'v'" in refusal(path)


def test_a_journal_that_lies_beside_the_file_is_not_played_back(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG})
    before = path.read_bytes()
    (tmp_path / "m.mbtiles-journal").write_bytes(b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + bytes(1000))
    (tmp_path / "m.mbtiles-wal").write_bytes(b"\x37\x7f\x06\x82" + bytes(1000))
    with closing(open_chart(path)) as chart:
        assert chart.tile(0, 0, 0) == PNG
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 3


def test_a_long_attribution_is_cut(tmp_path: Path) -> None:
    chart = open_chart(mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): PNG}, attribution="a\n" * 100_000))
    with closing(chart):
        assert isinstance(chart.about, About)
        assert len(chart.about.attribution) <= 500


@pytest.mark.parametrize("size", [(0, 20), (30, 0), (4_000_000_000, 20)])
def test_a_picture_without_a_size_that_can_be_drawn_is_refused(size: tuple[int, int], tmp_path: Path) -> None:
    width, height = (side.to_bytes(4, "big") for side in size)
    (tmp_path / "m.png").write_bytes(PNG[:16] + width + height)
    (tmp_path / "m.pgw").write_text("0.001 0 0 -0.001 8 47")
    assert f"is {size[0]} x {size[1]} px: each side must be 1 to 32767" in refusal(tmp_path / "m.png")


def test_a_world_file_that_leads_off_the_earth_or_never_ends_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(PNG)
    for words in ("1e150 0 0 -1e150 5e5 5e6", "10 0 0 -10 1e9 5e6", "10 0 0 -10 -1e300 1e300", "1 " * 10_000):
        (tmp_path / "m.pgw").write_text(words)
        with pytest.raises(ChartError, match=r"m\.pgw: (upper left at .*: is nowhere in|must be six numbers)"):
            open_chart(tmp_path / "m.png", zone_of("32N"))


@pytest.mark.parametrize("data", [b"PMTiles\x03" + bytes(200), b""])
def test_pmtiles_are_not_read(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "m.pmtiles").write_bytes(data)
    assert "must be .mbtiles, or a .png, .jpg or .webp" in refusal(tmp_path / "m.pmtiles")
