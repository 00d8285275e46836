"""Stand-in autopilots over UDP, whose simulators tell a truth 0.5 m from their estimates, or none."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.framing import wire
from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.document.load import parse_mission
from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.drive.external.autopilots import Autopilots
from sim_bridge.drive.external.flight import ExternalFlight
from sim_bridge.drive.external.sensors import Sensors
from sim_bridge.drive.links.router import Url, Way, open_sockets
from sim_bridge.judge.outcome import conclude
from sim_bridge.lab.judged import judged
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.simulated import ModelSensor

PX4, ARDUPILOT = mav.MAV_AUTOPILOT_PX4, mav.MAV_AUTOPILOT_ARDUPILOTMEGA
# Estimated 0.75 m west of the trunk's middle; in truth 0.5 m nearer: hull and trunk (0.35 + 0.2 m) touch.
ESTIMATED: tuple[Vec3, ...] = ((0.0, 9.25, -5.0), (0.0, -15.0, -5.0))
OFF_M = 0.5
TEXT = """
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [60.0, 0.0, 5.0]
vel_leader_mps = 2.0
[origin]
lat_deg = 47.397742
lon_deg = 8.545594
alt_m = 488.0
[swarm]
size = 2
[sensing]
[[forest.trees]]
base_enu_m = [10.0, 0.0]
trunk_radius_m = 0.2
height_m = 20.0
[[forest.trees]]
base_enu_m = [-12.0, 0.0]
trunk_radius_m = 0.2
height_m = 20.0
"""


@dataclass
class StandIns:
    """Two vehicles that hang in the air, and the bridge's side of them."""

    mission: Mission
    autopilots: Autopilots
    there: dict[int, socket.socket]
    asked: dict[int, set[int]]

    def tell(self, make: int, truth: tuple[int, ...], *, north_mps: int = 0, yaw_radps: float = 0.0) -> None:
        """Everything once; the simulators of those in `truth` also where they are. As all move: whole m/s, rad/s."""
        frame = LocalFrame(self.mission.origin.wgs84)  # type: ignore[union-attr]
        for k, bound in self.there.items():
            north_m, east_m, down_m = ESTIMATED[k - 1]
            messages = [
                mav.MAVLink_heartbeat_message(2, make, mav.MAV_MODE_FLAG_SAFETY_ARMED, 0, 4, 3),
                position(frame.to_wgs84((north_m, east_m, down_m)), north_mps),
                mav.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw_radps),
                mav.MAVLink_extended_sys_state_message(0, 2),
            ]
            if k in truth:
                place = frame.to_wgs84((north_m, east_m + OFF_M, down_m))
                messages.append(simulated(make, place, north_mps, yaw_radps))
            for m in messages:
                bound.send(wire.pack(m, seq=0, system=k, component=1))
        self.autopilots.listener.poll(0.1)

    def ask(self, now_s: float) -> None:
        """What the bridge asks for arrives."""
        self.autopilots.request_streams(now_s)
        for k, bound in self.there.items():
            said = read(bound.recv(65536))
            self.asked[k] |= {int(m.param1) for m in said if m.command == mav.MAV_CMD_SET_MESSAGE_INTERVAL}


def read(data: bytes) -> list[Any]:
    messages: list[Any] = mav.MAVLink(None).parse_buffer(bytearray(data)) or []
    return messages


def position(place: Wgs84, north_mps: int) -> mav.MAVLink_message:
    alt = round(place.alt_m * 1e3)
    return mav.MAVLink_global_position_int_message(0, *_e7(place), alt, 0, 100 * north_mps, 0, 0, 0)


def simulated(make: int, place: Wgs84, north_mps: int, yaw_radps: float) -> Any:
    lat, lon = _e7(place)
    if make == PX4:
        alt = round(place.alt_m * 1e3)
        return mav.MAVLink_hil_state_quaternion_message(
            0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, yaw_radps, lat, lon, alt, 100 * north_mps, 0, 0, 0, 0, 0, 0, 0
        )
    sim_state: Any = mav.MAVLink_sim_state_message
    degrees = (place.lat_deg, place.lon_deg, place.alt_m)
    vel = (float(north_mps), 0.0, 0.0)
    return sim_state(1.0, *[0.0] * 11, yaw_radps, *degrees, 0.0, 0.0, *vel, lat_int=lat, lon_int=lon)


def _e7(place: Wgs84) -> tuple[int, int]:
    return round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)


class Seen:
    """A model of a sensor that keeps the states it looks from."""

    def __init__(self) -> None:
        self.states: list[AirframeState] = []

    def frames(self, _vehicle_id: int, state: AirframeState, *_: Any) -> bytes:
        self.states.append(state)
        return b""


@pytest.fixture
def stand_ins() -> Iterator[StandIns]:
    mission = parse_mission(TEXT)
    with ExitStack() as stack:
        sockets = open_sockets(Url(Way.IN, "127.0.0.1", None), (1, 2), 0)
        stack.callback(sockets.close)
        autopilots = Autopilots((1, 2), sockets, print, sensing=True)
        stack.callback(autopilots.listener.close)
        assert mission.origin is not None
        autopilots.frame = LocalFrame(mission.origin.wgs84)
        there = {k: stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for k in (1, 2)}
        for k, bound in there.items():
            bound.settimeout(10.0)
            bound.connect(("127.0.0.1", sockets.ports[k]))
        yield StandIns(mission, autopilots, there, {1: set(), 2: set()})


