"""Whole flights in lockstep, fixed seeds."""

from __future__ import annotations

import json
import math
import os
import signal
from pathlib import Path

import psutil
import pytest
from pymavlink import mavutil

from companion.core.model.states import SwarmPhase
from mission.common.frames import LocalFrame, Wgs84
from mission.document.load import load_mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import CompanionLostError
from sim_bridge.judge.observer import time_limit_s
from sim_bridge.judge.run_folder import load
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.flights import flown, short_mission

LONE_TREE = Path(__file__).parents[2] / "mission" / "examples" / "lone_tree.toml"


@pytest.mark.parametrize("n", [1, 2, 4])
def test_swarm_arrives_on_full_flight_dynamics(n: int, tmp_path: Path) -> None:
    outcome, _ = flown(short_mission(swarm={"size": n}), tmp_path, point_mass=False)
    figures = outcome.metrics
    assert outcome.succeeded, outcome.ended
    assert figures.contacts == 0
    assert figures.acting_leaders_max == 1
    assert figures.connected_fraction_transit == 1.0
    assert figures.overhead_last is not None
    assert figures.overhead_last < 0.1
    if n > 1:
        assert figures.min_separation_m is not None
        assert figures.min_separation_m > 4.0
        assert figures.coverage_gap_deg is not None
        assert figures.coverage_gap_ideal_deg is not None
        assert figures.coverage_gap_deg < 1.3 * figures.coverage_gap_ideal_deg


@pytest.mark.parametrize(("n", "seed"), [(4, 500), (8, 510)])  # one stands between the leader and the tree
def test_whoever_comes_to_the_tree_first_is_not_in_its_leaders_way(n: int, seed: int, tmp_path: Path) -> None:
    mission = load_mission(LONE_TREE).with_size(n).with_seed(seed).with_origin(DEFAULT_ORIGIN)
    outcome, _ = flown(mission, tmp_path, point_mass=False)
    assert outcome.metrics.overhead_last is not None
    assert outcome.metrics.overhead_last <= 0.04
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m >= 5.5


def test_same_seed_flies_the_same_to_the_bit_and_another_does_not(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 3}, sim={"radio_loss": 0.2, "radio_delay_s": 0.1})
    first, again = (flown(mission, tmp_path / name)[0].summary["trace_hash"] for name in ("first", "again"))
    other = flown(mission.with_seed(2), tmp_path / "other")[0].summary["trace_hash"]
    assert first == again
    assert first != other


def test_agents_as_processes_fly_the_same_to_the_bit_as_in_process(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 3}, sim={"radio_loss": 0.1, "wind_mps": (2, 0, 0), "turbulence_mps": 2})
    inside, _ = flown(mission, tmp_path / "inside", point_mass=False)
    outside, _ = flown(mission, tmp_path / "outside", point_mass=False, in_process=False)
    assert outside.succeeded
    assert inside.summary["trace_hash"] == outside.summary["trace_hash"]


WRONG = {"velocity_bias_mps": 0.3, "velocity_noise_mps": 0.1, "position_noise_m": 0.1, "estimate_delay_s": 0.1}


def test_with_wrong_estimates_and_drag_both_ways_fly_the_same_to_the_bit_and_arrive(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 3}, sim={**WRONG, "drag": "sih"})
    inside, _ = flown(mission, tmp_path / "inside", point_mass=False)
    outside, _ = flown(mission, tmp_path / "outside", point_mass=False, in_process=False)
    exact, _ = flown(short_mission(swarm={"size": 3}), tmp_path / "exact", point_mass=False)
    assert inside.succeeded, inside.ended
    assert inside.metrics.contacts == 0
    assert inside.summary["trace_hash"] == outside.summary["trace_hash"] != exact.summary["trace_hash"]


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_a_swarm_with_estimates_as_recorded_lands_where_it_should(personality: str, tmp_path: Path) -> None:
    mission = short_mission(
        swarm={"size": 3}, route={"at_end": "return"}, sim={"estimates": "recorded", "personality": personality}
    )
    outcome, _ = flown(mission, tmp_path, point_mass=False)
    assert outcome.succeeded, outcome.ended
    assert outcome.ended == "all landed"
    assert outcome.metrics.contacts == 0


