"""What other sensors told, in the base station's files: a layer, a table with units in its headings, figures."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pyogrio
import pytest

from companion.payload.sample import PAYLOAD_KIND, PayloadSample, encode_sample
from companion.stand.products.payload import quantities_of, table_of
from companion.stand.products.write import describe_products, write_products
from companion.stand.records import StoredRecord, harvest_of
from companion.survey.observation import STEM_KIND, encode
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.document.model import Mission
from mission.stems.stem_map import read_stems
from tests.unit.stand.stand_kit import said
from tests.unit.stand.test_products import MISSION, ORIGIN


def sampled(
    number: int, name: str, unit: str, value: float, *, vehicle_id: int = 1, made_s: float = 10.0, east_m: float = 3.0
) -> StoredRecord:
    body = encode_sample(PayloadSample(vehicle_id, name, unit, value, 5.0, east_m, 4.0, 1.0))
    return StoredRecord(vehicle_id, 7, number, PAYLOAD_KIND, made_s, body)


RECORDS = [
    sampled(1, "light", "lx", 800.0),
    sampled(2, "humidity", "%", 71.5),
    sampled(3, "light", "lx", 900.0, made_s=12.0, east_m=7.0),
    sampled(4, "light", "lx", 500.0, made_s=1.0),  # its companion has started again
    sampled(1, "light", "lx", 1000.0, vehicle_id=2),
]
STEM = StoredRecord(1, 7, 5, STEM_KIND, 13.0, encode(said(1, north_m=5.0, east_m=3.0)))


def rows_of(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(file.read_text())))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("payload")
    write_products([*RECORDS, STEM], Mission.model_validate(MISSION | {"origin": ORIGIN}), out)
    return out


def test_values_of_one_tick_are_one_row_headed_with_their_units(folder: Path) -> None:
    rows = rows_of(folder / "payload.csv")
    assert list(rows[0]) == [
        *("east_m", "north_m", "vehicle_id", "flight", "made_s", "up_m", "position_sd_m"),
        *("humidity_pct", "light_lx"),
    ]
    told = [(row["vehicle_id"], row["flight"], row["made_s"], row["humidity_pct"], row["light_lx"]) for row in rows]
    assert told == [
        ("1", "1", "10.0", "71.5", "800.0"),
        ("1", "1", "12.0", "", "900.0"),
        ("1", "2", "1.0", "", "500.0"),
        ("2", "1", "10.0", "", "1000.0"),
    ]
    assert (rows[1]["east_m"], rows[1]["north_m"], rows[1]["up_m"]) == ("7.000", "5.000", "4.0")


def test_a_gis_reads_the_layer_where_on_earth_it_is(folder: Path) -> None:
    assert {name for name, _ in pyogrio.list_layers(folder / "stems.gpkg")} == {"stems", "payload"}
    meta, _, geometry, fields = pyogrio.raw.read(folder / "stems.gpkg", layer="payload")
    assert meta["crs"] == "EPSG:4326"
    columns = dict(zip(meta["fields"], fields, strict=True))
    assert columns["light_lx"].tolist() == [800.0, 900.0, 500.0, 1000.0]
    assert len(geometry) == 4
    (west, south, east, north) = pyogrio.read_info(folder / "stems.gpkg", layer="payload")["total_bounds"]
    frame = LocalFrame(Wgs84(**{k: ORIGIN[k] for k in ("lat_deg", "lon_deg", "alt_m")}))
    corner = frame.to_wgs84(enu_to_ned((7.0, 5.0, 0.0)))
    assert (east, north) == pytest.approx((corner.lon_deg, corner.lat_deg), abs=1e-9)
    assert west < east
    assert south == north


def test_the_stem_map_beside_it_is_still_read_as_one(folder: Path) -> None:
    stems = read_stems(folder / "stems.gpkg")
    assert len(stems.trees) == 1


def test_figures_are_of_each_quantity(folder: Path) -> None:
    told = {one["name"]: one for one in json.loads((folder / "stand.json").read_text())["payload"]}
    light = {"name": "light", "unit": "lx", "n": 4, "mean": 800.0, "sd": 216.025, "min": 500.0, "max": 1000.0}
    assert told["light"] == light
    assert (told["humidity"]["n"], told["humidity"]["sd"]) == (1, None)


def test_the_report_has_a_table_of_them(folder: Path) -> None:
    page = (folder / "report.html").read_text()
    assert "<h2>Other sensors</h2>" in page
    assert '<th scope="row">light</th><td>lx</td><td>4</td><td>800</td><td>216</td><td>500</td><td>1000</td>' in page


def test_every_record_is_told_as_it_was_understood(folder: Path) -> None:
    lines = [json.loads(line) for line in (folder / "records.jsonl").read_text().splitlines()]
    told = [line["values"] for line in lines if line["kind"] == "payload"]
    assert [one["value"] for one in told if one["name"] == "humidity"] == [71.5]


def test_a_stand_without_them_has_no_table_no_layer_and_no_file(tmp_path: Path) -> None:
    mission = Mission.model_validate(MISSION)
    write_products([*RECORDS, STEM], mission, tmp_path)
    assert (tmp_path / "payload.csv").exists()
    write_products([STEM], mission, tmp_path)
    assert not (tmp_path / "payload.csv").exists()
    assert [name for name, _ in pyogrio.list_layers(tmp_path / "stems.gpkg")] == ["stems"]
    assert "Other sensors" not in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "stand.json").read_text())["payload"] == []


def test_values_alone_are_a_stand_without_stems(tmp_path: Path) -> None:
    written = write_products(RECORDS, Mission.model_validate(MISSION), tmp_path)
    assert describe_products(written).startswith("0 stems; 5 values of other sensors; ")
    assert len(rows_of(tmp_path / "payload.csv")) == 4


def test_what_is_malformed_or_astray_is_refused_and_counted() -> None:
    body = encode_sample(PayloadSample(1, "light", "lx", 1.0, 90_000.0, 0.0, 4.0, 1.0))
    astray, bad = StoredRecord(1, 7, 8, PAYLOAD_KIND, 14.0, body), StoredRecord(1, 7, 9, PAYLOAD_KIND, 14.0, b"\x80")
    harvest = harvest_of([*RECORDS, astray, bad])
    assert (len(harvest.payload), harvest.refused) == (5, 2)


def test_no_two_columns_have_one_heading_whatever_a_radio_told() -> None:
    records = [
        sampled(1, "a", "b_c", 1.0),
        sampled(2, "a_b", "c", 2.0),
        sampled(3, "east", "m", 3.0),
        sampled(4, "9;drop", "x", 4.0),
        sampled(5, "MADE", "S", 5.0),
    ]
    table = table_of(harvest_of(records).payload)
    assert set(table.headings) == {"a_b_c", "a_b_c_2", "east_m_2", "value_9_drop_x", "made_s_2"}
    assert len(quantities_of(harvest_of(records).payload)) == 5
