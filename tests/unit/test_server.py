"""`sim-bridge serve`: who gets what, who may speak as whom, which ports, and at what pace."""

from __future__ import annotations

import argparse
import random
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.load import parse_mission
from mission.model import Mission
from sim_bridge.drive import serve, server
from sim_bridge.drive.hub import COMPANION_ALIVE_S, RadioGate, split
from sim_bridge.drive.ports import Address
from sim_bridge.drive.server import (
    CLIENT_SILENCE_S,
    CLIENTS_MAX,
    LAG_MAX_S,
    PACE_WINDOW_S,
    STEP_S,
    Clients,
    Pacer,
    PortPlan,
    Ports,
    Server,
    open_ports,
)
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import PROFILES
from sim_bridge.world.world import DEFAULT_ORIGIN, World

MISSION = """
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [60.0, 0.0, 8.0]
vel_leader_mps = 2.0
[swarm]
size = 3
"""
HERE, THERE = ("127.0.0.1", 40001), ("127.0.0.1", 40002)
READY_S = 5.0  # simulated: the autopilots' heartbeats have begun, and arming is allowed
GCS, COMPANION = 190, mav.MAV_COMP_ID_ONBOARD_COMPUTER


def frame(message: Any, system: int, component: int = COMPANION) -> bytes:
    packed: bytes = message.pack(mav.MAVLink(None, srcSystem=system, srcComponent=component))
    return packed


def heartbeat(system: int, component: int = COMPANION) -> bytes:
    return frame(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), system, component)


def beacon(system: int, time_ms: int = 0) -> bytes:
    return frame(
        mav.MAVLink_swarm_beacon_message(
            time_ms, 0, 0, 0, *(0.0,) * 9, 0.0, 1.0, 0, 0, *(0.0,) * 3, 300, 0, *(0,) * 13, 1, bytes(96)
        ),
        system,
    )


def ignore(_text: str) -> None:
    pass


class Peer:
    """A client's socket; on loopback a datagram has arrived when `sendto` returns."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self._to = ("127.0.0.1", port)

    def send(self, data: bytes) -> None:
        self.socket.sendto(data, self._to)

    def datagrams(self) -> list[bytes]:
        arrived = []
        while True:
            try:
                arrived.append(self.socket.recv(65536))
            except BlockingIOError:
                return arrived

    def messages(self) -> list[Any]:
        codec = mav.MAVLink(None)
        return [m for data in self.datagrams() for m in codec.parse_buffer(bytearray(data)) or []]

    def systems(self) -> set[int]:
        return {m.get_srcSystem() for m in self.messages()}


@pytest.fixture
def mission() -> Mission:
    return parse_mission(MISSION).with_origin(DEFAULT_ORIGIN)


@pytest.fixture
def world(mission: Mission) -> World:
    world = World(mission, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES)
    while world.now_s < READY_S:
        world.step(0.05)
    return world


@pytest.fixture
def ports() -> Iterator[Ports]:
    opened = open_ports(PortPlan(), (1, 2, 3))
    yield opened
    opened.close()


@pytest.fixture
def served(world: World, ports: Ports) -> Iterator[Server]:
    made = Server(world, ports, say=ignore)
    yield made
    made.close()


@pytest.fixture
def join(ports: Ports) -> Iterator[Callable[[str], Peer]]:
    """A client of "ground", "radio", or a vehicle's "1" ..."""
    peers = []

    def connect(where: str) -> Peer:
        bound = ports.onboard[int(where)] if where.isdigit() else getattr(ports, where)
        peers.append(Peer(bound.getsockname()[1]))
        return peers[-1]

    yield connect
    for peer in peers:
        peer.socket.close()


def turn(served: Server, steps: int = 1, now_s: float = 0.0) -> None:
    for _ in range(steps):
        served.poll(0.0, lambda: now_s)
        served.step(now_s)


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
    assert serve._onboard_to(text).of((1, 2, 3)) == {k: ("127.0.0.1", addresses[k - 1]) for k in (1, 2, 3)}


def test_onboard_to_that_has_no_room_is_refused() -> None:
    with pytest.raises(StartError, match="--onboard-to: port 65534 and up is too high"):
        serve._onboard_to("127.0.0.1:65534+").of((1, 2, 3))


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


