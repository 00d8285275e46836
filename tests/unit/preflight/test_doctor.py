"""`companion doctor`: each problem is found, and comes with what to do."""

from __future__ import annotations

import json
import re
import socket
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion import cli, doctor
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.endpoint import COMPONENT, heartbeat
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNED
from companion.mavlink.packing import pack_ranges
from companion.mavlink.peers.frame_mac import seal
from companion.preflight import computer
from companion.preflight.listen import SYSTEM_ID
from companion.preflight.report import Check, Verdict, good
from companion.sensors.lidar_tally import LidarTally
from companion.shell.links import LinkError
from companion.shell.urls import AUTOPILOT_SCHEMES, PEERS_SCHEMES, Url, parse_url
from mission import __version__
from mission.common.compiled import STATE
from mission.common.frames import LocalFrame
from tests.unit.core.core_kit import beacon, mission
from tests.unit.keys.keys_kit import key_file, operator_of, vehicle_of
from tests.unit.sensors import lidar_kit

SERIAL = parse_url("serial:///dev/ttyAMA0:57600", AUTOPILOT_SCHEMES)
UDP_OUT = parse_url("udpout://127.0.0.1:14600", AUTOPILOT_SCHEMES)
UDP_IN = parse_url("udpin://0.0.0.0:14540", AUTOPILOT_SCHEMES)
MESH = parse_url("udpbcast://127.255.255.255:14660", PEERS_SCHEMES)


class Heard:
    """A link on which `data` has already come."""

    errors = lost = 0
    up = True

    def __init__(self, data: tuple[bytes, ...]) -> None:
        self._near, self._far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._near.setblocking(False)
        for datagram in data:
            self._far.send(datagram)

    def fileno(self) -> int:
        return self._near.fileno()

    def recv(self) -> bytes | None:
        try:
            return self._near.recv(65536)
        except BlockingIOError:
            return None

    def send(self, data: bytes) -> None:
        assert wire.decode(data).get_srcSystem() == SYSTEM_ID

    def close(self) -> None:
        self._near.close()
        self._far.close()


@pytest.fixture
def hear(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(doctor, "LISTEN_S", 0.05)

    def heard(*data: bytes) -> None:
        monkeypatch.setattr(doctor, "open_link", lambda _url, **_options: Heard(data))

    return heard


def autopilot_beat(system: int, kind: int) -> bytes:
    message = dialect.MAVLink_heartbeat_message(2, kind, 0, 0, 3, 3)
    return wire.pack(message, seq=0, system=system, component=1)


def test_autopilots_are_told_with_their_ids_and_kinds(hear: Any) -> None:
    hear(autopilot_beat(3, dialect.MAV_AUTOPILOT_PX4), wire.pack(heartbeat(), seq=0, system=3, component=COMPONENT))
    check = doctor.autopilot_link(UDP_OUT)
    assert (check.verdict, check.found) == (Verdict.PASS, "PX4 3/1, no autopilot 3/191 (system/component)")
    hear(autopilot_beat(4, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA))
    assert doctor.autopilot_link(SERIAL).found == "ArduPilot 4/1 (system/component)"


@pytest.mark.parametrize(
    ("url", "data", "found", "fix"),
    [
        (SERIAL, (), "silence", "57600 baud"),
        (SERIAL, (b"\xff\0" * 50,), "100 bytes", "is the baud rate right (57600)"),
        (UDP_IN, (), "silence", "send to port 14540"),
        (UDP_OUT, (), "silence", "listen at 127.0.0.1:14600"),
        (UDP_OUT, (wire.pack(heartbeat(), seq=0, system=3, component=COMPONENT),), "no autopilot 3/191", "is it on"),
    ],
)
def test_silent_autopilot_comes_with_what_to_check(
    hear: Any, url: Url, data: tuple[bytes, ...], found: str, fix: str
) -> None:
    hear(*data)
    check = doctor.autopilot_link(url)
    assert check.verdict is Verdict.FAIL
    assert found in check.found
    assert fix in check.fix


def test_peers_are_told_by_id_and_their_silence_is_no_problem(hear: Any) -> None:
    spec = mission()
    assert spec.origin is not None
    codec = Codec(2, LocalFrame(spec.origin.wgs84))
    codec._pos_ned_m = (0.0, 0.0, 0.0)
    payload = codec.encode_beacon(beacon(2))
    assert payload is not None
    signed = wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=2, component=COMPONENT, flags=SIGNED)
    signed = seal(signed, bytes(32), 0, 1)
    hear(signed)
    assert (doctor.peers_link(MESH).found, doctor.peers_link(MESH).verdict) == ("vehicles 2", Verdict.PASS)
    hear(signed, wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=3, component=COMPONENT))
    assert doctor.peers_link(MESH).found == "vehicles 2, 3; UNSIGNED: 3"
    assert doctor.peers_link(MESH).verdict is Verdict.WARN
    hear()
    assert doctor.peers_link(MESH).verdict is Verdict.WARN


