"""`companion lidar` from the outside: a lidar's bytes on a pty or a socket become OBSTACLE_DISTANCE on another."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import pytest
from pymavlink.dialects.v20 import common

from companion import cli
from companion.lidar import command
from companion.shell.links import Link, LinkError
from companion.shell.urls import Url
from tests.unit.lidar.lidar_kit import (
    RPLIDAR_HEALTHY,
    RPLIDAR_INFO,
    RPLIDAR_SCANNING,
    everywhere,
    ld_revolution,
    mid360_points,
    post,
    rplidar_revolution,
)

LIMIT_S = 60.0
FREE_CM = 1201


class Pty:
    """A serial port with a lidar at its far end."""

    def __init__(self, opened: ExitStack) -> None:
        self._far, near = os.openpty()
        opened.callback(self.unplug)
        opened.callback(os.close, near)
        self.path = os.ttyname(near)

    def unplug(self) -> None:
        """Who has it open finds it gone."""
        if self._far >= 0:
            os.close(self._far)
        self._far = -1

    def write(self, data: bytes) -> int:
        """As much as there is room for, and how much that was; a lidar does not wait either."""
        os.set_blocking(self._far, False)
        with contextlib.suppress(BlockingIOError):
            return os.write(self._far, data)
        return 0

    def write_on(self, data: bytes) -> Callable[[], None]:
        """Writes it over and over, a part with each call, without a gap."""
        rest = b""

        def write_part() -> None:
            nonlocal rest
            rest = rest or data
            if select.select([], [self._far], [], 0.01)[1]:
                rest = rest[self.write(rest) :]

        return write_part

    def read_until(self, *wanted: bytes) -> None:
        """Requests of the driver, in this order."""
        os.set_blocking(self._far, True)
        heard = b""
        for request in wanted:
            while request not in heard:
                assert select.select([self._far], [], [], LIMIT_S)[0]
                heard += os.read(self._far, 1024)
            heard = heard.partition(request)[2]


class Agent:
    """The companion's end: what another MAVLink implementation makes of the datagrams."""

    def __init__(self, opened: ExitStack) -> None:
        self._socket = opened.enter_context(bound_socket())
        self.url = f"udpout://127.0.0.1:{self._socket.getsockname()[1]}"
        self._mav = common.MAVLink(None)

    def scan_until(self, is_it: Callable[[Any], bool], feed: Callable[[], object]) -> Any:
        """The first OBSTACLE_DISTANCE that is; the lidar is fed meanwhile."""
        for _ in range(20_000):
            feed()
            if select.select([self._socket], [], [], 0.005)[0]:
                (message,) = self._mav.parse_buffer(self._socket.recv(2048))
                assert message.get_type() == "OBSTACLE_DISTANCE"
                if is_it(message):
                    return message
        raise AssertionError("no such scan")


def bound_socket() -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(("127.0.0.1", 0))
    return bound


def free_port() -> int:
    with bound_socket() as free:
        port: int = free.getsockname()[1]
    return port


@contextmanager
def child(*options: str) -> Iterator[tuple[subprocess.Popen[str], IO[str]]]:
    """The program, and its stderr; ended by its own process id."""
    arguments = [sys.executable, "-m", "companion", "lidar", *options]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        late = threading.Timer(2.0 * LIMIT_S, process.kill)  # a line that never comes ends with its stream
        late.start()
        try:
            assert process.stderr is not None
            yield process, process.stderr
        finally:
            late.cancel()
            process.kill()


@contextmanager
def fed(feed: Callable[[], object]) -> Iterator[None]:
    """The lidar is fed all the while."""
    ended = threading.Event()

    def feed_on() -> None:
        while not ended.is_set():
            feed()

    thread = threading.Thread(target=feed_on)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def end_child(process: subprocess.Popen[str], number: signal.Signals = signal.SIGTERM) -> None:
    """It ends by itself, and well."""
    process.send_signal(number)
    assert process.wait(LIMIT_S) == 0


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def is_whole(message: Any) -> bool:
    """True once a full revolution was seen: the first may have begun anywhere."""
    return 65535 not in message.distances


def test_an_rplidar_is_started_and_its_scans_are_sent_as_the_vehicles_obstacle_sensor(opened: ExitStack) -> None:
    pty, agent = Pty(opened), Agent(opened)
    options = ["--model", "rplidar-a", "--lidar", f"serial://{pty.path}:115200", "--id", "3", "--to", agent.url]
    with child(*options) as (process, stderr):
        pty.read_until(b"\xa5\x25", b"\xa5\x50")
        pty.write(RPLIDAR_INFO)
        pty.read_until(b"\xa5\x52")
        pty.write(RPLIDAR_HEALTHY)
        pty.read_until(b"\xa5\x20")
        pty.write(RPLIDAR_SCANNING)
        revolution = rplidar_revolution(post(90.0, 2.1))
        message = agent.scan_until(is_whole, lambda: pty.write(revolution))
        assert (message.get_srcSystem(), message.get_srcComponent()) == (3, 196)
        assert message.frame == common.MAV_FRAME_BODY_FRD
        assert message.sensor_type == common.MAV_DISTANCE_SENSOR_LASER
        assert (message.increment, message.increment_f, message.angle_offset) == (5, 5.0, 0.0)
        assert (message.min_distance, message.max_distance) == (15, 1200)
        assert [(k, cm) for k, cm in enumerate(message.distances) if cm != FREE_CM] == [(17, 210), (18, 210), (19, 210)]
        assert message.time_usec > 0
        end_child(process)
        pty.read_until(b"\xa5\x25", b"\xa5\xf0\x02\x00\x00")
        log = stderr.read()
    assert "RPLIDAR model 1.8, firmware 1.29" in log
    assert "health: good" in log
    assert "scans arrive" in log