class TestRadio:
    def test_beacons_reach_the_others_as_one_datagram_of_unmodified_frames(
        self, served: Server, join: Callable[[str], Peer]
    ) -> None:
        one, two, three = (join("radio") for _ in range(3))
        for peer, vehicle_id in ((one, 1), (two, 2), (three, 3)):
            peer.send(heartbeat(vehicle_id))
        turn(served)
        assert one.datagrams() == two.datagrams() == three.datagrams() == []
        one.send(beacon(1, 7))
        three.send(beacon(3, 8))
        turn(served)
        (arrived,) = two.datagrams()
        assert sorted([beacon(1, 7), beacon(3, 8)]) == sorted(
            [arrived[: len(beacon(1, 7))], arrived[len(beacon(1, 7)) :]]
        )
        assert one.datagrams() == [beacon(3, 8)]

    def test_vehicles_out_of_range_hear_nothing(
        self, mission: Mission, ports: Ports, join: Callable[[str], Peer]
    ) -> None:
        apart = iter([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (10.0, 0.0, 0.0)])
        world = World(mission, lambda _frame, _place, _seed: PointMass(next(apart), 0.0), links=PROFILES)
        made = Server(world, ports, say=ignore)
        near, far = join("radio"), join("radio")
        near.send(heartbeat(3))
        far.send(heartbeat(2))
        sender = join("radio")
        sender.send(beacon(1))
        turn(made)
        assert (near.datagrams(), far.datagrams()) == ([beacon(1)], [])
        made.close()

    def test_beacons_from_before_a_companion_spoke_are_lost(self, served: Server, join: Callable[[str], Peer]) -> None:
        one, two = join("radio"), join("radio")
        one.send(beacon(1, 1))
        turn(served)
        two.send(heartbeat(2))
        turn(served)
        assert two.datagrams() == []


class TestRadioGate:
    @pytest.fixture
    def gate(self) -> RadioGate:
        return RadioGate((1, 2), ignore)

    def test_an_address_speaks_for_whom_it_first_spoke(self, gate: RadioGate) -> None:
        assert gate.admit(heartbeat(1), HERE, 0.0) == (1, b"")
        assert gate.address_of(1) == HERE
        assert gate.admit(beacon(1), HERE, 0.1) == (1, beacon(1))
        assert gate.admit(beacon(2), HERE, 0.1) == (0, b"")
        assert (gate.refused, gate.address_of(2)) == (1, None)

    def test_own_frames_pass_beside_foreign_ones(self, gate: RadioGate) -> None:
        assert gate.admit(beacon(1, 5) + beacon(2) + beacon(1, 6), HERE, 0.0) == (1, beacon(1, 5) + beacon(1, 6))
        assert gate.refused == 1

    def test_nobody_takes_over_a_vehicle_while_its_companion_lives(self, gate: RadioGate) -> None:
        gate.admit(beacon(1), HERE, 0.0)
        assert gate.admit(beacon(1), THERE, COMPANION_ALIVE_S) == (0, b"")
        assert (gate.refused, gate.address_of(1)) == (1, HERE)

    def test_a_companion_started_again_takes_over_from_the_dead_one(self, gate: RadioGate) -> None:
        gate.admit(beacon(1), HERE, 0.0)
        later_s = COMPANION_ALIVE_S + 0.1
        assert gate.admit(beacon(1), THERE, later_s) == (1, beacon(1))
        assert gate.address_of(1) == THERE
        assert gate.admit(beacon(1), HERE, later_s) == (0, b"")

    def test_a_port_used_again_may_speak_for_another(self, gate: RadioGate) -> None:
        gate.admit(beacon(1), HERE, 0.0)
        later_s = COMPANION_ALIVE_S + 0.1
        assert gate.admit(beacon(2), HERE, later_s) == (2, beacon(2))
        assert (gate.address_of(1), gate.address_of(2)) == (None, HERE)

    @pytest.mark.parametrize(
        "data",
        [
            heartbeat(1, component=1),
            heartbeat(3),
            frame(mav.MAVLink_statustext_message(6, b"hello"), 1),
            beacon(1)[:-1],
            beacon(1)[:-1] + bytes([beacon(1)[-1] ^ 1]),
            b"",
            b"\xfd" * 50,
        ],
    )
    def test_only_valid_words_of_a_companion_bind(self, gate: RadioGate, data: bytes) -> None:
        assert gate.admit(data, HERE, 0.0) == (0, b"")
        assert gate.address_of(1) is None

    def test_an_impostor_is_reported_once(self) -> None:
        said: list[str] = []
        gate = RadioGate((1, 2), said.append)
        gate.admit(beacon(1), HERE, 0.0)
        for _ in range(5):
            gate.admit(beacon(1), THERE, 0.1)
        assert said == [
            "radio: 127.0.0.1:40002 speaks as vehicle 1, which 127.0.0.1:40001 already does: "
            "refused for as long as the other lives, and 0.5 s more"
        ]


