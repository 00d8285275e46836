"""Records in whole flights: they reach the base station, or are named as lost, and the swarm flies as without them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.core.agent import TICK_S
from companion.core.model.stand import StandMeasured
from companion.core.model.states import SwarmPhase
from companion.records.record import BASE_ID, Draft, RecordKind
from companion.records.store import Batch, RecordStore
from companion.stand.records import read_records
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep import harvest
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge import run_folder
from tests.bench.forged_records import FORGED, Forger, log_of
from tests.bench.records import Maker
from tests.flights import flown, short_mission

SEED = 3


def surveying(n: int = 4, *, has_survey: bool = True, **tables: dict[str, Any]) -> Mission:
    """There and back, and the base station at d1."""
    sim = {"seed": SEED, **tables.pop("sim", {})}
    route = {"at_end": "return", **tables.pop("route", {})}
    # It finds nothing to measure: its records are of the way. Scans cost most of a flight: few are enough.
    senses = {"sensor": "scan-1deg", "range_m": 12.0, "rate_hz": 2.0, "stale_s": 1.5}
    survey: dict[str, Any] = {"survey": {}} if has_survey else {}
    return short_mission(swarm={"size": n}, route=route, sim=sim, sensing=senses, **survey, **tables)


def bodies_at_base(folder: Path) -> list[bytes]:
    """What is in the base station's file when all is over."""
    store = RecordStore(folder / "records.db", BASE_ID, lambda: 1)
    found = [body for kind in RecordKind for _, _, _, body in store.records(kind)]
    store.close()
    return found


def test_all_records_come_home_once(tmp_path: Path) -> None:
    outcome, shown = flown(surveying(), tmp_path, watch=Maker())
    made = outcome.summary["records_made"]
    assert outcome.succeeded, shown
    assert made > 200
    assert outcome.summary["records_delivered"] == made
    waited_s = outcome.summary["sim_time_s"] - outcome.summary["end_s"]
    assert harvest.COMPLETE_S < waited_s < harvest.COMPLETE_S + 5.0  # with nothing more to come
    assert f"base station: {made} of {made} records delivered" in shown
    assert re.search(r"transit .* \d+x  \d+ of \d+ records delivered", shown)
    assert len(set(bodies_at_base(tmp_path))) == len(bodies_at_base(tmp_path)) == made


def test_in_a_swarm_with_keys_all_records_come_home_signed_and_none_that_a_member_forges(tmp_path: Path) -> None:
    mission, maker, forger = surveying(), Maker(), Forger(3)

    def watch(flight: Flight) -> None:
        maker(flight)
        forger(flight)

    outcome, shown = flown(mission, tmp_path, watch=watch, keys=FleetKeys(mission))
    made = outcome.summary["records_made"]
    assert outcome.succeeded, shown
    assert made > 200
    assert outcome.summary["records_delivered"] == made
    stored = read_records(tmp_path / "records.db")
    assert len(stored) == made
    assert all(record.proven for record in stored)
    assert not any(record.body.startswith(FORGED) for record in stored)
    assert "records: forged as vehicle" in shown


def test_records_survive_two_lost_leaders_a_split_a_restart_and_bad_links(tmp_path: Path) -> None:
    faults = [
        {"kind": "kill", "phase": "transit", "at_s": 3.0},
        {"kind": "kill", "phase": "coverage", "at_s": 3.0},
        {"kind": "partition", "vehicles": [5, 6], "phase": "transit", "at_s": 2.0, "for_s": 60.0},
        {"kind": "restart", "vehicles": [4], "phase": "transit", "at_s": 6.0, "for_s": 2.0},
    ]
    mission = surveying(6, sim={"radio_loss": 0.3, "faults": faults}, radio={"bit_rate_kbps": 250.0})
    maker = Maker()
    outcome, shown = flown(mission, tmp_path, watch=maker)
    figures = outcome.summary
    lost = figures["records_lost"]
    assert figures["records_made"] > 300
    unwritten = sum(figures["records_unwritten"].values())  # made in the last half second before a fault
    assert unwritten <= 3
    assert figures["records_delivered"] + sum(lost.values()) + unwritten == figures["records_made"]
    assert figures["records_waiting"] == {}
    assert len(maker.lost) == 2
    assert {int(k) for k in lost} <= maker.lost
    for vehicle_id, count in lost.items():
        assert f"records lost with vehicle {vehicle_id}, which never came back: {count}" in shown
    assert len(set(bodies_at_base(tmp_path))) == len(bodies_at_base(tmp_path)) == figures["records_delivered"]


