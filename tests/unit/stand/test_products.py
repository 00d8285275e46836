"""Files and report of a stand: opened by other software, readable by a forester, the same for the same records."""

from __future__ import annotations

import csv
import io
import json
import random
import re
import sqlite3
import struct
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from companion.cli import main
from companion.stand.products.write import describe_products, write_products
from companion.stand.records import StoredRecord, read_records
from companion.survey.observation import STEM_KIND, Grade, encode
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Mission
from mission.stems.stem_map import read_stems
from mission.stems.utm import Zone, to_wgs84
from tests.unit.stand.stand_kit import Survey, records_of, regular_stand, rows_of, said

ORIGIN = {"lat_deg": 47.5, "lon_deg": 8.5, "alt_m": 400.0}
FENCE = ((-30.0, -30.0), (90.0, -30.0), (90.0, 80.0), (-30.0, 80.0))
MISSION = {
    "schema": 1,
    "name": "north <stand>",
    "route": {"d1_enu_m": (0.0, 0.0, 5.0), "d2_enu_m": (40.0, 30.0, 5.0), "vel_leader_mps": 1.0},
    "swarm": {"size": 2},
    "fence": {"altitude_min_m": 2.0, "altitude_max_m": 9.0, "polygon_enu_m": FENCE},
}
TEXT = """\
schema = 1
name = "north stand"
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [40.0, 30.0, 5.0]
vel_leader_mps = 1.0
[swarm]
size = 2
"""


def mission(**besides) -> Mission:
    return Mission.model_validate(MISSION | besides)


@pytest.fixture(scope="module")
def records() -> list[StoredRecord]:
    survey = Survey(seed=4, vehicles=4)
    trees = regular_stand(4, 400.0, east_m=40.0, north_m=30.0)
    return records_of(trees, rows_of((0.0, 0.0), (40.0, 30.0), survey), survey)


@pytest.fixture(scope="module")
def folder(records, tmp_path_factory) -> Path:
    """Products of `records`, on Earth."""
    out = tmp_path_factory.mktemp("stand")
    write_products(records, mission(origin=ORIGIN), out)
    return out


def stored(records, path: Path) -> Path:
    """A store as vehicles and base stations keep it."""
    with sqlite3.connect(path) as database:
        database.execute(
            "CREATE TABLE record (vehicle_id INTEGER NOT NULL, log_id INTEGER NOT NULL, number INTEGER NOT NULL, "
            "kind INTEGER NOT NULL, made_s REAL NOT NULL, body BLOB NOT NULL, "
            "PRIMARY KEY (vehicle_id, log_id, number)) WITHOUT ROWID"
        )
        database.executemany("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?)", [record[:6] for record in records])
    database.close()
    return path


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(file.read_text())))


