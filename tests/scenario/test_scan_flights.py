"""Flights by scans: the same in one process as in many, and what a vehicle does whose obstacle sensor falls silent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pymavlink import mavutil

from companion.core.model.states import FlightState
from companion.core.vehicle.failsafe import Cause
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.judge.run_folder import load_faults
from tests.flights import flown, short_mission

# Beside the way, within sight of it
TREES = [
    {"base_enu_m": (east_m, north_m), "trunk_radius_m": 0.2, "height_m": 20.0}
    for east_m in (10.0, 20.0, 30.0)
    for north_m in (-9.0, 9.0)
]
BLIND = {"kind": "blind", "vehicles": (2,), "phase": "transit", "at_s": 3.0, "for_s": 2.0}


def seeing(*faults: dict[str, Any], **sim: Any) -> Mission:
    return short_mission(
        sensing={},
        forest={"trees": TREES},
        swarm={"size": 3},
        sim={"seed": 1, "faults": faults, "time_limit_s": 40.0, **sim},
    )


class Watch:
    """Notes, tick by tick, what vehicle 2 does, why, how old its scans are, and how fast it is."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, FlightState, Cause | None, float, float]] = []

    def __call__(self, flight: Flight) -> None:
        now_s, companion = flight.world.now_s, flight.lockstep.companions[2]
        agent = companion.endpoint.agent  # type: ignore[attr-defined]
        status = agent.status(now_s)
        north_mps, east_mps, _ = flight.world.vehicles[2].airframe.state.vel_ned_mps
        self.seen.append(
            (now_s, status.state, status.cause, agent.sensors.age_s(now_s), abs(north_mps) + abs(east_mps))
        )


def test_flight_by_scans_is_the_same_to_the_bit_in_one_process_and_in_many(tmp_path: Path) -> None:
    faults = (BLIND, {"kind": "stop", "vehicles": (3,), "phase": "transit", "at_s": 4.0, "for_s": 1.0})
    one, _ = flown(seeing(*faults), tmp_path / "one")
    many, _ = flown(seeing(*faults), tmp_path / "many", in_process=False)
    assert one.summary["trace_hash"] == many.summary["trace_hash"]
    assert one.metrics == many.metrics
    assert len(load_faults(tmp_path / "many")) == 2
    assert load_faults(tmp_path / "many") == load_faults(tmp_path / "one")
    blind, _ = flown(seeing(), tmp_path / "never")
    assert blind.summary["trace_hash"] != one.summary["trace_hash"]


def test_vehicle_whose_scans_stop_brakes_and_holds_and_flies_on_with_the_next(tmp_path: Path) -> None:
    watch = Watch()
    _, shown = flown(seeing(BLIND), tmp_path, watch=watch)
    (event,) = load_faults(tmp_path)
    assert "fault: vehicle 2 blind for 2 s" in shown
    assert event.until_s is not None
    stale = [now_s for now_s, _, cause, _, _ in watch.seen if cause is Cause.OBSTACLES_STALE]
    assert event.at_s + 0.2 <= stale[0] <= event.at_s + 0.5  # 0.3 s after the last scan, which came before
    assert event.until_s - 0.1 <= stale[-1] <= event.until_s + 0.2
    assert all(
        state is FlightState.HOLD for now_s, state, _, _, _ in watch.seen if now_s in stale and now_s > stale[0] + 0.1
    )
    at_rest = [mps for now_s, _, _, _, mps in watch.seen if stale[0] + 1.5 < now_s < stale[-1]]
    assert at_rest
    assert max(at_rest) < 0.3
    after = [state for now_s, state, _, _, _ in watch.seen if now_s > stale[-1] + 1.0]
    assert FlightState.TRANSIT in after
    fresh = [age_s for now_s, state, _, age_s, _ in watch.seen if state is FlightState.TRANSIT]
    assert max(fresh) < 0.35


