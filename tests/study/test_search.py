"""`sim-bridge search`: what is drawn, what is looked at in every tick, how failures shrink, and the program."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.document import simulator
from mission.document.barometer import find_lacking_room
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.schema.kinds import FaultKind, SensorClass
from sim_bridge import cli
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.tick import Tick
from sim_bridge.lab.search import draw as drawing
from sim_bridge.lab.search import flight, program, shrink, summary
from sim_bridge.lab.search.draw import MOST_FAULTS, Drawn, draw
from sim_bridge.lab.search.invariants import Alone, Pilots, Progress, Setpoints
from sim_bridge.lab.study.jobs import Done
from sim_bridge.world.autopilot import Px4Mode
from tests.flights import short_mission
from tests.unit.judge.tick_kit import a_tick

SEEDS = range(1000, 1300)


@pytest.fixture(scope="module")
def missions() -> list[Mission]:
    return [draw(seed).mission for seed in SEEDS]


def test_a_seed_draws_the_same_mission_again(missions: list[Mission]) -> None:
    assert [draw(seed).mission for seed in SEEDS[:20]] == missions[:20]
    assert len({mission.model_dump_json(exclude={"name": True, "sim": {"seed"}}) for mission in missions}) == len(SEEDS)


def test_all_that_can_be_drawn_is_drawn(missions: list[Mission]) -> None:
    assert {mission.swarm.size for mission in missions} == set(range(3, 13))
    assert {len(mission.sim.faults) for mission in missions} >= set(range(MOST_FAULTS + 2))
    assert {fault.kind for mission in missions for fault in mission.sim.faults} == set(FaultKind)
    assert {fault.vehicles is None for mission in missions for fault in mission.sim.faults} == {True, False}
    assert len({mission.route.at_end for mission in missions}) == 3
    for seen in (
        {mission.forest.stand is None for mission in missions},
        {mission.flies_by_ranges for mission in missions},
        {bool(mission.route.stops) for mission in missions},
        {mission.sensing is None for mission in missions},
        {mission.forest.grade == (0.0, 0.0) for mission in missions},
        {mission.survey is None for mission in missions},
        {mission.survey.area_enu_m is None for mission in missions if mission.survey},
        {mission.survey.until is None for mission in missions if mission.survey},
        {mission.survey.rise_to_m is None for mission in missions if mission.survey},
        {mission.sensing.upside_down for mission in missions if mission.sensing},
        {mission.forest.shapes is None for mission in missions if mission.survey and mission.forest.stand},
    ):
        assert seen == {True, False}
    assert len({mission.sim.radio_trunks for mission in missions}) == 3
    assert {mission.sensing.sensor for mission in missions if mission.sensing is not None} == set(SensorClass)


def test_most_missions_among_trees_have_range_finders_and_the_others_room_for_a_barometer(
    missions: list[Mission],
) -> None:
    """Seeds 20132, 20196, 20245, 20330, 20334, 20438 had no such room: above the fence's top, or on the ground."""
    among = [mission for mission in missions if mission.forest.stand is not None]
    assert 0.7 < sum(mission.sim.range_finder for mission in among) / len(among) < 0.95
    assert {mission.sim.range_finder for mission in missions if mission.forest.stand is None} == {True, False}
    assert [find_lacking_room(mission) for mission in missions] == [""] * len(missions)
    assert not [mission for mission in missions if mission.sim.range_finder and any(mission.forest.grade)]


def test_the_simulated_vehicles_can_fly_what_is_drawn(missions: list[Mission]) -> None:
    """Seed 10052 had drawn SIH's drag in 6.6 m/s of wind: all drifted away at 0.9 m/s."""
    assert [simulator.problems(mission, "drawn") for mission in (*missions, draw(10052).mission)] == [()] * 301


def test_further_faults_mostly_begin_together_with_the_one_before(missions: list[Mission]) -> None:
    pairs = [mission.sim.faults[:2] for mission in missions if len(mission.sim.faults) > 1]
    together = sum(a.phase is b.phase and 0.0 <= b.at_s - a.at_s <= (a.for_s or 5.0) + 5.0 for a, b in pairs)
    assert together > 0.5 * len(pairs)


