"""What `sim-bridge fly --autopilots` makes of its options and of what autopilots say."""

from __future__ import annotations

import argparse
import math
import socket
import sys
from pathlib import Path

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.document.load import parse_mission
from sim_bridge.drive import fly_program
from sim_bridge.drive.external.autopilots import (
    SILENT_S,
    Autopilots,
    Telemetry,
    origin_at_home,
    silent_ones,
    still_up,
    strays,
)
from sim_bridge.drive.external.launched import Launched
from sim_bridge.drive.external.options import ExternalAutopilots
from sim_bridge.drive.links.router import Url, Way, open_sockets
from sim_bridge.errors import StartError
from sim_bridge.options import fly as fly_options

EACH = Url(Way.IN, "127.0.0.1", None)
MISSION = """
schema = 1
[route]
d1_enu_m = [30.0, -20.0, 5.0]
d2_enu_m = [90.0, 0.0, 5.0]
vel_leader_mps = 2.0
"""


def test_launch_is_filled_in_word_by_word_and_knows_no_shell() -> None:
    external = ExternalAutopilots(EACH, "px4 -i {index} --id={sysid} 'udp:{port} $(id) {}' ; rm")
    assert external.command(3, 14542) == ["px4", "-i", "2", "--id=3", "udp:14542 $(id) {}", ";", "rm"]


@pytest.mark.parametrize(
    ("launch", "why"),
    [("px4 'open", "No closing quotation"), ("", "no command"), ("px4 {sysID}", "{sysID}: must be one of")],
)
def test_launch_that_is_no_command_is_refused(launch: str, why: str) -> None:
    with pytest.raises(StartError, match=why):
        ExternalAutopilots(EACH, launch)


def test_udpout_to_nowhere_is_refused() -> None:
    with pytest.raises(StartError, match="wants --first-port, or --launch"):
        ExternalAutopilots(Url(Way.OUT, "127.0.0.1", None))


def test_without_origin_the_first_vehicles_home_is_on_the_ground_below_d1() -> None:
    home = Wgs84(-33.9, 151.2, 120.0)
    mission = origin_at_home(parse_mission(MISSION), home)
    assert mission.origin is not None
    north_m, east_m, down_m = LocalFrame(mission.origin.wgs84).to_ned(home)
    wanted = enu_to_ned(mission.route.d1_enu_m)
    assert (north_m, east_m) == pytest.approx(wanted[:2], abs=0.01)
    assert down_m == pytest.approx(0.0, abs=1e-6)


def position(lat: int, lon: int) -> mav.MAVLink_global_position_int_message:
    return mav.MAVLink_global_position_int_message(0, lat, lon, 488_500, 0, 100, -200, 50, 0)


def test_telemetry_keeps_position_and_velocity_in_si_units() -> None:
    telemetry = Telemetry()
    telemetry.receive_message(position(473_977_420, 85_455_940), 7.0)
    assert telemetry.position == Wgs84(47.3977420, 8.5455940, 488.5)
    assert telemetry.vel_ned_mps == (1.0, -2.0, 0.5)
    assert telemetry.position_s == 7.0


@pytest.mark.parametrize(("lat", "lon"), [(0, 0), (2**31 - 1, 5), (5, -(2**31))])
def test_position_that_is_none_changes_nothing(lat: int, lon: int) -> None:
    telemetry = Telemetry()
    telemetry.receive_message(position(lat, lon), 7.0)
    assert (telemetry.position, telemetry.position_s) == (None, -math.inf)


def attitude(roll: float, pitch: float, yaw: float) -> mav.MAVLink_attitude_message:
    return mav.MAVLink_attitude_message(0, roll, pitch, yaw, 0.0, 0.0, 0.0)


def test_attitude_is_kept_and_one_that_is_none_changes_nothing() -> None:
    telemetry = Telemetry()
    telemetry.receive_message(attitude(0.1, -0.2, 3.0), 7.0)
    telemetry.receive_message(attitude(0.1, math.nan, 3.0), 8.0)
    assert (telemetry.attitude_rad, telemetry.attitude_s) == ((0.1, -0.2, 3.0), 7.0)


