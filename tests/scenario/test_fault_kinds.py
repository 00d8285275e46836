"""Faults of vehicles, receivers, sensors and disks in whole flights: what each does, and that the swarm goes on."""

from __future__ import annotations

import math
import resource
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from mission.document.model import Estimates, Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.judge.verdict import Grade
from sim_bridge.world.airframe.state import AirframeState
from tests.flights import flown, short_mission

DOWN = "fault: a motor of vehicle 2 failed"


def with_fault(
    kind: str,
    *vehicles: int,
    n: int = 4,
    at_s: float = 3.0,
    tables: Mapping[str, dict[str, Any]] = MappingProxyType({}),
    **numbers: Any,
) -> Mission:
    fault = {"kind": kind, "vehicles": vehicles, "phase": "transit", "at_s": at_s, **numbers}
    return short_mission(swarm={"size": n}, sim={"faults": [fault]}, **tables)


class Noted:
    """Truth and belief of one vehicle, tick by tick, from when its fault began."""

    def __init__(self, vehicle_id: int = 2) -> None:
        self._id = vehicle_id
        self.states: list[tuple[float, AirframeState, AirframeState, str]] = []
        self.began_s = math.inf

    def __call__(self, flight: Flight) -> None:
        if flight.faults.happened:
            self.began_s = flight.faults.happened[0].at_s
            vehicle = flight.world.vehicles[self._id]
            row = (flight.world.now_s, vehicle.airframe.state, vehicle.believed.state, vehicle.autopilot.mode)
            self.states.append(row)

    def true_ne_m(self, after_s: float) -> tuple[float, float]:
        """The true place then."""
        _, true, _, _ = next(row for row in self.states if row[0] >= self.began_s + after_s)
        return true.pos_ned_m[0], true.pos_ned_m[1]

    def off_m(self, after_s: float) -> float:
        """How far belief and truth were apart then, level."""
        _, true, believed, _ = next(row for row in self.states if row[0] >= self.began_s + after_s)
        return math.dist(true.pos_ned_m[:2], believed.pos_ned_m[:2])


@pytest.mark.parametrize("point_mass", [True, False])
def test_one_whose_motor_fails_falls_and_the_others_arrive(point_mass: bool, tmp_path: Path) -> None:
    noted = Noted()
    outcome, shown = flown(with_fault("motor", 2), tmp_path, point_mass=point_mass, watch=noted)
    assert DOWN in shown
    falls = [now_s for now_s, true, _, _ in noted.states if not true.on_ground]
    assert falls[-1] - falls[0] < 2.0
    assert outcome.metrics.contacts == 0
    assert outcome.summary["grade"] in (Grade.ARRIVED, Grade.DEGRADED), shown
    assert outcome.metrics.absent == (2,)


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_one_that_loses_its_satellites_reckons_for_five_seconds_and_lands_by_its_own_failsafe(
    personality: str, tmp_path: Path
) -> None:
    noted = Noted()
    mission = with_fault("gnss-outage", 2).with_personality(personality)
    outcome, shown = flown(mission, tmp_path, watch=noted)
    assert 0.0 < noted.off_m(4.9) < 10.0
    modes = [(now_s - noted.began_s, mode) for now_s, _, _, mode in noted.states]
    steered = modes[0][1]
    left_s = next(after_s for after_s, mode in modes if mode != steered)
    assert 5.0 <= left_s <= 5.2
    assert next(mode for after_s, mode in modes if after_s >= left_s) == "LAND"
    assert "vehicle 2: released: failsafe" in shown
    assert noted.states[-1][1].on_ground
    assert outcome.summary["grade"] == Grade.DEGRADED, shown


STAND = {"density_per_ha": 300.0, "margin_m": 25.0, "spacing_min_m": 2.5, "dbh_min_m": 0.15, "dbh_mean_m": 0.3}