class TestClients:
    def test_the_table_is_bounded_and_does_not_drop_who_is_there(self) -> None:
        clients = Clients()
        crowd: list[Address] = [("127.0.0.1", port) for port in range(1, 100)]
        for address in crowd:
            clients.hear(address, 0.0)
        assert list(clients.addresses) == crowd[:CLIENTS_MAX]

    def test_who_keeps_speaking_stays(self) -> None:
        clients = Clients()
        clients.hear(HERE, 0.0)
        clients.hear(THERE, 0.0)
        clients.hear(THERE, 5.0)
        clients.forget(CLIENT_SILENCE_S + 1.0)
        assert clients.addresses == (THERE,)

    def test_a_fixed_one_stays_although_it_never_speaks_or_has_spoken_long_ago(self) -> None:
        clients = Clients([HERE])
        clients.hear(HERE, 0.0)
        clients.forget(1e6)
        assert clients.addresses == (HERE,)


class TestPacer:
    @pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
    def test_no_drift_however_late_each_step_is(self, speed: float) -> None:
        pacer = Pacer(0.0, speed)
        steps, now_s = 0, 0.0
        while now_s < 30.0:
            if pacer.wait_s(now_s) > 0.0:
                now_s += pacer.wait_s(now_s) + 0.0007  # as late as the operating system makes it
            if pacer.wait_s(now_s) <= 0.0:
                assert pacer.stepped(now_s) is None
                steps += 1
        assert steps == pytest.approx(30.0 * speed / STEP_S, abs=2)

    def test_a_hiccup_is_made_up_for(self) -> None:
        pacer = Pacer(0.0, 1.0)
        pacer.stepped(0.0)
        due = 0
        while pacer.wait_s(0.2) <= 0.0:
            pacer.stepped(0.2)
            due += 1
        assert due == pytest.approx(20, abs=1)

    def test_a_long_stall_is_given_up_and_no_word_is_said_for_it_alone(self) -> None:
        pacer = Pacer(0.0, 1.0)
        assert pacer.stepped(2.0) is None
        assert pacer.wait_s(2.0) == pytest.approx(-LAG_MAX_S)

    def test_a_slow_machine_is_reported_once_with_the_share_it_reaches(self) -> None:
        pacer = Pacer(0.0, 1.0)
        shares = [pacer.stepped(2.0 * STEP_S * k) for k in range(1, 2000)]
        assert [share for share in shares if share is not None] == [pytest.approx(0.5, abs=0.01)]
        assert 2.0 * STEP_S * shares.index(next(s for s in shares if s)) >= PACE_WINDOW_S - 0.1