def test_records_out_of_reach_are_named_as_waiting(tmp_path: Path) -> None:
    far = {"d1_enu_m": (0, 0, 4), "d2_enu_m": (90, 0, 4), "vel_leader_mps": 3.0, "at_end": "land"}
    mission = surveying(2, route=far, radio={"full_range_m": 30.0})
    outcome, shown = flown(mission, tmp_path, watch=Maker())
    figures = outcome.summary
    assert sum(figures["records_waiting"].values()) > 0, shown
    assert figures["records_delivered"] + sum(figures["records_waiting"].values()) == figures["records_made"]
    assert "out of reach of the base station" in shown


def test_a_swarm_that_surveys_flies_as_one_that_does_not_to_the_bit(tmp_path: Path) -> None:
    for has_survey in (True, False):
        mission = surveying(has_survey=has_survey, sim={"radio_loss": 0.2, "radio_delay_s": 0.1})
        flown(mission, tmp_path / str(has_survey), watch=Maker() if has_survey else None)
    with_survey, without = (run_folder.load(tmp_path / str(has_survey)) for has_survey in (True, False))
    ticks = without.time_s.size  # the other waits for the last records, on the ground
    assert with_survey.time_s.size > ticks
    assert np.array_equal(with_survey.pos_ned_m[:ticks], without.pos_ned_m)
    assert np.array_equal(with_survey.vel_ned_mps[:ticks], without.vel_ned_mps)


def test_a_full_disk_is_said_once_and_changes_nothing_of_the_flight(tmp_path: Path) -> None:
    full = {"kind": "disk-full", "vehicles": [2], "phase": "gather", "at_s": 1.0, "for_s": 40.0}
    flights = {}
    for name, faults in (("full", [full]), ("well", [])):
        flights[name] = flown(surveying(sim={"faults": faults}), tmp_path / name, watch=Maker())
    outcome, shown = flights["full"]
    assert shown.count("vehicle 2: records: disk full: kept in memory") == 1
    assert shown.count("vehicle 2: records: the disk takes them again") == 1
    assert outcome.summary["records_delivered"] == outcome.summary["records_made"]
    there, here = (run_folder.load(tmp_path / name) for name in ("well", "full"))
    ticks = min(there.time_s.size, here.time_s.size)
    assert np.array_equal(there.pos_ned_m[:ticks], here.pos_ned_m[:ticks])


def test_without_the_base_station_the_flight_is_the_same_and_records_come_later(tmp_path: Path) -> None:
    lost = {"kind": "base-lost", "vehicles": [1, 2, 3, 4], "phase": "gather", "at_s": 1.0}
    seen: list[int] = []

    def note(flight: Flight) -> None:
        maker(flight)
        if flight.faults.cut_links:
            assert flight.harvest is not None
            seen.append(flight.harvest.base.progress.delivered)

    flights = {}
    for name, faults in (("back", [{**lost, "for_s": 30.0}]), ("gone", [lost]), ("well", [])):
        maker = Maker()
        flights[name] = flown(surveying(sim={"faults": faults}), tmp_path / name, watch=note)
        if name == "back":
            assert seen
            assert set(seen[1:]) == {seen[0]}  # none meanwhile
    for name in ("back", "gone"):
        there, here = (run_folder.load(tmp_path / one) for one in ("well", name))
        ticks = min(there.time_s.size, here.time_s.size)
        assert np.array_equal(there.pos_ned_m[:ticks], here.pos_ned_m[:ticks])
        assert flights[name][0].succeeded
    back, gone = (flights[name][0].summary for name in ("back", "gone"))
    assert back["records_delivered"] == back["records_made"]
    assert sum(gone["records_waiting"].values()) > 100  # none lost: on the vehicles
    assert gone["records_unwritten"] == gone["records_lost"] == {}


def test_what_waits_for_the_next_write_where_a_flight_ends_in_the_air_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(flight: Flight) -> None:
        if flight.world.now_s > 20.0:  # in each tick: some wait at the end
            log_of(flight.lockstep.companions[1]).append(RecordKind.TRACK, b"x", flight.world.now_s)

    monkeypatch.setattr(harvest, "PATIENCE_MAX_S", 5.0)  # of a base station to which more records always come
    outcome, shown = flown(surveying(2, route={"at_end": "hold"}), tmp_path, watch=make)
    assert outcome.summary["records_unwritten"] == {}
    assert "not written" not in shown
    waiting = outcome.summary["records_waiting"]
    assert waiting["1"] > 0
    assert outcome.summary["records_made"] == outcome.summary["records_delivered"] + sum(waiting.values())


