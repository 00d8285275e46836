"""Flights in which a vehicle runs into a trunk: it falls and is lost, and the others go on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mission.document.load import load_mission
from sim_bridge.drive.fly import Flight
from sim_bridge.judge import run_folder
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.flights import flown, short_mission

TRUNK_EAST_M, TRUNK_RADIUS_M = 20.0, 0.6


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_a_leader_that_runs_into_a_trunk_falls_and_another_takes_the_others_on(
    personality: str, tmp_path: Path
) -> None:
    trunk = {"base_enu_m": (TRUNK_EAST_M, 0.0), "trunk_radius_m": TRUNK_RADIUS_M, "height_m": 15.0}
    mission = short_mission(
        swarm={"size": 5}, forest={"trees": (trunk,)}, sim={"placement": "ring", "personality": personality}
    )
    modes: set[tuple[bool, bool]] = set()  # of the vehicle that fell: armed, on the ground

    def watch(flight: Flight) -> None:
        for vehicle_id in flight.world.touched:
            vehicle = flight.world.vehicles[vehicle_id]
            modes.add((vehicle.autopilot.armed, vehicle.airframe.state.on_ground))

    outcome, shown = flown(mission, tmp_path, watch=watch)
    metrics = outcome.metrics
    (fallen,) = metrics.lost
    assert (metrics.contacts, metrics.contacts_trunks) == (1, 1)
    assert f"vehicle {fallen} has run into a trunk" in shown
    assert outcome.summary["verdict"].startswith(f"UNSAFE without {fallen}: 1 contact (1 with trunks)")
    assert metrics.arrived, shown
    assert metrics.leader_changes >= 1
    assert (False, True) in modes  # its autopilot has seen that it crashed, and disarmed
    recording = run_folder.load(tmp_path)
    column = fallen - 1
    began = int(np.flatnonzero(recording.touched[:, column])[0])
    at_ned_m = recording.pos_ned_m[began, column]
    assert np.hypot(at_ned_m[0], at_ned_m[1] - TRUNK_EAST_M) < TRUNK_RADIUS_M + 0.6
    assert np.array_equal(recording.pos_ned_m[-1, column, :2], at_ned_m[:2])  # it stays where it fell
    assert recording.pos_ned_m[-1, column, 2] == 0.0
    assert not recording.agent_alive[began:, column].any()
    others = [k for k in range(5) if k != column]
    assert recording.agent_alive[-1, others].all()


def test_a_swarm_starts_on_a_slope_and_lands_on_it(tmp_path: Path) -> None:
    mission = short_mission(
        route={"d2_enu_m": (40, 0, 7.2), "at_end": "land"}, forest={"grade": (0.08, 0.0)}, sensing={"range_m": 8.0}
    )
    outcome, shown = flown(mission, tmp_path)
    assert outcome.succeeded, shown
    recording = run_folder.load(tmp_path)
    for tick in (0, -1):
        _, east_m, down_m = recording.pos_ned_m[tick].T
        assert -down_m == pytest.approx(0.08 * east_m, abs=0.01)
        assert recording.on_ground[tick].all()


def test_one_that_was_blind_keeps_clear_of_its_dead_leader(tmp_path: Path) -> None:
    faults = [
        {"kind": "kill", "at_s": 40.0},
        {"kind": "blind", "vehicles": (2,), "at_s": 45.0, "for_s": 1.5},
    ]
    mission = load_mission("mission/examples/managed_stand.toml").with_size(4).with_faults(faults)
    outcome, shown = flown(mission.with_origin(DEFAULT_ORIGIN), tmp_path, point_mass=False)
    assert outcome.metrics.contacts == 0, shown
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m >= 5.0
