"""Lanes that the fence, the ground, the beacons, the time or a battery has no room for; what `mission check` says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from mission.check.findings import check_document
from mission.common.problems import MissionError
from mission.document.load import parse_document, parse_mission
from mission.document.model import Mission

AREA = [[20.0, -30.0], [120.0, -30.0], [120.0, 30.0], [20.0, 30.0]]
FENCE = [[-30.0, -60.0], [160.0, -60.0], [160.0, 60.0], [-30.0, 60.0]]


def surveying(n: int = 4, area: Any = AREA, fence: Any = FENCE, **tables: dict[str, Any]) -> Mission:
    values: dict[str, dict[str, Any]] = {
        "route": {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [0.0, 20.0, 4.0], "vel_leader_mps": 1.5, "at_end": "land"},
        "swarm": {"size": n},
        "coverage": {"duration_s": 0.0},
        "fence": {"altitude_min_m": 2.0, "altitude_max_m": 6.0, "polygon_enu_m": fence},
        "sensing": {"sensor": "multi-layer", "range_m": 12.0, "upside_down": True},
        "survey": {"area_enu_m": area},
    }
    for name, changes in tables.items():
        values[name] = values.get(name, {}) | changes
    return Mission.model_validate({"schema": 1, **values})


def test_lanes_become_visits_that_are_passed_at_the_height_of_d2() -> None:
    mission = surveying()
    assert len(mission.lanes) == 3
    *ends, d2 = mission.visits
    assert len(ends) == 6
    assert all(end.is_passed and end.duration_s == 0.0 and end.pos_enu_m[2] == 4.0 for end in ends)
    assert not d2.is_passed
    assert mission.surveyed_enu_m == tuple(map(tuple, AREA))
    assert mission.way_m > mission.route.length_m + 3 * 100.0


def test_more_vehicles_take_fewer_lanes() -> None:
    assert [len(surveying(n).lanes) for n in (1, 2, 4, 8)] == [12, 6, 3, 2]


def test_lanes_take_the_place_of_stops() -> None:
    with pytest.raises(ValueError, match=r"route\.stops .*must be left out: lanes are flown instead"):
        surveying(route={"stops": [{"pos_enu_m": [20.0, 0.0, 4.0]}]})


EXAMPLE = Path(__file__).parents[4] / "mission" / "examples" / "stand_by_lanes.toml"


@pytest.mark.parametrize(
    ("area", "place"),
    [
        ("5", ""),
        ("[[0.0, 0.0], [80.0, 0.0]]", ""),
        ('[[0.0, 0.0], [80.0, 0.0], [80.0, "x"]]', "[2][1]"),
        ("[[0.0, 0.0], [80.0, 0.0], [0.0, 60.0], [80.0, 60.0]]", ""),
        ("[[-20000.0, -20000.0], [20000.0, -20000.0], [20000.0, 20000.0], [-20000.0, 20000.0]]", ""),
    ],
)
def test_a_wrong_area_is_blamed_and_nothing_that_a_mission_without_one_would_need(area: str, place: str) -> None:
    text = re.sub(r"(?m)^area_enu_m = .*", f"area_enu_m = {area}", EXAMPLE.read_text())
    d2_beside, d2_at_d1 = "d2_enu_m = [-25.0, 25.0, 4.0]", "d2_enu_m = [-25.0, 0.0, 4.0]"
    for before, after in (("", ""), ('at_end = "land"', 'at_end = "hold"'), (d2_beside, d2_at_d1)):
        assert before in text
        with pytest.raises(MissionError) as refused:
            parse_mission(text.replace(before, after, 1))
        blamed = [problem.key for problem in refused.value.problems if not problem.key.startswith("forest")]
        assert blamed == [f"survey.area_enu_m{place}"]


def test_more_lanes_than_beacons_can_count_are_refused() -> None:
    with pytest.raises(ValueError, match=r"survey\.area_enu_m .*takes 41 lanes, 1\.5 m apart: must be at most 15"):
        surveying(survey={"lane_m": 1.5}, n=1)


def test_a_fence_that_leaves_no_room_is_refused_with_the_lane_the_place_and_the_room() -> None:
    tight = [[-30.0, -32.0], [160.0, -32.0], [160.0, 60.0], [-30.0, 60.0]]
    place = r"lane 1, from \(.*\) to \(.*\), which is 10.9 m inside the fence"
    with pytest.raises(ValueError, match=f"needs {place}"):
        surveying(fence=tight)


def test_a_fence_with_a_notch_across_the_lanes_is_gone_round_or_refused() -> None:
    """Of an L-shaped stand in an L-shaped fence no lane and no turn crosses the corner that is outside."""
    area = [[20.0, -30.0], [140.0, -30.0], [140.0, 0.0], [60.0, 0.0], [60.0, 60.0], [20.0, 60.0]]
    fence = [[-40.0, -70.0], [180.0, -70.0], [180.0, 30.0], [90.0, 30.0], [90.0, 95.0], [-40.0, 95.0]]
    assert surveying(area=area, fence=fence).lanes


def test_lanes_beneath_the_ground_are_refused() -> None:
    with pytest.raises(ValueError, match=r"route\.d2_enu_m .*is -?\d\.\d m above the ground at the lane's end"):
        surveying(forest={"grade": [0.05, 0.0]})


def test_a_time_limit_counts_lanes() -> None:
    with pytest.raises(ValueError, match=r"sim\.time_limit_s = 200\.0: must be above .* s, which 3 lanes take"):
        surveying(sim={"time_limit_s": 200.0})


def test_a_battery_that_does_not_last_for_the_lanes_is_refused() -> None:
    text = """
schema = 1
survey = { area_enu_m = [[20.0, -30.0], [120.0, -30.0], [120.0, 30.0], [20.0, 30.0]] }
sensing = { sensor = "multi-layer", range_m = 12.0 }
swarm = { size = 1 }
coverage = { duration_s = 0.0 }
sim = { battery_mah = { 1 = 2000.0 } }
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [0.0, 20.0, 4.0]
vel_leader_mps = 1.5
at_end = "land"
"""
    with pytest.raises(MissionError, match=r"takes 12 lanes, .* of the smallest simulated battery, is \d+ %"):
        check_document(parse_document(text, "lanes.toml"), "lanes.toml")
    found = check_document(parse_document(text.replace("2000.0", "5000.0"), "lanes.toml"), "lanes.toml")
    (note,) = [note for note in found.notes if "lanes" in note]
    assert note.startswith("survey: 12 lanes over 0.60 ha, at most 6.0 m apart, ")


def test_lanes_too_far_apart_are_noted() -> None:
    text = """
schema = 1
survey = { area_enu_m = [[20.0, -30.0], [120.0, -30.0], [120.0, 30.0], [20.0, 30.0]], lane_m = 30.0 }
sensing = { sensor = "multi-layer", range_m = 12.0 }
swarm = { size = 1 }
coverage = { duration_s = 0.0 }
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [0.0, 20.0, 4.0]
vel_leader_mps = 1.5
at_end = "land"
"""
    notes = check_document(parse_document(text, "lanes.toml"), "lanes.toml").notes
    assert any(note.startswith("survey.lane_m = 30: stems between lanes are passed on one side") for note in notes)