def test_leader_that_stays_blind_rests_then_lands_and_another_leads_the_others_on(tmp_path: Path) -> None:
    mission = short_mission(
        sensing={},
        forest={"trees": TREES},
        swarm={"size": 4},
        coverage={"duration_s": 60.0},
        sim={"seed": 1, "faults": [{"kind": "blind", "phase": "transit", "at_s": 2.5}]},
    )
    outcome, shown = flown(mission, tmp_path)
    (event,) = load_faults(tmp_path)
    (blind,) = event.vehicles
    assert f"vehicle {blind}: hold: obstacle scan lost" in shown
    assert f"vehicle {blind}: land: no obstacle scan for 60 s" in shown
    metrics = outcome.metrics
    assert metrics.landed_early == (blind,)
    assert metrics.absent == (blind,), shown
    assert metrics.leader_changes >= 1
    assert metrics.contacts == 0


def test_both_makes_of_autopilot_tell_the_attitude_that_scans_are_placed_by(tmp_path: Path) -> None:
    mission = short_mission(
        sensing={}, forest={"trees": TREES}, swarm={"size": 2}, sim={"seed": 1, "personalities": {2: "ardupilot"}}
    )
    dropped: dict[int, list[int]] = {1: [], 2: []}

    def note(flight: Flight) -> None:
        for k, companion in flight.lockstep.companions.items():
            sensor = companion.endpoint.sensors.sources[0]  # type: ignore[attr-defined]
            dropped[k].append(sensor.counters()["scans without attitude"])

    outcome, shown = flown(mission, tmp_path, watch=note)
    assert outcome.metrics.arrived, shown
    for counts in dropped.values():
        assert counts[-1] == counts[60]  # within 3 s of the boot it flows, and never stops
    assert "no obstacle scan" not in shown


def test_scans_that_autopilots_forward_are_flown_by_too_and_are_late_with_the_telemetry(tmp_path: Path) -> None:
    late = {"kind": "late", "vehicles": (2,), "phase": "transit", "at_s": 3.0, "late_s": 0.35, "for_s": 3.0}
    mission = seeing(late, lidar={"via": "autopilot"})
    watch = Watch()
    one, _ = flown(mission, tmp_path / "one", watch=watch)
    many, _ = flown(mission, tmp_path / "many", in_process=False)
    assert one.summary["trace_hash"] == many.summary["trace_hash"]
    (event,) = load_faults(tmp_path / "one")
    assert event.until_s is not None
    states = {state for now_s, state, _, _, _ in watch.seen if now_s < event.at_s}
    assert FlightState.TRANSIT in states
    ages_s = [age_s for now_s, _, _, age_s, _ in watch.seen if event.at_s + 1.0 < now_s < event.until_s]
    assert min(ages_s) >= 0.3  # by the driver's clock: they come as often as ever
    causes = {cause for now_s, _, cause, _, _ in watch.seen if event.at_s + 1.0 < now_s < event.until_s}
    assert causes == {Cause.OBSTACLES_STALE}  # positions are held against 0.4 s


def test_scans_are_what_a_driver_sends_and_are_kept_with_the_flight(tmp_path: Path) -> None:
    """Read by pymavlink's common dialect from the telemetry log, as by any tool that opens it."""
    outcome, _ = flown(seeing(), tmp_path)
    log = mavutil.mavlink_connection(str(tmp_path / "vehicle-1.tlog"), dialect="common")
    seen = iter(lambda: log.recv_match(type="OBSTACLE_DISTANCE"), None)
    nearest_cm = []
    for m in seen:
        assert (m.get_srcSystem(), m.get_srcComponent()) == (1, mavutil.mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE)
        assert (m.frame, m.increment_f, m.max_distance) == (mavutil.mavlink.MAV_FRAME_BODY_FRD, 5.0, 800)
        nearest_cm.append(min(m.distances))
    assert abs(len(nearest_cm) - 10.0 * outcome.metrics.sim_time_s) <= 2
    assert min(nearest_cm) < 800  # a trunk, or another vehicle