def test_a_seed_without_a_possible_mission_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    tables = {"schema": 1, "swarm": {"size": 3}}  # no route
    monkeypatch.setattr(drawing, "_tables", lambda *_: tables | {"sim": {"faults": []}})
    with pytest.raises(drawing.DrawError, match="seed 7: none of 200"):
        draw(7)


def seen(
    tick: Tick,
    *,
    told: Mapping[int, bytes] = MappingProxyType({}),
    sent: Mapping[int, bytes] = MappingProxyType({}),
    companions: Sequence[int] = (1, 2),
    happened: Sequence[FaultEvent] = (),
) -> Any:
    """As much of a flight as invariants look at."""
    lockstep = SimpleNamespace(to_companion=told, from_companion=sent, companions=companions)
    return SimpleNamespace(last=tick, lockstep=lockstep, faults=SimpleNamespace(happened=happened))


@pytest.mark.parametrize(
    ("asked", "violated"),
    [
        ((3.0, 4.0, 0.0), False),
        ((3.1, 4.2, 0.0), True),
        ((0.0, 0.0, -1.6), True),
        ((float("nan"), 0.0, 0.0), True),
        ((float("inf"), 0.0, 0.0), True),
        (None, False),
    ],
)
def test_a_setpoint_beyond_the_limits_is_seen(asked: Any, violated: bool) -> None:
    setpoints = Setpoints(short_mission())  # 5 m/s, 1.5 m/s up and down
    setpoints.check_flight(seen(a_tick(2.5, n=2, asked_ned_mps=(None, asked))))
    assert bool(setpoints.violation) is violated
    if violated:
        assert setpoints.violation.startswith("setpoint of vehicle 2 at 2.50 s")


def frame(message: Any, *, system: int = 2, component: int = 1) -> bytes:
    return wire.pack(message, seq=0, system=system, component=component)


def heartbeat(mode: int, *, armed: bool = True) -> bytes:
    base = dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return frame(dialect.MAVLink_heartbeat_message(2, 12, base, mode, 4, 3))


def order(command: int) -> bytes:
    return frame(dialect.MAVLink_command_long_message(2, 1, command, 0, *[0.0] * 7), component=191)


SETPOINT = frame(
    dialect.MAVLink_set_position_target_local_ned_message(0, 2, 1, 1, 0, *[0.0] * 3, 1.0, *[0.0] * 7), component=191
)


@pytest.mark.parametrize(
    ("sent", "violated"),
    [
        (SETPOINT, True),
        (order(dialect.MAV_CMD_DO_SET_MODE), True),
        (order(dialect.MAV_CMD_COMPONENT_ARM_DISARM), True),
        (order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL), False),
        (heartbeat(0, armed=False), False),
    ],
)
def test_what_steers_after_a_takeover_is_seen(sent: bytes, violated: bool) -> None:
    pilots = Pilots(short_mission())
    for told, when_s in ((heartbeat(Px4Mode.OFFBOARD), 1.0), (heartbeat(Px4Mode.POSCTL, armed=False), 2.0)):
        pilots.check_flight(seen(a_tick(when_s), told={2: told}, sent={2: SETPOINT}))
    assert not pilots.violation
    pilots.check_flight(seen(a_tick(3.0), told={2: heartbeat(Px4Mode.POSCTL)}))
    pilots.check_flight(seen(a_tick(3.05), told={2: b""}, sent={2: sent}))
    assert bool(pilots.violation) is violated


def test_a_vehicle_that_is_handed_back_may_be_steered() -> None:
    pilots = Pilots(short_mission())
    pilots.check_flight(seen(a_tick(3.0), told={2: heartbeat(Px4Mode.POSCTL) + order(dialect.MAV_CMD_MISSION_START)}))
    pilots.check_flight(seen(a_tick(3.05), told={2: b""}, sent={2: SETPOINT}))
    assert not pilots.violation