def test_an_ld19_upside_down_is_turned_and_masked_and_garbage_costs_nothing_else(opened: ExitStack) -> None:
    pty, agent = Pty(opened), Agent(opened)
    options = ["--model", "ld19", "--lidar", f"serial://{pty.path}:230400", "--id", "250", "--component", "197"]
    mounting = ["--upside-down", "--yaw-deg", "180", "--mask", "130..140", "--range-m", "8", "--to", agent.url]
    with child(*options, *mounting) as (process, _):
        reads = iter(range(10**6))

        def feed() -> None:
            pty.write(ld_revolution(post(90.0, 2.1)))
            if next(reads) % 7 == 0:
                pty.write(b"\x54\x2c\x54\xff" * 9)

        message = agent.scan_until(lambda m: list(m.distances).count(65535) == 3 and m.distances[18] == 210, feed)
        assert (message.get_srcSystem(), message.get_srcComponent()) == (250, 197)
        assert message.max_distance == 800
        assert [k for k, cm in enumerate(message.distances) if cm == 65535] == [26, 27, 28]
        assert {(k, cm) for k, cm in enumerate(message.distances) if cm < 801} <= {(17, 210), (18, 210), (19, 210)}
        end_child(process, signal.SIGINT)


def test_an_rplidar_of_too_few_samples_for_its_class_is_an_error_with_figures(opened: ExitStack) -> None:
    pty = Pty(opened)
    options = ["--model", "rplidar-a", "--lidar", f"serial://{pty.path}:115200", "--id", "3", "--raw", "scan-0.5deg"]
    with child(*options, "--to", f"udpout://127.0.0.1:{free_port()}") as (process, stderr):
        pty.read_until(b"\xa5\x20")
        pty.write(RPLIDAR_SCANNING)
        with fed(pty.write_on(rplidar_revolution(everywhere(4.0), samples=180))):
            lines = iter(stderr.readline, "")
            told = next(line for line in lines if "rays a turn" in line)
        end_child(process)
    found = re.search(r"(\d+) of 720 rays a turn are sampled: ERROR, too few for --raw scan-0.5deg", told)
    assert found is not None  # how many exactly depends on what a computer that is busy leaves out


def test_a_mid360_is_told_where_to_send_and_its_points_are_sectors(opened: ExitStack) -> None:
    agent, lidar = Agent(opened), opened.enter_context(bound_socket())
    here = ("127.0.0.1", free_port())
    options = ["--model", "mid360", "--lidar", f"udpin://{here[0]}:{here[1]}", "--id", "3", "--to", agent.url]
    with child(*options, "--configure", f"127.0.0.1:{lidar.getsockname()[1]}", "--band-m=-0.3..0.6") as (
        process,
        stderr,
    ):
        lidar.settimeout(LIMIT_S)
        request, sender = lidar.recvfrom(2048)
        assert request[0] == 0xAA
        assert request[32:44] == bytes([3, 6, 0, 8, 0, 127, 0, 0, 1]) + here[1].to_bytes(2, "little") + b"\xec"
        lidar.sendto(request[:10] + b"\1\1" + request[12:24] + b"\x20\x06\x00", sender)
        points = [(0.0, -2.1, 0.5), (0.0, -1.5, 0.8), (3.0, 0.0, 2.0)]

        def feed() -> None:
            lidar.sendto(mid360_points(3, points), here)

        message = agent.scan_until(lambda _: True, feed)
        assert (message.min_distance, message.max_distance) == (10, 4000)
        assert message.distances[18] == pytest.approx(210, abs=1)
        assert message.distances[0] == 4001  # seen above the band only
        assert list(message.distances).count(65535) == 70
        end_child(process)
        assert "refuses parameter 0x0006: return code 0x20" in stderr.read()


def test_an_unplugged_port_is_named_and_read_again_once_it_is_back(opened: ExitStack, tmp_path: Path) -> None:
    pty, agent, device = Pty(opened), Agent(opened), tmp_path / "ttyLIDAR"
    options = ["--model", "ld06", "--lidar", f"serial://{device}:230400", "--id", "3", "--to", agent.url]
    with child(*options) as (process, stderr):
        lines = iter(stderr.readline, "")
        assert any(f"no {device}: is it plugged in?" in line for line in lines)
        device.symlink_to(pty.path)
        agent.scan_until(is_whole, lambda: pty.write(ld_revolution(everywhere(4.0))))
        assert any("scans arrive" in line for line in lines)
        pty.unplug()
        device.unlink()
        assert any(f"no {device}: is it plugged in?" in line for line in lines)
        again = Pty(opened)
        device.symlink_to(again.path)
        agent.scan_until(
            lambda m: is_whole(m) and m.distances[0] == 500, lambda: again.write(ld_revolution(everywhere(5.0)))
        )
        assert any("scans arrive" in line for line in lines)
        end_child(process)


