"""`companion run --key`: whose key it is, and what the log says with one and without."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.keys.autopilot_link import link_key
from companion.keys.key_file import load_keyring
from companion.mavlink.autopilot_link.signing import LinkSigning
from companion.mavlink.framing.frames import whole
from companion.preflight.computer import now
from companion.preflight.report import Check, Report, Verdict, write_report
from mission.document.load import mission_sha256

LIMIT_S = 60.0
URL = "udpout://127.0.0.1:9"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    folder = tmp_path / "fleet"
    made = run_companion("key", "new", str(folder), "--vehicles", "2")
    assert made.returncode == 0, made.stderr
    return folder


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    file = tmp_path / "two.toml"
    file.write_text(
        "schema = 1\n[swarm]\nsize = 2\n[origin]\nlat_deg = 47.0\nlon_deg = 8.0\nalt_m = 400.0\n"
        "[route]\nd1_enu_m = [0, 0, 8]\nd2_enu_m = [40, 0, 8]\nvel_leader_mps = 2.0\n"
    )
    return file


def run_companion(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "companion.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)


def flown_log(mission: Path, *options: str, meanwhile: Callable[[], None] = lambda: None) -> str:
    """The log of a companion that has come to its loop, and was stopped after `meanwhile`."""
    links = ("--autopilot", URL, "--peers", URL)
    command = [sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", "1", *links, *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=mission.parent) as process:
        assert process.stderr is not None
        lines: list[str] = []
        for line in process.stderr:
            lines.append(line)
            if "GROUNDED" in line or "cleared to arm" in line:
                break
        meanwhile()
        process.terminate()
        lines += process.stderr
        assert process.wait(LIMIT_S) == 0
    return "".join(lines)


def test_log_says_that_a_radio_without_a_key_is_unsigned(mission: Path) -> None:
    log = flown_log(mission, "--unsigned")
    assert "UNSIGNED (--unsigned): whoever is in radio range can start, lead and land" in log


def test_without_a_key_it_refuses_and_says_how_to_make_one_and_how_to_fly_without(mission: Path) -> None:
    done = run_companion("run", "--mission", str(mission), "--id", "1", "--autopilot", URL, "--peers", URL)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    for words in (
        "--key FILE is needed",
        "`companion key new fleet --vehicles 2`",
        "docs/how-to/keys.md",
        "--unsigned",
    ):
        assert words in line


def test_a_key_and_the_word_that_none_is_wanted_are_no_choice(mission: Path, fleet: Path) -> None:
    both = ("--key", str(fleet / "vehicle-1.key"), "--unsigned")
    done = run_companion("run", "--mission", str(mission), "--id", "1", "--autopilot", URL, "--peers", URL, *both)
    assert done.returncode == 2
    assert "not allowed with argument --key" in done.stderr


def test_base_station_without_a_key_refuses_as_well(mission: Path, tmp_path: Path) -> None:
    mission.write_text(mission.read_text() + '[sensing]\nrange_m = 12.0\nsensor = "scan-1deg"\n[survey]\n')
    options = ("--listen", "udpin://127.0.0.1:9", "--records", str(tmp_path / "base.db"))
    done = run_companion("base", str(mission), *options)
    assert done.returncode == 2
    assert "--key FILE is needed" in done.stderr
    assert not (tmp_path / "base.db").exists()


def test_log_shows_whose_key_it_is_and_no_secret(mission: Path, fleet: Path) -> None:
    key = fleet / "vehicle-1.key"
    log = flown_log(mission, "--key", str(key))
    assert "radio signed: vehicle 1" in log
    assert "UNSIGNED" not in log
    hexadecimal = [word for word in key.read_text().split('"') if len(word) == 64]
    assert hexadecimal
    assert not any(word in log for word in hexadecimal)


def test_orders_that_an_earlier_release_kept_here_are_to_be_moved(mission: Path, fleet: Path) -> None:
    (mission.parent / "orders-1").touch()
    words = ("run", "--mission", str(mission), "--id", "1", "--autopilot", URL, "--peers", URL)
    command = [sys.executable, "-m", "companion.cli", *words, "--key", str(fleet / "vehicle-1.key")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False, cwd=mission.parent)
    assert done.returncode == 2
    assert done.stderr.startswith("companion: orders-1: here, where an earlier release kept which orders")


@pytest.mark.parametrize("file", ["vehicle-2.key", "operator.key", "none.key"])
def test_key_of_another_is_refused(mission: Path, fleet: Path, file: str) -> None:
    links = ("--autopilot", URL, "--peers", URL)
    done = run_companion("run", "--mission", str(mission), "--id", "1", *links, "--key", str(fleet / file))
    assert done.returncode == 2
    assert f"companion: --key {fleet / file}: " in done.stderr


def test_key_that_others_may_read_is_refused(mission: Path, fleet: Path) -> None:
    key = fleet / "vehicle-1.key"
    os.chmod(key, 0o644)
    links = ("--autopilot", URL, "--peers", URL)
    done = run_companion("run", "--mission", str(mission), "--id", "1", *links, "--key", str(key))
    assert done.returncode == 2
    assert "--key" in done.stderr


def test_autopilot_link_is_signed_and_nothing_armed_until_preflight_saw_it_refuse(mission: Path, fleet: Path) -> None:
    key = fleet / "vehicle-1.key"
    good = Check(name="battery", verdict=Verdict.PASS, found="90 %", wanted="at least 50 %")
    then = now()
    report = Report(
        verdict=Verdict.PASS,
        time_unix_s=then.unix_s,
        time_utc="now",
        boot_id=then.boot_id,
        boot_s=then.boot_s,
        mission="two",
        mission_sha256=mission_sha256(mission),
        vehicle_id=1,
        checks=(good,),
    )
    write_report(report, mission.with_name("report.json"))
    options = ("--key", str(key), "--sign-autopilot", "--preflight", str(mission.with_name("report.json")))
    heard: list[bytes] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(LIMIT_S)
        at = f"udpout://127.0.0.1:{autopilot.getsockname()[1]}"
        log = flown_log(mission, *options, "--autopilot", at, meanwhile=lambda: heard.append(autopilot.recv(65536)))
    assert "GROUNDED, nothing is armed: preflight failed: signing" in log
    assert "autopilot link signed" in log
    gate = LinkSigning(link_key(load_keyring(str(key), 1)))
    assert all(gate.admits(data[start:end]) for data in heard for start, end, _ in whole(data))
    assert gate.signed


def test_autopilot_link_is_not_signed_without_a_key(mission: Path) -> None:
    links = ("--autopilot", URL, "--peers", URL)
    done = run_companion("run", "--mission", str(mission), "--id", "1", *links, "--unsigned", "--sign-autopilot")
    assert done.returncode == 2
    assert "--sign-autopilot" in done.stderr
    done = run_companion("preflight", "--mission", str(mission), "--id", "1", "--autopilot", URL, "--sign-autopilot")
    assert done.returncode == 2
    assert "is needed for --sign-autopilot" in done.stderr
