"""`sim-bridge fly` as a program: exit codes, messages, Ctrl-C, and companions that do not play along."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from mission.document.load import dump_mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep import processes
from sim_bridge.world.autopilot import Link
from tests.flights import flown, short_mission

EXAMPLE = Path(__file__).parents[2] / "mission" / "examples" / "lone_tree.toml"


FLY_ONE = (sys.executable, "-m", "sim_bridge.cli", "fly", "--agents", "in-process")


def one(folder: Path) -> Path:
    """A mission file for a vehicle alone."""
    file = folder / "one.toml"
    file.write_text(dump_mission(short_mission(swarm={"size": 1}, route={"d2_enu_m": (12, 0, 4)})))
    return file


def sim_bridge(*args: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sim_bridge.cli", *args],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["fly", "nowhere.toml"], 2, "nowhere.toml"),
        (["fly", str(EXAMPLE), "-n", "0"], 2, "-n: swarm.size = 0: must be an integer from 1 to 250"),
        (["fly", str(EXAMPLE), "-n", "251"], 2, "-n: swarm.size = 251: must be an integer from 1 to 250"),
        (["fly", str(EXAMPLE), "--seed", "-1"], 2, "--seed: sim.seed = -1"),
        (["fly", str(EXAMPLE), "--speed", "fast"], 2, "fast: must be max, or a factor of at least 0.01"),
        (["fly", str(EXAMPLE), "--speed", "1e-300"], 2, "1e-300: must be max, or a factor of at least 0.01"),
        (["fly", str(EXAMPLE), "--speed", "inf"], 2, "inf: must be max, or a factor of at least 0.01"),
        (
            ["fly", str(EXAMPLE), "--kill", "leader"],
            2,
            "must be VEHICLES@WHEN, as leader@40. VEHICLES: leader",
        ),
        (["fly", str(EXAMPLE), "--stop", "2@30"], 2, "--stop 2@30: must be VEHICLES@WHEN:SECONDS, as 2@30:3"),
        (["fly", str(EXAMPLE), "-n", "4", "--kill", "5@9"], 2, "--kill 5@9: sim.faults[0].vehicles = [5]: has no veh"),
        (["fly", str(EXAMPLE), "--out", str(EXAMPLE.parent)], 2, "is not an empty folder"),
        (
            ["fly", str(EXAMPLE), "--airframe", "point-mass", "--autopilots", "udpin://127.0.0.1:0"],
            2,
            "--airframe: is of simulated vehicles",
        ),
        (
            ["fly", str(EXAMPLE), "--airframe", "point-mass", "--wind", "1@5:3:0"],
            2,
            "--airframe point-mass: flies in still air, and the mission has a wind fault",
        ),
        (["report", str(EXAMPLE.parent)], 2, "must be the folder of a flight"),
        ([], 2, "COMMAND"),
    ],
)
def test_wrong_usage_is_refused_in_words(args: list[str], code: int, message: str) -> None:
    done = sim_bridge(*args)
    assert done.returncode == code
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("missing", ["jsbsim", "numpy", "rich"])
def test_missing_library_is_named_with_what_to_install(missing: str, tmp_path: Path) -> None:
    (tmp_path / f"{missing}.py").write_text(f"raise ModuleNotFoundError('no {missing}', name='{missing}')\n")
    done = sim_bridge("fly", str(EXAMPLE), "--out", str(tmp_path / "run"), PYTHONPATH=str(tmp_path))
    assert done.returncode == 3
    assert missing in done.stderr
    assert "in the checkout, pip install -e '.[sim]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_flight_is_reported_as_json_and_in_its_folder(tmp_path: Path) -> None:
    mission = tmp_path / "short.toml"
    mission.write_text(dump_mission(short_mission(swarm={"size": 2})))
    done = sim_bridge("fly", str(mission), "--out", str(tmp_path / "run"), "--json")
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["arrived"]
    assert figures == json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (tmp_path / "run" / "report.html").read_text().startswith("<!doctype html>")
    again = sim_bridge("report", str(tmp_path / "run"), "--json")
    assert (again.returncode, again.stderr) == (0, "")
    assert json.loads(again.stdout).items() <= figures.items()
    assert json.loads(again.stdout)["verdict"] == "ARRIVED"


def test_point_masses_fly_a_mission_and_it_is_said(tmp_path: Path) -> None:
    hashes = {}
    for body in ("point-mass", "jsbsim"):
        run = tmp_path / body
        asked = ("--airframe", body, "--agents", "in-process", "--out", str(run), "--json")
        done = sim_bridge("fly", str(one(tmp_path)), *asked)
        assert done.returncode == 0, done.stderr
        assert ("point masses: no flight dynamics, still air" in done.stderr) == (body == "point-mass")
        hashes[body] = json.loads(done.stdout)["trace_hash"]
    assert hashes["point-mass"] != hashes["jsbsim"]


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-", "2> >(exec true)"])
def test_flight_goes_on_where_nobody_can_be_shown_anything(redirection: str, tmp_path: Path) -> None:
    command = [*FLY_ONE, str(one(tmp_path)), "--out", str(tmp_path / "run"), "--json"]
    done = subprocess.run(["bash", "-c", f"{shlex.join(command)} {redirection}"], stdout=subprocess.PIPE, check=False)
    assert done.returncode == 0
    assert json.loads(done.stdout)["verdict"] == "ARRIVED"
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["verdict"] == "ARRIVED"
    assert (tmp_path / "run" / "report.html").is_file()


def test_signed_flight_has_its_key_files_beside_it(tmp_path: Path) -> None:
    done = sim_bridge("fly", str(one(tmp_path)), "--signed", "--out", str(tmp_path / "run"), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verdict"] == "ARRIVED"
    assert "radio signed: vehicle 1" in (tmp_path / "run" / "companions" / "companion-1.log").read_text()
    assert (tmp_path / "run" / "keys").stat().st_mode & 0o777 == 0o700
    assert [file.name for file in (tmp_path / "run" / "keys").iterdir()] == ["vehicle-1.key"]
    assert (tmp_path / "run" / "keys" / "vehicle-1.key").stat().st_mode & 0o777 == 0o600
    refused = sim_bridge("fly", str(one(tmp_path)), "--signed", "--autopilots", "udpin://127.0.0.1:14540")
    assert refused.returncode == 2
    assert "--signed: flies in the bridge alone" in refused.stderr


@pytest.mark.parametrize("signed", [(), ("--signed",)])
def test_an_outsider_of_an_unsigned_swarm_is_told_for_what_it_is(signed: tuple[str, ...], tmp_path: Path) -> None:
    asked = ("--airframe", "point-mass", "--agents", "in-process", "--outsider", "1@2", *signed)
    done = sim_bridge("fly", str(one(tmp_path)), *asked, "--out", str(tmp_path / "run"))
    assert done.returncode in (0, 1), done.stderr
    said = "an outsider without --signed: what it sends counts as the members' own"
    assert (said in done.stderr) is (signed == ())


def test_verdict_that_cannot_be_written_is_an_error_in_a_line_and_the_flight_is_kept(tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        command = [*FLY_ONE, str(one(tmp_path)), "--out", str(tmp_path / "run")]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.splitlines()[-1].startswith("sim-bridge: ")
    assert "Traceback" not in done.stderr
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["verdict"] == "ARRIVED"


def test_mission_file_is_kept_as_it_was_when_it_was_read(tmp_path: Path) -> None:
    mission = one(tmp_path)
    before = mission.read_bytes()
    command = [*FLY_ONE, str(mission), "--out", str(tmp_path / "run"), "--speed", "20"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as flight:
        assert flight.stderr is not None
        for line in flight.stderr:
            if "swarm takes off" in line:
                break
        mission.unlink()
        _, shown = flight.communicate()
    assert flight.returncode == 0, shown
    assert (tmp_path / "run" / "mission.original.toml").read_bytes() == before


def test_ctrl_c_while_loading_is_a_line(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text(
        "import os, signal; os.kill(os.getpid(), signal.SIGINT); raise ImportError('an interrupt, swallowed')\n"
    )
    done = sim_bridge("fly", str(one(tmp_path)), "--out", str(tmp_path / "run"), PYTHONPATH=str(tmp_path))
    assert done.returncode == 1
    assert done.stderr == "sim-bridge: interrupted\n"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM])
def test_terminal_or_manager_that_ends_it_gets_the_flight_so_far(number: signal.Signals, tmp_path: Path) -> None:
    command = [*FLY_ONE, str(one(tmp_path)), "--out", str(tmp_path / "run"), "--speed", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as flight:
        assert flight.stderr is not None
        for line in flight.stderr:
            if "leader: vehicle" in line:
                break
        flight.send_signal(number)
        verdict, shown = flight.communicate()
    assert flight.returncode == 1
    assert "Traceback" not in shown
    assert verdict.splitlines()[-1] == "INCOMPLETE: not all arrived (interrupted)"
    assert (tmp_path / "run" / "report.html").is_file()
    assert (tmp_path / "run" / "recording.npz").is_file()


def test_mission_that_fails_exits_with_1(tmp_path: Path) -> None:
    mission = tmp_path / "short.toml"
    mission.write_text(dump_mission(short_mission(swarm={"size": 1}, sim={"time_limit_s": 30})))
    done = sim_bridge("fly", str(mission), "--out", str(tmp_path / "run"), "--agents", "in-process")
    assert done.returncode == 1
    assert "INCOMPLETE: not all arrived (time limit of 30 s reached)" in done.stdout


def test_ctrl_c_ends_flight_and_companions_and_keeps_the_run_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sim_bridge.cli", "fly", str(EXAMPLE), "-n", "3", "--speed", "1"]
    with subprocess.Popen([*command, "--out", str(tmp_path)], stderr=subprocess.PIPE, text=True) as flight:
        assert flight.stderr is not None
        for line in flight.stderr:
            if "leader: vehicle" in line:
                break
        children = psutil.Process(flight.pid).children(recursive=True)
        flight.send_signal(signal.SIGINT)
        flight.stderr.read()
    assert flight.returncode == 1
    assert len(children) == 4  # with the server that they are forked from
    assert not any(child.is_running() for child in children)
    assert json.loads((tmp_path / "metrics.json").read_text())["ended"] == "interrupted"


def test_companion_that_stops_answering_is_named_and_the_others_arrive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "ANSWER_LIMIT_S", 0.5)

    def stop_two(flight: Flight) -> None:
        companion = flight.lockstep.companions.get(2)
        if flight.world.now_s > 30.0 and companion is not None:
            os.kill(companion.process.pid, signal.SIGSTOP)  # type: ignore[attr-defined]

    outcome, shown = flown(short_mission(swarm={"size": 4}), tmp_path, in_process=False, watch=stop_two)
    assert "companion 2: did not answer" in shown
    assert outcome.summary["verdict"] == "INCOMPLETE without 2: lost vehicle 2", shown
    assert outcome.metrics.lost == (2,)


def test_companion_that_never_speaks_is_named_and_the_others_fly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "HELLO_LIMIT_S", 3.0)
    deaf = {3: (sys.executable, "-c", "import signal; signal.pause()")}
    mission = short_mission(swarm={"size": 3, "start_timeout_s": 3})
    outcome, shown = flown(mission, tmp_path, in_process=False, programs=deaf)
    assert "companion 3: never answered" in shown
    assert outcome.summary["verdict"] == "INCOMPLETE without 3: lost vehicle 3", shown


def test_flight_that_no_companion_begins_says_why(tmp_path: Path) -> None:
    broken = {1: (sys.executable, "-c", "raise SystemExit(4)")}
    outcome, shown = flown(short_mission(swarm={"size": 1}), tmp_path, in_process=False, programs=broken)
    assert "companion 1: ended with exit code 4" in shown
    assert outcome.summary["ended"] == "no companion left"


def test_garbage_from_a_companion_does_no_harm(tmp_path: Path) -> None:
    def shout(flight: Flight) -> None:
        world = flight.world
        garbage = bytes(range(256)) + b"\xfd" * 40
        flight.lockstep.transmitter.send(1, garbage, world.now_s)
        for vehicle in world.vehicles.values():
            for link in Link:
                vehicle.autopilot.receive(link, garbage, world.now_s)
        for companion in flight.lockstep.companions.values():
            endpoint = companion.endpoint  # type: ignore[attr-defined]
            endpoint.from_peers(garbage, world.now_s)
            endpoint.from_autopilot(garbage, world.now_s)

    outcome, shown = flown(short_mission(swarm={"size": 3}), tmp_path, watch=shout)
    assert outcome.succeeded, shown