def test_a_companion_that_does_not_listen_is_told_and_so_is_one_that_does_again(opened: ExitStack) -> None:
    pty, port = Pty(opened), free_port()
    options = ["--model", "ld06", "--lidar", f"serial://{pty.path}:230400", "--id", "3"]
    with child(*options, "--to", f"udpout://127.0.0.1:{port}") as (process, stderr):
        lines = iter(stderr.readline, "")
        with fed(lambda: pty.write(ld_revolution(everywhere(4.0)))):
            assert any(f"nobody listens at udpout://127.0.0.1:{port}" in line for line in lines)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
                agent.bind(("127.0.0.1", port))
                assert any(f"udpout://127.0.0.1:{port} are refused no more" in line for line in lines)
        end_child(process)


def test_a_serial_lidar_is_opened_with_dtr_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """The motor of an RPLIDAR A1 turns then."""
    found: list[bool] = []

    def refuse(_: Url, *, dtr: bool = True, **_others: bool) -> Link:
        found.append(dtr)
        raise LinkError("no")

    monkeypatch.setattr(command, "open_link", refuse)
    assert cli.main(["lidar", "--check", "--model", "rplidar-a", "--lidar", "serial:///dev/ttyS0:115200"]) == 3
    assert found == [False]


def test_a_check_without_a_lidar_ends_with_the_reason(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pty = Pty(opened)
    monkeypatch.setattr(command, "PATIENCE_S", 0.1)
    code = cli.main(["lidar", "--check", "--model", "ld19", "--lidar", f"serial://{pty.path}:230400"])
    assert code == 3
    printed = capsys.readouterr()
    assert f"nothing is received at serial://{pty.path}:230400" in printed.err
    assert "Stand clear" in printed.out


def test_a_check_with_another_baud_rate_or_model_says_so(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pty = Pty(opened)
    monkeypatch.setattr(command, "PATIENCE_S", 0.5)
    with fed(lambda: pty.write(b"\x00\xff\x55" * 20)):
        code = cli.main(["lidar", "--check", "--model", "ld19", "--lidar", f"serial://{pty.path}:230400"])
    assert code == 3
    found = re.search(
        r"no scan in (\d+) bytes received at .*, (\d+) of them part of no packet", capsys.readouterr().err
    )
    assert found is not None
    # Fed without a pause: of what has waited meanwhile the last reads are looked at. The last may yet begin a packet
    looked_at = int(found[1]) * command.FRESH_MAX // command.READS_PER_TURN
    assert looked_at - 46 <= int(found[2]) <= int(found[1])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_check_that_is_stopped_has_not_failed(opened: ExitStack, number: signal.Signals) -> None:
    pty = Pty(opened)
    with child("--check", "--model", "ld19", "--lidar", f"serial://{pty.path}:230400") as (process, stderr):
        with fed(lambda: pty.write(ld_revolution(everywhere(4.0)))):
            assert any("scans arrive" in line for line in iter(stderr.readline, ""))
            process.send_signal(number)
            assert process.wait(LIMIT_S) == 130
        assert process.stdout is not None
        said = process.stdout.read()
    assert "STOPPED: the check was not walked to its end" in said
    assert "FAIL" not in said


@pytest.mark.parametrize(("turned_deg", "code", "verdict"), [(0.0, 0, "PASS"), (90.0, 1, "try --yaw-deg 270")])
def test_a_check_walks_one_round_the_vehicle(
    opened: ExitStack, capsys: pytest.CaptureFixture[str], turned_deg: float, code: int, verdict: str
) -> None:
    pty = Pty(opened)
    places = {"in front of": 0.0, "to the right of": 90.0, "behind": 180.0, "to the left of": 270.0}
    asked: list[str] = []
    said: list[str] = []

    def stand_where_asked() -> None:
        said.append(capsys.readouterr().out)
        asked.extend(place for place in places if f"stand still {place} " in said[-1])
        world = post((places[asked[-1]] + turned_deg) % 360.0, 2.1) if asked else everywhere(0.0)
        pty.write(ld_revolution(world))

    with fed(stand_where_asked):
        done = cli.main(["lidar", "--check", "--model", "ld19", "--lidar", f"serial://{pty.path}:230400"])
    said.append(capsys.readouterr().out)
    assert done == code
    assert asked == list(places)
    assert verdict in "".join(said)
    assert "front right" in "".join(said)


def test_a_port_that_cannot_be_opened_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    code = cli.main(["lidar", "--check", "--model", "ld19", "--lidar", f"serial://{tmp_path}/file:230400"])
    assert code == 3
    assert "cannot be opened as a serial port" in capsys.readouterr().err
