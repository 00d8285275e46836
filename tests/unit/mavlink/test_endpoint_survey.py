"""A survey gets the lidar's pieces with the tick's pose, and the records get its finds; without, nothing changes."""

from __future__ import annotations

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.events import LidarScan
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle, VehicleTracks
from companion.mavlink import dialect, harvest
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, encode_lidar_scan
from companion.sensors.table import sensors_of
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.mavlink.endpoint_kit import HOME, ME, heartbeat, packed, position

FLOWN = mission(sensing={"sensor": "scan-1deg"}, survey={})
ATTITUDE = dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0)


class Listening:
    """A survey that notes what it is given, and finds one thing a tick."""

    def __init__(self) -> None:
        self.scans: list[tuple[LidarScan, ScanPose, float]] = []

    def integrate(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        self.scans.append((scan, pose, now_s))

    def take_records(self, pose: ScanPose | None, now_s: float) -> list[tuple[int, bytes]]:
        return [(1, f"{pose is not None} {now_s}".encode())]


class Kept:
    def __init__(self) -> None:
        self.bodies: list[tuple[int, bytes, float]] = []

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        self.bodies.append((kind, body, now_s))

    def receive(self, _frame: bytes, _now_s: float) -> bool:
        return False

    def frames(self, _now_s: float, _beacon_bytes: int) -> list[tuple[int, bytes]]:
        return []

    def take_stand(self, **_: object) -> None:
        return None

    def lines(self) -> list[str]:
        return []


def piece() -> bytes:
    payload = encode_lidar_scan(
        time_us=10,
        ray_time_s=0.0,
        first_bearing_deg=0.0,
        bearing_step_deg=1.0,
        elevation_deg=0.0,
        min_m=0.1,
        max_m=12.0,
        turn=1,
        ranges_mm=[4000] * 90,
    )
    return wire.Sender(ME, 196).frame(LIDAR_SCAN_ID, payload)


def hand_over(one: Endpoint) -> None:
    one.from_autopilot(packed(HOME, position(), heartbeat(), ATTITUDE), 1.0)
    one.from_sensor(piece(), 1.0)


def test_pieces_reach_the_survey_with_the_pose_and_its_records_are_kept() -> None:
    survey, kept = Listening(), Kept()
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), survey=survey, records=kept)
    hand_over(one)
    one.tick(1.0)
    ((scan, pose, now_s),) = survey.scans
    assert len(scan.ranges_m) == 90
    assert pose.pos_ned_m[2] == -8.0
    assert now_s == 1.0
    assert kept.bodies == [(1, b"True 1.0", 1.0)]


def test_without_a_position_nothing_is_placed() -> None:
    survey, kept = Listening(), Kept()
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), survey=survey, records=kept)
    one.from_autopilot(packed(ATTITUDE), 1.0)
    one.from_sensor(piece(), 1.0)
    one.tick(1.0)
    assert survey.scans == []
    assert kept.bodies == [(1, b"False 1.0", 1.0)]


def test_an_endpoint_flies_the_same_with_a_survey_and_without() -> None:
    plain = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN))
    surveying = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), survey=Listening())
    hand_over(plain)
    hand_over(surveying)
    assert plain.tick(1.0) == surveying.tick(1.0)


class Broken(Listening):
    """A survey with a defect in one of its parts."""

    def __init__(self, part: str) -> None:
        super().__init__()
        self.part, self.calls = part, 0

    def _run(self, part: str) -> None:
        self.calls += 1
        if part == self.part:
            raise ValueError("nothing to fit")

    def integrate(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        self._run("integrate")
        super().integrate(scan, pose, now_s)

    def take_records(self, pose: ScanPose | None, now_s: float) -> list[tuple[int, bytes]]:
        self._run("take_records")
        return super().take_records(pose, now_s)


@pytest.mark.parametrize("part", ["integrate", "take_records"])
def test_a_survey_that_raises_stops_and_the_flight_goes_on(part: str) -> None:
    survey, kept = Broken(part), Kept()
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), survey=survey, records=kept)
    plain = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN))
    hand_over(one)
    hand_over(plain)
    first, calls = one.tick(1.0), survey.calls
    plain.tick(1.0)
    said = [say.text for say in first.said if say.text.startswith("survey")]
    assert said == ["survey: stopped by an error"]
    assert one.survey is not None
    assert one.survey.error.startswith("ValueError: nothing to fit (test_endpoint_survey.py:")
    assert kept.bodies == []
    later = one.tick(1.05)
    assert survey.calls == calls  # it is not asked again
    assert [say.text for say in later.said] == [say.text for say in plain.tick(1.05).said]  # once


def test_a_pose_that_cannot_be_had_stops_the_survey_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_agent: object, _now_s: float) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(harvest, "scan_pose_of", refuse)
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), survey=Listening(), records=Kept())
    hand_over(one)
    assert "survey: stopped by an error" in [say.text for say in one.tick(1.0).said]


def standing_about(*, silent: dict[int, PeerReport], heard: list[Neighbour]) -> list[tuple[float, float]]:
    """Places that a survey is told, of a vehicle that is at (1, 0)."""
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN))
    hand_over(one)
    one.agent.localiser.silent, one.agent.localiser.neighbours = silent, heard
    pose = harvest.scan_pose_of(one.agent, 1.0)
    assert pose is not None
    return [(round(n, 3), round(e, 3)) for n, e in pose.standing_ne_m]


def test_a_survey_is_told_where_vehicles_hover() -> None:
    silent = PeerReport(1, (5.0, 2.0, 0.0), 3.0, silent=True, elsewhere=((9.0, 0.0, 0.0),))
    held = neighbour(2, rel_ned_m=(0.0, 7.0, 0.0), state=FlightState.RELEASED, airborne=True)
    assert held.stands
    assert standing_about(silent={1: silent}, heard=[held]) == [(6.0, 2.0), (10.0, 0.0), (1.0, 7.0)]


def test_a_neighbour_that_is_steered_is_no_place_to_leave_out() -> None:
    flown = neighbour(2, rel_ned_m=(0.0, 7.0, 0.0), state=FlightState.TRANSIT, airborne=True)
    assert standing_about(silent={}, heard=[flown]) == []


@pytest.mark.sources
def test_a_vehicle_that_is_seen_to_stand_is_told_and_one_that_moves_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = [
        SeenVehicle((3.0, 1.0, 0.0), (0.1, 0.1, 0.0), 0.1, 0.0),
        SeenVehicle((-3.0, 1.0, 0.0), (0.7, 0.0, 0.0), 0.1, 0.0),
    ]
    monkeypatch.setattr(VehicleTracks, "find_vehicles", lambda *_: seen)
    assert standing_about(silent={}, heard=[]) == [(4.0, 1.0)]