def scan_frame(component: int = 196, **changes: Any) -> bytes:
    fields = {"increment": 5, "min_distance": 20, "max_distance": 800, "frame": 12} | changes
    message = dialect.MAVLink_obstacle_distance_message(0, 0, [300] * 72, **fields)
    return wire.pack(message, seq=0, system=3, component=component)


@pytest.mark.parametrize(
    ("data", "verdict", "found"),
    [
        ((scan_frame(), scan_frame()), Verdict.PASS, "3/196: "),
        ((scan_frame(), scan_frame(197)), Verdict.PASS, "; 3/197: "),
        ((scan_frame(increment=0),), Verdict.FAIL, "1 make no sense"),
        ((autopilot_beat(3, 12),), Verdict.FAIL, "no OBSTACLE_DISTANCE in them"),
        ((), Verdict.FAIL, "silence"),
    ],
)
def test_obstacle_sensors_are_told_with_what_they_see(
    hear: Any, data: tuple[bytes, ...], verdict: Verdict, found: str
) -> None:
    hear(*data)
    check = next(doctor.sensor_link("obstacles", UDP_IN))
    assert check.verdict is verdict
    assert found in check.found
    if verdict is Verdict.PASS:
        assert "0.2 to 8 m, 360 deg from ahead" in check.found
        assert [*doctor.sensor_link("obstacles", UDP_IN)][1].found.startswith("3/196: front 3.0  front right 3.0")


def test_a_view_has_the_nearest_at_the_vehicles_height_and_none_of_scans_from_north(hear: Any) -> None:
    rays = [{"elevation_deg": deg, "ranges_mm": [mm] * 90} for deg, mm in ((0.0, 5000), (-7.0, 2000), (52.0, 1000))]
    hear(b"".join(lidar_kit.frame(first_bearing_deg=-45.0, **layer) for layer in rays))
    (_, view) = doctor.sensor_link("lidar", UDP_IN)
    assert view.found.startswith("3/196: front 2.0  front right 2.0  right ?")
    hear(scan_frame(frame=dialect.MAV_FRAME_LOCAL_NED))
    assert len([*doctor.sensor_link("obstacles", UDP_IN)]) == 1


