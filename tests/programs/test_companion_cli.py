"""`companion` from the outside: exit codes, and messages that say what to do."""

from __future__ import annotations

import os
import re
import select
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from companion import cli
from companion.records.store import RecordStore
from mission import __version__
from tests.programs.companion_kit import MISSION

LIMIT_S = 60.0


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    path.write_text(MISSION)
    return path


def _companion(*arguments: str, module: str = "companion.cli") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", module, *arguments], capture_output=True, text=True, timeout=LIMIT_S, check=False
    )


def _run(mission: Path | str, **options: str) -> subprocess.CompletedProcess[str]:
    """`companion run` with options that are right, but for those given. It must end by itself."""
    given = {
        "mission": str(mission),
        "id": "1",
        "autopilot": "udpout://127.0.0.1:9",
        "peers": "udpout://127.0.0.1:9",
        **options,
    }
    words = (word for name, value in given.items() for word in (f"--{name}", value))
    return _companion("run", "--unsigned", *words)


@pytest.mark.parametrize("module", ["companion", "companion.cli"])
def test_version(module: str) -> None:
    done = _companion("--version", module=module)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.match(rf"understory {re.escape(__version__)}, (compiled|pure Python \()", done.stdout)


def test_help_says_what_it_is_with_an_example() -> None:
    done = _companion("--help")
    assert done.returncode == 0
    assert "companion run --mission" in done.stdout
    done = _companion("run", "--help")
    assert done.returncode == 0
    for word in (
        "--mission",
        "--id",
        "--autopilot",
        "--peers",
        "--sensor",
        "--clock",
        "--log",
        "--preflight",
        "--waive",
        "--key",
        "--unsigned",
        "SIGTERM",
        "failsafe",
        "udpbcast",
    ):
        assert word in done.stdout


@pytest.mark.parametrize("below", ["", "folder"])
def test_a_black_box_where_a_file_is_is_refused(below: str, mission: Path) -> None:
    done = _run(mission, **{"black-box": str(mission / below)})
    assert (done.returncode, done.stderr.splitlines()[-1]) == (3, f"companion: --black-box {mission}: is not a folder")


@pytest.mark.parametrize(
    ("name", "why"),
    [("obstacles", "has no [sensing] with sensor"), ("ranges", "has no [ranging]")],
)
def test_sensor_that_the_mission_does_not_fly_by_is_refused(mission: Path, name: str, why: str) -> None:
    done = _run(mission, sensor=f"{name}=udpin://127.0.0.1:14570")
    assert done.returncode == 2
    assert why in done.stderr
    assert "deprecated" not in done.stderr
    old = _run(mission, **{name: "udpin://127.0.0.1:14570"})
    assert old.returncode == 2
    assert why in old.stderr
    assert f"--{name} URL is deprecated: use --sensor {name}=URL" in old.stderr


@pytest.mark.parametrize(
    ("value", "what"),
    [
        ("sonar=udpin://127.0.0.1:1", "NAME one of obstacles, lidar, ranges, payload"),
        ("udpin://127.0.0.1:1", "must be NAME=URL"),
        ("obstacles=tcp://127.0.0.1:1", "udpin://HOST:PORT"),
    ],
)
def test_sensor_link_that_cannot_be_meant_is_refused(mission: Path, value: str, what: str) -> None:
    done = _run(mission, sensor=value)
    assert done.returncode == 2
    assert "--sensor" in done.stderr
    assert what in done.stderr


def test_names_of_sensors_are_listed() -> None:
    done = _companion("run", "--sensor", "help")
    assert done.returncode == 0
    assert [line.partition(":")[0] for line in done.stdout.splitlines()] == ["obstacles", "lidar", "ranges", "payload"]


def test_without_a_command_it_says_which_there_are() -> None:
    done = _companion()
    assert done.returncode == 2
    assert "COMMAND" in done.stderr


def test_the_reference_can_read_the_parser() -> None:
    assert cli.build_parser().prog == "companion"


@pytest.mark.parametrize(
    ("option", "value", "allowed"),
    [
        ("autopilot", "tcpout://127.0.0.1:5760", "serial:///dev/ttyX:BAUD"),
        ("autopilot", "udpbcast://192.168.4.255:14660", "udpin://HOST:PORT"),
        ("peers", "serial:///dev/ttyS0:57600", "udpbcast://BROADCAST:PORT"),
        ("clock", "wall", "vehicle"),
        ("id", "one", "'one' is no vehicle id"),
        ("id", "", "UNDERSTORY_ID"),
    ],
)
def test_a_wrong_option_is_named_with_its_value_and_what_is_allowed(
    mission: Path, option: str, value: str, allowed: str
) -> None:
    done = _run(mission, **{option: value})
    assert done.returncode == 2
    assert f"--{option}" in done.stderr
    assert value in done.stderr
    assert allowed in done.stderr