def test_gdal_opens_the_geopackage_with_the_same_stems_in_the_same_places(folder: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    info = pyogrio.read_info(folder / "stems.gpkg")
    assert (info["crs"], info["geometry_type"], info["layer_name"]) == ("EPSG:4326", "Point", "stems")
    _, _, geometry, fields = pyogrio.raw.read(folder / "stems.gpkg")
    table = dict(zip(info["fields"], fields, strict=True))
    told = rows(folder / "stems.csv")
    assert list(table["stem_id"]) == [row["stem_id"] for row in told]
    assert table["dbh_cm"].tolist() == [float(row["dbh_cm"]) for row in told]
    _, _, of_geojson, _ = pyogrio.raw.read(folder / "stems.geojson")
    for ours, theirs in zip(geometry, of_geojson, strict=True):
        x, y = (pytest.approx(v, abs=2e-8) for v in _xy(theirs))
        assert _xy(ours) == (x, y)


def _xy(wkb: bytes) -> tuple[float, float]:
    return struct.unpack_from("<dd", wkb, 5)


def test_the_csv_is_a_stem_map_that_missions_read(folder: Path) -> None:
    stems = read_stems(folder / "stems.csv")
    told = rows(folder / "stems.csv")
    assert len(stems.trees) == len(told)
    assert stems.trees[0].east_m == pytest.approx(float(told[0]["east_m"]), abs=0.006)
    assert 200.0 * stems.trees[0].radius_m == pytest.approx(float(told[0]["dbh_cm"]))
    assert len(read_stems(folder / "stems.gpkg", origin=Wgs84(47.5, 8.5, 400.0)).trees) == len(told)


def test_the_3dfin_file_is_in_metres_and_utm(folder: Path) -> None:
    ours, theirs = rows(folder / "stems.csv"), rows(folder / "stems_3dfin.csv")
    assert list(theirs[0]) == ["treeID", "TH", "DBH", "X", "Y", "stem_id"]
    assert [row["stem_id"] for row in theirs] == [row["stem_id"] for row in ours]
    assert json.loads((folder / "stand.json").read_text())["stems_3dfin_xy"] == "UTM 32N (EPSG:32632)"
    frame = LocalFrame(Wgs84(47.5, 8.5, 400.0))
    for own, other in zip(ours, theirs, strict=True):
        lat_deg, lon_deg = to_wgs84(float(other["X"]), float(other["Y"]), Zone(32, south=False))
        north_m, east_m, _ = frame.to_ned(Wgs84(lat_deg, lon_deg, 400.0))
        assert (east_m, north_m) == pytest.approx((float(own["east_m"]), float(own["north_m"])), abs=0.003)
        assert float(other["DBH"]) == pytest.approx(float(own["dbh_cm"]) / 100.0, abs=1e-4)


def test_raw_records_are_all_there_with_their_bodies(folder: Path, records) -> None:
    lines = [json.loads(line) for line in (folder / "records.jsonl").read_text().splitlines()]
    assert len(lines) == len(records)
    assert {line["kind"] for line in lines} == {"stem", "track"}
    stem = next(line for line in lines if line["kind"] == "stem")
    assert stem["values"]["dbh_m"] > 0.0
    assert stem["body"]


def test_without_an_origin_there_is_no_geojson_and_places_are_of_the_missions_frame(records, tmp_path: Path) -> None:
    written = write_products(records, mission(), tmp_path)
    assert "stems.geojson" not in {file.name for file in written.files}
    ours, theirs = rows(tmp_path / "stems.csv"), rows(tmp_path / "stems_3dfin.csv")
    assert [row["X"] for row in theirs] == [row["east_m"] for row in ours]
    with sqlite3.connect(tmp_path / "stems.gpkg") as database:
        assert database.execute("SELECT srs_id FROM gpkg_contents").fetchone() == (-1,)
    database.close()


def test_the_same_records_in_any_order_give_the_same_bytes(folder: Path, records, tmp_path: Path) -> None:
    mixed = [*records, *records[:30]]
    random.Random(1).shuffle(mixed)
    write_products(mixed, mission(origin=ORIGIN), tmp_path)
    for file in sorted(folder.iterdir()):
        assert (tmp_path / file.name).read_bytes() == file.read_bytes(), file.name


def test_no_records_give_files_that_say_so(tmp_path: Path) -> None:
    written = write_products([], mission(origin=ORIGIN), tmp_path)
    assert written.ground.figures is None
    page = (tmp_path / "report.html").read_text()
    assert "Too little ground was seen" in page
    assert "No stem was found." in page
    assert json.loads((tmp_path / "stand.json").read_text())["figures"] is None


def test_text_from_the_radio_is_no_markup_in_the_report_and_no_formula_in_a_spreadsheet(tmp_path: Path) -> None:
    told = [
        replace(said(1, north_m=4.0 * k, east_m=3.0), grade=Grade.POOR, reason='=HYPERLINK("x")<script>')
        for k in (1, 2)
    ]
    write_products(
        [StoredRecord(1, 7, k, STEM_KIND, 0.0, encode(o)) for k, o in enumerate(told, start=1)], mission(), tmp_path
    )
    assert all(row["reason"].startswith("'=") for row in rows(tmp_path / "stems.csv"))
    page = (tmp_path / "report.html").read_text()
    assert "<script" not in page
    assert "north &lt;stand&gt;" in page


class _Page(HTMLParser):
    """What the report has of each tag."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "rect", "polygon", "circle"):
            self.open.append(tag)

    def handle_endtag(self, tag) -> None:
        if tag not in ("rect", "polygon", "circle"):
            assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs) -> None:
        self.tags.append((tag, dict(attrs)))


def test_the_report_is_well_formed_and_accessible_and_asks_nothing_of_a_network(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    page = _Page()
    page.feed(text)
    assert page.open == []
    names = [tag for tag, _ in page.tags]
    assert names.count("h1") == 1
    assert names.count("h2") == 5
    assert names.count("table") == names.count("caption") == 2
    assert all("scope" in attrs for tag, attrs in page.tags if tag == "th")
    assert dict(page.tags)["html"]["lang"] == "en"
    assert next(attrs for tag, attrs in page.tags if tag == "svg")["aria-label"]
    assert names.count("circle") == len(rows(folder / "stems.csv"))
    assert not re.search(r"(?:src|href)=\"(?!data:)", text)
    assert "url(" not in text
    assert set(re.findall(r"https?://[^\"\s<]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_the_report_says_what_a_forester_asks(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    figures = json.loads((folder / "stand.json").read_text())["figures"]
    basal = figures["basal_area_m2_per_ha"]
    assert f"{basal['value']:.1f} ({basal['low']:.1f} to {basal['high']:.1f})" in text
    for said_there in (
        "by taper from the cut",
        "ha were not",
        "form height of 12.7 m",
        "Grades:",
        " m</text>",
        ">N<",
    ):
        assert said_there in text, said_there


def test_contrast_of_the_reports_colours_is_enough_to_read() -> None:
    from companion.stand.products.report import STYLE

    light, dark = (dict(re.findall(r"--(\w+): (#\w{6})", part)) for part in STYLE.split("@media")[:2])
    for colours in (light, dark):
        for ink in ("ink", "muted"):
            for ground in ("ground", "panel"):
                assert _contrast(colours[ink], colours[ground]) >= 4.5
        for mark in ("good", "fair", "poor", "bar"):  # graphics: WCAG 1.4.11
            assert _contrast(colours[mark], colours["seen"]) >= 3.0, mark


def _contrast(one: str, other: str) -> float:
    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_program_writes_everything_and_says_the_finding(
    records, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.toml").write_text(TEXT)
    store = stored(records, tmp_path / "base.db")
    assert read_records(store) == sorted(records)
    arguments = ["stand", str(store), "--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    *files, last = capsys.readouterr().out.splitlines()
    assert [line.rpartition("/")[2] for line in files] == [
        "stems.gpkg",
        "stems.csv",
        "stems_3dfin.csv",
        "stand.json",
        "records.jsonl",
        "report.html",
    ]
    assert re.fullmatch(r"\d+ stems; [\d.]+ ha seen; basal area [\d.]+ m2/ha \([\d.]+ to [\d.]+\)", last)
    assert not list((tmp_path / "out").glob(".*"))


def test_a_folder_that_cannot_be_made_is_named(records, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.toml").write_text(TEXT)
    (tmp_path / "out").write_text("a file")
    store = stored(records, tmp_path / "base.db")
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out" / "stand")]
    assert main(["stand", str(store), *arguments]) == 3
    assert "out" in capsys.readouterr().err


def test_without_scipy_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "companion.stand.command", raising=False)
    monkeypatch.setitem(sys.modules, "companion.stand.products.write", None)
    assert main(["stand", str(tmp_path / "a.db"), "--mission", "m.toml", "--out", str(tmp_path)]) == 3
    assert "pip install -e '.[stand]'" in capsys.readouterr().err


@pytest.mark.parametrize("value", ["0", "nan", "many", "61"])
def test_a_form_height_beyond_reason_is_refused(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["stand", "a.db", "--mission", "m.toml", "--out", "out", "--form-height-m", value])
    assert "must be from 1 to 60 m" in capsys.readouterr().err


def test_records_that_are_missing_are_told_in_report_figures_and_line(records, tmp_path: Path) -> None:
    lost = [r for r in records if not (r.vehicle_id == 2 and r.number in (1, 4, 5))]
    assert any(r.vehicle_id == 2 and r.number > 5 for r in lost)
    written = write_products(lost, mission(), tmp_path)
    line = f"3 of at least {len(records)} records are missing, of vehicle 2"
    assert line in (tmp_path / "report.html").read_text()
    assert describe_products(written).endswith(f"; {line}")
    logs = json.loads((tmp_path / "stand.json").read_text())["logs"]
    assert [(log["vehicle_id"], log["missing"]) for log in logs] == [(1, 0), (2, 3), (3, 0), (4, 0)]
    assert sum(log["records"] for log in logs) == len(lost)


def test_where_no_record_is_missing_nothing_is_said_of_it(records, folder: Path, tmp_path: Path) -> None:
    assert "missing" not in (folder / "report.html").read_text()
    assert "missing" not in describe_products(write_products(records, mission(), tmp_path))


def test_the_report_says_how_it_was_made(folder: Path, records, tmp_path: Path) -> None:
    page = (folder / "report.html").read_text()
    assert "Mission north &lt;stand&gt;: no obstacle sensor; origin 47.500000, 8.500000." in page
    assert f"{len(records)} records of 4 vehicles." in page
    sensed = mission(sensing={"sensor": "multi-layer", "range_m": 12.0}, survey={})
    write_products(records, sensed, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "sensor multi-layer; no [origin], so places are in metres" in page
    told = json.loads((tmp_path / "stand.json").read_text())
    assert (told["sensor"], told["origin"]) == ("multi-layer", None)


def test_the_map_of_no_stems_has_no_circles_in_its_legend(records, tmp_path: Path) -> None:
    write_products([r for r in records if r.kind != STEM_KIND], mission(), tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "Green: ground" in page
    assert "Circles" not in page
    assert "times as thick" not in page


def test_a_file_of_a_time_before_that_is_not_written_now_is_removed(records, tmp_path: Path) -> None:
    write_products(records, mission(origin=ORIGIN), tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    written = write_products(records, mission(), tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {file.name for file in written.files} | {"notes.txt"}


def test_the_share_of_the_area_that_was_seen_stands_beside_the_figures(records, folder: Path, tmp_path: Path) -> None:
    figures = json.loads((folder / "stand.json").read_text())["figures"]
    share = f"{100.0 * figures['seen_ha'] / figures['area_ha']:.0f} %"
    answer = re.search(r'<p class="answer">(.*?)</p>', (folder / "report.html").read_text())
    assert answer is not None
    assert f"ha ({share} seen)" in answer[1]
    line = describe_products(write_products(records, mission(), tmp_path))
    assert f" of {figures['area_ha']:.2f} ha seen ({share}); basal area" in line