def test_another_leads_on_after_the_leader_is_killed_in_transit(tmp_path: Path) -> None:
    killed: dict[str, float] = {}

    def kill_leader(flight: Flight) -> None:
        leader, now_s = flight.leader(), flight.world.now_s
        if flight.phase() is SwarmPhase.TRANSIT and not killed and leader is not None:
            killed.update(at_s=now_s, leader=leader)
            os.kill(flight.lockstep.companions[leader].process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
        elif killed and "again_s" not in killed and leader not in (None, killed["leader"]):
            killed["again_s"] = now_s

    mission = short_mission(swarm={"size": 5}, route={"d2_enu_m": (60, 0, 4)})
    outcome, shown = flown(mission, tmp_path, in_process=False, watch=kill_leader)
    leader = int(killed["leader"])
    assert killed["again_s"] - killed["at_s"] <= 3.5
    assert outcome.metrics.lost == (leader,)
    assert not outcome.succeeded
    assert outcome.summary["verdict"] == f"INCOMPLETE without {leader}: lost vehicle {leader}", shown
    assert f"companion {leader}: killed by SIGKILL" in shown
    assert outcome.metrics.contacts == 0


def test_swarm_arrives_in_wind_and_over_a_lossy_late_radio(tmp_path: Path) -> None:
    mission = short_mission(
        swarm={"size": 4},
        sim={"wind_mps": (3, 3, 0), "turbulence_mps": 4, "radio_loss": 0.3, "radio_delay_s": 0.15},
    )
    outcome, shown = flown(mission, tmp_path, point_mass=False)
    assert outcome.succeeded, shown
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m > 4.0


@pytest.mark.parametrize("at_end", ["land", "return"])
def test_swarm_lands_where_it_is_or_back_at_d1(at_end: str, tmp_path: Path) -> None:
    outcome, shown = flown(short_mission(route={"at_end": at_end}), tmp_path, point_mass=False)
    assert outcome.ended == "all landed", shown
    assert outcome.succeeded
    assert outcome.metrics.contacts == 0


def test_vehicle_that_its_companion_leaves_in_the_air_ends_the_flight_by_name(tmp_path: Path) -> None:
    def drop_three(flight: Flight) -> None:
        if flight.phase() is SwarmPhase.LAND and 3 in flight.lockstep.companions:
            flight.lockstep.drop(CompanionLostError(3, "dropped"))

    outcome, shown = flown(short_mission(route={"at_end": "land"}), tmp_path, watch=drop_three)
    assert outcome.ended == "all landed but 3", shown
    assert outcome.metrics.aloft == outcome.metrics.armed == (3,)
    wanted = "INCOMPLETE without 3: vehicle 3 still armed in the air; lost vehicle 3"
    assert outcome.summary["verdict"] == wanted
    assert outcome.metrics.sim_time_s < time_limit_s(short_mission(route={"at_end": "land"})) - 60.0


def test_without_one_that_a_fault_killed_the_others_do_all_that_the_mission_asks(tmp_path: Path) -> None:
    faults = [{"kind": "kill", "vehicles": (3,), "phase": "land", "at_s": 0.0}]
    outcome, shown = flown(short_mission(route={"at_end": "land"}, sim={"faults": tuple(faults)}), tmp_path)
    assert outcome.succeeded, shown
    assert outcome.summary["verdict"] == "ARRIVED without 3 (vehicle 3 still armed in the air)"


def test_ring_closes_up_about_those_that_faults_killed_on_it(tmp_path: Path) -> None:
    faults = tuple(
        {"kind": "kill", "vehicles": (k,), "phase": "coverage", "at_s": at_s}
        for k, at_s in ((2, 16.0), (4, 4.0), (5, 9.0))
    )
    mission = short_mission(swarm={"size": 7}, coverage={"duration_s": 120.0}, sim={"faults": faults})
    outcome, shown = flown(mission, tmp_path)
    assert outcome.metrics.lost == (2, 4, 5)
    assert outcome.succeeded, shown
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m > mission.separation.hard_m


def test_swarm_around_a_sphere_lands_without_one_above_another(tmp_path: Path) -> None:
    mission = short_mission(
        route={"d2_enu_m": (40, 0, 20), "at_end": "land"},
        coverage={"shape": "sphere"},
        fence={"altitude_max_m": 40.0},
        swarm={"size": 6},
    )
    outcome, shown = flown(mission, tmp_path)
    assert outcome.ended == "all landed", shown
    assert outcome.metrics.contacts == 0


def test_predetermined_leader_leads(tmp_path: Path) -> None:
    led: set[int | None] = set()

    def note_leader(flight: Flight) -> None:
        if flight.phase() is SwarmPhase.TRANSIT:
            led.add(flight.leader())

    flown(short_mission(swarm={"leader_priority": (3, 2)}), tmp_path, watch=note_leader)
    assert led == {3}


def test_run_folder_holds_the_mission_the_logs_and_the_figures(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 2})
    outcome, _ = flown(mission, tmp_path, in_process=False)
    assert load_mission(tmp_path / "mission.toml") == mission
    assert json.loads((tmp_path / "metrics.json").read_text()) == json.loads(json.dumps(outcome.summary))
    assert "leader: vehicle" in (tmp_path / "companions" / "companion-1.log").read_text()
    log = mavutil.mavlink_connection(str(tmp_path / "vehicle-2.tlog"), dialect="common")
    seen = set()
    while (message := log.recv_match()) is not None:
        seen.add((message.get_srcSystem(), message.get_srcComponent(), message.get_type()))
    log.close()
    assert {
        (2, 1, "LOCAL_POSITION_NED"),
        (2, 1, "COMMAND_ACK"),
        (2, 191, "HEARTBEAT"),
        (2, 191, "SET_POSITION_TARGET_LOCAL_NED"),
        (2, 191, "COMMAND_LONG"),
    } <= seen


