"""Flights without range radios: vehicles find one another by the trunks that they share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.lockstep import InProcess
from tests.flights import flown
from tests.scenario.test_flights_by_ranges import Restarted
from tests.scenario.test_shared_trunks import Relative
from tests.unit.core.ranging_kit import STARTS, ranging_mission


def by_trunks(**tables: Any) -> Mission:
    return ranging_mission(
        ranging={"radio": False} | tables.pop("ranging", {}),
        sensing={"sensor": "scan-0.5deg", "range_m": 20.0},
        forest={"stand": {"density_per_ha": 400.0}},
        sim={"seed": 1000, "radio_loss": 0.1, **tables.pop("sim", {})},
        **tables,
    )


def test_a_swarm_arrives_by_trunks_alone(tmp_path: Path) -> None:
    relative, measured = Relative(), set[int]()

    def watch(flight: fly.Flight) -> None:
        relative.watch(flight)
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            localiser = companion.endpoint.agent.localiser
            assert isinstance(localiser, GnssDeniedLocaliser)
            if any(localiser.ranging.measured_m(j, flight.world.now_s, 1.0) < 1e3 for j in range(1, 5)):
                measured.add(k)

    outcome, shown = flown(by_trunks(), tmp_path, watch=watch)
    assert outcome.summary["verdict"] == "ARRIVED", shown
    assert outcome.metrics.contacts == 0
    assert "start not confirmed" not in shown
    assert outcome.metrics.min_separation_m >= 4.5
    assert relative.error_m < 0.4
    assert not measured


def test_without_alignments_nobody_sets_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mission = by_trunks(sim={"time_limit_s": 120.0})
    monkeypatch.setattr(Mission, "shares_trunks", False)
    outcome, shown = flown(mission, tmp_path)
    assert not outcome.metrics.arrived
    assert outcome.metrics.contacts == 0
    assert "hold: vehicle 1 position uncertain" in shown
    assert "start not confirmed: no trunks in common" in shown
    assert "transit" not in shown


def test_starts_that_are_a_mirror_image_are_found_by_trunks(tmp_path: Path) -> None:
    """Companions have another mission than the world: vehicles 2 and 3 have changed places."""
    mission = by_trunks()
    told = by_trunks(ranging={"start_enu_m": [STARTS[0], STARTS[2], STARTS[1], STARTS[3]]})
    begun: list[bool] = []

    def watch(flight: fly.Flight) -> None:
        if not begun:
            begun.append(True)
            for k in flight.lockstep.companions:
                flight.lockstep.companions[k] = InProcess(told, k)

    outcome, shown = flown(mission, tmp_path, watch=watch)
    assert outcome.metrics.arrived, shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
    assert "start positions wrong: vehicle 1 found elsewhere" in shown


def test_a_companion_that_starts_again_in_flight_finds_the_others_by_trunks(tmp_path: Path) -> None:
    faults = [{"kind": "kill", "vehicles": [3], "phase": "transit", "at_s": 8.0}]
    restarted = Restarted(3, 5.0)
    outcome, shown = flown(by_trunks(sim={"faults": faults}), tmp_path, watch=restarted.watch)
    assert outcome.metrics.arrived, shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
    assert restarted.back_s is not None
    assert restarted.steers_s is not None
    assert restarted.steers_s - restarted.back_s <= 10.0
    assert restarted.worst_m <= 2.0
