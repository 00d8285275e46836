"""`sim-bridge serve`: its ports, its pace, what it survives, and its command."""

from __future__ import annotations

import argparse
import random
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.mavlink import dialect as mav
from sim_bridge.drive.links.hub import split
from sim_bridge.drive.links.ports import Address, Listener, bound_socket
from sim_bridge.drive.serve import program as serve
from sim_bridge.drive.serve.server import (
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
from sim_bridge.options import serve as serve_options
from tests.unit.drive.serve.server_kit import GCS, HERE, MISSION, THERE, Peer, beacon, frame, heartbeat, turn


class TestClients:
    def test_the_table_is_bounded_and_does_not_drop_who_is_there(self) -> None:
        clients = Clients()
        crowd: list[Address] = [("127.0.0.1", port) for port in range(1, 100)]
        for address in crowd:
            clients.note_client(address, 0.0)
        assert list(clients.addresses) == crowd[:CLIENTS_MAX]

    def test_who_keeps_speaking_stays(self) -> None:
        clients = Clients()
        clients.note_client(HERE, 0.0)
        clients.note_client(THERE, 0.0)
        clients.note_client(THERE, 5.0)
        clients.forget(CLIENT_SILENCE_S + 1.0)
        assert clients.addresses == (THERE,)

    def test_a_fixed_one_stays_although_it_never_speaks_or_has_spoken_long_ago(self) -> None:
        clients = Clients([HERE])
        clients.note_client(HERE, 0.0)
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


def open_and_close(plan: PortPlan) -> Ports:
    ports = open_ports(plan, (1, 2, 3))
    ports.close()
    return ports


class TestPorts:
    def test_free_ports_differ(self) -> None:
        ports = open_ports(PortPlan(), (1, 2, 3))
        numbers = [s.getsockname() for s in (ports.ground, ports.radio, *ports.onboard.values())]
        assert len(set(numbers)) == 5
        assert {host for host, _ in numbers} == {"127.0.0.1"}
        ports.close()

    def test_obstacle_sensors_have_ports_of_their_own_where_there_are_any(self) -> None:
        assert open_and_close(PortPlan()).sensors == {}
        ports = open_and_close(PortPlan(first_sensor=0))
        assert list(ports.sensors) == [1, 2, 3]

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
            (
                PortPlan(first_onboard=30000, first_sensor=30001),
                r"--first-sensor-port \(vehicle 1\): port 30001 is --first-port \(vehicle 2\)'s",
            ),
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
    serve_options.configure(parser)
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
        assert "in the checkout, pip install -e '.[sim]'" in capsys.readouterr().err

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


def test_a_flood_of_one_port_leaves_the_others_their_turn_in_time() -> None:
    with bound_socket("flooded", 0) as flooded, bound_socket("other", 0) as other, bound_socket("sender", 0) as sender:
        now_s = 0.0
        read: list[bytes] = []

        def receive_slowly(data: bytes, _address: Address, _now_s: float) -> None:
            nonlocal now_s
            now_s += 0.02
            read.append(data)

        listener = Listener()
        listener.listen(flooded, receive_slowly)
        listener.listen(other, receive_slowly)
        for _ in range(20):
            sender.sendto(b"flood", flooded.getsockname())
        sender.sendto(b"genuine", other.getsockname())
        listener.poll(5.0, lambda: now_s)
        listener.close()
        assert read.count(b"flood") == 3
        assert read.count(b"genuine") == 1
