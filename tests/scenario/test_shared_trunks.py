"""Swarms of which only the leader has GNSS, by raw scans among trees: trunks that vehicles share place one another."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.world.autopilot.estimates.odometry import Odometer
from tests.flights import flown
from tests.scenario.test_black_box_flights import replayed_in
from tests.unit.core.ranging_kit import ranging_mission


def among_trees(**tables: Any) -> Mission:
    return ranging_mission(
        sensing={"sensor": "scan-1deg", "range_m": 12.0},
        forest={"stand": {"density_per_ha": 400.0}},
        sim={"seed": 1000, "radio_loss": 0.1, **tables.pop("sim", {})},
        **tables,
    )


class Relative:
    """Errors of where vehicles in transit have one another, by their own odometry's axes; root of the mean square."""

    def __init__(self) -> None:
        self._squares: list[float] = []

    def watch(self, flight: fly.Flight) -> None:
        places = flight.world.positions()
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            agent = companion.endpoint.agent
            localiser, believed = agent.localiser, flight.world.vehicles[k].believed
            if agent.swarm.phases.phase is not SwarmPhase.TRANSIT or not agent.flight.vehicle.airborne:
                continue
            assert isinstance(localiser, GnssDeniedLocaliser)
            off_rad = believed.north_off_rad if isinstance(believed, Odometer) else 0.0
            by_rad = off_rad - agent.perception.motion.turn_rad - localiser.ranging.filter.compass[0]  # type: ignore[attr-defined]
            for other in (j for j in places if j != k):
                found = localiser.ranging.filter.relative(other)
                if found is not None:
                    (n, e), c, s = found.ne_m, math.cos(by_rad), math.sin(by_rad)
                    north_m, east_m = places[other][0] - places[k][0], places[other][1] - places[k][1]
                    self._squares.append((c * n - s * e - north_m) ** 2 + (s * n + c * e - east_m) ** 2)

    @property
    def error_m(self) -> float:
        return math.sqrt(sum(self._squares) / len(self._squares))


def test_vehicles_that_share_trunks_know_better_where_the_others_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared, alone = Relative(), Relative()
    outcome, shown = flown(among_trees(), tmp_path / "shared", watch=shared.watch)
    assert outcome.summary["verdict"] == "ARRIVED", shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m >= 4.5
    monkeypatch.setattr(Mission, "shares_trunks", False)
    flown(among_trees(), tmp_path / "alone", watch=alone.watch)
    assert shared.error_m < 0.12
    assert shared.error_m < 0.75 * alone.error_m


def test_it_is_the_same_flight_to_the_bit_in_one_process_and_in_many(tmp_path: Path) -> None:
    """Trunks go through sockets, too."""
    mission = among_trees(sim={"time_limit_s": 30.0})
    one, _ = flown(mission, tmp_path / "one")
    many, shown = flown(mission, tmp_path / "many", in_process=False)
    assert one.summary["trace_hash"] == many.summary["trace_hash"], shown


def test_a_signed_flight_with_trunks_replays_bit_for_bit(tmp_path: Path) -> None:
    mission = among_trees(swarm={"size": 3}, sim={"time_limit_s": 58.0})
    told: set[int] = set()

    def note_told(flight: fly.Flight) -> None:
        for k, companion in flight.lockstep.companions.items():
            assert isinstance(companion, InProcess)
            localiser = companion.endpoint.agent.localiser
            assert isinstance(localiser, GnssDeniedLocaliser)
            assert localiser.trunks is not None
            if localiser.trunks.aligned:
                told.add(k)

    flown(mission, tmp_path, keys=FleetKeys(mission), black_box=True, watch=note_told)
    assert len(told) >= 2  # they have aligned what another told, through the guard
    for replayed in replayed_in(tmp_path):
        assert (replayed.difference, replayed.breaks, replayed.stopped) == ([], [], "")
        assert replayed.same == replayed.summary.ticks > 100