def test_a_vehicles_log_goes_on_without_its_companion_and_says_where_it_is(tmp_path: Path) -> None:
    killed = {"kind": "kill", "vehicles": (1,), "at_s": 20.0}
    stopped = {"kind": "stop", "vehicles": (2,), "at_s": 20.0, "for_s": 9.0}
    mission = short_mission(swarm={"size": 4}, sim={"faults": (killed, stopped)})
    outcome, _ = flown(mission, tmp_path)
    recording, frame = load(tmp_path), LocalFrame(DEFAULT_ORIGIN.wgs84)
    for vehicle in (1, 2, 3):
        log = mavutil.mavlink_connection(str(tmp_path / f"vehicle-{vehicle}.tlog"), dialect="common")
        times_s, off_m = [], []
        while (m := log.recv_match(type="GLOBAL_POSITION_INT")) is not None:
            times_s.append(m._timestamp)
            told_ned_m = frame.to_ned(Wgs84(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3))
            row = round(m.time_boot_ms / 50.0) - 1  # the first tick ends at 0.05 s
            off_m.append(math.dist(told_ned_m, recording.pos_ned_m[row, vehicle - 1]))
        log.close()
        assert times_s[-1] - times_s[0] == pytest.approx(outcome.metrics.sim_time_s, abs=0.5)
        assert max(off_m) < 0.02


def test_companion_that_dies_on_the_ground_is_named_and_the_others_fly(tmp_path: Path) -> None:
    def kill_three(flight: Flight) -> None:
        if flight.world.now_s > 0.5 and 3 in flight.lockstep.companions:
            os.kill(flight.lockstep.companions[3].process.pid, signal.SIGKILL)  # type: ignore[attr-defined]

    mission = short_mission(swarm={"size": 3, "start_timeout_s": 5})
    outcome, shown = flown(mission, tmp_path, in_process=False, watch=kill_three)
    assert "companion 3: killed by SIGKILL; the flight goes on for the others" in shown
    assert "without 3" in shown
    assert outcome.summary["verdict"] == "INCOMPLETE without 3: lost vehicle 3", shown


@pytest.mark.parametrize(
    ("blow", "ended", "line"),
    [
        (signal.SIGKILL, "no companion left", "fork server killed by SIGKILL; all companions that it started are gone"),
        (signal.SIGSTOP, "interrupted", "fork server did not answer for 3 s; all companions that it"),
    ],
)
def test_a_fork_server_that_is_gone_is_one_line_and_the_flight_has_its_figures(
    blow: signal.Signals, ended: str, line: str, tmp_path: Path
) -> None:
    struck = False

    def strike(flight: Flight) -> None:
        nonlocal struck
        if not struck:
            companion = flight.lockstep.companions[1].process.pid  # type: ignore[attr-defined]
            os.kill(psutil.Process(companion).ppid(), blow)
            struck = True
        elif flight.world.now_s > 2.0:
            raise KeyboardInterrupt

    mission = short_mission(swarm={"size": 3})
    outcome, shown = flown(mission, tmp_path, in_process=False, watch=strike)
    assert outcome.ended == ended
    assert shown.count(line) == shown.count("fork server") == 1, shown
    assert "companion 1" not in shown
    assert json.loads((tmp_path / "metrics.json").read_text())["ended"] == ended


def test_nobody_takes_off_without_a_majority(tmp_path: Path) -> None:
    def drop_all_but_one(flight: Flight) -> None:
        for vehicle_id in (2, 3):
            companion = flight.lockstep.companions.get(vehicle_id)
            if companion is not None and flight.world.now_s > 0.5:
                os.kill(companion.process.pid, signal.SIGKILL)  # type: ignore[attr-defined]

    mission = short_mission(swarm={"size": 3, "start_timeout_s": 2}, sim={"time_limit_s": 30})
    outcome, _ = flown(mission, tmp_path, in_process=False, watch=drop_all_but_one)
    assert not outcome.succeeded
    assert outcome.metrics.straight_time_s is None
