"""A stand's point cloud: vehicles' errors that the fusion found are taken off, each point told of what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.cloud.returns import encode_returns
from companion.cloud.returns_file import ReturnsFile
from companion.stand.cloud.merge import merge_returns
from companion.stand.fusion.fuse import fuse
from companion.stand.records import StoredRecord, harvest_of
from companion.survey.observation import STEM_KIND, encode
from tests.unit.cloud.cloud_kit import returns_at
from tests.unit.stand.stand_kit import said
from tests.unit.stand.test_products import TEXT, stored

STEMS = [(5.0, 3.0, 0.30), (9.0, -2.0, 0.40), (14.0, 6.0, 0.25), (20.0, 1.0, 0.35)]  # north, east, DBH
OFF_M = (0.8, -0.6)  # of vehicle 2's frame


def surveyed() -> tuple[list[StoredRecord], dict[int, list[bytes]]]:
    """Two vehicles see four stems, the second from a frame that is off; their records and bodies."""
    records, bodies = [], dict[int, list[bytes]]()
    for vehicle_id, (off_n, off_e) in ((1, (0.0, 0.0)), (2, OFF_M)):
        for k, (north_m, east_m, dbh_m) in enumerate(STEMS, start=1):
            told = said(vehicle_id, north_m=north_m + off_n, east_m=east_m + off_e, dbh_m=dbh_m, at_s=10.0 + k)
            bodies.setdefault(vehicle_id, []).append(encode(told))
            records.append(StoredRecord(vehicle_id, 7, k, STEM_KIND, 15.0 + k, bodies[vehicle_id][-1]))
    return records, bodies


def passes_of(vehicle_id: int, bodies: list[bytes]) -> list:
    off_n, off_e = OFF_M if vehicle_id == 2 else (0.0, 0.0)
    return [
        returns_at(
            vehicle_id=vehicle_id, body=body, north_m=north_m + off_n, east_m=east_m + off_e, first_s=11.0 + k, n=8
        )
        for k, (body, (north_m, east_m, _)) in enumerate(zip(bodies, STEMS, strict=True))
    ]


def test_what_the_fusion_found_of_a_vehicles_frame_is_taken_off_its_points() -> None:
    records, bodies = surveyed()
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations)
    cloud = merge_returns([passes_of(k, bodies[k]) for k in (1, 2)], harvest.observations, fusion)
    assert cloud.n == 2 * 4 * 8
    middles = [
        np.array([cloud.north_m[own].mean(), cloud.east_m[own].mean()])
        for k in (1, 2)
        for own in [(cloud.vehicle == k) & (cloud.tree == 1)]
    ]
    assert np.hypot(*(middles[0] - middles[1])) < 0.1 < np.hypot(*OFF_M)
    for tree in range(1, 5):  # as the map has them
        own = cloud.tree == tree
        stem = fusion.stems[tree - 1]
        assert np.hypot(cloud.north_m[own] - stem.north_m, cloud.east_m[own] - stem.east_m).max() < 0.25
    assert cloud.of_stem.sum() == 2 * 4 * 7
    assert np.allclose(cloud.above_ground_m, 1.3)
    assert np.allclose(cloud.up_m, 0.8)


def test_returns_without_a_record_go_by_their_vehicles_error_and_are_of_no_stem() -> None:
    records, bodies = surveyed()
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations)
    passes = passes_of(2, bodies[2])
    sapling = returns_at(vehicle_id=2, north_m=5.0 + OFF_M[0], east_m=3.0 + OFF_M[1], first_s=12.0)
    cloud = merge_returns([passes_of(1, bodies[1]), [*passes, sapling]], harvest.observations, fusion)
    own = cloud.tree == 0
    assert own.sum() == 8
    beside = (cloud.tree == 1) & (cloud.vehicle == 2)  # which stands where the sapling does, and has a record
    assert cloud.north_m[own].mean() == pytest.approx(cloud.north_m[beside].mean(), abs=0.05)
    unknown = returns_at(vehicle_id=3, north_m=50.0)
    alone = merge_returns([[unknown]], harvest.observations, fusion)
    assert alone.north_m.mean() == pytest.approx(50.0, abs=0.1)


def test_a_stand_without_returns_is_an_empty_cloud() -> None:
    harvest = harvest_of(surveyed()[0])
    assert merge_returns([[]], harvest.observations, fuse(harvest.observations)).n == 0


def test_the_command_writes_the_cloud_beside_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    laspy = pytest.importorskip("laspy")
    records, bodies = surveyed()
    database = stored(records, tmp_path / "base.db")
    (tmp_path / "m.toml").write_text(TEXT)
    files = []
    for k in (2, 1):
        files.append(str(tmp_path / f"records-{k}.returns"))
        ReturnsFile(Path(files[-1])).write([encode_returns(one) for one in passes_of(k, bodies[k])])
    call = [
        "stand",
        str(database),
        "--mission",
        str(tmp_path / "m.toml"),
        "--out",
        str(tmp_path / "out"),
        "--cloud",
        *files,
    ]
    assert main(call) == 0
    assert "cloud: 64 points, 56 of them on 4 stems" in capsys.readouterr().out
    las = laspy.read(tmp_path / "out" / "cloud.laz")
    assert np.asarray(las.x).max() == pytest.approx(6.0, abs=0.4)  # no origin: metres of the mission's frame
    assert sorted(np.unique(las.point_source_id)) == [1, 2]
    assert not [vlr for vlr in las.header.vlrs if vlr.record_id == 2112]


def test_files_of_returns_are_looked_at_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("laspy")
    database = stored(surveyed()[0], tmp_path / "base.db")
    (tmp_path / "m.toml").write_text(TEXT)
    (tmp_path / "one.returns").touch()
    call = ["stand", str(database), "--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out"), "--cloud"]
    for names, why in ((["one", "one"], "given twice"), (["none"], "no such file")):
        assert main([*call, *(str(tmp_path / f"{name}.returns") for name in names)]) == 2
        assert f"{names[0]}.returns: {why}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_file_that_holds_no_returns_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("laspy")
    database = stored(surveyed()[0], tmp_path / "base.db")
    (tmp_path / "m.toml").write_text(TEXT)
    call = ["stand", str(database), "--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main([*call, "--cloud", str(tmp_path / "m.toml")]) == 2
    assert "m.toml: holds no returns of a survey" in capsys.readouterr().err


def test_returns_of_another_flight_are_refused_and_those_of_some_stems_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("laspy")
    records, bodies = surveyed()
    database = stored(records, tmp_path / "base.db")
    (tmp_path / "m.toml").write_text(TEXT)
    theirs = [body[:-1] + bytes([body[-1] ^ 1]) for body in bodies[2]]
    call = ["stand", str(database), "--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out"), "--cloud"]
    passes = {
        "another": passes_of(2, theirs),
        "not_flown": passes_of(3, bodies[2]),
        "mixed": [*passes_of(2, theirs), *passes_of(2, bodies[2])],
        "thin": [returns_at()],
    }
    for name, some in passes.items():
        ReturnsFile(tmp_path / name).write([encode_returns(one) for one in some])
    for name, vehicle_id in (("another", 2), ("not_flown", 3)):
        assert main([*call, str(tmp_path / name)]) == 2
        said = f"{name}: returns of another flight, or mission: none of its 4 stems is among the records; if vehicle "
        assert f"{said}{vehicle_id} flew here" in capsys.readouterr().err
        assert not (tmp_path / "out").exists()
    assert main([*call, str(tmp_path / "mixed"), str(tmp_path / "thin")]) == 0
    out = capsys.readouterr().out
    assert f"{tmp_path / 'mixed'}: 4 of its 8 stems are not among the records: never delivered, or of others" in out
    assert f"{tmp_path / 'thin'}: of which flight cannot be told: none of its stems has a record" in out
