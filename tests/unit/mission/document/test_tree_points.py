"""d1 and d2 by the ids of trees in the stem map."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest

from mission.common.problems import MissionError
from mission.document.load import dump_mission, load_document, load_mission, parse_mission
from mission.document.model import Mission
from mission.schema.json_schema import json_schema
from mission.stand.resolve import resolve_stand

STEMS = "x,y,dbh_cm,id\n1.5,60.25,30,A-1\n100,2,40,7\n140,0,30,twice\n150,0,30,twice\n160,0,30,\n"
LEAST = "schema = 1\n[sensing]\n[forest]\nfile = 'stems.csv'\n"
ROUTE = "[route]\nvel_leader_mps = 3.0\n"
D1 = "d1_enu_m = [0.0, 0.0, 8.0]\n"


def mission_file(tmp_path: Path, route: str, rest: str = "", stems: str = STEMS) -> Path:
    (tmp_path / "stems.csv").write_text(stems)
    file = tmp_path / "m.toml"
    file.write_text(LEAST + rest + ROUTE + route)
    return file


def refusal(file: Path) -> str:
    with pytest.raises(MissionError) as caught:
        resolve_stand(load_mission(file), file)
    return str(caught.value).replace(f"{file.parent}/", "")


def test_d2_is_where_its_tree_stands_as_high_as_d1(tmp_path: Path) -> None:
    file = mission_file(tmp_path, D1 + "d2_tree = '7'\n")
    mission = load_mission(file)
    assert mission.route.d2_enu_m == (100.0, 2.0, 8.0)
    assert resolve_stand(mission, file).trees
    jsonschema.Draft202012Validator(json_schema(Mission)).validate(
        {"schema": 1, "route": {"d1_enu_m": [0, 0, 8], "d2_tree": "7", "vel_leader_mps": 3}}
    )


def test_the_mission_that_companions_get_needs_no_map(tmp_path: Path) -> None:
    mission = load_mission(mission_file(tmp_path, D1 + "d2_tree = '7'\n"))
    told = parse_mission(dump_mission(mission))
    assert told == mission


def test_vehicles_start_in_a_ring_about_the_tree_at_d1_that_leaves_it_room(tmp_path: Path) -> None:
    route = "d1_tree = 'A-1'\nd2_enu_m = [100.0, 2.0, 8.0]\n"
    file = mission_file(tmp_path, route, "[sim]\nplacement = 'ring'\n")
    mission = load_mission(file)
    assert mission.route.d1_enu_m == (1.5, 60.25, 8.0)
    assert resolve_stand(mission, file).trees
    for rest in ("", "[sim]\nplacement = 'ring'\n[swarm]\nsize = 1\n"):
        assert "stands -0.1 m from d1: must be at least" in refusal(mission_file(tmp_path, route, rest))
    thick, pair = STEMS.replace("60.25,30,A-1", "60.25,500,A-1"), "[sim]\nplacement = 'ring'\n[swarm]\nsize = 2\n"
    assert "must be at least" in refusal(mission_file(tmp_path, route, pair, thick))
    beside = STEMS + "3,61,30,other\n"
    assert "the tree at 3.00 east, 61.00 north: stands" in refusal(
        mission_file(tmp_path, route, "[sim]\nplacement = 'ring'\n", beside)
    )


@pytest.mark.parametrize(
    ("route", "message"),
    [
        (D1 + "d2_tree = '8'\n", 'm.toml:8: route.d2_tree = "8": no tree of stems.csv has this id; it has "A-1", "7"'),
        (D1 + "d2_tree = 'twise'\n", 'has this id; it has "twice"'),
        (D1 + "d2_tree = 'twice'\n", 'route.d2_tree = "twice": 2 trees of stems.csv have this id: lines 4, 5'),
        (
            "d1_tree = 'A-1'\nd2_tree = '7'\n",
            'route.d1_tree = "A-1": how high? The other end does not say it: write d1',
        ),
        (D1 + "d2_tree = 7\n", "route.d2_tree = 7: must be text of at most 40 characters"),
        (D1 + "d2_enu_m = [99.0, 2.0, 8.0]\nd2_tree = '7'\n", "stands at 100 east, 2 north, d2_enu_m is elsewhere"),
        (D1 + "d2_enu_m = [99.0, 2.0, 8.0]\nd2_tree = '8'\n", "no tree of stems.csv has this id"),
    ],
)
def test_a_tree_that_is_not_there_or_not_alone_is_refused(tmp_path: Path, route: str, message: str) -> None:
    assert message in refusal(mission_file(tmp_path, route))


def test_a_map_without_ids_and_a_mission_without_a_map_are_refused(tmp_path: Path) -> None:
    route = D1 + "d2_tree = '7'\n"
    assert "stems.csv has no ids" in refusal(mission_file(tmp_path, route, stems="x,y,dbh_cm\n100,2,40\n"))
    file = tmp_path / "m.toml"
    file.write_text("schema = 1\n" + ROUTE + route)
    assert "m.toml:5: route.d2_tree" in refusal(file)
    assert "is a tree of a stem map: the mission has no forest.file" in refusal(file)
    file.write_text("schema = 1\n" + ROUTE + route + "d2_enu_m = [100.0, 2.0, 8.0]\n")
    assert "is a tree of a stem map: the mission has no forest.file" in refusal(file)


def test_a_law_that_the_trees_place_breaks_is_told_at_the_tree(tmp_path: Path) -> None:
    file = mission_file(
        tmp_path, D1 + "d2_tree = '7'\n", "[fence]\npolygon_enu_m = [[-40, -40], [90, -40], [90, 40], [-40, 40]]\n"
    )
    told = refusal(file)
    assert 'm.toml:10: route.d2_tree = "7": must be inside the fence (the tree is at [100.0, 2.0, 8.0], fence.' in told
    assert "d2_enu_m" not in told
    assert "d1_enu_m" not in told


def test_a_law_that_a_tree_takes_part_in_names_it_and_where_it_is(tmp_path: Path) -> None:
    route = "d1_tree = 'A-1'\nd2_enu_m = [1.5, 60.25, 8.0]\n"
    told = refusal(mission_file(tmp_path, route, "[sim]\nplacement = 'ring'\n"))
    assert "m.toml:10: route.d2_enu_m = [1.5, 60.25, 8.0]: must differ from the deployment point" in told
    assert '(route.d1_tree = "A-1" at [1.5, 60.25, 8.0])' in told
    assert "d1_enu_m" not in told
    box = "[[forest.boxes]]\ncentre_enu_m = [3.0, 60.0]\nheight_m = 2.0\nlength_m = 2.0\nwidth_m = 2.0\n"
    route = "d1_tree = 'A-1'\nd2_enu_m = [100.0, 2.0, 8.0]\n"
    told = refusal(mission_file(tmp_path, route, box + "[sim]\nplacement = 'ring'\n"))
    assert "from d1: must be at least" in told
    assert '(route.d1_tree = "A-1" at [1.5, 60.25, 8.0], ' in told


@pytest.mark.parametrize(
    ("route", "rest"),
    [("d2_tree = 7\n", ""), ("d2_tree = ''\n", ""), ("d2_tree = '7'\n", "[forest]\nfile = 'maps/stems.csv'\n")],
)
def test_a_tree_that_is_refused_leaves_no_point_missing(tmp_path: Path, route: str, rest: str) -> None:
    file = mission_file(tmp_path, D1 + route)
    if rest:
        file.write_text(file.read_text().replace("[forest]\nfile = 'stems.csv'\n", rest))
    assert "d2_enu_m" not in refusal(file)


def test_a_text_that_is_no_file_has_no_map_beside_it() -> None:
    with pytest.raises(MissionError) as caught:
        parse_mission("schema = 1\n[forest]\nfile = 'stems.csv'\n" + ROUTE + D1 + "d2_tree = '7'\n")
    assert str(caught.value) == (
        'mission:7: route.d2_tree = "7": is a tree of a stem map, and this text is of no file beside which one could be'
    )


def test_other_files_are_left_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text("route = 3\nforest = 4\n")
    assert load_document(file)[0] == {"route": 3, "forest": 4}
