"""A flight that is watched: nothing that is looked at changes it, and what a viewer does can be flown again."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.live.live import Live
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.live.pace import Pace
from sim_bridge.judge import run_folder
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.run_folder import load_faults
from tests.flights import flown, point_masses, short_mission


class Viewer:
    """Stands in for a Map with one viewer, who asks for `wishes` when a row of their time is shown."""

    def __init__(self, wishes: Sequence[tuple[float, Mapping[str, Any]]] = ()) -> None:
        self.viewers, self.gone, self.url = 1, None, ""
        self.rows: list[float] = []
        self.events: list[str] = []
        self.told: list[Mapping[str, Any]] = []
        self.faults: list[Mapping[str, Any]] = []
        self.begun: tuple[Path, str, int] | None = None
        self._wishes = list(wishes)

    def begin(self, mission_file: Path, title: str, size: int) -> None:
        self.begun = (mission_file, title, size)

    def due(self, _now_s: float) -> bool:
        return True

    def row(self, row: Sequence[Any], yaws_deg: Sequence[Any], ages_s: Sequence[Any]) -> None:
        assert len(yaws_deg) == len(ages_s) == len(row[1])
        self.rows.append(row[0])

    def event(self, _time_s: float, text: str) -> None:
        self.events.append(text)

    def fault(self, fault: Mapping[str, Any]) -> None:
        self.faults.append(fault)

    def send_changes(self, **values: Any) -> None:
        self.told.append(values)

    def asked(self, _wait_s: float = 0.0) -> list[Mapping[str, Any]]:
        now_s = self.rows[-1] if self.rows else 0.0
        due = [wish for at_s, wish in self._wishes if at_s <= now_s]
        self._wishes = [(at_s, wish) for at_s, wish in self._wishes if at_s > now_s]
        return due


def watched(mission: Mission, folder: Path, viewer: Viewer, airframes: Any = point_masses) -> fly.Outcome:
    folder.mkdir(parents=True, exist_ok=True)
    pace = Pace(None, Skipping())
    with Progress(io.StringIO()) as progress:
        live = Live(viewer, pace, "short")  # type: ignore[arg-type]
        return fly.fly(mission, folder, progress, in_process=True, airframes=airframes, live=live)


class Skipping:
    """A wall clock on which nothing is ever early."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def __call__(self) -> float:
        self._now_s += 10.0
        return self._now_s


@pytest.fixture(scope="module")
def mission() -> Mission:
    return short_mission(swarm={"size": 4}, coverage={"duration_s": 5.0})


