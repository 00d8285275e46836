"""The page's flight is the bridge's, and its view is told what viewers of the live map are told."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from docs.website.native.__main__ import flown as flown_natively
from docs.website.world.feed import Feed
from docs.website.world.flight import PageFlight
from docs.website.world.here import CONTROLS, Here
from docs.website.world.settings import SETTINGS, Settings
from mission.common.problems import MissionError
from mission.document.load import dump_mission
from sim_bridge.judge.live.feed import Feed as LiveFeed
from sim_bridge.judge.recording import Recorder
from tests.flights import flown

OPEN = {"size": 3, "range_m": 25, "density_per_ha": 0, "seed": 2, "loss": 0.2}
AMONG_TREES = {"size": 3, "range_m": 30, "density_per_ha": 200, "seed": 3}


def test_it_has_the_trace_of_the_bridges_own_flight(tmp_path: Path) -> None:
    mission = Settings.read(OPEN).mission()
    flight = PageFlight(mission)
    while flight.ended is None:
        flight.tick()
    ticks, trace = 0, ""

    def watch(one: Any) -> None:
        nonlocal ticks, trace
        one.record()
        ticks += 1
        if ticks == flight.ticks:
            trace = one.trace.hexdigest()

    flown(mission, tmp_path, watch=watch)
    assert flight.ended == "coverage of 45 s flown"
    assert flight.trace.hexdigest() == trace


def test_a_kill_at_a_tick_is_the_same_flight_again() -> None:
    kills = ["200:1", "220:3"]
    once, again = (flown_natively(json.dumps(AMONG_TREES), kills, 300, 100) for _ in range(2))
    assert once == again
    assert once["trace"] != flown_natively(json.dumps(AMONG_TREES), kills[:1], 300, None)["trace"]


@pytest.mark.parametrize("settings", [OPEN, AMONG_TREES], ids=["open", "trees"])
def test_rows_are_those_of_the_live_map(tmp_path: Path, settings: dict[str, Any]) -> None:
    mission = Settings.read(settings).mission()
    file = tmp_path / "mission.toml"
    file.write_text(dump_mission(mission), encoding="utf-8")
    flight = PageFlight(mission)
    feed, theirs, recorder = Feed(flight, "a flight"), LiveFeed(file, "a flight", tmp_path), Recorder()
    first = feed.first(CONTROLS, {"paused": False, "factor": 2.0})
    snapshot = theirs.snapshot([], [], [])
    assert first["replay"].keys() == snapshot.keys()
    for name in ("stand", "mission", "title", "seed", "format", "version", "mission_toml"):
        assert first["replay"][name] == snapshot[name], name
    assert first["replay"]["swarm"].keys() == snapshot["swarm"].keys()
    compared = 0
    for tick in range(1, 900):
        flight.tick()
        recorder.add(flight.last)
        if tick % 50 and tick < 860:
            continue
        told = {"row": recorder.last, "yaw_deg": [0.0] * 3, "beacon_age_s": [0.0] * 3}
        drawn, _ = theirs.drawn(json.dumps(told).encode(), [])
        row, wanted = json.loads(json.dumps(feed.row())), json.loads(drawn)
        for left_out in ("lambda2", "gap_deg"):
            del row["swarm"][left_out], wanted["swarm"][left_out]
        for own in ("yaw_deg", "beacon_age_s"):
            del row["vehicles"][own], wanted["vehicles"][own]
        assert row == wanted, tick
        compared += 1
    assert compared > 40


def test_a_ring_leaves_the_gap_that_it_leaves(tmp_path: Path) -> None:
    mission = Settings.read({**OPEN, "loss": 0.0}).mission()
    file = tmp_path / "mission.toml"
    file.write_text(dump_mission(mission), encoding="utf-8")
    flight = PageFlight(mission)
    feed, theirs, recorder = Feed(flight, "a flight"), LiveFeed(file, "a flight", tmp_path), Recorder()
    while flight.ended is None:
        flight.tick()
        recorder.add(flight.last)
    drawn, _ = theirs.drawn(
        json.dumps({"row": recorder.last, "yaw_deg": [0.0] * 3, "beacon_age_s": [0.0] * 3}).encode(), []
    )
    assert feed.row()["swarm"]["gap_deg"] == pytest.approx(json.loads(drawn)["swarm"]["gap_deg"], abs=0.01)


@pytest.fixture
def fly_on(monkeypatch: pytest.MonkeyPatch) -> Callable[[Here, int], list[dict[str, Any]]]:
    """Turns of a page whose clock goes on by 10 ms at each look."""
    now = [0.0]

    def clock() -> float:
        now[0] += 0.01
        return now[0]

    monkeypatch.setattr("docs.website.world.here.time.monotonic", clock)

    def turns(here: Here, count: int) -> list[dict[str, Any]]:
        return [json.loads(here.turn(0.05)) for _ in range(count)]

    return turns


def test_a_leader_is_killed_from_the_page_and_another_leads(fly_on: Callable[..., list[dict[str, Any]]]) -> None:
    here = Here()
    first = json.loads(here.begin(json.dumps(AMONG_TREES)))
    assert first["controls"] == list(CONTROLS)
    here.ask('{"do": "speed", "factor": null}')
    told = fly_on(here, 100)
    leaders = [one["figures"]["leader"] for one in told]
    assert leaders[-1] == 1
    here.ask('{"do": "kill"}')
    here.ask('{"do": "kill", "vehicle": 1}')  # it has ended by then
    told = fly_on(here, 120)
    events = [event["text"] for one in told if one["view"] for event in one["view"].get("events", ())]
    assert events[0] == "companion of vehicle 1 killed"
    assert events[1] == "not done: vehicle 1 has no companion"
    assert any(text in ("vehicle 2 leads", "vehicle 3 leads") for text in events)
    figures = told[-1]["figures"]
    (kill,) = figures["kills"]
    again = flown_natively(json.dumps(AMONG_TREES), ["{}:{}".format(*kill)], figures["ticks"], None)
    assert again["trace"] == figures["trace"]


def test_it_pauses_steps_and_goes_on(fly_on: Callable[..., list[dict[str, Any]]]) -> None:
    here = Here()
    here.begin(json.dumps(OPEN))
    here.ask('{"do": "pause"}')
    told = fly_on(here, 5)
    assert told[-1]["figures"]["ticks"] == 0
    assert told[0]["view"]["pace"] == {"paused": True, "factor": 2.0}
    here.ask('{"do": "step"}')
    assert fly_on(here, 5)[-1]["figures"]["ticks"] == 1
    here.ask('{"do": "resume"}')
    assert fly_on(here, 50)[-1]["figures"]["ticks"] > 1
    here.ask('{"do": "speed", "factor": 1e9}')
    (event,) = [event for one in fly_on(here, 3) if one["view"] for event in one["view"].get("events", ())]
    assert event["text"].startswith("not done: speed 1e+09: must be")


def test_it_ends_with_a_verdict(fly_on: Callable[..., list[dict[str, Any]]]) -> None:
    here = Here()
    here.begin(json.dumps({**OPEN, "size": 2, "loss": 0.0}))
    here.ask('{"do": "speed", "factor": null}')
    told = fly_on(here, 1500)
    (over,) = [one["view"]["over"] for one in told if one["view"] and "over" in one["view"]]
    assert over["verdict"]["succeeded"]
    assert over["verdict"]["text"].startswith("2 of 2 companions around the tree, least separation ")
    assert told[-1]["figures"]["ended"] == "coverage of 45 s flown"


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"size": 1}, "size = 1: must be 2 to 12"),
        ({"size": 2.5}, "size = 2.5: must be a whole number"),
        ({"loss": math.nan}, "loss = nan: must be 0 to 0.6"),
        ({"seed": "1"}, "seed = 1: must be 1 to 99"),
    ],
)
def test_settings_out_of_bounds_are_named(values: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        Settings.read(values)
    assert json.loads(Here().begin(json.dumps(values))) == {"wrong": why}


def test_sliders_at_their_ends_make_missions_that_may_be_flown() -> None:
    for size in (SETTINGS["size"].least, SETTINGS["size"].most):
        for range_m in (SETTINGS["range_m"].least, SETTINGS["range_m"].most):
            for density in (0, 25, SETTINGS["density_per_ha"].most):
                wanted = {"size": size, "range_m": range_m, "density_per_ha": density}
                try:
                    Settings.read(wanted).mission()
                except MissionError as error:
                    pytest.fail(f"{wanted}: {error}")
    usual = {name: setting.usual for name, setting in SETTINGS.items()}
    assert Settings.read(usual) == Settings()
