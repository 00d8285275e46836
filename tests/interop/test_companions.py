"""Companions as programs of their own, by the wall clock: they find each other, elect, and take off when told to."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, Served, child, listening, mavlink, serving

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT, heartbeat
from companion.shell.links import UdpLink
from companion.shell.urls import PEERS_SCHEMES, parse_url

pytestmark = pytest.mark.interop

# Vehicle 4 has no companion: its radio is the test's, which only listens.
MISSION = """
schema = 1
name = "three of four"
[route]
d1_enu_m = [0.0, 0.0, 10.0]
d2_enu_m = [60.0, 0.0, 10.0]
vel_leader_mps = 2.0
[swarm]
size = 4
start_timeout_s = 2.0
[sim]
placement = "grid"
"""
FLYING = (1, 2, 3)
LISTENER = 4
AIRBORNE_MM = 8_000


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Four vehicles, and a companion for each of FLYING."""
    folder = tmp_path_factory.mktemp("companions")
    with serving(folder, MISSION) as served, ExitStack() as stack:
        for vehicle_id in FLYING:
            program, *options = served.vehicle(vehicle_id)["companion"]
            command = [sys.executable, "-m", f"{program}.cli", *options]
            process = stack.enter_context(child(command, folder, f"companion-{vehicle_id}", stdin=subprocess.DEVNULL))
            assert process.poll() is None
        yield served


class Listener:
    """The radio of a vehicle that says no more than that it is there."""

    def __init__(self, served: Served) -> None:
        url = f"udpout://127.0.0.1:{served.notice['radio']['port']}"
        self._link = UdpLink(parse_url(url, PEERS_SCHEMES))
        self._codec = dialect.MAVLink(None, srcSystem=LISTENER, srcComponent=COMPONENT)
        self.beacons: dict[int, Any] = {}  # the last of each sender

    def listen(self) -> None:
        """Take in what has come, and stay known."""
        self._link.send(heartbeat().pack(self._codec))
        while (data := self._link.recv()) is not None:
            for message in self._codec.parse_buffer(bytearray(data)):
                assert message.get_type() == "SWARM_BEACON"
                self.beacons[message.get_srcSystem()] = message

    def close(self) -> None:
        """Let go."""
        self._link.close()


def test_companions_elect_one_leader_and_take_off_when_told_to(served: Served) -> None:
    listener = Listener(served)
    ready: set[int] = set()
    airborne: set[int] = set()
    told = False
    with listening(served) as station:
        for message in station.messages(HAPPEN_LIMIT_S):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            match message.get_type():
                case "STATUSTEXT" if sender[1] == COMPONENT and message.text == "ready":
                    ready.add(sender[0])
                case "GLOBAL_POSITION_INT" if message.relative_alt > AIRBORNE_MM:
                    airborne.add(sender[0])
                case "HEARTBEAT":
                    listener.listen()
                case "COMMAND_ACK" if message.command == mavlink.MAV_CMD_MISSION_START:
                    assert (sender, message.result) == ((2, COMPONENT), mavlink.MAV_RESULT_ACCEPTED)
            if ready == set(FLYING) and not told:
                assert not airborne
                assert {beacon.flight_state for beacon in listener.beacons.values()} <= {
                    FlightState.WAITING,
                    FlightState.READY,
                }
                station.command(2, COMPONENT, mavlink.MAV_CMD_MISSION_START)
                told = True
            steered = {
                k
                for k, beacon in listener.beacons.items()
                if beacon.flight_state in (FlightState.GATHERING, FlightState.TRANSIT)
            }
            if airborne == steered == set(FLYING):
                break
        assert (told, airborne, steered) == (True, set(FLYING), set(FLYING))
    assert set(listener.beacons) == set(FLYING)
    assert {beacon.leader for beacon in listener.beacons.values()} <= set(FLYING)
    assert len({beacon.leader for beacon in listener.beacons.values()}) == 1
    assert all(beacon.phase >= SwarmPhase.GATHER for beacon in listener.beacons.values())
    listener.close()
