"""Faults in whole flights: the same in both ways to run the agents, and what they do to a swarm."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.core.model.states import SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.beacon import beacons
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import Framing
from mission.common.problems import MissionError
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.schema.faults import FaultKind
from sim_bridge.drive.fly import Flight
from sim_bridge.judge import run_folder
from sim_bridge.judge.run_folder import load_faults
from sim_bridge.lab.study.jobs import fly_batch
from sim_bridge.lab.study.load import load_study
from tests.flights import flown, short_mission

WIRE = Framing(frozenset({dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_TIMESYNC}))


def told(data: bytes) -> list[Any]:
    """Positions and TIMESYNC requests: the answers to the companion's own requests are left out."""
    return [m for m in WIRE.parse(data) if m.get_type() != "TIMESYNC" or m.tc1 == 0]


def with_faults(*faults: dict[str, Any], n: int = 4, **tables: dict[str, Any]) -> Mission:
    sim = {"faults": faults, **tables.pop("sim", {})}
    return short_mission(swarm={"size": n}, sim=sim, **tables)


def test_companions_that_are_started_again_come_along(tmp_path: Path) -> None:
    leader = {"kind": "restart", "phase": "transit", "at_s": 3.0, "for_s": 2.0}
    mission = with_faults(leader, leader | {"vehicles": (3,), "at_s": 9.0}, sim={"radio_loss": 0.1})
    inside, shown = flown(mission, tmp_path / "inside")
    assert "fault: vehicle 3 killed, started again after 2 s" in shown
    assert "fault over: vehicle 3 started again" in shown
    assert inside.succeeded, shown
    assert inside.metrics.lost == ()
    outside, shown = flown(mission, tmp_path / "outside", in_process=False)
    assert outside.summary["trace_hash"] == inside.summary["trace_hash"], shown
    assert [event.kind for event in load_faults(tmp_path / "outside")] == [FaultKind.RESTART] * 2
    assert (tmp_path / "outside" / "companions" / "companion-3-2.log").exists()


def test_faults_are_the_same_to_the_bit_with_agents_as_processes_and_in_process(tmp_path: Path) -> None:
    mission = with_faults(
        {"kind": "kill", "phase": "transit", "at_s": 2.0},
        {"kind": "stop", "vehicles": (4,), "phase": "transit", "at_s": 3.0, "for_s": 4.0},
        {"kind": "partition", "vehicles": (3, 5), "phase": "transit", "at_s": 8.0, "for_s": 5.0},
        {"kind": "late", "vehicles": (3,), "phase": "transit", "at_s": 6.0, "late_s": 0.3, "for_s": 5.0},
        {"kind": "kill", "vehicles": (3, 4), "phase": "coverage", "at_s": 1.0},
        n=6,
        sim={"radio_loss": 0.1, "radio_delay_s": 0.05},
    )
    processes: dict[int, subprocess.Popen[bytes]] = {}

    def note(flight: Flight) -> None:
        for k, companion in flight.lockstep.companions.items():
            processes[k] = companion.process  # type: ignore[attr-defined]

    inside, _ = flown(mission, tmp_path / "inside")
    outside, _ = flown(mission, tmp_path / "outside", in_process=False, watch=note)
    assert inside.summary["trace_hash"] == outside.summary["trace_hash"]
    assert inside.metrics == outside.metrics
    event = load_faults(tmp_path / "inside")
    assert event == load_faults(tmp_path / "outside")
    assert len(event) == len(mission.sim.faults)
    (leader,) = event[0].vehicles
    assert inside.metrics.lost == tuple(sorted({leader, 3, 4}))
    assert [k for k, process in processes.items() if process.returncode == -signal.SIGKILL] == list(inside.metrics.lost)