@pytest.mark.parametrize(("sends", "steered"), [(True, True), (False, False)])
def test_among_trees_one_that_loses_its_satellites_flies_on_by_trunks(
    sends: bool, steered: bool, tmp_path: Path
) -> None:
    """Its autopilot is told how it moves (ODOMETRY); else it lands blindly, beside whatever stands there."""
    noted = Noted()
    tables = {
        "sensing": {"sends_odometry": sends, "sensor": "scan-1deg", "range_m": 12.0},
        "forest": {"stand": STAND},
        "coverage": {"keep_out_m": 2.0},
    }
    mission = with_fault("gnss-outage", 2, at_s=2.0, for_s=20.0, tables=tables)
    mission = mission.model_copy(
        update={"sim": mission.sim.model_copy(update={"estimates": Estimates.RECORDED, "range_finder": True})}
    )
    outcome, shown = flown(mission, tmp_path, watch=noted)
    held = {mode for now_s, _, _, mode in noted.states if now_s < noted.began_s + 20.0}
    assert (held == {"OFFBOARD"}) is steered
    assert ("vehicle 2: released: failsafe" in shown) is not steered
    if steered:
        assert outcome.succeeded, shown
        assert noted.off_m(19.0) < 12.0  # what its autopilot reports; it corrects that by trunks


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
@pytest.mark.parametrize("for_s", [3.0, 4.5])
def test_a_short_outage_is_reckoned_over(personality: str, for_s: float, tmp_path: Path) -> None:
    noted = Noted()
    mission = with_fault("gnss-outage", 2, for_s=for_s).with_personality(personality)
    outcome, shown = flown(mission, tmp_path, watch=noted)
    assert noted.off_m(for_s - 0.1) > 0.0
    assert noted.off_m(for_s + 0.1) == 0.0
    assert "vehicle 2: hold: GNSS fix lost" in shown
    assert outcome.succeeded, shown


def test_one_that_is_spoofed_flies_where_it_is_led_and_says_the_contrary(tmp_path: Path) -> None:
    noted = Noted()
    flown(with_fault("gnss-drift", 2, drift_mps=(0.3, 0.4), for_s=10.0), tmp_path, watch=noted)
    assert noted.off_m(8.0) == pytest.approx(0.5 * 8.0, abs=0.1)
    _, true, believed, _ = next(row for row in noted.states if row[0] >= noted.began_s + 8.0)
    assert believed.vel_ned_mps[0] - true.vel_ned_mps[0] == pytest.approx(0.4)
    assert noted.off_m(10.2) == 0.0


def test_scans_are_noisier_and_later_for_a_time(tmp_path: Path) -> None:
    senses = {"sensing": {"stale_s": 1.0}}
    mission = with_fault("scan-errors", 2, noise_m=1.0, delay_s=0.3, for_s=5.0, tables=senses)
    seen: set[tuple[float, float]] = set()

    def note(flight: Flight) -> None:
        drivers = flight.world.sensors[0]._drivers  # type: ignore[attr-defined]
        assert drivers[1].lidar._delay_s == 0.0
        seen.add((drivers[2].lidar._noise_m, drivers[2].lidar._delay_s))

    outcome, shown = flown(mission, tmp_path, watch=note)
    assert seen == {(0.05, 0.0), (math.hypot(0.05, 1.0), 0.3)}
    assert outcome.succeeded, shown


def test_a_full_disk_ends_the_log_and_not_the_flight(tmp_path: Path) -> None:
    limits: list[int] = []

    def note(flight: Flight) -> None:
        if flight.faults.happened and 2 in flight.lockstep.companions:
            process = flight.lockstep.companions[2].process  # type: ignore[attr-defined]
            limits.append(resource.prlimit(process.pid, resource.RLIMIT_FSIZE)[0])

    mission = with_fault("disk-full", 2, n=3, at_s=0.0)
    outcome, shown = flown(mission, tmp_path, in_process=False, watch=note)
    assert outcome.succeeded, shown
    assert set(limits) == {0}
    logs = {k: (tmp_path / "companions" / f"companion-{k}.log").read_text() for k in (1, 2)}
    assert "COVERAGE" in logs[1].upper()
    assert "COVERAGE" not in logs[2].upper()
    inside, _ = flown(mission, tmp_path / "inside")
    assert inside.summary["trace_hash"] == outcome.summary["trace_hash"]


def test_faults_of_vehicles_are_the_same_to_the_bit_on_jsbsim(tmp_path: Path) -> None:
    mission = with_fault("gnss-drift", 2, drift_mps=(0.3, 0.0), for_s=5.0)
    first, _ = flown(mission, tmp_path / "first", point_mass=False)
    again, _ = flown(mission, tmp_path / "again", point_mass=False)
    assert first.summary["trace_hash"] == again.summary["trace_hash"]


def test_a_blind_vehicle_stays_where_it_came_to_rest(tmp_path: Path) -> None:
    """By zero velocity alone, as its estimator has it, it drifts by metres."""
    noted = Noted()
    mission = with_fault("blind", 2, for_s=25.0, tables={"sensing": {}})
    mission = mission.model_copy(update={"sim": mission.sim.model_copy(update={"estimates": Estimates.RECORDED})})
    flown(mission, tmp_path, watch=noted)
    at = {after_s: noted.true_ne_m(after_s) for after_s in (6.0, 12.0, 18.0, 24.0)}
    assert max(math.dist(at[6.0], place) for place in at.values()) < 1.6  # 3.7 m without