def test_lidar_is_told_with_what_it_sees(hear: Any) -> None:
    turn = [lidar_kit.frame(first_bearing_deg=90.0 * k, elevation_deg=deg) for k in range(4) for deg in (-7.0, 52.0)]
    hear(b"".join(turn))
    check = next(doctor.sensor_link("lidar", UDP_IN))
    assert check.verdict is Verdict.PASS
    assert "0.2 to 12 m, 360 deg from ahead, rays 1 deg apart, 2 layers, -7 to 52 deg up" in check.found
    hear(b"".join(lidar_kit.frame(first_bearing_deg=90.0 * k, turn=k // 4) for k in range(3)))
    view = [*doctor.sensor_link("lidar", UDP_IN)][1]
    assert (view.name, view.verdict) == ("lidar view", Verdict.PASS)
    assert view.found == (
        "3/196: front 3.0  front right 3.0  right 3.0  rear right 3.0  rear 3.0  rear left 3.0  left 3.0  front left ?"
    )
    hear(b"".join(lidar_kit.frame(first_bearing_deg=90.0 * k, ranges_mm=[3000, 0] * 45) for k in range(4)))
    check = next(doctor.sensor_link("lidar", UDP_IN))
    assert (check.verdict, check.fix) == (Verdict.FAIL, LidarTally.FIX_FEW_RAYS)
    assert "of 360 rays a turn" in check.found
    hear(lidar_kit.frame(bearing_step_deg=0.0))
    check = next(doctor.sensor_link("lidar", UDP_IN))
    assert (check.verdict, check.fix) == (Verdict.FAIL, LidarTally.FIX_NONSENSE)


def ranges_frame(*vehicles: int) -> bytes:
    message = dialect.MAVLink_swarm_ranges_message(0, list(pack_ranges([(k, 8.0, 0.0) for k in vehicles])))
    return wire.pack(message, seq=0, system=3, component=158)


@pytest.mark.parametrize(
    ("data", "rows"),
    [
        ((ranges_frame(1, 4),), [("ranges", Verdict.PASS, "ranges to 1, 4 (system/component)")]),
        ((ranges_frame(),), [("ranges", Verdict.FAIL, "ranges to nobody")]),
        ((autopilot_beat(3, 12),), [("ranges", Verdict.FAIL, "no SWARM_RANGES in them")]),
        ((), [("ranges", Verdict.FAIL, "silence")]),
        ((scan_frame(),), [("obstacles", Verdict.PASS, "3/196"), ("ranges", Verdict.FAIL, "no SWARM_RANGES in them")]),
    ],
)
def test_range_radio_is_told_with_whom_it_measures_and_others_that_share_its_link(
    hear: Any, data: tuple[bytes, ...], rows: list[tuple[str, Verdict, str]]
) -> None:
    hear(*data)
    checks = [*doctor.examine(None, None, {"ranges": UDP_OUT})]
    told = [check for check in checks if check.name in ("ranges", "obstacles")]
    assert [(check.name, check.verdict) for check in told] == [(name, verdict) for name, verdict, _ in rows]
    assert all(found in check.found for check, (_, _, found) in zip(told, rows, strict=True))


def test_link_that_cannot_be_opened_is_a_problem_with_its_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(url: Url, **_options: bool) -> None:
        raise LinkError(f"{url}: the port is taken: end the program that has it")

    monkeypatch.setattr(doctor, "open_link", refuse)
    for check in (doctor.autopilot_link(UDP_IN), doctor.peers_link(MESH), *doctor.sensor_link("ranges", UDP_IN)):
        assert check.verdict is Verdict.FAIL
        assert "the port is taken" in check.fix


def only(checks: Iterator[Check]) -> Check:
    (check,) = checks
    return check


def test_ports_of_its_own_links_are_looked_at(hear: Any) -> None:
    hear()
    assert "/dev/ttyAMA0" in {check.name for check in doctor.examine(SERIAL, None)}


@pytest.mark.parametrize(
    ("autopilot", "peers", "rows"),
    [
        (None, None, []),
        (UDP_OUT, None, []),
        (SERIAL, MESH, ["udp 14660"]),
        (UDP_IN, MESH, ["udp 14540", "udp 14660"]),
    ],
)
def test_only_the_ports_that_its_own_links_bind_are_looked_at(
    hear: Any, autopilot: Url | None, peers: Url | None, rows: list[str]
) -> None:
    hear()
    assert [check.name for check in doctor.examine(autopilot, peers) if check.name.startswith("udp")] == rows


def test_versions_are_our_own_and_those_of_all_that_is_installed_with_it() -> None:
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    needed = {re.split("[<>=]", requirement)[0] for requirement in project["dependencies"]}
    assert set(doctor.PACKAGES) == needed
    assert f"understory {__version__}, {STATE}, " in doctor.versions().found


def test_missing_package_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.versions().verdict is Verdict.PASS
    monkeypatch.setattr(doctor, "PACKAGES", ("pymavlink", "no-such-package"))
    check = doctor.versions()
    assert (check.verdict, check.found.endswith("missing: no-such-package")) == (Verdict.FAIL, True)


def test_power_and_governor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "HWMON", tmp_path)
    monkeypatch.setattr(doctor, "CPU", tmp_path / "governor")
    assert list(doctor.undervoltage()) == []
    assert doctor.governor().verdict is Verdict.WARN
    alarm = tmp_path / "hwmon3" / doctor.ALARM
    alarm.parent.mkdir()
    alarm.write_text("1\n")
    assert only(doctor.undervoltage()).verdict is Verdict.FAIL
    alarm.write_text("0\n")
    assert only(doctor.undervoltage()).verdict is Verdict.PASS
    (tmp_path / "governor").write_text("powersave\n")
    assert doctor.governor().verdict is Verdict.WARN
    (tmp_path / "governor").write_text("schedutil\n")
    assert doctor.governor().verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("told", "verdict"),
    [
        (None, Verdict.PASS),
        ("LoadState=not-found\nActiveState=inactive\nSubState=dead", Verdict.PASS),
        ("LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=0", Verdict.PASS),
        ("LoadState=loaded\nActiveState=inactive\nSubState=dead\nNRestarts=0", Verdict.PASS),
        ("LoadState=loaded\nActiveState=activating\nSubState=start\nNRestarts=0", Verdict.PASS),
        ("LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=1", Verdict.WARN),
        ("LoadState=loaded\nActiveState=failed\nSubState=failed\nNRestarts=5", Verdict.FAIL),
        ("LoadState=loaded\nActiveState=activating\nSubState=auto-restart\nNRestarts=0", Verdict.FAIL),
        ("LoadState=loaded\nActiveState=activating\nSubState=start\nNRestarts=4711", Verdict.FAIL),
    ],
)
def test_service(told: str | None, verdict: Verdict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "told_by", lambda *_: told)
    assert doctor.service().verdict is verdict


@pytest.mark.parametrize(
    ("started", "unit", "verdict"),
    [
        (["companion", "run", "--key", "a"], "ExecStart=companion run --key a", Verdict.PASS),
        (["companion", "run", "--unsigned"], "", Verdict.WARN),
        ([], "ExecStart=companion run --unsigned", Verdict.WARN),
    ],
)
def test_companions_that_fly_without_keys_are_told(
    started: list[str], unit: str, verdict: Verdict, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = SimpleNamespace(info={"pid": 7, "cmdline": started})
    monkeypatch.setattr(doctor.psutil, "process_iter", lambda _names: [running])
    monkeypatch.setattr(doctor, "told_by", lambda *_: unit)
    assert doctor.unsigned().verdict is verdict


@pytest.mark.parametrize(("told", "verdict"), [("yes", Verdict.PASS), ("no", Verdict.WARN), (None, Verdict.WARN)])
def test_wall_clock(told: str | None, verdict: Verdict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(computer, "told_by", lambda *_: told)
    assert doctor.wall_clock().verdict is verdict


def test_key_is_a_row_where_one_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.preflight.computer.harden_process", lambda: "")
    path = key_file(tmp_path / "key", vehicle_of(operator_of(), 2))
    told = {check.name: check for check in doctor.examine(None, None, key=str(path))}
    assert told["key"].verdict is Verdict.PASS
    assert told["key"].found.startswith("vehicle 2, fleet ")
    path.chmod(0o644)
    told = {check.name: check for check in doctor.examine(None, None, key=str(path))}
    assert told["key"].verdict is Verdict.FAIL
    assert "key" not in {check.name for check in doctor.examine(None, None)}


def test_program_works_without_any_link_and_counts_its_problems(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "serial_ports", lambda _urls: iter(()))
    monkeypatch.setattr(doctor, "undervoltage", lambda: iter(()))
    monkeypatch.setattr(doctor, "service", lambda: good("service", "none"))
    assert cli.main(["doctor"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "no problem"
    monkeypatch.setattr(doctor, "PACKAGES", ("no-such-package",))
    assert cli.main(["doctor", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["problems"] == ["versions"]
    assert {check["name"] for check in told["checks"]} >= {"clock", "disk", "monotonic", "governor"}