@pytest.mark.parametrize(
    ("make", "streams"),
    [
        (PX4, {mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION}),
        (ARDUPILOT, {mav.MAVLINK_MSG_ID_SIM_STATE, mav.MAVLINK_MSG_ID_SIMSTATE}),
        (0, set()),  # of any other make
    ],
)
def test_each_make_is_asked_for_what_its_simulator_tells(stand_ins: StandIns, make: int, streams: set[int]) -> None:
    stand_ins.tell(make, truth=())
    assert stand_ins.autopilots.lacks_truth() is bool(streams)
    stand_ins.ask(100.0)
    truths = {mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, mav.MAVLINK_MSG_ID_SIM_STATE, mav.MAVLINK_MSG_ID_SIMSTATE}
    assert stand_ins.asked[1] & truths == streams


def test_who_has_told_no_truth_by_the_start_is_not_asked_again_nor_believed_later(stand_ins: StandIns) -> None:
    stand_ins.tell(PX4, truth=(1,))
    stand_ins.autopilots.fix_position_sources()
    stand_ins.tell(PX4, truth=(1, 2))
    stand_ins.ask(100.0)
    assert mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION in stand_ins.asked[1]
    assert mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION not in stand_ins.asked[2]
    east_m = {k: place[1] for k, place in stand_ins.autopilots.positions().items()}
    assert east_m == pytest.approx({1: 9.25 + OFF_M, 2: -15.0}, abs=0.02)


@pytest.mark.parametrize("make", [PX4, ARDUPILOT])
@pytest.mark.parametrize("told", [True, False])
def test_scans_are_cast_from_the_truth_where_it_is_told(stand_ins: StandIns, make: int, told: bool) -> None:
    stand_ins.tell(make, truth=(1, 2) if told else ())
    stand_ins.autopilots.fix_position_sources()
    with ExitStack() as stack:
        sensors = Sensors(stand_ins.mission, stand_of(stand_ins.mission, Path()), stand_ins.autopilots, stack)
        companion = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        companion.settimeout(10.0)
        (port,) = sensors.ports(2).values()
        companion.sendto(b"here", ("127.0.0.1", port))
        stand_ins.autopilots.listener.poll(10.0)
        for step in range(1, 50):
            sensors.send_due(step * 0.01, blind=())
        scans = read(companion.recv(65536))
    nearest_cm = min(min(scan.distances) for scan in scans)
    assert nearest_cm == pytest.approx(230.0 if told else 280.0, abs=15.0)  # the trunk east of vehicle 2


@pytest.mark.parametrize("make", [PX4, ARDUPILOT])
@pytest.mark.parametrize("told", [True, False])
def test_sensors_look_from_vehicles_that_move(stand_ins: StandIns, make: int, told: bool) -> None:
    """A companion takes its own motion out of raw scans: those of vehicles that stood still put a trunk 0.3 m off."""
    stand_ins.tell(make, (1, 2) if told else (), north_mps=3, yaw_radps=0.5)
    stand_ins.autopilots.fix_position_sources()
    seen = Seen()
    with ExitStack() as stack:
        sensors = Sensors(stand_ins.mission, stand_of(stand_ins.mission), stand_ins.autopilots, stack)
        sensors._sensors = (ModelSensor("obstacles", "a witness", seen),)
        sensors.send_due(0.1, blind=())
    assert [(state.vel_ned_mps, state.rates_radps) for state in seen.states] == [((3.0, 0.0, 0.0), (0.0, 0.0, 0.5))] * 2


@pytest.mark.parametrize(("truth", "suffix"), [((1, 2), ""), ((), " (by estimates)"), ((1,), " (by estimates of 2)")])
def test_contacts_figures_and_verdict_are_by_truth_or_say_that_they_are_not(
    stand_ins: StandIns, truth: tuple[int, ...], suffix: str, tmp_path: Path
) -> None:
    stand_ins.tell(PX4, truth)
    stand_ins.autopilots.fix_position_sources()
    (tmp_path / "mission.toml").write_text(TEXT)
    with ExitStack() as stack:
        flight = ExternalFlight(stand_ins.mission, stand_ins.autopilots, tmp_path, stack)
        while len(flight.recorder.recording().time_s) < 3:
            stand_ins.tell(PX4, truth)
            flight.step()
        recording = flight.recorder.recording()
        outcome = conclude(
            recording, stand_ins.mission, tmp_path, "interrupted", flown_s=1.0, wall_s=1.0, trace_hash=None,
            stand=flight.stand, estimates=flight.errors(),
        )  # fmt: skip
    east_m = [ESTIMATED[k - 1][1] + (OFF_M if k in truth else 0.0) for k in (1, 2)]
    assert recording.pos_ned_m[-1, :, 1] == pytest.approx(east_m, abs=0.02)
    assert outcome.metrics.contacts_trunks == (1 if 1 in truth else 0)
    assert flight.last.touched[0] == ("trunk" if 1 in truth else "")
    assert outcome.summary["verdict"].endswith(suffix)
    assert ("by estimates" in outcome.summary["verdict"]) is bool(suffix)
    assert outcome.summary["positions_by_estimates"] == suffix.strip(" ()")
    errors = [outcome.summary[f"estimate_error_{which}_m"] for which in ("rms", "max")]
    if truth:
        assert errors == pytest.approx([OFF_M, OFF_M], abs=0.02)
        assert outcome.summary["estimate_height_error_max_m"] == pytest.approx(0.0, abs=0.01)
        assert outcome.summary["estimate_yaw_error_max_deg"] == pytest.approx(0.0, abs=math.degrees(1e-3))
    else:
        assert errors == [None, None]
    again = judged(tmp_path)
    assert again.verdict.text == outcome.summary["verdict"]
    assert all("estimate_off" in vehicle for vehicle in again.document()["vehicles"])
