"""`companion base` as a program: records in, a vector out, and what it says."""

from __future__ import annotations

import select
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from companion.keys.fleet_folder import file_name, make_fleet
from companion.keys.key_file import load_keyring
from companion.keys.keyring import OPERATOR
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.peers.guard import Guard, OpenGuard, SignedGuard
from companion.mavlink.peers.session import Session, open_session
from companion.records.node import open_records
from companion.records.record import BASE_ID, Record, RecordKind
from companion.records.signed.messages import SIGNED_RECORD_ID, encode_signed_record
from companion.records.store import RecordStore
from companion.shell.radio_keys import mission_digest
from companion.stand.records import read_records
from mission.document.load import parse_mission
from tests.programs.companion_kit import MISSION

LIMIT_S = 60.0
SURVEY = MISSION + '[sensing]\nrange_m = 12.0\nsensor = "scan-1deg"\n[survey]\n'


class Vehicle:
    """Vehicle 1's companion, at the other end of the base station's link."""

    def __init__(self, port: int, *, log: int = 9, session: Session | None = None) -> None:
        self.records = open_records(parse_mission(SURVEY), 1, None, lambda: log, session=session)
        self._guard: Guard = OpenGuard() if session is None else SignedGuard(session)
        self._sender = wire.Sender(1, COMPONENT, self._guard.flags)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._now_s = 0.0

    def run(self, is_done: str, process: subprocess.Popen[str]) -> None:
        """Until its records say so of their progress; the base station is given time to answer, not the clock."""
        for _ in range(20_000):
            assert process.poll() is None
            self._now_s += 0.05
            proof = self._guard.proof(self._now_s)
            if proof is not None:
                self._socket.send(self._guard.seal_proof(self._sender.frame(*proof)))
            for frame in self.records.frames(self._now_s, 0):
                self._socket.send(self._guard.seal(self._sender.frame(*frame), self._now_s, named=False))
            while select.select([self._socket], [], [], 0.005)[0]:
                try:
                    data = self._socket.recv(2000)
                except ConnectionRefusedError:
                    continue
                if not self._guard.take_proof(data, self._now_s) and self._guard.admits(data, self._now_s, named=False):
                    self.records.receive(data, self._now_s)
            if str(self.records.progress()) == is_done:
                return
        raise AssertionError(f"{self.records.progress()}, not {is_done}")

    def forge(self) -> None:
        """Send a record in vehicle 2's name."""
        payload = encode_signed_record(Record(2, 7, 1, RecordKind.STEM, 0.0, b"forged", bytes(64)))
        frame = self._sender.frame(SIGNED_RECORD_ID, payload)
        self._socket.send(self._guard.seal(frame, self._now_s, named=False))

    def close(self) -> None:
        self._socket.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


def base(folder: Path, port: int, key: Path | None = None) -> subprocess.Popen[str]:
    (folder / "m.toml").write_text(SURVEY)
    signs = ["--unsigned"] if key is None else ["--key", str(key)]
    options = [*signs, "--listen", f"udpin://127.0.0.1:{port}", "--records", str(folder / "base.db")]
    arguments = [sys.executable, "-m", "companion", "base", str(folder / "m.toml"), *options]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("base station of 'test' on udpin://127.0.0.1:")
    if key is None:
        assert process.stdout.readline().startswith("UNSIGNED (--unsigned): whoever is in radio range")
    return process