@pytest.mark.parametrize("vehicle_id", ["0", "3", "-1"])
def test_an_id_that_the_mission_does_not_have(mission: Path, vehicle_id: str) -> None:
    done = _run(mission, id=vehicle_id)
    assert done.returncode == 2
    assert f"--id {vehicle_id}" in done.stderr
    assert "1 to 2" in done.stderr


def test_a_real_flight_needs_an_origin(mission: Path) -> None:
    mission.write_text(MISSION.replace("[origin]\nlat_deg = 47.0\nlon_deg = 8.0\nalt_m = 400.0\n", ""))
    done = _run(mission)
    assert done.returncode == 2
    assert "a real flight needs [origin]" in done.stderr
    for key in ("lat_deg", "lon_deg", "alt_m"):
        assert key in done.stderr


def test_every_problem_of_the_mission_is_printed(mission: Path) -> None:
    mission.write_text(MISSION.replace("size = 2", "size = 0").replace("= 3.0", "= 99.0"))
    done = _run(mission)
    assert done.returncode == 2
    assert "swarm.size" in done.stderr
    assert "route.vel_leader_mps" in done.stderr


def test_a_mission_that_is_not_there() -> None:
    done = _run("/nowhere/m.toml")
    assert done.returncode == 2
    assert "/nowhere/m.toml: no such file" in done.stderr


