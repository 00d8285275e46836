"""pymavlink's mavutil as a ground station: one port, all vehicles."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from interop_kit import HAPPEN_LIMIT_S, START_LIMIT_S, Served, listening
from pymavlink import mavutil

pytestmark = pytest.mark.interop

mavlink = mavutil.mavlink
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
GPS_HZ = 20.0
HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "connect-a-ground-station.md"


def test_it_sees_all_vehicles(fleet: Served) -> None:
    seen: set[int] = set()

    def all_seen(message: mavlink.MAVLink_message) -> bool:
        if message.get_type() == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_PX4:
            seen.add(message.get_srcSystem())
        return seen == {1, 2}

    with listening(fleet) as station:
        station.until(all_seen, "heartbeats of both vehicles")


def test_the_snippet_of_the_how_to_hears_a_vehicle_by_mavlink_2(fleet: Served) -> None:
    page = HOW_TO.read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^## pymavlink\n\n```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert "udpout:127.0.0.1:14600" in snippet
    version = "print(mavutil.mavlink.WIRE_PROTOCOL_VERSION)\n"  # when it speaks first: later it follows what it hears
    script = snippet.replace("14600", str(fleet.ground_port)).replace("vehicle.mav.", f"{version}vehicle.mav.")
    environment = {name: value for name, value in os.environ.items() if name != "MAVLINK20"}
    command = [sys.executable, "-c", script]
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        timeout=START_LIMIT_S,
        check=True,
        stdin=subprocess.DEVNULL,
    )
    spoken, heartbeat = done.stdout.splitlines()
    assert spoken == "2.0"
    assert heartbeat.startswith("HEARTBEAT {type : 2, autopilot : 12,")


def test_it_lists_every_parameter_of_the_vehicle_that_it_asks(fleet: Served) -> None:
    values: dict[str, float] = {}
    with listening(fleet) as station:
        station.link.mav.param_request_list_send(2, AUTOPILOT)
        for message in station.messages(HAPPEN_LIMIT_S):
            if message.get_type() == "PARAM_VALUE":
                assert message.get_srcSystem() == 2
                values[message.param_id] = message.param_value
                if len(values) == message.param_count:
                    break
        assert len(values) == message.param_count > 50
    assert struct.unpack("<i", struct.pack("<f", values["MAV_SYS_ID"]))[0] == 2  # integers travel bytewise
    assert values["COM_OF_LOSS_T"] == 0.5


def test_it_sets_how_often_a_message_comes_from_one_vehicle(fleet: Served) -> None:
    gps, interval = mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    with listening(fleet) as station:
        for hz in (GPS_HZ, 1.0):
            station.command(1, AUTOPILOT, interval, gps, 1e6 / hz)
            ack = station.until(lambda m: m.get_type() == "COMMAND_ACK" and m.command == interval, "the answer")
            assert (ack.get_srcSystem(), ack.result) == (1, mavlink.MAV_RESULT_ACCEPTED)
            times_us: list[int] = []

            def three_came(message: mavlink.MAVLink_message, times_us: list[int] = times_us) -> bool:
                if message.get_type() == "GPS_RAW_INT" and message.get_srcSystem() == 1:
                    times_us.append(message.time_usec)
                return len(times_us) == 3

            station.until(three_came, f"GPS_RAW_INT at {hz} Hz")
            assert times_us[2] - times_us[1] == pytest.approx(1e6 / hz, abs=10_000)  # the vehicle's clock
        station.command(2, AUTOPILOT, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, gps)
        other = station.until(lambda m: m.get_type() == "MESSAGE_INTERVAL", "vehicle 2's interval")
        assert (other.get_srcSystem(), other.interval_us) == (2, 1_000_000)