@pytest.fixture(scope="module")
def unwatched(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> str:
    outcome, _ = flown(mission, tmp_path_factory.mktemp("unwatched"))
    trace: str = outcome.summary["trace_hash"]
    return trace


def test_a_map_a_viewer_pauses_and_steps_leave_the_flight_as_it_is_to_the_bit(
    mission: Mission, unwatched: str, tmp_path: Path
) -> None:
    wishes = [(10.0, {"do": "pause"}), (10.0, {"do": "step"}), (10.05, {"do": "step"}), (10.1, {"do": "resume"})]
    viewer = Viewer([*wishes, (20.0, {"do": "speed", "factor": 20.0})])
    outcome = watched(mission, tmp_path, viewer)
    assert outcome.summary["trace_hash"] == unwatched
    assert viewer.rows == sorted(set(viewer.rows))
    assert viewer.begun == (tmp_path / "mission.toml", "short", 4)
    assert {"pace": {"paused": True, "factor": 5.0}} in viewer.told
    assert viewer.told[-1] == {"pace": {"paused": False, "factor": 20.0}}
    said = [text for text in viewer.events if text in ("paused on the map", "goes on")]
    assert said == ["paused on the map", "goes on"]


def test_a_leader_killed_from_the_map_is_a_fault_of_the_mission_that_flies_the_same_again(
    mission: Mission, unwatched: str, tmp_path: Path
) -> None:
    viewer = Viewer([(25.0, {"do": "kill"})])
    outcome = watched(mission, tmp_path / "first", viewer)
    (fault,) = load_faults(tmp_path / "first")
    assert (fault.at_s, len(fault.vehicles)) == (25.05, 1)  # the tick after the row that was seen
    assert [told["vehicles"] for told in viewer.faults] == [fault.vehicles]
    assert f"fault: vehicle {fault.vehicles[0]} killed" in viewer.events
    assert outcome.metrics.lost == fault.vehicles
    assert outcome.summary["trace_hash"] != unwatched
    kept = load_mission(tmp_path / "first" / "mission.toml")
    assert kept == outcome.mission
    again, _ = flown(kept, tmp_path / "again")
    assert again.summary["trace_hash"] == outcome.summary["trace_hash"]
    assert again.summary["mission_sha256"] == outcome.summary["mission_sha256"]


def test_a_radio_lost_from_the_map_is_one_that_a_mission_can_hold(mission: Mission, tmp_path: Path) -> None:
    viewer = Viewer([(25.0, {"do": "radio", "vehicle": 3, "for_s": 4})])
    outcome = watched(mission, tmp_path / "first", viewer)
    (fault,) = load_faults(tmp_path / "first")
    assert (fault.kind.value, fault.vehicles, fault.until_s) == ("partition", (3,), pytest.approx(29.05))
    again, _ = flown(load_mission(tmp_path / "first" / "mission.toml"), tmp_path / "again")
    assert again.summary["trace_hash"] == outcome.summary["trace_hash"]


def test_wind_from_the_map_moves_the_swarm_and_is_one_that_a_mission_can_hold(tmp_path: Path) -> None:
    calm = short_mission(swarm={"size": 2}, coverage={"duration_s": 1.0})
    north_m = []
    for name, wishes in (("calm", []), ("wind", [(12.0, {"do": "wind", "wind_mps": [0, 6]})])):
        outcome = watched(calm, tmp_path / name, Viewer(wishes), airframes=None)
        recording = run_folder.load(tmp_path / name)
        north_m.append(recording.pos_ned_m[recording.time_s < 14.0, :, 0])
    pushed_m = north_m[1] - north_m[0]
    assert (pushed_m[-1] > 0.05).all()  # to the north, before the autopilot holds against it
    assert (pushed_m[:200] == 0.0).all()
    (fault,) = load_faults(tmp_path / "wind")
    assert (fault.vehicles, fault.wind_mps) == ((1, 2), (0.0, 6.0))
    again, _ = flown(load_mission(tmp_path / "wind" / "mission.toml"), tmp_path / "again", point_mass=False)
    assert again.summary["trace_hash"] == outcome.summary["trace_hash"]


@pytest.mark.parametrize(
    ("wish", "why"),
    [
        ({"do": "kill", "vehicle": 9}, "not done: the map: sim.faults[0].vehicles = [9]"),
        ({"do": "kill", "vehicle": "leader"}, "not done: vehicle leader: must be an id"),
        ({"do": "kill"}, "not done: no vehicle leads now"),
        ({"do": "radio", "vehicle": 1, "for_s": -2}, "not done: the map: sim.faults[0].for_s = -2"),
        ({"do": "radio", "vehicle": 1, "for_s": "long"}, "not done: for_s long: must be a number"),
        ({"do": "speed", "factor": 0}, "not done: speed 0: must be 0.05 to 1000"),
        ({"do": "wind"}, "not done: the map: sim.faults[0] = a table: wind: needs wind_mps"),
        ({"do": "wind", "wind_mps": "strong"}, "not done: the map: sim.faults[0].wind_mps"),
        ({"do": "fly"}, "not done: fly: must be one of pause, resume, step, speed"),
        ({}, "not done: None: must be one of"),
    ],
)
def test_a_wish_that_cannot_be_is_refused_in_words_and_changes_nothing(
    wish: dict[str, Any], why: str, mission: Mission, unwatched: str, tmp_path: Path
) -> None:
    viewer = Viewer([(1.0, wish)])
    if len(wish) == 1 and wish != {"do": "kill"}:  # one whole flight is enough to show the second half of the name
        assert watched(mission, tmp_path, viewer).summary["trace_hash"] == unwatched
    else:
        watched(
            mission.model_copy(update={"sim": mission.sim.model_copy(update={"time_limit_s": 3.0})}), tmp_path, viewer
        )
    assert [text for text in viewer.events if text.startswith(why)]
    assert load_faults(tmp_path) == ()


def test_wind_that_no_point_mass_feels_is_refused_and_is_no_fault_of_the_flight(
    mission: Mission, unwatched: str, tmp_path: Path
) -> None:
    viewer = Viewer([(1.0, {"do": "wind", "wind_mps": [0, 6]})])
    assert watched(mission, tmp_path, viewer).summary["trace_hash"] == unwatched
    assert [text for text in viewer.events if text.startswith("not done: wind 1,2") and "none of these" in text]
    assert load_faults(tmp_path) == ()
    assert not load_mission(tmp_path / "mission.toml").sim.faults


def test_the_map_of_a_flight_serves_its_rows_and_ends_with_it(mission: Mission, unwatched: str, tmp_path: Path) -> None:
    map_ = Map(("127.0.0.1", 0), ())
    try:
        with Progress(io.StringIO()) as progress:
            live = Live(map_, Pace(), "short")
            outcome = fly.fly(mission, tmp_path, progress, in_process=True, airframes=point_masses, live=live)
        assert outcome.summary["trace_hash"] == unwatched
        assert map_.gone is None
    finally:
        map_.close()


def test_a_map_whose_process_is_gone_is_told_once_and_the_flight_goes_on(
    mission: Mission, unwatched: str, tmp_path: Path
) -> None:
    map_ = Map(("127.0.0.1", 0), ())
    map_.close()
    shown = io.StringIO()
    with Progress(shown) as progress:
        live = Live(map_, Pace(), "short")
        outcome = fly.fly(mission, tmp_path, progress, in_process=True, airframes=point_masses, live=live)
    assert outcome.summary["trace_hash"] == unwatched
    assert shown.getvalue().count("the map is gone") == 1