@pytest.mark.parametrize("sensing", [True, False])
def test_attitude_is_asked_for_where_obstacle_sensors_look(sensing: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        url = Url(Way.OUT, "127.0.0.1", there.getsockname()[1])
        sockets = open_sockets(url, (1,), 0)
        autopilots = Autopilots((1,), sockets, print, sensing=sensing)
        autopilots.request_streams(100.0)
        asked = mav.MAVLink(None).parse_buffer(bytearray(there.recv(65536)))
        autopilots.listener.close()
        sockets.close()
    ids = {m.param1 for m in asked if m.command == mav.MAV_CMD_SET_MESSAGE_INTERVAL}
    assert (mav.MAVLINK_MSG_ID_ATTITUDE in ids) is sensing


def test_landed_state_decides_over_arming() -> None:
    telemetry = Telemetry()
    assert telemetry.on_ground
    telemetry.receive_message(mav.MAVLink_heartbeat_message(2, 12, mav.MAV_MODE_FLAG_SAFETY_ARMED, 0, 4, 3), 0.0)
    assert not telemetry.on_ground
    telemetry.receive_message(mav.MAVLink_extended_sys_state_message(0, 1), 0.0)
    assert telemetry.on_ground
    telemetry.receive_message(mav.MAVLink_extended_sys_state_message(0, 99), 0.0)
    assert telemetry.on_ground


def test_vehicle_that_stands_out_of_radio_range_of_d1_is_named() -> None:
    near, far = (-20.0, 30.0, 0.0), (-20.0, 90.0, 0.0)
    assert strays(parse_mission(MISSION), {1: near, 2: far}) == [
        "vehicle 2 stands 60 m from d1: further than the radio range of 30 m"
    ]


def test_autopilot_that_says_nothing_any_more_is_silent_until_it_speaks() -> None:
    telemetry = {1: Telemetry(), 2: Telemetry()}
    for heard in telemetry.values():
        heard.receive_message(position(473_977_420, 85_455_940), 7.0)
    assert silent_ones(telemetry, 7.0 + SILENT_S) == set()
    telemetry[2].receive_message(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3), 8.0)
    assert silent_ones(telemetry, 7.5 + SILENT_S) == {1}
    telemetry[1].receive_message(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3), 7.5 + SILENT_S)
    assert silent_ones(telemetry, 7.5 + SILENT_S) == set()


@pytest.mark.parametrize(
    "options",
    [
        ("--autopilots", "udpin://127.0.0.1:{port}", "--launch", "px4 {bogus}"),
        ("--autopilots", "udpout://127.0.0.1:{port}", "--first-port", "65535"),
        ("--autopilots", "udpin://127.0.0.1:{port}", "--launch", "no-such-program"),
    ],
)
def test_wrong_usage_leaves_no_run_folder(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fly_program, "interrupt_once", lambda: None)  # it sets signal handlers, here pytest's
    (tmp_path / "mission.toml").write_text(MISSION)
    parser = argparse.ArgumentParser()
    fly_options.configure(parser)
    args = parser.parse_args([str(tmp_path / "mission.toml"), "-n", "2", "--out", str(tmp_path / "run"), *options])
    with pytest.raises(StartError) as refused:
        fly_program.run(args)
    assert refused.value.exit_code in (2, 3)
    assert not (tmp_path / "run").exists()


def test_each_launched_program_works_in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "autopilot"
    program.write_text(f"#!{sys.executable}\nimport sys\nopen('eeprom.bin', 'x').write(sys.argv[1])\nprint('flies')\n")
    program.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    launched = Launched()
    try:
        launched.start_all({k: ["./bin/autopilot", str(k)] for k in (1, 2)}, Path("autopilots"))
        said: list[str] = []
        while len(said) < 2:  # as soon as they have ended
            said += launched.died()
    finally:
        launched.close()
    assert all("ended with exit code 0" in words for words in said)
    for k in (1, 2):
        assert (tmp_path / "autopilots" / f"autopilot-{k}" / "eeprom.bin").read_text() == str(k)
        assert (tmp_path / "autopilots" / f"autopilot-{k}.log").read_text() == "flies\n"


def test_vehicle_whose_autopilot_is_silent_is_not_waited_for() -> None:
    telemetry = {k: Telemetry() for k in (1, 2, 3)}
    for k in (1, 2):
        telemetry[k].receive_message(mav.MAVLink_heartbeat_message(2, 12, mav.MAV_MODE_FLAG_SAFETY_ARMED, 0, 4, 3), 0.0)
    assert still_up(telemetry, silent=set()) == [1, 2]
    assert still_up(telemetry, silent={2}) == [1]
