"""A flight as KML, GPX and GeoJSON."""

from __future__ import annotations

import json
import math
import os
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from mission.common.frames import LocalFrame, Wgs84
from mission.document.load import load_mission
from mission.stand.stand import stand_of
from sim_bridge import cli
from sim_bridge.drive.fly import Flight
from sim_bridge.judge import run_folder
from sim_bridge.judge.export.flown import load
from sim_bridge.judge.export.telemetry import begins_us, read_telemetry
from sim_bridge.judge.recording import Recorder
from tests.flights import flown, short_mission

KML = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
GPX = {"g": "http://www.topografix.com/GPX/1/1"}


@pytest.fixture(scope="module")
def out(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    assert cli.main(["export", str(run), "--kml", "--gpx", "--geojson", "--out", str(folder)]) == 0
    return folder


def off_m(run: Path, vehicle: int, time_s: float, place: Wgs84) -> float:
    """How far `place` is from where the vehicle was."""
    recording, mission = run_folder.load(run), load_mission(run / "mission.toml")
    assert mission.origin is not None
    row = int(np.argmin(np.abs(recording.time_s - time_s)))
    assert recording.time_s[row] == pytest.approx(time_s, abs=2e-3)
    return math.dist(LocalFrame(mission.origin.wgs84).to_ned(place), recording.pos_ned_m[row, vehicle - 1])


def unix_s(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()


def test_kml_has_a_track_in_time_for_each_vehicle(run: Path, out: Path) -> None:
    root = ET.parse(out / "flight.kml").getroot()
    assert root.findtext("k:Document/k:name", namespaces=KML) == "oak & <beech>"
    tracks = root.findall(".//gx:Track", KML)
    assert len(tracks) == 3
    start_s = begins_us(run / "vehicle-1.tlog") / 1e6
    for vehicle, track in enumerate(tracks, start=1):
        times_s = [unix_s(when.text or "") - start_s for when in track.findall("k:when", KML)]
        places = [[float(x) for x in (at.text or "").split()] for at in track.findall("gx:coord", KML)]
        assert len(times_s) == len(places) > 100
        assert times_s == sorted(times_s)
        for k in (0, len(places) // 2, -1):
            lon, lat, alt = places[k]
            assert off_m(run, vehicle, times_s[k], Wgs84(lat, lon, alt)) < 0.05


def test_kml_has_places_fence_and_trunks(run: Path, out: Path) -> None:
    root = ET.parse(out / "flight.kml").getroot()
    names = [element.text for element in root.findall(".//k:Placemark/k:name", KML)]
    trees = stand_of(load_mission(run / "mission.toml")).trees
    assert names[:6] == ["vehicle 1", "vehicle 2", "vehicle 3", "d1", "d2", "fence"]
    assert names[6:] == [f"{2 * tree.radius_m:.2f} m" for tree in trees]
    assert len(trees) > 100


def test_gpx_has_a_track_in_time_for_each_vehicle_and_the_places(run: Path, out: Path) -> None:
    root = ET.parse(out / "flight.gpx").getroot()
    assert [point.findtext("g:name", namespaces=GPX) for point in root.findall("g:wpt", GPX)] == ["d1", "d2"]
    start_s = begins_us(run / "vehicle-1.tlog") / 1e6
    tracks = root.findall("g:trk", GPX)
    assert [track.findtext("g:name", namespaces=GPX) for track in tracks] == ["vehicle 1", "vehicle 2", "vehicle 3"]
    for vehicle, track in enumerate(tracks, start=1):
        points = track.findall(".//g:trkpt", GPX)
        assert len(points) > 100
        for point in (points[0], points[len(points) // 2], points[-1]):
            place = Wgs84(
                float(point.attrib["lat"]),
                float(point.attrib["lon"]),
                float(point.findtext("g:ele", "", GPX)),
            )
            assert off_m(run, vehicle, unix_s(point.findtext("g:time", "", GPX)) - start_s, place) < 0.05


def test_geojson_has_lines_places_fence_and_trunks(run: Path, out: Path) -> None:
    features = json.loads((out / "flight.geojson").read_text())["features"]
    kinds = [feature["properties"]["kind"] for feature in features]
    mission = load_mission(run / "mission.toml")
    trees = stand_of(mission).trees
    assert [kinds.count(kind) for kind in ("vehicle", "place", "fence", "trunk")] == [3, 2, 1, len(trees)]
    line = features[1]
    assert line["properties"]["vehicle"] == 2
    coordinates, times_s = line["geometry"]["coordinates"], line["properties"]["time_s"]
    assert len(coordinates) == len(times_s)
    for (lon, lat, alt), time_s in zip(coordinates[::40], times_s[::40], strict=True):
        assert off_m(run, 2, time_s, Wgs84(lat, lon, alt)) < 0.05
    assert mission.origin is not None
    frame = LocalFrame(mission.origin.wgs84)
    (ring,) = next(f for f in features if f["properties"]["kind"] == "fence")["geometry"]["coordinates"]
    corners = [frame.to_ned(Wgs84(lat, lon, alt))[:2] for lon, lat, alt in ring]
    assert ring[0] == ring[-1]
    doubled_m2 = sum(
        east * next_north - next_east * north for (north, east), (next_north, next_east) in pairwise(corners)
    )
    assert doubled_m2 == pytest.approx(2 * 160 * 120, rel=1e-3)  # against the clock, as RFC 7946 wants it
    trunk = next(f for f in features if f["properties"]["kind"] == "trunk")
    lon, lat, alt = trunk["geometry"]["coordinates"]
    assert frame.to_ned(Wgs84(lat, lon, alt))[:2] == pytest.approx((trees[0].north_m, trees[0].east_m), abs=0.02)
    assert trunk["properties"]["dbh_m"] == pytest.approx(2 * trees[0].radius_m, abs=1e-4)


def test_telemetry_that_breaks_off_is_read_up_to_there(run: Path, tmp_path: Path) -> None:
    data = (run / "vehicle-2.tlog").read_bytes()
    start_us = begins_us(run / "vehicle-2.tlog")
    whole = read_telemetry(run / "vehicle-2.tlog", start_us)
    assert len(whole.fixes) > 100
    (tmp_path / "cut.tlog").write_bytes(data[: len(data) // 2 + 7])
    cut = read_telemetry(tmp_path / "cut.tlog", start_us)
    assert 0 < len(cut.fixes) < len(whole.fixes)
    assert cut.fixes == whole.fixes[: len(cut.fixes)]
    (tmp_path / "noise.tlog").write_bytes(data[:5000] + bytes(range(256)) * 8)
    noise = read_telemetry(tmp_path / "noise.tlog", start_us)
    assert 0 < len(noise.fixes) < 20
    assert noise.fixes == whole.fixes[: len(noise.fixes)]
    assert read_telemetry(tmp_path / "absent.tlog", start_us).setpoints == []


def make_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_bytes(b""), make_pipe])
@pytest.mark.parametrize("vehicle_id", [1, 3])
def test_a_log_that_is_missing_or_empty_takes_none_from_the_others(
    vehicle_id: int, spoil: Callable[[Path], object], run: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    spoil(folder / f"vehicle-{vehicle_id}.tlog")
    flight, whole = load(folder), load(run)
    assert abs(flight.start_us - whole.start_us) < 1_000_000
    assert flight.telemetry[vehicle_id].fixes == []
    assert 0.0 <= flight.telemetry[2].fixes[0][0] < 5.0
    assert len(flight.telemetry[2].fixes) == len(whole.telemetry[2].fixes) > 100


def test_without_telemetry_logs_a_flight_began_in_1970(run: Path, tmp_path: Path) -> None:
    for name in ("recording.npz", "mission.toml"):
        shutil.copyfile(run / name, tmp_path / name)
    assert cli.main(["export", str(tmp_path), "--gpx"]) == 0
    times = ET.parse(tmp_path / "flight.gpx").getroot().findall(".//g:time", GPX)
    assert {(time.text or "")[:13] for time in times} == {"1970-01-01T00"}
    assert load(tmp_path).start_us == 0


def test_a_flight_that_ended_before_it_began_has_nothing_to_export(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copyfile(run / "mission.toml", tmp_path / "mission.toml")
    run_folder.save(Recorder().recording(), tmp_path)
    assert cli.main(["export", str(tmp_path), "--kml"]) == 2
    assert "holds no tick" in capsys.readouterr().err


def test_one_vehicle_on_the_ground_is_a_flight_too(tmp_path: Path) -> None:
    ticks = 0

    def stop(_flight: Flight) -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 3:
            raise KeyboardInterrupt

    flown(short_mission(swarm={"size": 1}), tmp_path, watch=stop)
    assert cli.main(["export", str(tmp_path), "--mcap", "--kml", "--gpx", "--geojson"]) == 0
    names = ("flight.mcap", "flight.kml", "flight.gpx", "flight.geojson")
    assert all((tmp_path / name).stat().st_size > 500 for name in names)


def test_export_wants_to_know_what_and_of_which_flight(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["export", str(run)]) == 2
    assert "--mcap, --rrd, --kml, --gpx, --geojson, --ros2bag" in capsys.readouterr().err
    assert cli.main(["export", str(tmp_path), "--kml"]) == 2
    assert "no such file" in capsys.readouterr().err
    assert cli.main(["export", str(run), "--kml", "--out", str(tmp_path / "nowhere")]) == 3
    assert "cannot be written" in capsys.readouterr().err
