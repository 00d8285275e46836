"""`sim-bridge serve`: which port gets what, and which ground stations and companions may speak."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from companion.mavlink import dialect as mav
from sim_bridge.drive.serve import server
from sim_bridge.drive.serve.server import CLIENT_SILENCE_S, Ports, Server
from sim_bridge.errors import StartError
from sim_bridge.options import serve as serve_options
from sim_bridge.world.world import World
from tests.unit.drive.serve.server_kit import COMPANION, GCS, Peer, frame, heartbeat, ignore, turn


def test_onboard_streams_are_pushed_to_who_has_not_spoken(world: World, ports: Ports) -> None:
    api = Peer(ports.ground.getsockname()[1])
    pushing = Server(world, ports, push_onboard=dict.fromkeys((1, 2, 3), api.socket.getsockname()), say=ignore)
    try:
        turn(pushing, 120)
        assert api.systems() == {1, 2, 3}
    finally:
        pushing.close()
        api.socket.close()


@pytest.mark.parametrize(
    ("text", "addresses"),
    [("127.0.0.1:14549", [14549, 14549, 14549]), ("127.0.0.1:14540+", [14540, 14541, 14542])],
)
def test_onboard_to_is_one_port_or_a_row_of_them(text: str, addresses: list[int]) -> None:
    assert serve_options.onboard_to(text).of((1, 2, 3)) == {k: ("127.0.0.1", addresses[k - 1]) for k in (1, 2, 3)}


def test_onboard_to_that_has_no_room_is_refused() -> None:
    with pytest.raises(StartError, match="--onboard-to: port 65534 and up is too high"):
        serve_options.onboard_to("127.0.0.1:65534+").of((1, 2, 3))


class TestGround:
    def test_every_client_that_speaks_gets_all_vehicles(self, served: Server, join: Callable[[str], Peer]) -> None:
        first, second, mute = join("ground"), join("ground"), join("ground")
        for client in (first, second):
            client.send(heartbeat(255, GCS))
        turn(served, 3)
        assert first.systems() == second.systems() == {1, 2, 3}
        assert mute.datagrams() == []

    @pytest.mark.parametrize(("target", "armed"), [(2, {2}), (0, {1, 2, 3}), (9, set())])
    def test_what_has_a_target_goes_there_and_target_0_to_all(
        self, served: Server, join: Callable[[str], Peer], target: int, armed: set[int]
    ) -> None:
        client = join("ground")
        arm = mav.MAVLink_command_long_message(target, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
        client.send(frame(arm, 255, GCS))
        turn(served)
        assert {k for k, v in served.world.vehicles.items() if v.autopilot.snapshot.armed} == armed
        acks = {m.get_srcSystem() for m in client.messages() if m.get_msgId() == mav.MAVLINK_MSG_ID_COMMAND_ACK}
        assert acks == armed

    def test_what_has_no_target_goes_to_all(self, served: Server, join: Callable[[str], Peer]) -> None:
        client, companion = join("ground"), join("3")
        companion.send(heartbeat(3))
        turn(served)
        companion.datagrams()
        client.send(heartbeat(255, GCS) + frame(mav.MAVLink_statustext_message(6, b"hello"), 255, GCS))
        turn(served)
        assert {m.get_msgId() for m in companion.messages() if m.get_srcSystem() == 255} >= {0, 253}

    def test_a_datagram_for_several_vehicles_is_taken_apart(self, served: Server, join: Callable[[str], Peer]) -> None:
        client = join("ground")
        asks = [mav.MAVLink_param_request_read_message(k, 1, b"MAV_SYS_ID", -1) for k in (3, 1)]
        client.send(b"\xfd" + frame(asks[0], 255, GCS) + b"junk" + frame(asks[1], 255, GCS))
        turn(served)
        answers = [m.get_srcSystem() for m in client.messages() if m.get_msgId() == mav.MAVLINK_MSG_ID_PARAM_VALUE]
        assert answers == [1, 3]

    def test_a_client_silent_for_ten_seconds_is_forgotten(self, served: Server, join: Callable[[str], Peer]) -> None:
        client = join("ground")
        client.send(heartbeat(255, GCS))
        turn(served, 100, now_s=0.0)
        assert client.datagrams()
        turn(served, 100, now_s=CLIENT_SILENCE_S + 1.0)  # looked at once a simulated second
        client.datagrams()
        turn(served, 10, now_s=CLIENT_SILENCE_S + 1.0)
        assert client.datagrams() == []

    def test_a_station_that_listens_is_sent_to_unasked_and_for_good(
        self, world: World, ports: Ports, join: Callable[[str], Peer]
    ) -> None:
        station = join("ground")
        made = Server(world, ports, push=station.socket.getsockname(), say=ignore)
        turn(made, 200, now_s=1000.0)
        assert station.systems() == {1, 2, 3}
        made.close()


class TestOnboard:
    def test_a_vehicle_alone_is_at_its_port(self, served: Server, join: Callable[[str], Peer]) -> None:
        companion = join("2")
        companion.send(heartbeat(2))
        turn(served, 5)
        assert companion.systems() == {2}

    def test_companion_and_ground_station_hear_each_other(self, served: Server, join: Callable[[str], Peer]) -> None:
        station, companion, other = join("ground"), join("2"), join("1")
        station.send(heartbeat(255, GCS))
        for client, vehicle_id in ((companion, 2), (other, 1)):
            client.send(heartbeat(vehicle_id))
        turn(served)
        assert (2, COMPANION) in {(m.get_srcSystem(), m.get_srcComponent()) for m in station.messages()}
        start = mav.MAVLink_command_long_message(2, COMPANION, mav.MAV_CMD_MISSION_START, 0, *(0.0,) * 7)
        for client in (companion, other):
            client.datagrams()
        station.send(frame(start, 255, GCS))
        turn(served)
        assert mav.MAVLINK_MSG_ID_COMMAND_LONG in {m.get_msgId() for m in companion.messages()}
        assert 255 not in other.systems()

    def test_nothing_stale_waits_for_a_late_client(self, served: Server, join: Callable[[str], Peer]) -> None:
        station, companion = join("ground"), join("2")
        station.send(frame(mav.MAVLink_statustext_message(6, b"old"), 255, GCS))
        turn(served, server.UNHEARD_STEPS)
        companion.send(heartbeat(2))
        turn(served)
        assert 255 not in companion.systems()
