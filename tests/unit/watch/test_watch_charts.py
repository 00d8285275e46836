"""Maps from the disk: the right tile, whichever file it is in; and files that are none, refused by name."""

from __future__ import annotations

import gzip
import random
import struct
from pathlib import Path

import pytest

from mission.basemap.chart import ChartError
from mission.basemap.charts import open_chart
from mission.stems.utm import zone_of
from tests.unit.watch.watch_kit import mbtiles

PNG = b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR" + struct.pack(">II", 30, 20)
TILES = {
    (z, x, y): PNG + f"tile {z}/{x}/{y}".encode() for z, x, y in ((0, 0, 0), (1, 0, 1), (9, 267, 179), (9, 268, 179))
}


def test_a_tile_is_the_one_that_was_asked_for(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "m.mbtiles", TILES, bounds="8,47,9,48", attribution="who drew it")
    chart = open_chart(path)
    try:
        assert {key: chart.tile(*key) for key in TILES} == TILES
        assert [chart.tile(*key) for key in ((1, 1, 1), (9, 267, 180), (8, 0, 0), (10, 3, 4))] == [None] * 4
        assert chart.image() is None
        assert (chart.about.min_zoom, chart.about.max_zoom, chart.about.mime) == (0, 9, "image/png")
        assert (chart.about.bounds_deg, chart.about.attribution) == ((8.0, 47.0, 9.0, 48.0), "who drew it")
    finally:
        chart.close()


def test_damaged_files_are_refused_by_name_or_have_no_tile_and_nothing_else_is_raised(tmp_path: Path) -> None:
    whole = mbtiles(tmp_path / "whole.mbtiles", TILES).read_bytes()
    rng = random.Random(1)
    refused: list[str] = []
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path = tmp_path / "broken.mbtiles"
        path.write_bytes(data[: rng.choice((len(data), rng.randint(1, len(data))))])
        try:
            chart = open_chart(path)
        except ChartError as error:
            refused.append(str(error))
            continue
        for key in TILES:
            chart.tile(*key)
        chart.close()
    assert 0 < len(refused) < 300
    assert all("broken.mbtiles" in message for message in refused)


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("m.tif", b"II*", "must be .mbtiles, or a .png, .jpg or .webp"),
        ("m.mbtiles", b"no database", "cannot be read as a map"),
        ("m.png", PNG, "has no world file: m.pgw, m.pngw, m.wld"),
    ],
)
def test_what_is_no_map_is_refused_by_name(name: str, content: bytes, why: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ChartError, match=why) as refused:
        open_chart(tmp_path / name)
    assert name in str(refused.value)
    with pytest.raises(ChartError, match="no such file"):
        open_chart(tmp_path / f"absent-{name}")


def test_a_picture_that_is_cut_short_is_refused_as_such(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(PNG[:20])
    (tmp_path / "m.pgw").write_text("0.001 0 0 -0.001 8 47")
    with pytest.raises(ChartError, match=r"m\.png: is cut short"):
        open_chart(tmp_path / "m.png")


@pytest.mark.parametrize("numbers", ["0 0 0 0 0 0", "0.001 0 0 0 8 47", "0.001 0.002 0.001 0.002 8 47"])
def test_a_world_file_whose_pixels_have_no_area_is_refused(numbers: str, tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(PNG)
    (tmp_path / "m.pgw").write_text(numbers)
    with pytest.raises(ChartError, match=r"m\.pgw: its pixels have no area"):
        open_chart(tmp_path / "m.png")


@pytest.mark.parametrize("tile", [gzip.compress(b"vectors", mtime=0), b"", b"<html>"])
def test_tiles_that_are_no_pictures_are_refused_whatever_the_metadata_say(tile: bytes, tmp_path: Path) -> None:
    with pytest.raises(ChartError, match="its metadata say png, but a tile is no picture"):
        open_chart(mbtiles(tmp_path / "m.mbtiles", {(0, 0, 0): tile}))


def test_a_folder_and_a_device_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "m.mbtiles").mkdir()
    for path in (tmp_path / "m.mbtiles", Path("/dev/null")):
        with pytest.raises(ChartError, match=f"^{path}: is not a file$"):
            open_chart(path)


def test_vector_tiles_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ChartError, match="its tiles are pbf: must be pictures"):
        open_chart(mbtiles(tmp_path / "v.mbtiles", TILES, format="pbf"))


def test_an_images_corners_are_the_outer_edges_of_its_pixels(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(PNG)
    (tmp_path / "m.pgw").write_text("0.001\n0\n0\n-0.002\n8.0005\n46.999\n")
    chart = open_chart(tmp_path / "m.png")
    assert chart.about.size_px == (30, 20)
    corners = chart.about.corners_deg
    assert corners is not None
    for found, wanted in zip(corners, ((47.0, 8.0), (47.0, 8.03), (46.96, 8.0)), strict=True):
        assert found == pytest.approx(wanted)
    assert chart.image() == PNG
    assert chart.tile(0, 0, 0) is None


def test_an_image_in_utm_wants_its_zone(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(PNG)
    (tmp_path / "m.wld").write_text("10 0 0 -10 500005 5205995")
    with pytest.raises(ChartError, match="is not in degrees: name its zone, as --utm 32N"):
        open_chart(tmp_path / "m.png")
    corners = open_chart(tmp_path / "m.png", zone_of("32N")).about.corners_deg
    assert corners is not None
    assert corners[0] == pytest.approx((47.0065, 9.0), abs=0.01)  # the zone's middle meridian
    assert corners[1][1] - corners[0][1] == pytest.approx(300.0 / 76_000.0, rel=0.01)
    (tmp_path / "m.wld").write_text("10 0 0 -10 500005")
    with pytest.raises(ChartError, match="must be six numbers"):
        open_chart(tmp_path / "m.png")


def test_the_size_of_a_jpeg_is_read(tmp_path: Path) -> None:
    app, frame = b"\xff\xe0\0\x04ab", b"\xff\xc0\0\x11\x08" + struct.pack(">HH", 480, 640) + bytes(12)
    (tmp_path / "m.jpg").write_bytes(b"\xff\xd8" + app + frame)
    (tmp_path / "m.jgw").write_text("0.001 0 0 -0.001 8 47")
    assert open_chart(tmp_path / "m.jpg").about.size_px == (640, 480)