def stands(until_s: float, state: FlightState, *, moves_m: float = 0.0, happened: Sequence[FaultEvent] = ()) -> str:
    progress = Progress(short_mission())
    said = {k: SimpleNamespace(flight_state=state if k == 2 else FlightState.TRANSIT) for k in (1, 2)}
    for second in range(round(until_s) + 1):
        places = ((0.0, 0.0, -4.0), (0.0, 7.0 + moves_m * second, -4.0))
        tick = a_tick(float(second), n=2, said=said, pos_ned_m=places)
        progress.check_flight(seen(tick, happened=happened))
    return progress.violation


def test_vehicles_that_wait_for_one_another_are_seen() -> None:
    late = FaultEvent(FaultKind.LATE, (1,), 0.0, 20.0, late_s=1.0)
    kill = FaultEvent(FaultKind.KILL, (3,), 0.0)
    assert "vehicles 1, 2 stand still on their way since 0 s" in stands(61.0, FlightState.TRANSIT)
    assert not stands(59.0, FlightState.TRANSIT)
    assert not stands(100.0, FlightState.TRANSIT, moves_m=0.1)
    assert not stands(100.0, FlightState.HOLD)  # it says why
    assert not stands(79.0, FlightState.TRANSIT, happened=[late])
    assert stands(81.0, FlightState.TRANSIT, happened=[late])
    assert stands(61.0, FlightState.TRANSIT, happened=[kill])
    assert stands(61.0, FlightState.TRANSIT, happened=[FaultEvent(FaultKind.DISK_FULL, (2,), 0.0)])


@pytest.mark.parametrize(("north_mps", "violated"), [(0.5, False), (3.0, True)])
def test_a_vehicle_that_flies_on_without_its_companion_is_seen(north_mps: float, violated: bool) -> None:
    alone = Alone(short_mission())
    for tenth in range(120):
        vel = ((5.0, 0.0, 0.0), (north_mps, 0.0, 0.0))
        alone.check_flight(seen(a_tick(0.1 * tenth, n=2, vel_ned_mps=vel, on_ground=(False,) * 2), companions=[1]))
    assert bool(alone.violation) is violated