def test_the_leader_is_killed_when_the_phase_begins_and_another_leads_on(tmp_path: Path) -> None:
    mission = with_faults({"kind": "kill", "phase": "transit", "at_s": 0.0}, n=5)
    outcome, shown = flown(mission, tmp_path)
    (event,) = load_faults(tmp_path)
    assert outcome.metrics.arrived, shown
    recording = run_folder.load(tmp_path)
    announced = recording.phase[recording.agent_alive[:, event.vehicles[0] - 1], event.vehicles[0] - 1]
    assert np.count_nonzero(announced == SwarmPhase.TRANSIT) == 1
    assert f"{event.at_s:7.1f} s  fault: leader {event.vehicles[0]} killed\n" in shown
    assert "the flight goes on for the others" not in shown  # said once is enough
    assert outcome.metrics.lost == event.vehicles
    assert outcome.metrics.leader_changes == 1


def test_a_leader_that_stood_still_and_goes_on_is_no_second_leader(tmp_path: Path) -> None:
    mission = with_faults({"kind": "stop", "phase": "transit", "at_s": 3.0, "for_s": 6.0})
    outcome, shown = flown(mission, tmp_path)
    metrics = outcome.metrics
    assert " resumes" in shown
    assert (metrics.leader_changes, metrics.acting_leaders_max, metrics.acting_leaders_overlap_s) == (1, 1, 0.0), shown


def test_a_companion_that_is_stopped_is_not_ticked_and_finds_what_came_meanwhile(tmp_path: Path) -> None:
    ticks: list[tuple[float, bytes | None, bool]] = []

    def note(flight: Flight) -> None:
        lockstep = flight.lockstep
        ticks.append((flight.world.now_s, lockstep.to_companion.get(2), 2 in lockstep.from_companion))

    stop = {"kind": "stop", "vehicles": (2,), "phase": "transit", "at_s": 3.0, "for_s": 2.0}
    mission = with_faults(stop, coverage={"duration_s": 25.0})  # it comes behind, and the ring waits for it
    outcome, shown = flown(mission, tmp_path, watch=note)
    (event,) = load_faults(tmp_path)
    assert outcome.succeeded, shown
    still = [now_s for now_s, _, answered in ticks if not answered]
    assert still == pytest.approx(np.arange(event.at_s + 0.05, event.at_s + 2.04, 0.05))  # the tick ends TICK_S later
    handed_out = next(data for now_s, data, _ in ticks if data is not None and now_s > still[-1])
    messages = told(handed_out)
    assert [m.get_type() for m in messages] == ["LOCAL_POSITION_NED"] * 41 + ["TIMESYNC"]
    assert messages[-1].ts1 / 1e9 == pytest.approx(event.at_s + 2.0)
    recording = run_folder.load(tmp_path)
    assert np.count_nonzero(~recording.agent_alive[:, 1]) == 40
    assert "vehicle 2: companion stalled: resynchronising" in shown


@pytest.mark.sources
def test_parts_that_are_cut_off_do_not_hear_one_another_until_it_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[tuple[float, int, set[int]]] = []
    listen = Endpoint.from_peers

    def note(endpoint: Endpoint, data: bytes, now_s: float) -> None:
        heard.append((now_s, endpoint.id, {sender for sender, _, _ in beacons(data)}))
        listen(endpoint, data, now_s)

    monkeypatch.setattr(Endpoint, "from_peers", note)
    mission = with_faults({"kind": "partition", "vehicles": (1, 2), "phase": "transit", "at_s": 2.0, "for_s": 8.0})
    flown(mission, tmp_path)
    (event,) = load_faults(tmp_path)
    assert event.until_s is not None
    parts = {1: {2}, 2: {1}, 3: {4}, 4: {3}}
    # What was sent before it began is on the air for a tick.
    during = [(k, who) for now_s, k, who in heard if event.at_s + 0.01 < now_s <= event.until_s and who]
    assert {(k, *who) for k, who in during} == {(k, *others) for k, others in parts.items()}
    after = [(k, who) for now_s, k, who in heard if event.until_s + 0.2 < now_s < event.until_s + 0.4]
    assert {k: set().union(*(who for other, who in after if other == k)) for k in parts} == {
        k: set(parts) - {k} for k in parts
    }


