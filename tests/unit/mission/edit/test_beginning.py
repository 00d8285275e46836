"""A new mission is begun in a stem map: only d1 and d2 are missing then."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import mission
from mission.common.problems import MissionError
from mission.document.load import parse_mission
from mission.edit import ground
from mission.edit.beginning import begin_text, bring_stems, flight_height_m, put_stems
from mission.edit.draft import Draft, open_draft
from mission.edit.editor import Editor
from mission.edit.toml_text import Change
from mission.stems.stem_map import StemMap, read_stems

STEMS = Path(mission.__file__).parent / "examples" / "stems.csv"
ON_EARTH = """\
lat,lon,dbh_cm,height_m,crown_base_m
47.0001,8.0001,30,20,9.0
47.0005,8.0009,40,22,8.6
47.0009,8.0002,35,21,9.1
"""


def keys_of(text: str) -> list[str]:
    with pytest.raises(MissionError) as refused:
        parse_mission(text)
    return [problem.key for problem in refused.value.problems]


@pytest.mark.parametrize("stems", [None, STEMS])
def test_d1_and_d2_are_all_that_is_missing(stems: Path | None) -> None:
    assert keys_of(begin_text('a "name" of mine', stems)) == ["route.d1_enu_m", "route.d2_enu_m"]


def test_the_fence_ends_below_the_crowns_and_the_flight_below_the_fence(tmp_path: Path) -> None:
    stems = tmp_path / "stand.csv"
    stems.write_text(ON_EARTH)
    text = begin_text("stand", stems)
    assert "altitude_max_m = 8.1            # the lowest crown begins at 8.6 m" in text
    assert flight_height_m(8.1) == 7.3
    assert (flight_height_m(30.0), flight_height_m(2.0)) == (8.0, 2.5)


def test_a_map_on_earth_says_where_the_mission_is(tmp_path: Path) -> None:
    stems = tmp_path / "stand.csv"
    stems.write_text(ON_EARTH)
    text = begin_text("stand", stems)
    assert "[origin]" in text
    placed = text.replace("[route]", "[route]\nd1_enu_m = [-60.0, 0.0, 7.3]\nd2_enu_m = [0.0, 0.0, 7.3]", 1)
    origin = parse_mission(placed).origin
    assert origin is not None
    assert (origin.lat_deg, origin.lon_deg) == pytest.approx((47.0005, 8.0002), abs=1e-6)


def test_a_map_from_elsewhere_is_copied_beside_the_mission_and_replaces_nothing(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    source = Path(shutil.copy(STEMS, tmp_path / "stand.csv"))
    assert bring_stems(source, there) == there / "stand.csv"
    assert (there / "stand.csv").read_bytes() == STEMS.read_bytes()
    assert bring_stems(source, there) == there / "stand.csv"
    assert bring_stems(there / "stand.csv", there) == there / "stand.csv"
    source.write_text(ON_EARTH)
    with pytest.raises(MissionError, match="another file of this name is beside the mission already"):
        bring_stems(source, there)
    assert (there / "stand.csv").read_bytes() == STEMS.read_bytes()


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("../stand.csv", b"", "must be the name of a stem map"),
        ("stand.exe", b"", "must be the name of a stem map"),
        ("", b"", "must be the name of a stem map"),
        (".csv", b"", "must be the name of a stem map"),
        ("a/b.csv", b"", "must be the name of a stem map"),
        ("nul\x00.csv", b"x", "cannot be written beside the mission"),
        ("x" * 300 + ".csv", b"x", "cannot be written beside the mission"),
        ("stand.csv", b"no,columns\n1,2\n", "stand.csv"),
        ("stand.gpkg", b"SQLite", "stand.gpkg"),
    ],
)
def test_what_is_no_stem_map_is_refused_and_leaves_nothing(
    name: str, data: bytes, message: str, tmp_path: Path
) -> None:
    with pytest.raises(MissionError, match=message):
        put_stems(name, data, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_mission_without_a_forest_takes_up_a_map_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "stand.csv").write_text(ON_EARTH)
    editor = Editor(Draft(tmp_path / "new.toml", 'schema = 1\nname = "mine"\n', None))
    assert editor.describe()["stem_files"] == ["stand.csv"]
    editor.take_stems("stand.csv", None)
    state = editor.describe()
    assert state["values"]["forest"] == {"file": "stand.csv"}
    assert state["values"]["origin"]["lat_deg"] == pytest.approx(47.0005, abs=1e-3)
    assert state["fields"]["fence.altitude_max_m"] == 8.1
    assert b'"east_m"' in editor.ground.data


def test_trees_are_there_while_the_mission_is_not_good_yet(tmp_path: Path) -> None:
    stems = Path(shutil.copy(STEMS, tmp_path / "stems.csv"))
    editor = Editor(Draft(tmp_path / "new.toml", begin_text("new", stems), None))
    state = editor.describe()
    assert [problem["key"] for problem in state["problems"]] == ["route.d1_enu_m", "route.d2_enu_m"]
    assert state["start"]["clear_m"] == pytest.approx(state["start"]["radius_m"] + 1.0)
    number = state["stand"]
    editor.change([Change(do="set", path=("route", "d1_enu_m"), value=[0, 0, 4.4])])
    assert editor.describe()["stand"] == number
    stems.write_text(ON_EARTH)
    editor.look_again()
    assert editor.describe()["stand"] != number
    stems.unlink()
    editor.look_again()
    assert "no such file" in editor.describe()["no_stand"]


@pytest.mark.parametrize("text", [ON_EARTH.replace("lat,lon", "north_m,east_m"), "east_m,north_m\n1,2\n"])
def test_a_map_is_read_once_however_often_the_mission_is_changed(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """20,000 trees take seconds."""
    (tmp_path / "stand.csv").write_text(text)
    counted = []

    def read(path: Path, **options: Any) -> StemMap:
        counted.append(path)
        return read_stems(path, **options)

    monkeypatch.setattr(ground, "read_stems", read)
    route = "[route]\nd1_enu_m = [-60.0, 0.0, 5.0]\nd2_enu_m = [90.0, 0.0, 5.0]\nvel_leader_mps = 2.0\n"
    editor = Editor(Draft(tmp_path / "new.toml", f'schema = 1\n{route}[forest]\nfile = "stand.csv"\n', None))
    states = []
    for size in (3, 4, 5):
        editor.change([Change(do="set", path=("swarm", "size"), value=size)])
        states.append(editor.describe()["problems"])
    assert (len(counted), states[0] == states[2]) == (1, True)
    (tmp_path / "stand.csv").write_text(text + "7,7,30,20,9\n")
    editor.look_again()
    editor.describe()
    assert len(counted) == 2


def test_a_generated_stand_stays_while_the_mission_is_not_good() -> None:
    editor = Editor(open_draft(STEMS.with_name("natural_stand.toml")))
    editor.change([Change(do="set", path=("forest", "grade"), value=[0.05, 0.0])])  # d2 is below ground then
    assert editor.describe()["problems"]
    assert json.loads(editor.ground.data)["grade"] == [0.05, 0.0]
    editor.draft.undo()
    number = editor.describe()["stand"]
    assert len(editor.ground.data) > 10_000
    editor.change([Change(do="set", path=("route", "vel_leader_mps"), value=99)])
    state = editor.describe()
    assert [problem["key"] for problem in state["problems"]] == ["route.vel_leader_mps"]
    assert state["stand"] == number