def test_a_broken_invariant_is_the_first_cause_of_its_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planted defect: the companion of a vehicle that its pilot has taken over streams setpoints all the same."""
    pilot = {"kind": "pilot", "vehicles": [2], "phase": "transit", "at_s": 1.0}
    mission = short_mission(swarm={"size": 3}, sim={"faults": [pilot]})
    row = flight.fly_to_row(mission, on_jsbsim=False)
    assert (row["grade"], row["faults"]) == ("DEGRADED", {"pilot": 1}), row["verdict"]
    answer = InProcess.receive

    def steers(companion: InProcess) -> tuple[bytes, bytes]:
        to_peers, to_autopilot = answer(companion)
        return to_peers, (SETPOINT if companion.id == 2 else b"") + to_autopilot  # while it steers, its own counts

    monkeypatch.setattr(InProcess, "receive", steers)
    row = flight.fly_to_row(mission, on_jsbsim=False)
    assert (row["grade"], row["causes"][0]) == ("UNSAFE", "takeover")
    assert row["verdict"].startswith("UNSAFE: vehicle 2: a setpoint at ")


def test_an_error_of_the_program_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("of a planted defect")

    monkeypatch.setattr(flight.fly, "fly", broken)
    row = flight.fly_to_row(short_mission(), on_jsbsim=False)
    assert (row["grade"], row["causes"]) == ("UNSAFE", [flight.CRASHED])
    assert "ZeroDivisionError: of a planted defect" in row["verdict"]


def test_a_flight_that_is_interrupted_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> Any:
        return SimpleNamespace(ended=flight.fly.INTERRUPTED, summary={"grade": "INCOMPLETE"})

    monkeypatch.setattr(flight, "fly_stack", interrupted)
    with pytest.raises(KeyboardInterrupt):
        flight.fly_to_row(short_mission(), on_jsbsim=False)


def a_row(seed: int, grade: str, *causes: str, run: str = "open", asked: tuple[str, ...] = ()) -> dict[str, Any]:
    found: dict[str, Any] = {
        "seed": seed,
        "n": 5,
        "run": run,
        "grade": grade,
        "causes": list(causes),
        "verdict": f"{grade}: why",
    }
    found["sim_time_s"] = 40.0 + 10.0 * seed
    return found | {"asked": list(asked), "faults": dict(Counter(asked[:1]))}


def test_the_tables_of_a_campaign() -> None:
    rows = [
        a_row(1, "ARRIVED", asked=("kill", "late")),
        a_row(2, "INCOMPLETE", "not arrived", "coverage"),
        a_row(3, "UNSAFE", "contact", run="trees"),
        a_row(4, "DEGRADED", "not arrived") | {"attacker": "insider"},
    ]  # those of earlier versions name no attacker
    assert [row["seed"] for row in summary.failures(rows)] == [3, 2]
    text = summary.markdown(rows)
    assert "in still air" not in text
    assert "in still air" in summary.markdown([row | {"backend": "agents"} for row in rows])
    assert "| all: 4 | 1 (25.0 %) | 1 (25.0 %) | 1 (25.0 %) | 1 (25.0 %) | 65 (80) |" in text
    assert "| insider: 1 | 0 (0.0 %) | 1 (100.0 %) |" in text
    assert "| no attacker: 3 | 1 (33.3 %) |" in text
    assert "| trees: 1 | 0 (0.0 %) | 0 (0.0 %) | 0 (0.0 %) | 1 (100.0 %) |" in text
    assert "| not arrived | some never came to d2 | 0 | 1 | 1 | 2 |" in text
    assert "| late | 1 | 0 |" in text
    assert "| 3 | 5 | 70.0 | UNSAFE: why |" in text
    del rows[2]["sim_time_s"]  # it never came to an end
    assert "| 3 | 5 | - | UNSAFE: why |" in summary.markdown(rows)


def test_a_flight_whose_process_died_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    crashed = {"grade": "UNSAFE", "causes": [flight.CRASHED], "verdict": "UNSAFE: ValueError", "arrived": False}

    def flies(todo: Sequence[Any]) -> Iterator[Any]:
        for batch in todo:
            yield batch, BrokenProcessPool() if batch[0].seed == 7 else Done((crashed,), 1.0, 1.0)

    @contextmanager
    def one_worker(*_: Any) -> Iterator[Any]:
        yield flies

    documents: list[dict[str, Any]] = []
    monkeypatch.setattr(program, "_workers", one_worker)
    monkeypatch.setattr(program.page, "write", lambda *told: documents.append(program.page.document(*told)))
    command = ["search", "--backend", "point-mass", "--seed", "7", "--out", str(tmp_path)]
    assert cli.main([*command, "--flights", "1", "--shrink", "1"]) == 1
    assert "1 flights, 1 to look into" in capsys.readouterr().out
    assert cli.main([*command, "--flights", "2"]) == 1
    text = (tmp_path / "summary.md").read_text()
    assert re.search(r"^\| flights \| .*UNSAFE \| never ended \|", text, re.MULTILINE)
    assert "| all: 2 | 0 (0.0 %) | 0 (0.0 %) | 0 (0.0 %) | 1 (50.0 %) | 1 (50.0 %) | - |" in text
    assert re.search(r"^\| 7 \| [0-9]+ \| - \| never ended: .*process", text, re.MULTILINE)
    document = documents[-1]
    assert document["answer"].startswith("FAILED: ")
    assert {flown["verdict"] for flown in document["worst"]} == {"the worker process died", "UNSAFE: ValueError"}


def test_a_campaign_goes_on_where_it_ended_and_keeps_missions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def tiny(seed: int, _share: float) -> Drawn:
        route = {"d2_enu_m": (20.0, 0.0, 4.0)}
        late = 20.0 if seed == 8 else 200.0  # no time to arrive
        return Drawn(
            short_mission(swarm={"size": 2}, route=route, sim={"seed": seed, "time_limit_s": late}), 0, seed == 8
        )

    monkeypatch.setattr(program, "draw", tiny)
    command = ["search", "--backend", "point-mass", "--seed", "7", "--workers", "1", "--out", str(tmp_path)]
    assert cli.main([*command, "--flights", "2"]) == 1
    shown = capsys.readouterr()
    assert "2 flights, 1 to look into" in shown.out
    assert "seed 8, after 20.0 s: INCOMPLETE: not all arrived" in shown.err
    assert re.search(r"^\| 8 \| 2 \| 20\.0 \| INCOMPLETE: not all arrived", shown.out, re.MULTILINE)
    assert "sim-bridge search --backend point-mass --seed 8 --flights 1" in shown.err
    rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert {row["seed"]: row["grade"] for row in rows} == {7: "ARRIVED", 8: "INCOMPLETE"}
    assert {row["seed"]: row["signed"] for row in rows} == {7: False, 8: True}
    assert {(row["version"], row["attacker"]) for row in rows} == {(drawing.VERSION, "")}
    assert (tmp_path / "report.html").is_file()
    assert (tmp_path / "summary.md").read_text().startswith("| flights |")
    with (tmp_path / "rows.jsonl").open("ab") as file:
        file.write(b'{"key": "')  # as an interruption leaves it
    monkeypatch.setattr(flight, "fly_to_row", None)  # nothing is flown again
    assert cli.main([*command, "--flights", "2", "--json"]) == 1
    shown = capsys.readouterr()
    assert "rows.jsonl: the last row was cut off" in shown.err
    told = json.loads(shown.out)
    assert [row["seed"] for row in told] == [7, 8]
    assert [row["sim_time_s"] for row in told] == [row["sim_time_s"] for row in rows]
    monkeypatch.setattr(shrink, "fly_to_row", lambda *_, **__: {"grade": "ARRIVED", "causes": []})
    assert cli.main([*command, "--flights", "2", "--shrink", "1"]) == 1
    assert load_mission(tmp_path / "8.toml") == load_mission(tmp_path / "8-shrunk.toml")
    assert (tmp_path / "8.toml").read_text().startswith("# signed: true\n")
    assert cli.main([*command, "--flights", "1", "--attackers", "0.25"]) == 0  # as drawn here: nothing to fly
    (tmp_path / "summary.md").unlink()
    capsys.readouterr()

    def interrupted(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(shrink, "fly_to_row", interrupted)
    assert cli.main([*command, "--flights", "2", "--shrink", "1"]) == 1
    assert "interrupted: the same command goes on" in capsys.readouterr().err
    assert (tmp_path / "summary.md").is_file()


def test_a_search_by_hours_ends_with_the_first_flight_after_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock_s = [0.0]

    def fly(cases: Sequence[Any]) -> Any:
        clock_s[0] += 1000.0
        figures = a_row(1, "ARRIVED") | {"arrived": True}
        return Done(tuple({k: v for k, v in figures.items() if k not in ("seed", "n", "run")} for _ in cases), 1.0, 1.0)

    @contextmanager
    def one_worker(*_: Any) -> Iterator[Any]:
        yield lambda todo: ((batch, fly(batch)) for batch in todo)

    monkeypatch.setattr(program, "_workers", one_worker)
    monkeypatch.setattr(program.time, "monotonic", lambda: clock_s[0])
    command = ["search", "--backend", "point-mass", "--seed", "7", "--hours", "1", "--out", str(tmp_path)]
    assert cli.main(command) == 0
    assert "4 flights, 0 to look into" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("option", "value", "why"),
    [
        ("--flights", "0", "whole number of at least 1"),
        ("--hours", "soon", "number of hours above 0"),
        ("--seed", "-1", "whole number from 0"),
        ("--shrink", "few", "whole number"),
        ("--attackers", "all", "number from 0 to 1"),
        ("--attackers", "1.5", "number from 0 to 1"),
    ],
)
def test_what_an_option_must_be_is_said(option: str, value: str, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["search", f"{option}={value}"])
    assert why in capsys.readouterr().err
