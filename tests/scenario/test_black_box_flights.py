"""Faulted flights with black boxes: each is run again of its log alone, bit for bit; none flies otherwise for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.journal import journal
from companion.journal.reading import find_flights
from companion.journal.replay import Replayed, replay_flight
from mission.document.model import Mission
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from tests.flights import flown, short_mission
from tests.scenario.test_record_flights import surveying
from tests.unit.core.ranging_kit import ranging_mission

MISSIONS: dict[str, dict[str, Any]] = {
    "a leader killed, beacons lost and late": {
        "sim": {"seed": 3, "radio_loss": 0.2, "radio_delay_s": 0.1, "faults": [{"kind": "kill", "at_s": 25.0}]}
    },
    "restarted, stopped, and out of radio contact": {
        "sim": {
            "seed": 4,
            "personalities": {"2": "ardupilot"},
            "faults": [
                {"kind": "restart", "vehicles": [2], "at_s": 20.0, "for_s": 2.0},
                {"kind": "stop", "vehicles": [3], "at_s": 26.0, "for_s": 3.0},
                {"kind": "partition", "vehicles": [4], "at_s": 30.0, "for_s": 8.0},
                {"kind": "late", "vehicles": [1], "late_s": 0.6, "at_s": 22.0, "for_s": 6.0},
            ],
        }
    },
    "sectors among trunks, and one blind": {
        "route": {"d2_enu_m": (25, 0, 4)},
        "sensing": {},
        "forest": {"stand": {"density_per_ha": 200.0}},
        "sim": {"seed": 5, "faults": [{"kind": "blind", "vehicles": [2], "at_s": 18.0, "for_s": 2.0}]},
    },
    "a fix lost": {
        "sim": {"seed": 7, "faults": [{"kind": "gnss-outage", "vehicles": [2], "at_s": 20.0, "for_s": 6.0}]}
    },
}


RANGE_ERRORS = {"kind": "range-errors", "vehicles": [3], "bias_m": 1.0, "noise_m": 0.3, "at_s": 20.0, "for_s": 5.0}


def replayed_in(folder: Path) -> list[Replayed]:
    return [replay_flight(flight) for flight in find_flights(folder / FOLDER_NAME)]


def hash_of(mission: Mission, folder: Path, *, black_box: bool) -> str:
    outcome, _ = flown(mission, folder, black_box=black_box)
    return str(outcome.summary["trace_hash"])


@pytest.mark.parametrize("name", [*MISSIONS, "by ranges that are wrong", "surveyed, over a bad radio"])
def test_a_faulted_flight_replays_bit_for_bit(name: str, tmp_path: Path) -> None:
    if name in MISSIONS:
        mission = short_mission(**MISSIONS[name])
    elif "ranges" in name:
        mission = ranging_mission(swarm={"leader_priority": [1]}, sim={"seed": 1000, "faults": [RANGE_ERRORS]})
    else:
        faults = [{"kind": "restart", "vehicles": [2], "at_s": 20.0, "for_s": 2.0}]
        mission = surveying(3, sim={"radio_loss": 0.2, "faults": faults})
    flown(mission, tmp_path, black_box=True)
    replays = replayed_in(tmp_path)
    restarts = sum(fault.kind.value == "restart" for fault in mission.sim.faults)
    assert len(replays) == mission.swarm.size + restarts
    for replayed in replays:
        assert (replayed.difference, replayed.breaks, replayed.stopped) == ([], [], "")
        assert replayed.same == replayed.summary.ticks > 100


def test_a_signed_flight_replays_without_its_keys(tmp_path: Path) -> None:
    faults = [{"kind": "restart", "vehicles": [3], "at_s": 20.0, "for_s": 2.0}]
    mission = short_mission(sim={"seed": 8, "radio_loss": 0.2, "faults": faults})
    flown(mission, tmp_path, keys=FleetKeys(mission), black_box=True)
    replays = replayed_in(tmp_path)
    assert len(replays) == 5
    for replayed in replays:
        assert (replayed.difference, replayed.breaks, replayed.stopped) == ([], [], "")
        assert replayed.same == replayed.summary.ticks > 100


def test_companions_that_are_processes_keep_them_too_and_one_that_is_killed_loses_a_quarter_of_a_second(
    tmp_path: Path,
) -> None:
    faults = [{"kind": "kill", "vehicles": [2], "at_s": 12.0}]
    mission = short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)}, sim={"faults": faults})
    flown(mission, tmp_path, in_process=False, black_box=True)
    whole, killed = replayed_in(tmp_path)
    assert whole.ends.startswith("stopped by SIGTERM")
    assert whole.is_same
    assert killed.ends.startswith("without being closed: ")
    assert killed.is_same
    assert 11.7 <= killed.summary.last_s < 12.0
    log = (tmp_path / "companions" / "companion-1.log").read_text()
    assert f"head of the chain {whole.head}" in log


@pytest.mark.parametrize("in_process", [pytest.param(True, marks=pytest.mark.sources), False])
def test_a_full_disk_changes_no_setpoint(in_process: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "WAITING_BYTES", 20_000)  # of companions in this process: a gap, too
    fault = {"kind": "disk-full", "vehicles": [1, 2], "at_s": 6.0, "for_s": 20.0}
    tables: dict[str, Any] = {"swarm": {"size": 2}, "route": {"d2_enu_m": (12, 0, 4)}}
    plain = hash_of(short_mission(**tables), tmp_path / "plain", black_box=False)
    mission = short_mission(**tables, sim={"faults": [fault]})
    outcome, _ = flown(mission, tmp_path / "full", black_box=True, in_process=in_process)
    assert outcome.summary["trace_hash"] == plain
    for replayed in replayed_in(tmp_path / "full"):
        assert (replayed.difference, replayed.breaks) == ([], [])
        if in_process:
            assert replayed.stopped.startswith("gap: ticks ")
            assert replayed.stopped.endswith("were lost (disk full)")
        else:  # kept in memory, and written later
            assert replayed.is_same


def test_a_flight_is_the_same_with_a_black_box_and_without(tmp_path: Path) -> None:
    mission = short_mission(**MISSIONS["restarted, stopped, and out of radio contact"])
    assert hash_of(mission, tmp_path / "with", black_box=True) == hash_of(
        mission, tmp_path / "without", black_box=False
    )


def test_a_flight_of_another_law_says_that_it_cannot_be_replayed(tmp_path: Path) -> None:
    """It is no decision of ours, and the log does not hold it."""
    mission = short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)})
    flown(mission, tmp_path, entrant=Entrant(safety_filter=False), black_box=True)
    for replayed in replayed_in(tmp_path):
        assert replayed.stopped == "it was flown by WITHOUT SAFETY FILTER, which the log does not hold"
        assert replayed.breaks == []


def test_without_one_no_folder_is_made(tmp_path: Path) -> None:
    flown(short_mission(swarm={"size": 1}, route={"d2_enu_m": (12, 0, 4)}), tmp_path)
    assert not (tmp_path / FOLDER_NAME).exists()
