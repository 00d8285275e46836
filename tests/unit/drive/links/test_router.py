"""External autopilots are told apart by system id, whatever ports they share; garbage and impostors do no harm."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from contextlib import closing

import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing import wire
from sim_bridge.drive.links.router import AUTOPILOT_ALIVE_S, AutopilotSockets, Router, Url, Way, open_sockets, parse_url
from sim_bridge.errors import StartError

HERE, THERE = ("127.0.0.1", 40001), ("127.0.0.1", 40002)


def heartbeat(system: int, component: int = 1, autopilot: int = mav.MAV_AUTOPILOT_PX4) -> bytes:
    message = mav.MAVLink_heartbeat_message(mav.MAV_TYPE_QUADROTOR, autopilot, 0, 0, mav.MAV_STATE_ACTIVE, 3)
    return wire.pack(message, seq=0, system=system, component=component)


def text(system: int, component: int = 1) -> bytes:
    return wire.pack(mav.MAVLink_statustext_message(6, b"hello"), seq=0, system=system, component=component)


@pytest.fixture
def shared() -> Iterator[AutopilotSockets]:
    """Three vehicles that all send to one port."""
    with closing(open_sockets(Url(Way.IN, "127.0.0.1", None), [1], 0)) as sockets:
        bound = sockets.bound[1]
        yield AutopilotSockets({k: sockets.ports[1] for k in (1, 2, 3)}, {k: bound for k in (1, 2, 3)}, {})


class Hub:
    """A router with one socket, and what it says."""

    def __init__(self, sockets: AutopilotSockets) -> None:
        self.said: list[str] = []
        self.router = Router(sockets, self.said.append)
        self._bound = sockets.bound[1]

    def read(self, data: bytes, address: tuple[str, int] = HERE, now_s: float = 0.0) -> dict[int, bytes]:
        return self.router.route_datagram(self._bound, data, address, now_s)[0]


@pytest.fixture
def hub(shared: AutopilotSockets) -> Hub:
    return Hub(shared)


def test_several_autopilots_on_one_port_are_told_apart_by_system_id(hub: Hub) -> None:
    for system in (1, 2, 3):
        hub.read(heartbeat(system), ("127.0.0.1", 50000 + system))
    for system in (1, 2, 3):
        assert hub.read(text(system), ("127.0.0.1", 50000 + system)) == {system: text(system)}


def test_several_autopilots_behind_one_address_are_told_apart_by_system_id(hub: Hub) -> None:
    hub.read(heartbeat(1) + heartbeat(2))
    assert hub.read(text(1) + text(2) + heartbeat(1)) == {1: text(1) + heartbeat(1), 2: text(2)}


def test_what_a_ground_station_sends_through_an_autopilot_reaches_the_companions_behind_it(hub: Hub) -> None:
    hub.read(heartbeat(1) + heartbeat(2))
    hub.read(heartbeat(3), THERE)
    assert hub.read(text(255, 190)) == {1: text(255, 190), 2: text(255, 190)}
    assert hub.read(text(255, 190), THERE) == {3: text(255, 190)}


def test_nothing_is_routed_before_the_autopilots_heartbeat(hub: Hub) -> None:
    companions = heartbeat(1, component=COMPONENT, autopilot=mav.MAV_AUTOPILOT_INVALID)
    for data in (text(1), companions, heartbeat(1)[:-1], b""):
        assert hub.read(data) == {}
    assert not hub.router.knows(1)
    assert hub.read(heartbeat(1)) == {1: heartbeat(1)}


def test_frames_from_another_address_in_a_vehicles_name_are_refused(hub: Hub) -> None:
    hub.read(heartbeat(1))
    hub.read(heartbeat(2), THERE)
    assert hub.read(text(1), THERE) == {}
    assert hub.router.refused == 1


def test_a_second_autopilot_with_the_same_id_is_named_once_and_refused_while_the_first_lives(hub: Hub) -> None:
    hub.read(heartbeat(1))
    for now_s in (1.0, 2.0):
        hub.read(text(1), HERE, now_s)
        assert hub.read(heartbeat(1), THERE, now_s) == {}
    assert hub.said == ["two autopilots have system id 1: 127.0.0.1:40001, and 127.0.0.1:40002: refused"]


def test_an_autopilot_that_has_rebooted_elsewhere_is_found_again(hub: Hub) -> None:
    hub.read(heartbeat(1))
    assert hub.read(heartbeat(1), THERE, AUTOPILOT_ALIVE_S + 0.1) == {1: heartbeat(1)}


def test_an_autopilot_that_is_not_of_the_mission_is_named_once(hub: Hub) -> None:
    for _ in range(3):
        assert hub.read(heartbeat(9)) == {}
    assert hub.said == ["127.0.0.1:40001: an autopilot with system id 9: not one of this mission's"]


def test_garbage_never_raises_and_binds_nobody(hub: Hub) -> None:
    rng = random.Random(3)
    valid = heartbeat(1) + text(2)
    for _ in range(2000):
        data = bytearray(rng.choice([valid, rng.randbytes(rng.randrange(300))]))
        for _ in range(3):
            if data:
                data[rng.randrange(len(data))] = rng.choice([0xFD, 0xFE, rng.randrange(256)])
        hub.read(bytes(data), ("127.0.0.1", 50001))
    assert not hub.router.knows(2)
    assert not hub.router.knows(3)


def test_answers_go_to_where_the_autopilot_speaks_from() -> None:
    with (
        closing(open_sockets(Url(Way.IN, "127.0.0.1", None), [1, 2], 0)) as sockets,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
    ):
        autopilot.bind(("127.0.0.1", 0))
        router = Router(sockets, lambda _: None)
        router.send(1, b"lost")
        assert router.unsent == 1
        router.route_datagram(sockets.bound[1], heartbeat(1), autopilot.getsockname(), 0.0)
        router.send(1, b"answer")
        assert autopilot.recvfrom(100) == (b"answer", sockets.bound[1].getsockname())


def test_udpout_sends_before_anything_is_heard() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        port = autopilot.getsockname()[1]
        with closing(open_sockets(Url(Way.OUT, "127.0.0.1", port), [1, 2], 0)) as sockets:
            assert sockets.bound[1] is sockets.bound[2]
            Router(sockets, lambda _: None).send(2, b"first")
            assert autopilot.recv(100) == b"first"


@pytest.mark.parametrize(
    ("text_", "url"),
    [
        ("udpin://127.0.0.1:{port}", Url(Way.IN, "127.0.0.1", None)),
        ("udpin://0.0.0.0:14540", Url(Way.IN, "0.0.0.0", 14540)),
        ("udpout://127.0.0.1:14540", Url(Way.OUT, "127.0.0.1", 14540)),
    ],
)
def test_url_is_read(text_: str, url: Url) -> None:
    assert parse_url(text_) == url


@pytest.mark.parametrize(
    "text_",
    [
        *("", "14540", "udpin://127.0.0.1", "udpin://127.0.0.1:0", "udpin://127.0.0.1:65536", "tcpin://127.0.0.1:1"),
        *("udpout://0.0.0.0:14540", "udpin://127.0.0.1:{index}", "serial:///dev/ttyACM0:57600"),
    ],
)
def test_bad_url_is_named(text_: str) -> None:
    with pytest.raises(ValueError, match=r"must be|is no address"):
        parse_url(text_)


def test_taken_port_is_named_with_its_vehicle() -> None:
    with closing(open_sockets(Url(Way.IN, "127.0.0.1", None), [1], 0)) as sockets:
        taken = sockets.ports[1]
        with pytest.raises(StartError, match=rf"--autopilots \(vehicle 1\): UDP port {taken} is taken"):
            open_sockets(Url(Way.IN, "127.0.0.1", taken), [1, 2], 0)