def test_late_telemetry_comes_in_order_and_the_tick_on_time(tmp_path: Path) -> None:
    came: list[tuple[float, list[Any]]] = []

    def note(flight: Flight) -> None:
        came.append((flight.world.now_s - 0.05, told(flight.lockstep.to_companion[1])))

    mission = with_faults({"kind": "late", "vehicles": (1,), "at_s": 20.0, "late_s": 1.5, "for_s": 20.0}, n=2)
    flown(mission, tmp_path, watch=note)
    for now_s, messages in came:
        assert messages[-1].get_type() == "TIMESYNC"
        assert messages[-1].ts1 / 1e9 == pytest.approx(now_s)
        ages_s = [now_s - m.time_boot_ms / 1e3 for m in messages[:-1]]
        if 21.5 <= now_s < 40.0:
            assert ages_s == pytest.approx([1.5])
        elif 20.0 <= now_s < 21.5 or 40.0 <= now_s < 41.45:
            assert all(age_s == pytest.approx(1.5) for age_s in ages_s)
        elif now_s > 41.5:
            assert ages_s == pytest.approx([0.0])
    times = [m.time_boot_ms for _, messages in came for m in messages[:-1]]
    assert times == sorted(set(times))


def test_a_fault_that_never_happened_is_said_at_the_end(tmp_path: Path) -> None:
    mission = with_faults({"kind": "kill", "vehicles": (2,), "phase": "return", "at_s": 1.0}, n=2)
    outcome, shown = flown(mission, tmp_path)
    assert outcome.succeeded
    assert shown.splitlines()[-1].endswith("fault that never happened: kill 2@return+1")
    assert json.loads((tmp_path / "faults.json").read_text()) == [
        {"kind": "kill", "asked": "kill 2@return+1", "at_s": None}
    ]


def test_options_come_besides_the_file_and_the_run_folder_flies_the_same_again(tmp_path: Path) -> None:
    def fly(file: Path, folder: str, *options: str) -> dict[str, Any]:
        command = [sys.executable, "-m", "sim_bridge.cli", "fly", str(file), "--out", str(tmp_path / folder), "--json"]
        done = subprocess.run(
            [*command, *options, "--agents", "in-process"], capture_output=True, text=True, check=False
        )
        assert done.stdout, done.stderr
        figures: dict[str, Any] = json.loads(done.stdout)
        return figures

    mission = tmp_path / "short.toml"
    mission.write_text(dump_mission(with_faults({"kind": "stop", "at_s": 25.0, "for_s": 1.0}, n=3)))
    first = fly(mission, "first", "--kill", "leader@transit+3", "--late", "2@10:0.1:5")
    kinds = [event.kind for event in load_faults(tmp_path / "first")]
    assert sorted(kinds) == [FaultKind.KILL, FaultKind.LATE, FaultKind.STOP]
    again = fly(tmp_path / "first" / "mission.toml", "again")
    assert again["trace_hash"] == first["trace_hash"]
    assert load_faults(tmp_path / "again") == load_faults(tmp_path / "first")


def test_a_study_flies_the_faults_of_its_missions(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(dump_mission(with_faults({"kind": "kill", "vehicles": (3,), "at_s": 12.0})))
    study = tmp_path / "study.toml"
    text = 'schema = 1\nmissions = ["short.toml"]\n[[run]]\nname = "killed"\nbackend = "{}"\n'
    study.write_text(text.format("agents"))
    (case,) = load_study(study).cases
    (figures,) = fly_batch((case,)).figures
    assert figures["lost"] == [3]
    study.write_text(text.format("point-mass"))
    with pytest.raises(MissionError, match=r'study\.toml:5: run\[0\]\.backend = "point-mass": flies no faults'):
        load_study(study)