@pytest.mark.parametrize("option", ["autopilot", "peers"])
def test_a_taken_port_is_named_with_the_fix(mission: Path, option: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{taken.getsockname()[1]}"
        done = _run(mission, **{option: url})
    assert done.returncode == 3
    assert f"--{option} {url}: the port is taken" in done.stderr
    assert "choose another" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_serial_device_is_named_and_waited_for(mission: Path, tmp_path: Path) -> None:
    """As at boot, where USB is late."""
    device = tmp_path / "ttyLATE"
    options = ["--unsigned", "--autopilot", f"serial://{device}:57600", "--peers", "udpout://127.0.0.1:9"]
    command = [sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", "1", *options]
    far, near = os.openpty()
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            lines = iter(process.stderr.readline, "")
            assert any(f"no {device}: is it plugged in? Opened once it is there" in line for line in lines)
            device.symlink_to(os.ttyname(near))
            assert any("autopilot link connected" in line for line in lines)
            assert select.select([far], [], [], LIMIT_S)[0]  # it speaks to its autopilot
            process.terminate()
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()
    os.close(near)
    os.close(far)


def test_records_of_a_mission_that_does_not_survey_are_refused(mission: Path) -> None:
    done = _run(mission, records="a.db")
    assert done.returncode == 2
    assert "has no [survey]" in done.stderr


def surveying(mission: Path) -> list[str]:
    """Options of a companion whose mission surveys, as written now."""
    mission.write_text(MISSION + '[sensing]\nrange_m = 12.0\nsensor = "scan-1deg"\n[survey]\n')
    return ["--unsigned", *(f"--{kind}=udpout://127.0.0.1:9" for kind in ("autopilot", "peers", "sensor=lidar"))]


@pytest.mark.parametrize(
    ("file", "why"),
    [
        ("folder", "is no file"),
        ("notes.txt", "is no store of records, and no database"),
        ("of_another_vehicle.db", "holds the records of vehicle 3, not 1"),
        ("of_another_mission.db", "holds the records of another mission"),
    ],
)
def test_a_file_of_records_that_is_not_this_flights_is_refused(
    mission: Path, tmp_path: Path, file: str, why: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "notes.txt").write_text("Mind the bees.\n" * 20)
    RecordStore(tmp_path / "of_another_vehicle.db", 3, lambda: 1).close()
    RecordStore(tmp_path / "of_another_mission.db", 1, lambda: 1, mission_hash=77).close()
    command = [sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", "1"]
    options = [*surveying(mission), "--waive", "all", "--records", str(tmp_path / file)]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == f"companion: --records {tmp_path / file}: {why}"


def test_records_that_cannot_be_written_keep_the_vehicle_on_the_ground(mission: Path, tmp_path: Path) -> None:
    """It does not end: one that starts again in flight, with a card that has failed meanwhile, must fly on."""
    log, file = tmp_path / "flight.log", tmp_path / "unmounted" / "a.db"
    command = [sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", "1"]
    options = [*surveying(mission), "--waive", "all", "--log", str(log), "--records", str(file)]
    with subprocess.Popen([*command, *options]) as process:
        try:
            while "to arm" not in _text(log) and "nothing is armed" not in _text(log):
                assert process.poll() is None
            process.terminate()
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()
    lines = _text(log)
    assert f"records in memory alone, not in {file}, unable to open database file: 0 of 0 records" in lines
    assert "GROUNDED, nothing is armed: records: unable to open database file" in lines


@pytest.mark.parametrize("given", [True, False])
def test_a_mission_that_surveys_has_its_records_in_a_file(mission: Path, tmp_path: Path, given: bool) -> None:
    options = [*surveying(mission), "--log", str(tmp_path / "flight.log")]
    options += ["--records", str(tmp_path / "given.db")] if given else []
    command = [sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", "1", *options]
    with subprocess.Popen(command) as process:
        try:
            while "nothing is armed" not in (log := _text(tmp_path / "flight.log")):
                assert process.poll() is None
            process.terminate()
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()
    (file,) = tmp_path.glob("*.db")
    assert file.name == "given.db" if given else file.name.startswith("records-1-")
    assert f"records in {file}: 0 of 0 records delivered" in log
    assert "records heard of 0, delivered 0, own ones lost 0" in _text(tmp_path / "flight.log")  # as it ends


def _text(path: Path) -> str:
    return path.read_text() if path.exists() else ""


def test_a_serial_device_that_is_there_but_cannot_be_opened_is_refused(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = _run(mission, autopilot=f"serial://{tmp_path}/file:57600")
    assert done.returncode == 3
    assert f"--autopilot serial://{tmp_path}/file:57600: cannot be opened as a serial port" in done.stderr


def test_a_log_that_cannot_be_opened(mission: Path) -> None:
    done = _run(mission, log="/nowhere/flight.log")
    assert done.returncode == 3
    assert "--log /nowhere/flight.log" in done.stderr


def test_a_broken_invariant_ends_the_process_with_its_traceback_in_the_log(
    mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("cannot be")

    monkeypatch.setattr("companion.mavlink.endpoint.Endpoint.tick", broken)
    log = tmp_path / "flight.log"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpout://127.0.0.1:{other.getsockname()[1]}"
        links = ["--autopilot", url, "--peers", url]
        code = cli.main(["run", "--mission", str(mission), "--id", "1", *links, "--unsigned", "--log", str(log)])
    assert code == 1
    assert "AssertionError: cannot be" in log.read_text()
    assert "Traceback" in log.read_text()


def test_a_flight_stays_small() -> None:
    heavy = ("mavsdk", "psutil", "numpy", "scipy", "lxml", "pymavlink", "asyncio", "jsbsim", "rich", "companion.doctor")
    check = f"import sys, companion.cli, companion.run_command; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", check], capture_output=True, text=True, timeout=LIMIT_S, check=True, env=os.environ
    )
    assert done.stdout.strip() == "[]"


def test_the_garbage_collector_rests_while_the_program_loads_and_works_from_then() -> None:
    check = """
import gc, sys
loading = []
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "companion.run_command":
            loading.append(gc.isenabled())
from companion.__main__ import main
sys.meta_path.insert(0, Finder())
url = "udpout://127.0.0.1:9"
sys.argv[1:] = ["run", "--mission", "/nowhere/m.toml", "--id", "1", "--autopilot", url, "--peers", url]
main()
print(loading, gc.isenabled(), gc.get_freeze_count() > 0)
"""
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, timeout=LIMIT_S, check=True)
    assert done.stdout.splitlines()[-1] == "[False] True True"


INTERRUPTED = """
import os, signal, sys
from companion.__main__ import main

number = getattr(signal, sys.argv.pop())

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "companion.shell.links":
            os.kill(os.getpid(), number)

sys.meta_path.insert(0, Interrupting())
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("command", "number", "code"),
    [
        ("run", "SIGINT", 0),
        ("run", "SIGTERM", 0),
        ("watch", "SIGINT", 0),
        ("watch", "SIGTERM", 0),
        ("doctor", "SIGINT", 130),
    ],
)
def test_a_signal_while_modules_load_ends_it_quietly(command: str, number: str, code: int) -> None:
    url = "udpout://127.0.0.1:9"
    options = {
        "run": ["--mission", "/nowhere/m.toml", "--id", "1", "--autopilot", url, "--peers", url],
        "watch": ["--peers", "udpin://127.0.0.1:9"],
    }
    process = [sys.executable, "-c", INTERRUPTED, command, *options.get(command, ()), number]
    done = subprocess.run(process, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