def test_a_disk_that_stays_full_loses_records_by_name_and_number(tmp_path: Path) -> None:
    full = {"kind": "disk-full", "vehicles": [2], "phase": "gather", "at_s": 1.0}
    figures, shown = {}, {}
    for name, faults in (("full", [full]), ("well", [])):
        outcome, shown[name] = flown(surveying(2, sim={"faults": faults}), tmp_path / name, watch=Maker())
        figures[name] = outcome.summary
    lost = figures["full"]["records_unwritten"]["2"]
    assert lost > 30
    assert figures["full"]["records_made"] == figures["well"]["records_made"]
    assert figures["full"]["records_delivered"] == figures["full"]["records_made"] - lost
    assert f"records not written by vehicle 2, whose disk was full or companion ended: {lost}" in shown["full"]
    assert figures["well"]["records_unwritten"] == {}
    assert "not written" not in shown["well"]


class Refill:
    """While vehicle 2's companion is down, records are put on its disk, as it had made them before it fell."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "companions" / "records-2.db"
        self.filled = 0

    def __call__(self, flight: Flight) -> None:
        if 2 not in flight.lockstep.companions and not self.filled:
            self.filled = 12
            store = RecordStore(self._file, 2, lambda: 99)
            store.write(Batch(own=[Draft(RecordKind.STEM, 1.0, b"kept %d" % k) for k in range(self.filled)]))
            store.close()


@pytest.mark.parametrize("in_process", [True, False])
def test_a_companion_that_starts_again_in_flight_goes_on_with_its_disk(tmp_path: Path, in_process: bool) -> None:
    fault = {"kind": "restart", "vehicles": [2], "phase": "transit", "at_s": 4.0, "for_s": 1.0}
    refill = Refill(tmp_path)
    mission = surveying(3, sim={"faults": [fault]})
    outcome, shown = flown(mission, tmp_path, watch=refill, in_process=in_process)
    assert outcome.summary["records_delivered"] == outcome.summary["records_made"] > refill.filled == 12, shown
    assert {body for body in bodies_at_base(tmp_path) if body.startswith(b"kept")} == {
        b"kept %d" % k for k in range(12)
    }


def test_a_companion_as_a_process_says_that_its_disk_is_full(tmp_path: Path) -> None:
    faults = [
        {"kind": "disk-full", "vehicles": [1], "phase": "gather", "at_s": 1.0},
        {"kind": "restart", "vehicles": [2], "phase": "transit", "at_s": 4.0, "for_s": 1.0},
    ]
    outcome, shown = flown(surveying(3, sim={"faults": faults}), tmp_path, watch=Refill(tmp_path), in_process=False)
    assert shown.count("kept in memory") == 1, shown
    assert "vehicle 1: records:" in shown
    assert outcome.succeeded, shown


def test_the_base_station_does_not_hear_what_its_range_does_not_reach(tmp_path: Path) -> None:
    seen: list[list[int]] = []

    def note(flight: Flight) -> None:
        assert flight.harvest is not None
        seen.append(flight.harvest.base.in_range(flight.world.now_s))
        if flight.world.now_s > 20.0 and not flight.lockstep.world.vehicles[1].airframe.state.on_ground:
            log_of(flight.lockstep.companions[1]).append(RecordKind.TRACK, b"x", flight.world.now_s)

    far = {"d1_enu_m": (0, 0, 4), "d2_enu_m": (90, 0, 4), "vel_leader_mps": 3.0, "at_end": "land"}
    flown(surveying(2, route=far, radio={"full_range_m": 30.0}), tmp_path, watch=note)
    assert [1, 2] in seen
    assert seen[-1] == []


class Knows:
    """Tells the acting leader in coverage that it knows the stand as well as it says."""

    def __init__(self, basal_area_pct: float) -> None:
        self.basal_area_pct = basal_area_pct
        self.covered_s = 0.0

    def __call__(self, flight: Flight) -> None:
        leader = flight.leader()
        if leader is not None and flight.phase() is SwarmPhase.COVERAGE:
            self.covered_s += TICK_S
            companion = flight.lockstep.companions[leader]
            assert isinstance(companion, InProcess)
            companion.endpoint.agent.receive(StandMeasured(self.basal_area_pct), flight.world.now_s)


@pytest.mark.parametrize(("pct", "covers_s"), [(9.0, 15.0), (11.0, 50.0)], ids=["known", "not known"])
def test_followers_go_with_a_leader_that_ends_coverage_as_the_mission_lets_it(
    tmp_path: Path, pct: float, covers_s: float
) -> None:
    until = {"until": {"basal_area_pct": 10.0, "after_s": 15.0}}
    plain = surveying(coverage={"duration_s": 50.0})
    mission = Mission.model_validate({**plain.model_dump(by_alias=True), "survey": until})
    knows = Knows(pct)
    outcome, shown = flown(mission, tmp_path, watch=knows)
    assert outcome.succeeded, shown
    assert covers_s - 0.5 <= knows.covered_s <= covers_s + 5.0
    assert "does not believe" not in shown
    assert "phase is false" not in shown
