"""A sensor is its class and a line in the table: all else loops. CONTRIBUTING.md's worked example is held by this."""

from __future__ import annotations

import ast
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import pytest

from companion import cli, doctor, run_command, sensors
from companion.core.agent import TICK_HZ
from companion.core.model.events import Event, Ranges
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from companion.mavlink.sensor_source import Finding, SensorSource, SensorTally
from companion.mavlink.streams import streams_hz
from companion.preflight import command as preflight_command
from companion.preflight.report import Verdict
from companion.preflight.survey import Survey
from companion.sensors.obstacle_sensor import ATTITUDE_HZ
from companion.sensors.table import SENSORS, autopilot_hz, sensors_of
from companion.shell.flight_log import ChangeLogger, FlightLog
from companion.shell.runner import Runner
from tests.unit.core.core_kit import mission
from tests.unit.shell.runner_kit import MemoryLink

ME, DRIVER = 3, 99
COMMAND = dialect.MAVLINK_MSG_ID_COMMAND_LONG
URL = "udpin://127.0.0.1:14599"


class AltimeterTally(SensorTally):
    """Counts ALTITUDE."""

    def note_message(self, m: Any, _who: tuple[int, int], _now_s: float) -> bool:
        return bool(m.altitude_relative > 0.0)

    def check(self, _mission: Any, vehicle_id: int, _ended_s: float, where: str) -> Finding:
        heard = (vehicle_id, DRIVER) in self._arrived_s
        return Finding("heard" if heard else f"nothing on {where}", "ALTITUDE", "" if heard else "switch it on")

    def describe(self, _ended_s: float) -> Finding:
        return Finding(f"{len(self._arrived_s)} heard", "ALTITUDE")


class Altimeter(SensorSource):
    """A sensor that nobody but its table knows."""

    NAME = "altimeter"
    TITLE = "altimeter"
    MESSAGES = {dialect.MAVLINK_MSG_ID_ALTITUDE: "ALTITUDE"}  # noqa: RUF012
    HELP = "ALTITUDE of a test"
    ABOUT = "It is heard."
    UNUSED = "has no use for it"
    STALE = "no height that is fresh"

    @classmethod
    def is_flown(cls, mission: Any) -> bool:
        return bool(mission.name != "without")

    @classmethod
    def of(cls, _mission: Any) -> Self:
        return cls(1.0)

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        self.mark_measured(component, now_s)
        return Ranges(((1, m.altitude_relative, 0.0),))

    def counters(self) -> dict[str, int]:
        return {"heights refused": 0}

    @classmethod
    def tally(cls, began_s: float) -> AltimeterTally:
        return AltimeterTally(began_s)


class SlowAltimeter(Altimeter):
    """Content with fewer positions and attitudes of the autopilot than the flight goes by."""

    NAME = "slow altimeter"
    MESSAGES: ClassVar = {dialect.MAVLINK_MSG_ID_HYGROMETER_SENSOR: "HYGROMETER_SENSOR"}
    AUTOPILOT_HZ: ClassVar = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 2.0, dialect.MAVLINK_MSG_ID_ATTITUDE: 2.0}


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SENSORS, Altimeter.NAME, Altimeter)


def altitude(system: int = ME) -> bytes:
    message = dialect.MAVLink_altitude_message(0, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0)
    return wire.pack(message, seq=0, system=system, component=DRIVER)


class Heard:
    """A link by which one message has come."""

    errors, up = 0, True

    def __init__(self) -> None:
        self._near, self._far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._near.setblocking(False)
        self._far.send(altitude())

    def fileno(self) -> int:
        return self._near.fileno()

    def recv(self) -> bytes | None:
        try:
            return self._near.recv(65536)
        except BlockingIOError:
            return None

    def send(self, _data: bytes) -> None:
        pass

    def close(self) -> None:
        self._near.close()
        self._far.close()


