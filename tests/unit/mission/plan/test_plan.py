"""QGroundControl's plans: out, in, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mission.cli.main import main
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.common.problems import MissionError
from mission.document.load import dump_mission, load_mission
from mission.document.model import AtEnd, Mission
from mission.plan.qgc_plan import MAX_ITEMS, from_plan, to_plan

ORIGIN = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
FENCE = ((-60.0, -60.0), (140.0, -60.0), (140.0, 90.0), (-60.0, 90.0))


def mission(**tables: dict[str, Any]) -> Mission:
    values: dict[str, Any] = {
        "schema": 1,
        "name": "oaks",
        "origin": ORIGIN,
        "route": {
            "d1_enu_m": (3.0, -4.0, 6.0),
            "d2_enu_m": (100.0, 20.0, 8.0),
            "vel_leader_mps": 2.5,
            "stops": ({"pos_enu_m": (50.0, 40.0, 7.0), "duration_s": 20.0}, {"pos_enu_m": (70.0, 10.0, 8.5)}),
            "at_end": "return",
        },
        "fence": {"polygon_enu_m": FENCE},
        "coverage": {"duration_s": 45.0, "radius_m": 12.0},
        "swarm": {"size": 5},
    }
    for name, changes in tables.items():
        values[name] = {**values[name], **changes}
    return Mission.model_validate(values)


def qgc(items: list[dict[str, Any]], **parts: Any) -> dict[str, Any]:
    """A plan as QGroundControl 4 saves one."""
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": 15,
            "firmwareType": 12,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": 4,
            "items": items,
            "plannedHomePosition": [47.397742, 8.545594, 488.0],
            "vehicleType": 2,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
        **parts,
    }


def item(command: int, east_m: float, north_m: float, up_m: float, first: float = 0, frame: int = 3) -> dict[str, Any]:
    at = LocalFrame(Wgs84(*ORIGIN.values())).to_wgs84(enu_to_ned((east_m, north_m, up_m)))
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": up_m,
        "AltitudeMode": 1,
        "autoContinue": True,
        "command": command,
        "doJumpId": 1,
        "frame": frame,
        "params": [first, 0, 0, None, at.lat_deg, at.lon_deg, up_m if frame == 3 else at.alt_m],
        "type": "SimpleItem",
    }


def simple(command: int, *params: float) -> dict[str, Any]:
    return {
        "autoContinue": True,
        "command": command,
        "frame": 2,
        "params": [*params, *[0] * (7 - len(params))],
        "type": "SimpleItem",
    }


TAKEOFF, WAYPOINT = item(22, 0, 0, 8), item(16, 80, 5, 9)


def read(plan: dict[str, Any], base: Mission | None = None) -> tuple[Mission, str]:
    found, notes = from_plan(json.dumps(plan), "my.plan", base)
    return found, "\n".join(notes)


def refusal(plan: dict[str, Any]) -> str:
    with pytest.raises(MissionError) as error:
        read(plan)
    return str(error.value)


@pytest.mark.parametrize("at_end", list(AtEnd))
def test_a_mission_survives_out_and_in(at_end: AtEnd) -> None:
    flown = mission(route={"at_end": at_end})
    back, _ = read(json.loads(to_plan(flown, "my.toml")), flown)
    assert back.visits == flown.visits
    assert back.route.d1_enu_m == flown.route.d1_enu_m
    assert (back.route.at_end, back.route.vel_leader_mps) == (at_end, 2.5)
    assert back.fence == flown.fence
    assert (back.name, back.swarm, back.coverage, back.origin) == (
        flown.name,
        flown.swarm,
        flown.coverage,
        flown.origin,
    )


def test_a_plan_survives_in_and_out() -> None:
    """Without a mission to lean on its places are the same on Earth, whatever the frame."""
    plan = json.loads(to_plan(mission(), "my.toml"))
    again = json.loads(to_plan(read(plan)[0], "my.toml"))
    there = [one["params"] for one in plan["mission"]["items"]]
    back = [one["params"] for one in again["mission"]["items"]]
    assert len(there) == len(back) == 6
    for before, after in zip(there, back, strict=True):
        assert after[:4] == pytest.approx([before[0], before[1], after[2], before[3]])
        assert after[4:6] == pytest.approx(before[4:6], abs=1e-7)  # 1 cm
        assert after[6] == pytest.approx(before[6], abs=1e-3)
    corners = [one["geoFence"]["polygons"][0]["polygon"] for one in (plan, again)]
    assert corners[0] == [pytest.approx(corner, abs=1e-7) for corner in corners[1]]


def test_a_plan_drawn_in_qgroundcontrol_becomes_a_mission() -> None:
    home = LocalFrame(Wgs84(*ORIGIN.values()))
    corners = [home.to_wgs84((north, east, 0.0)) for east, north in FENCE]
    fence = {"inclusion": True, "polygon": [[at.lat_deg, at.lon_deg] for at in corners], "version": 1}
    plan = qgc(
        [TAKEOFF, simple(2000, 0, 5), item(16, 30, 0, 8, first=12), WAYPOINT, simple(20)],
        geoFence={"circles": [], "polygons": [fence], "version": 2},
        rallyPoints={"points": [[47.4, 8.5, 30]], "version": 2},
    )
    found, notes = read(plan)
    assert found.route.d1_enu_m == (0.0, 0.0, 8.0)
    assert [stop.model_dump() for stop in found.route.stops] == [{"pos_enu_m": (30.0, 0.0, 8.0), "duration_s": 12.0}]
    assert found.route.d2_enu_m == (80.0, 5.0, 9.0)
    assert found.route.at_end is AtEnd.RETURN
    assert found.route.vel_leader_mps == 4.0
    assert found.fence.polygon_enu_m == FENCE
    assert found.coverage.duration_s == 60.0  # no time is told
    for said in ("4 m/s, the plan's hover speed", "commands 2000", "rally points", "2 to 30 m"):
        assert said in notes


def test_heights_above_the_sea_count_from_the_origin() -> None:
    found, _ = read(qgc([item(22, 0, 0, 6, frame=0), item(19, 60, 0, 11, first=30, frame=0), item(21, 60, 0, 0)]))
    assert (found.route.d1_enu_m[2], found.route.d2_enu_m[2]) == (6.0, 11.0)
    assert found.coverage.duration_s == 30.0
    assert found.route.at_end is AtEnd.LAND


def test_a_takeoff_without_a_place_is_at_home() -> None:
    takeoff = {**TAKEOFF, "params": [0, 0, 0, None, 0, 0, 8]}
    assert read(qgc([takeoff, WAYPOINT]))[0].route.d1_enu_m == (0.0, 0.0, 8.0)


def test_the_missions_own_keys_stay_and_its_fence_goes_with_the_plans() -> None:
    found, notes = read(qgc([TAKEOFF, WAYPOINT]), mission())
    assert (found.swarm.size, found.name) == (5, "oaks")
    assert found.route.vel_leader_mps == 2.5
    assert found.route.stops == ()
    assert found.fence.polygon_enu_m is None
    assert "no fence in the plan" in notes
    assert found.coverage == mission().coverage


CASES: dict[str, tuple[dict[str, Any], str]] = {
    "not a plan": ({"fileType": "Mission"}, 'must be a plan of QGroundControl: JSON with "fileType": "Plan"'),
    "no mission": ({"fileType": "Plan"}, "mission = null: must be an object"),
    "no takeoff": (qgc([WAYPOINT]), "mission.items[0].command = 16: cannot be flown by a swarm, or not here"),
    "nothing": (qgc([]), "mission.items: must begin with a takeoff (command 22): d1"),
    "nowhere to fly": (qgc([TAKEOFF]), "mission.items: must hold a waypoint to fly to"),
    "a survey": (
        qgc([TAKEOFF, {"type": "ComplexItem", "complexItemType": "survey"}]),
        'mission.items[1] = "survey": must be a SimpleItem',
    ),
    "a jump": (qgc([TAKEOFF, WAYPOINT, simple(177, 2, 3)]), "mission.items[2].command = 177: cannot be flown"),
    "terrain": (qgc([TAKEOFF, item(16, 80, 5, 9, frame=10)]), "mission.items[1].frame = 10: must be relative to home"),
    "two speeds": (
        qgc([TAKEOFF, simple(178, 1, 3), WAYPOINT, simple(178, 1, 4)]),
        "mission.items[3].params[1] = 4: must be 3 as before: a swarm has one speed",
    ),
    "after the end": (qgc([TAKEOFF, WAYPOINT, simple(20), WAYPOINT]), "mission.items[3].command = 16: must not come"),
    "after a loiter without end": (qgc([TAKEOFF, item(17, 50, 0, 8), WAYPOINT]), "loiter at without end"),
    "lands elsewhere": (qgc([TAKEOFF, WAYPOINT, item(21, 10, 5, 0)]), "mission.items[2]: lands 70 m from d2"),
    "text for a number": (
        qgc([TAKEOFF, {**WAYPOINT, "params": [0, 0, 0, None, "47", 8.5, 8]}]),
        'mission.items[1].params = "47": must be a number',
    ),
    "too few parameters": (qgc([TAKEOFF, {**WAYPOINT, "params": [0]}]), "must be an array of 7"),
    "too far north": (
        qgc([TAKEOFF, {**WAYPOINT, "params": [0, 0, 0, None, 89.0, 8.5, 8]}]),
        "must be a latitude from -85 to 85",
    ),
    "too many items": (qgc([TAKEOFF] + [WAYPOINT] * MAX_ITEMS), f"must be at most {MAX_ITEMS}"),
    "a circle": (
        qgc([TAKEOFF, WAYPOINT], geoFence={"circles": [{"inclusion": True}], "polygons": []}),
        "must be empty: a mission's fence is one polygon",
    ),
    "a fence to stay out of": (
        qgc([TAKEOFF, WAYPOINT], geoFence={"circles": [], "polygons": [{"inclusion": False, "polygon": []}]}),
        "geoFence.polygons[0]: must be one to stay inside of",
    ),
    "two fences": (
        qgc([TAKEOFF, WAYPOINT], geoFence={"polygons": [{}, {}]}),
        "must be an array of at most one polygon",
    ),
    "a mission that cannot be": (qgc([TAKEOFF, item(16, 2, 0, 8)]), "route.d2_enu_m"),
}


@pytest.mark.parametrize("name", CASES)
def test_what_a_swarm_cannot_fly_is_refused_by_name(name: str) -> None:
    plan, said = CASES[name]
    assert said in refusal(plan)
    assert refusal(plan).startswith("my.plan: ")


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"fileType": NaN}', "[1]", '"Plan"', "1" * 5000])
def test_what_is_no_json_object_is_refused(text: str) -> None:
    with pytest.raises(MissionError):
        from_plan(text, "my.plan")


def test_a_mission_that_is_nowhere_on_earth_has_no_plan() -> None:
    values = mission().model_dump(by_alias=True)
    del values["origin"]
    with pytest.raises(MissionError, match=r"my\.toml: origin: missing"):
        to_plan(Mission.model_validate(values), "my.toml")


# The program


def run(*arguments: str | Path) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my.toml"
    path.write_text(dump_mission(mission()))
    return path


def test_export_and_import_give_the_mission_again(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, again = tmp_path / "my.plan", tmp_path / "again.toml"
    assert run("export", file, "--out", plan) == 0
    assert "4 positions, a fence of 4 vertices" in capsys.readouterr().out
    assert run("import", plan, "--mission", file, "--out", again) == 0
    assert "over 2 stops, at 2.5 m/s" in capsys.readouterr().out
    assert load_mission(again).visits == mission().visits
    assert run("import", plan, "--out", again) == 0
    text = again.read_text()
    assert load_mission(again).route.length_m == pytest.approx(mission().route.length_m, abs=0.01)
    assert "separation" not in text  # only what the plan says
    assert load_mission(again).swarm.size == 8


BAD: dict[str, tuple[Callable[[Path], list[str | Path]], int, str]] = {
    "a stem map": (lambda folder: ["import", "a.csv", "--out", folder / "x"], 2, "stem maps: mission forest import"),
    "no file": (lambda folder: ["import", folder / "no.plan", "--out", folder / "x"], 2, "no such file"),
    "no place": (lambda folder: ["export", folder / "my.toml", "--out", folder / "no" / "x"], 3, "cannot write"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_named_and_nothing_is_written(
    name: str, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, code, said = BAD[name]
    assert run(*arguments(tmp_path)) == code
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_lanes_go_out_as_waypoints_that_are_passed() -> None:
    surveys = mission(
        route={"stops": ()},
        coverage={"duration_s": 0.0},
        fence={"polygon_enu_m": ((-90.0, -90.0), (140.0, -90.0), (140.0, 90.0), (-90.0, 90.0))},
    )
    area = ((20.0, -20.0), (60.0, -20.0), (60.0, 20.0), (20.0, 20.0))
    values = {**surveys.model_dump(by_alias=True), "sensing": {"sensor": "scan-1deg"}, "survey": {"area_enu_m": area}}
    lanes = Mission.model_validate(values)
    items = json.loads(to_plan(lanes, "lanes"))["mission"]["items"]
    passed = [one["params"][1] for one in items if one["command"] == 16]
    assert passed == [2.0] * (2 * len(lanes.lanes))
    assert [one["command"] for one in items][-2:] == [19, 20]  # d2, and home