class TestPorts:
    def test_free_ports_differ(self) -> None:
        ports = open_ports(PortPlan(), (1, 2, 3))
        numbers = [s.getsockname() for s in (ports.ground, ports.radio, *ports.onboard.values())]
        assert len(set(numbers)) == 5
        assert {host for host, _ in numbers} == {"127.0.0.1"}
        ports.close()

    def test_ports_asked_for_are_those(self) -> None:
        free = open_ports(PortPlan(), (1,))
        ground, radio = free.ground.getsockname()[1], free.radio.getsockname()[1]
        free.close()
        ports = open_ports(PortPlan(ground=ground, radio=radio), (1,))
        assert (ports.ground.getsockname()[1], ports.radio.getsockname()[1]) == (ground, radio)
        ports.close()

    def test_a_taken_port_is_named_and_none_stays_open(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            port = other.getsockname()[1]
            with pytest.raises(
                StartError, match=rf"--first-port \(vehicle 1\): UDP port {port} is taken: end"
            ) as refused:
                open_ports(PortPlan(first_onboard=port), (1,))
        assert refused.value.exit_code == 3

    @pytest.mark.parametrize(
        ("plan", "message"),
        [
            (PortPlan(ground=30002, first_onboard=30000), r"--first-port \(vehicle 3\): port 30002 is --ground-port's"),
            (PortPlan(radio=30000, first_onboard=30000), r"--first-port \(vehicle 1\): port 30000 is --radio-port's"),
            (PortPlan(ground=30000, radio=30000), "--radio-port: port 30000 is --ground-port's"),
            (PortPlan(ground=14550, push=("127.0.0.1", 14550)), "--ground: port 14550 is --ground-port's"),
            (PortPlan(first_onboard=65534), r"--first-port \(vehicle 3\): no port 65536: must be at most 65535"),
        ],
    )
    def test_ports_that_collide_are_refused(self, plan: PortPlan, message: str) -> None:
        with pytest.raises(StartError, match=message) as refused:
            open_ports(plan, (1, 2, 3))
        assert refused.value.exit_code == 2


def test_split_keeps_frames_whole_and_in_order() -> None:
    frames = [beacon(1, 1), heartbeat(1), beacon(1, 2), beacon(1, 3)]
    assert list(split(b"".join(frames), len(frames[0]) + len(frames[1]))) == [
        frames[0] + frames[1],
        frames[2],
        frames[3],
    ]
    assert list(split(b"".join(frames), 1)) == frames
    assert list(split(b"", 100)) == []


def test_garbage_on_any_port_stops_nothing(served: Server, join: Callable[[str], Peer]) -> None:
    rng = random.Random(1)
    valid = [heartbeat(1), beacon(2), frame(mav.MAVLink_command_long_message(1, 1, 400, 0, *(float("nan"),) * 7), 255)]
    peers = [join(where) for where in ("ground", "radio", "1", "2")]
    for _ in range(300):
        data = bytearray(rng.choice([rng.randbytes(rng.randrange(300)), rng.choice(valid) * rng.randrange(20)]))
        for _ in range(rng.randrange(4)):
            if data:
                data[rng.randrange(len(data))] = rng.choice([0xFD, 0xFE, rng.randrange(256)])
        rng.choice(peers).send(bytes(data))
        turn(served)
    station = join("ground")
    station.send(heartbeat(255, GCS))
    turn(served, 5)
    assert station.systems() >= {1, 2, 3}


def arguments(*options: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    serve.configure(parser)
    return parser.parse_args(options)


@pytest.fixture
def mission_file(tmp_path: Path) -> Path:
    file = tmp_path / "mission.toml"
    file.write_text(MISSION)
    return file


class TestRun:
    @pytest.mark.parametrize("n", ["0", "251", "-1"])
    def test_a_swarm_of_no_possible_size_is_refused(
        self, mission_file: Path, n: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert serve.run(arguments(str(mission_file), f"-n={n}")) == 2
        assert "from 1 to 250" in capsys.readouterr().err

    def test_every_problem_of_a_bad_mission_is_listed(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        bad = tmp_path / "bad.toml"
        bad.write_text(MISSION.replace("size = 3", "size = 999").replace("2.0", "-2.0"))
        assert serve.run(arguments(str(bad))) == 2
        error = capsys.readouterr().err
        assert "swarm.size = 999" in error
        assert "route.vel_leader_mps = -2.0" in error

    def test_a_taken_port_ends_it_with_3(self, mission_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            port = other.getsockname()[1]
            assert serve.run(arguments(str(mission_file), "--ground-port", str(port))) == 3
        assert f"--ground-port: UDP port {port} is taken" in capsys.readouterr().err

    def test_without_jsbsim_it_says_what_to_install(
        self, mission_file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "jsbsim", None)
        assert serve.run(arguments(str(mission_file))) == 3
        assert "in the checkout, pip install '.[sim]'" in capsys.readouterr().err

    def test_a_mission_copy_that_cannot_be_written_ends_it_with_3(
        self, mission_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = tmp_path / "no" / "mission.toml"
        assert serve.run(arguments(str(mission_file), "--out", str(out))) == 3
        assert "No such file or directory" in capsys.readouterr().err

    @pytest.mark.parametrize(
        "options",
        [
            ("--speed", "0"),
            ("--speed", "nan"),
            ("--speed", "fast"),
            ("--ground-port", "0"),
            ("--radio-port", "65536"),
            ("--first-port", "1e3"),
            ("--ground", "192.0.2.1:14550"),
            ("--ground", "127.0.0.1"),
            ("--ground", "14550"),
            ("--ground", "127.0.0.1:0"),
        ],
    )
    def test_wrong_usage_ends_it_with_2(self, options: tuple[str, str]) -> None:
        with pytest.raises(SystemExit) as ended:
            arguments("mission.toml", *options)
        assert ended.value.code == 2