def end(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> tuple[str, str]:
    process.send_signal(number)
    shown, errors = process.communicate(timeout=LIMIT_S)
    assert errors == ""
    return shown, errors


def at_base(folder: Path) -> list[bytes]:
    store = RecordStore(folder / "base.db", BASE_ID, lambda: 1)
    found = [body for _, _, _, body in store.records(RecordKind.STEM)]
    store.close()
    return found


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_it_stores_what_it_hears_and_shows_how_far_it_is(tmp_path: Path, ending: signal.Signals) -> None:
    port = free_port()
    with base(tmp_path, port) as process:
        vehicle = Vehicle(port)
        for k in range(5):
            vehicle.records.append(RecordKind.STEM, b"stem %d" % k, 0.0)
        vehicle.run("5 of 5 records delivered", process)
        vehicle.close()
        shown, _ = end(process, ending)
        assert process.returncode == 0
    assert shown.splitlines()[-1] == "5 of 5 records delivered"
    assert at_base(tmp_path) == [b"stem %d" % k for k in range(5)]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_a_restart_in_the_middle_leaves_no_gap_and_no_duplicate(tmp_path: Path, ending: signal.Signals) -> None:
    port = free_port()
    vehicle = Vehicle(port)
    for turn in range(2):
        for k in range(5):
            vehicle.records.append(RecordKind.STEM, b"stem %d" % (5 * turn + k), 0.0)
        with base(tmp_path, port) as process:
            wanted = 5 * (turn + 1)
            vehicle.run(f"{wanted} of {wanted} records delivered", process)
            process.send_signal(ending)
            process.communicate(timeout=LIMIT_S)
    vehicle.close()
    assert at_base(tmp_path) == [b"stem %d" % k for k in range(10)]


def test_with_its_key_it_stores_what_is_signed_and_acknowledges_it(tmp_path: Path) -> None:
    make_fleet(tmp_path / "fleet", 2)
    port = free_port()
    (tmp_path / "m.toml").write_text(SURVEY)
    keyring = load_keyring(tmp_path / "fleet" / file_name(1), 1)
    vehicle = Vehicle(port, session=open_session(keyring, 1, mission_digest(str(tmp_path / "m.toml")), 5))
    with base(tmp_path, port, tmp_path / "fleet" / file_name(OPERATOR)) as process:
        for k in range(5):
            vehicle.records.append(RecordKind.STEM, b"stem %d" % k, 0.0)
        vehicle.run("5 of 5 records delivered", process)
        vehicle.forge()
        vehicle.records.append(RecordKind.STEM, b"stem 5", 0.0)
        vehicle.run("6 of 6 records delivered", process)
        vehicle.close()
        shown, _ = end(process)
    assert "records: forged as vehicle 2's: refused" in shown.splitlines()
    assert shown.splitlines()[-2:] == ["6 of 6 records delivered", "refused, as forged by a member of the swarm: 1"]
    stored = read_records(tmp_path / "base.db")
    assert [record.body for record in stored] == [b"stem %d" % k for k in range(6)]
    assert all(record.proven for record in stored)


def test_a_mission_that_does_not_survey_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MISSION)
    options = ["--unsigned", "--listen", f"udpin://127.0.0.1:{free_port()}", "--records", str(tmp_path / "base.db")]
    done = subprocess.run(
        [sys.executable, "-m", "companion", "base", str(tmp_path / "m.toml"), *options],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 2
    assert "has no [survey]" in done.stderr
    assert not (tmp_path / "base.db").exists()


@pytest.mark.parametrize(
    ("records", "why"),
    [
        ("none/base.db", "unable to open database file"),
        ("of_vehicle.db", "holds the records of vehicle 3"),
        ("of_another.db", "of_another.db: holds the records of another mission"),
        ("m.toml", "m.toml: is no store of records"),
    ],
)
def test_a_file_that_it_cannot_use_is_refused_by_name(tmp_path: Path, records: str, why: str) -> None:
    (tmp_path / "m.toml").write_text(SURVEY)
    RecordStore(tmp_path / "of_vehicle.db", 3, lambda: 1).close()
    RecordStore(tmp_path / "of_another.db", BASE_ID, lambda: 1, mission_hash=77).close()
    options = ["--unsigned", "--listen", f"udpin://127.0.0.1:{free_port()}", "--records", str(tmp_path / records)]
    done = subprocess.run(
        [sys.executable, "-m", "companion", "base", str(tmp_path / "m.toml"), *options],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 3
    assert (tmp_path / "m.toml").read_text() == SURVEY
    assert why in done.stderr
    assert "--records" in done.stderr