def test_endpoint_takes_its_messages_and_the_core_gets_its_events(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = mission()
    one = Endpoint(flown, ME, sensors=sensors_of(flown), sensor_streams={"altimeter": False})
    received: list[Any] = []
    monkeypatch.setattr(one, "agent", SimpleNamespace(receive=lambda event, _now_s: received.append(event)))
    one.from_sensor(altitude(), 10.0, "altimeter")
    one.from_sensor(altitude(system=7), 10.0, "altimeter")
    assert [event.ranges for event in received] == [((1, 7.0, 0.0),)]
    assert one.sensors.foreign("altimeter") == {7}


def test_runner_drains_its_link_and_tells_its_driver_the_address() -> None:
    flown = mission()
    one = Endpoint(flown, ME, sensors=sensors_of(flown), sensor_streams={"altimeter": False})
    link, autopilot, peers = MemoryLink(), MemoryLink(), MemoryLink()
    link.arriving.append(altitude())
    nothing: Any = SimpleNamespace(log_changes=lambda *_: None)
    runner = Runner(one, autopilot, peers, nothing, nothing, nothing, {"altimeter": link})
    runner._drain(10.0, 1e9)
    runner._tick(10.0)
    assert one.sensors.sources[-1].freshness(10.0) == {DRIVER: True}
    assert wire.decode(link.sent[0]).get_srcSystem() == ME


def test_command_line_takes_its_name_and_refuses_a_mission_that_does_not_fly_by_it(tmp_path: Path) -> None:
    links = ["--autopilot", "udpout://127.0.0.1:9", "--peers", "udpout://127.0.0.1:9"]
    file = tmp_path / "mission.toml"
    arguments = cli.build_parser().parse_args(
        ["run", "--mission", str(file), "--id", "1", *links, "--sensor", f"altimeter={URL}"]
    )
    assert {name: str(url) for name, url in arguments.sensors.items()} == {"altimeter": URL}
    text = "schema = 1\norigin = { lat_deg = 47.0, lon_deg = 8.0, alt_m = 400.0 }\n"
    text += "route = { d1_enu_m = [0, 0, 5], d2_enu_m = [50, 0, 5], vel_leader_mps = 2.0 }\n"
    file.write_text(text)
    assert run_command.mission_of(arguments).swarm.size
    file.write_text(f'name = "without"\n{text}')
    with pytest.raises(run_command.RefusedError, match="has no use for it"):
        run_command.mission_of(arguments)


def test_preflight_listens_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preflight_command, "WINDOW_S", 0.05)
    monkeypatch.setattr(preflight_command, "open_link", lambda _url, **_options: Heard())
    url = cli.build_parser().parse_args(["doctor", "--sensor", f"altimeter={URL}"]).sensors["altimeter"]
    (check,) = preflight_command.sensor_checks({"altimeter": url}, mission(), ME, Survey())
    assert (check.name, check.verdict, check.found) == ("altimeter", Verdict.PASS, "heard")
    (check,) = preflight_command.sensor_checks({}, mission(), ME, Survey())
    assert (check.verdict, check.fix) == (Verdict.FAIL, "switch it on")


def test_doctor_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LISTEN_S", 0.05)
    monkeypatch.setattr(doctor, "open_link", lambda _url, **_options: Heard())
    given = cli.build_parser().parse_args(["doctor", "--sensor", f"altimeter={URL}"]).sensors
    rows = {check.name: check for check in doctor.examine(None, None, given)}
    assert rows["altimeter"].found == "1 heard (system/component)"
    assert "udp 14599" in rows


@pytest.fixture
def log(tmp_path: Path) -> Iterator[tuple[FlightLog, Path]]:
    path = tmp_path / "log"
    with path.open("wb") as file:
        yield FlightLog(file.fileno()), path


def test_flight_log_tells_of_its_driver_and_its_link(log: tuple[FlightLog, Path]) -> None:
    flown = mission()
    one = Endpoint(flown, ME, sensors=sensors_of(flown), sensor_streams={"altimeter": False})
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    altimeter: Any = SimpleNamespace(up=True, errors=0, lost=0)
    changes = ChangeLogger(log[0], one, link, link, {"altimeter": altimeter})
    one.from_sensor(altitude(), 10.0, "altimeter")
    changes.log_changes(10.0, [])
    altimeter.up = False
    changes.log_changes(12.0, [])
    lines = [line.split("] ")[1] for line in log[1].read_text().splitlines()]
    assert [line for line in lines if line.startswith("altimeter")] == [
        "altimeter 99 (component): heard",
        "altimeter 99 (component): lost: no height that is fresh",
        "altimeter's link lost: retrying",
    ]
    assert changes.counters().items() >= {"heights refused": 0, "times altimeter lost": 1}.items()


def test_sensors_are_pure() -> None:
    """The bridge imports them: no sockets, no clocks, no files."""
    pure = {"socket", "select", "time", "os", "pathlib", "serial", "subprocess", "threading"}
    for path in Path(sensors.__path__[0]).glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not {name.split(".")[0] for name in names} & pure, path


def test_a_sensor_lowers_no_rate_that_the_flight_or_another_sensor_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SENSORS, SlowAltimeter.NAME, SlowAltimeter)
    seeing = mission(sensing={})
    attitude, position = dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    assert autopilot_hz(seeing)[attitude] == ATTITUDE_HZ
    assert streams_hz(None, sensors_hz=autopilot_hz(seeing))[position] == TICK_HZ
    out = Framing({COMMAND}).read_messages(Endpoint(seeing, ME, sensors=sensors_of(seeing)).tick(0.0).autopilot)
    asked_hz = {int(i.message.param1): 1e6 / i.message.param2 for i in out if i.message.param2}
    assert (asked_hz[attitude], asked_hz[position]) == pytest.approx((ATTITUDE_HZ, TICK_HZ))
