"""The harness of point masses among trees: what it sees, counts and compares with."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mission as mission_package
from companion.core.model.events import ObstacleScan
from companion.core.model.states import SwarmPhase
from mission.common.problems import MissionError
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from mission.stand.stand import Stand, stand_of
from sim_bridge import cli
from sim_bridge.judge import estimate_recorder
from sim_bridge.lab.study.backends import agents
from sim_bridge.lab.study.engine import flown_row
from sim_bridge.lab.study.forest import flight as forest
from sim_bridge.lab.study.forest.air import Air, trunks_between
from sim_bridge.lab.study.forest.crew import Crew
from sim_bridge.lab.study.jobs import fly_batch
from sim_bridge.lab.study.law import law_module, law_params
from sim_bridge.lab.study.load import load_study
from sim_bridge.lab.study.results import must
from sim_bridge.lab.study.results.summary import summarise
from sim_bridge.trunk_attenuation import ANTENNA_UP_M

STUDIES = sorted((Path(mission_package.__file__).parent / "studies").glob("forest*.toml"))
SHORT = """\
schema = 1
route = { d1_enu_m = [0.0, 0.0, 4.0], d2_enu_m = [20.0, 0.0, 4.0], vel_leader_mps = 3.0 }
swarm.size = 2
coverage.duration_s = 0.0
sensing = {}
forest.stand.density_per_ha = 50.0
"""
STUDY = """\
schema = 1
missions = ["way.toml"]
seeds = 3
first_seed = 1000
[[run]]
name = "short"
law = "{law}"
[run.must]
{must}
"""
NORTH_TRUNK = np.array([[0.0, 5.0, 0.3, 20.0]])  # east, north, radius, top


def mission(n: int = 4, *, density: float | None = 400.0, way_m: float = 40.0, **tables: Any) -> Mission:
    values: dict[str, Any] = {
        "route": {"d1_enu_m": (0, 0, 4), "d2_enu_m": (way_m, 0, 4), "vel_leader_mps": 3.0},
        "swarm": {"size": n},
        "coverage": {"duration_s": 0.0},
        "sensing": {},
        "forest": {} if density is None else {"stand": {"density_per_ha": density}},
        "sim": {"radio_loss": 0.1, "radio_delay_s": 0.1, "seed": 7},
    }
    for name, changes in tables.items():
        values[name] = {**values.get(name, {}), **changes}
    return Mission.model_validate({"schema": 1, **values})


def fly(flown: Mission, law: str = "heading-scan", **params: float) -> forest.Figures:
    return forest.fly(flown, law, law_params(law, params, "test"))


# --- the air ---


def test_links_through_trunks_as_each_model_has_them() -> None:
    places = np.array([[0.0, 0.0, 4.0], [0.0, 10.0, 4.0], [0.0, 20.0, 4.0]])
    trunks = trunks_between(places, NORTH_TRUNK)
    assert trunks.tolist() == [[0, 1, 1], [1, 0, 0], [1, 0, 0]]
    distance_m = np.abs(places[:, 1] - places[:, 1][:, None])
    air = Air("disc", 6.0, 0.0, 2, np.random.default_rng(1))
    hear = {m: air.links(m, distance_m, trunks, np.full(3, 30.0)) for m in ("disc", "attenuated", "cut")}
    assert hear["disc"].all()
    assert hear["attenuated"][0, 1]  # 6 dB halve the range to 15 m
    assert not hear["attenuated"][0, 2]
    assert not hear["cut"][0, 1]
    assert hear["cut"][1, 2]


def test_trunks_in_the_way_are_those_of_the_stand() -> None:
    stand = stand_of(mission(density=600.0))
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(0.0, 40.0, 12), rng.uniform(-15.0, 15.0, 12), rng.uniform(2.0, 12.0, 12)])
    counted = trunks_between(places, forest.trunks_of(stand))
    up = np.array([0.0, 0.0, ANTENNA_UP_M])
    known = [[len(stand.crossed(a + up, b + up)) for b in places] for a in places]
    assert counted.sum() > 10
    assert counted.tolist() == known


def test_beacons_come_after_the_delay_and_some_are_lost() -> None:
    air = Air("disc", 6.0, 0.1, 2, np.random.default_rng(1))
    distance_m = np.full((50, 50), 10.0)
    for tick in range(20):
        air.send({0: "word"}, distance_m, np.zeros((50, 50)), np.full(50, 30.0), tick)
    assert air.deliver(1) == []
    heard = air.deliver(21)
    assert all(0 not in sent.receivers for sent in heard)
    assert sum(len(sent.receivers) for sent in heard) / (20 * 49) == pytest.approx(0.9, abs=0.03)


# --- flights ---


def test_one_alone_takes_the_straight_time_and_a_little() -> None:
    alone_s = fly(mission(density=None)).alone_s
    straight_s = 35.0 / 3.0
    assert straight_s < alone_s < straight_s + 1.5


def test_in_the_open_a_swarm_arrives_as_one_alone() -> None:
    figures = fly(mission(density=None))
    assert figures.arrived
    assert figures.contacts == 0
    assert figures.over_alone_leader == pytest.approx(0.0, abs=0.01)
    assert figures.connected_fraction_transit == 1.0


def test_a_vehicle_that_sees_nothing_hits_the_trunk_in_its_way_and_is_lost() -> None:
    # A field without reach: nothing keeps anybody from a trunk.
    figures = fly(mission(1, density=None, forest={"trees": [WALL]}), "potential-field", rho0_m=0.001)
    assert figures.contacts == figures.contacts_trunks == figures.lost == 1
    assert not figures.arrived
    assert figures.trunk_clearance_min_m is not None
    assert figures.trunk_clearance_min_m <= 0.35


WALL = {"base_enu_m": (20.0, 0.0), "trunk_radius_m": 2.0, "height_m": 20.0}


@pytest.mark.parametrize("law", ["ours", "heading-scan", "potential-field"])
def test_each_law_passes_a_sparse_stand(law: str) -> None:
    figures = fly(mission(density=50.0), law)
    assert figures.arrived
    assert figures.contacts == 0
    assert figures.trunk_clearance_min_m is not None
    assert 0.35 < figures.trunk_clearance_min_m < 8.0


def test_a_flight_is_its_seeds_and_each_seed_has_a_forest_of_its_own() -> None:
    first, again, other = (fly(mission(2).with_seed(seed)) for seed in (3, 3, 4))
    assert first == again
    assert first != other


def test_a_flight_does_not_depend_on_its_batch(tmp_path: Path) -> None:
    (tmp_path / "way.toml").write_text(SHORT, encoding="utf-8")
    text = STUDY.format(law="ours", must="contacts = { worst = 0 }")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    cases = load_study(tmp_path / "study.toml", most_seeds=2).cases
    together = fly_batch(cases).figures
    assert together == tuple(fly_batch((case,)).figures[0] for case in cases)
    assert together[0] != together[1]


def test_gusts_push_by_what_is_asked() -> None:
    flown = mission(4, density=None)
    flight = forest.Flight(flown, Stand(), gusts_mps=0.5)
    drawn = []
    for _ in range(4000):
        flight._gust.advance_time(0.05)
        drawn.append(flight._gust.now)
    rms = np.sqrt(np.mean(np.square(drawn), axis=(0, 1)))
    assert rms[:2] == pytest.approx(0.5, rel=0.05)
    assert rms[2] == pytest.approx(0.25, rel=0.05)


def test_autopilots_hold_the_place_of_their_takeoff_in_gusts() -> None:
    strayed_m = []
    for seed in (1, 2):
        flight = forest.Flight(mission(8, density=None, sim={"seed": seed}), Stand(), gusts_mps=0.6)
        starts = flight.pos_enu_m
        while not flight.crew.steered.any():
            flight.tick()
        off = (flight.pos_enu_m - starts)[:, :2]
        strayed_m.append(np.sqrt((off * off).sum(axis=1)))
    assert np.mean(np.square(strayed_m)) < 1.0


def test_agents_get_scans_at_the_missions_rate_and_leaning_as_they_do() -> None:
    flown = mission(2, density=None, sensing={"rate_hz": 5.0, "stale_s": 0.5})
    flight = forest.Flight(flown, stand_of(flown))
    seen: dict[int, list[tuple[float, ObstacleScan]]] = {0: [], 1: []}
    hand_over = flight.crew.receive_scan

    def note(row: int, scan: ObstacleScan, now_s: float) -> None:
        seen[row].append((now_s, scan))
        hand_over(row, scan, now_s)

    flight.crew.receive_scan = note  # type: ignore[method-assign]
    for _ in range(400):
        flight.tick()
    for scans in seen.values():
        assert len(scans) == 100
        assert scans[1][0] - scans[0][0] == pytest.approx(0.2)
        assert all(scan.roll_rad == scan.pitch_rad == 0.0 for now_s, scan in scans if now_s < 1.0)
        assert any(abs(scan.pitch_rad) > 0.05 for _, scan in scans)


def test_a_vehicle_leans_the_way_it_accelerates() -> None:
    roll, pitch, yaw = forest.lean((0.0, 3.0, 0.0), 0.0)  # to the north, facing north: nose down
    assert pitch == pytest.approx(-math.atan2(3.0, 9.80665))
    assert (roll, yaw) == (pytest.approx(0.0), 0.0)
    roll, pitch, _ = forest.lean((3.0, 0.0, 0.0), 0.0)  # to the east: right side down
    assert roll == pytest.approx(math.atan2(3.0, 9.80665))
    assert pitch == pytest.approx(0.0)


def test_a_lost_vehicle_is_silent_and_the_others_fly_on() -> None:
    flown = mission(4, density=None)
    flight = forest.Flight(flown, Stand())
    while flight.crew.phase < SwarmPhase.TRANSIT:
        flight.tick()
    leader = flight.crew.leader
    assert leader is not None
    flight.watch.alive[leader] = False
    figures = flight.fly(math.nan)
    assert figures.leader_changes == 1
    assert figures.arrival_leader_s is not None
    assert not figures.arrived


def test_agents_of_another_law_see_no_trees_themselves() -> None:
    flown = mission(2)
    stages = [law_module("heading-scan").stage(flown, law_module("heading-scan").Params()) for _ in range(2)]
    assert all(seat.agent.mission.sensing is None for seat in Crew(flown, stages).seats)
    assert all(seat.agent.mission.sensing is not None for seat in Crew(flown).seats)


@pytest.mark.parametrize("file", STUDIES, ids=[file.stem for file in STUDIES])
def test_every_study_that_comes_along_is_sound(file: Path) -> None:
    seeds = {case.mission.sim.seed for case in load_study(file, most_seeds=2).cases}
    assert min(seeds) >= 1000 or max(seeds) <= 199  # of reports, of tuning


def test_a_study_says_what_its_cases_reach_and_miss(tmp_path: Path) -> None:
    (tmp_path / "way.toml").write_text(SHORT, encoding="utf-8")
    text = STUDY.format(law="heading-scan", must="contacts = { worst = 0 }\nover_alone_last = { mean = -0.5 }")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(tmp_path / "study.toml", most_seeds=1)
    assert [case.mission.sim.seed for case in study.cases] == [1000]
    rows = [flown_row(case, fly_batch((case,)).figures[0]) for case in study.cases]
    [group] = summarise(rows)
    verdicts = must.judge(group, "", study.study.run[0].must)
    assert [(v.figure, v.reached) for v in verdicts] == [("contacts", True), ("over_alone_last", False)]
    assert not must.judge(group, "", {"coverage_settled_s": {"mean": 1.0}})[0].reached  # none has it


@pytest.mark.parametrize(("limit", "code"), [("contacts = { worst = 0 }", 0), ("over_alone_last = { mean = -0.5 }", 1)])
def test_a_missed_limit_is_told_by_the_exit_code(tmp_path: Path, limit: str, code: int) -> None:
    (tmp_path / "way.toml").write_text(SHORT, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY.format(law="heading-scan", must=limit), encoding="utf-8")
    options = ["--out", str(tmp_path / "out"), "--seeds", "1", "--workers", "1"]
    assert cli.main(["study", str(tmp_path / "study.toml"), *options]) == code
    assert [v["reached"] for v in json.loads((tmp_path / "out" / "must.json").read_text())] == [code == 0]


@pytest.mark.parametrize(
    ("law", "limits", "named"),
    [
        ("vasarhelyi", "contacts = { worst = 0 }", "passes no trees"),
        ("heading-scan", "contact = { worst = 0 }", "run[0].must.contact"),
        ("heading-scan", "contacts = { median = 0 }", "run[0].must.contacts.median"),
    ],
)
def test_a_study_with_a_wrong_law_or_limit_is_refused(tmp_path: Path, law: str, limits: str, named: str) -> None:
    (tmp_path / "way.toml").write_text(SHORT, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY.format(law=law, must=limits), encoding="utf-8")
    with pytest.raises(MissionError, match=re.escape(named)):
        load_study(tmp_path / "study.toml")


@pytest.mark.parametrize("changes", [{}, {"sensing": None}], ids=["among trees", "open field"])
def test_a_study_of_point_masses_with_stops_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    stops = [{"pos_enu_m": (40.0, 40.0, 4.0)}]
    flown = mission(2, density=None, way_m=80.0, route={"stops": stops}).model_copy(update=changes)
    (tmp_path / "way.toml").write_text(dump_mission(flown), encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY.format(law="ours", must=""), encoding="utf-8")
    with pytest.raises(MissionError, match=r'run\[0\].backend = "point-mass": flies no stops, and way.toml has some'):
        load_study(tmp_path / "study.toml")


def test_a_study_of_point_masses_by_raw_scans_is_refused(tmp_path: Path) -> None:
    flown = mission(2, density=None, way_m=80.0)
    assert flown.sensing is not None
    raw = flown.model_copy(update={"sensing": flown.sensing.model_copy(update={"sensor": SensorClass.SCAN_1DEG})})
    (tmp_path / "way.toml").write_text(dump_mission(raw), encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY.format(law="ours", must=""), encoding="utf-8")
    with pytest.raises(MissionError, match=r'"point-mass": flies by sectors alone, and way.toml has another'):
        load_study(tmp_path / "study.toml")


def test_a_study_of_the_whole_stack_flies_one_alone_once_for_all_its_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "way.toml").write_text(SHORT, encoding="utf-8")
    text = STUDY.format(law="ours", must="arrived = { mean = 1 }").replace("law =", 'backend = "jsbsim"\nlaw =')
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    flown: list[int] = []

    def fly(mission: Mission, *_args: Any, **_options: Any) -> SimpleNamespace:
        assert len(flown) < 10, "without end"
        flown.append(mission.swarm.size)
        figures = {"arrival_leader_s": 7.0 + mission.swarm.size, "arrival_last_s": None}
        summary = dict.fromkeys(("ended", "verdict", "grade", "trace_hash", *estimate_recorder.definitions()))
        return SimpleNamespace(metrics=SimpleNamespace(as_dict=lambda: figures), summary=summary)

    monkeypatch.setattr(agents.fly, "fly", fly)
    done = fly_batch(load_study(tmp_path / "study.toml").cases)
    assert [figures["over_alone_leader"] for figures in done.figures] == [pytest.approx(0.125)] * 3
    assert sorted(flown) == [1, 2, 2, 2]


def test_flights_of_the_whole_stack_are_compared_with_one_alone_too(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Mission] = []

    def alone_s(mission_json: str, on_jsbsim: bool) -> float:
        assert on_jsbsim
        asked.append(Mission.model_validate_json(mission_json))
        return 40.0

    monkeypatch.setattr(agents, "_alone_s", alone_s)
    figures = {"arrival_leader_s": 42.0, "arrival_last_s": None}
    found = agents._over_alone(figures, mission(8, sim={"turbulence_mps": 3.0}), on_jsbsim=True)
    assert found == {"alone_s": 40.0, "over_alone_leader": pytest.approx(0.05), "over_alone_last": None}
    assert asked[0].swarm.size == 1
    assert asked[0].forest.stand is None
    assert asked[0].sim.turbulence_mps == 0.0
    assert asked[0].sensing is not None
