"""A process that holds a key: no core, and no secret in its arguments, its log, a traceback or a fault's trace."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from companion.keys import process
from companion.keys.process import harden_process
from tests.unit.keys.keys_kit import key_file, operator_of, secret_texts, vehicle_of

KEYRING = vehicle_of(operator_of(), 2)
CHILD = """
import ctypes, faulthandler, logging, os, resource, sys
from pathlib import Path
from companion.keys.crypto import Signer, session_key
from companion.keys.key_file import load_keyring
from companion.keys.process import harden_process

faulthandler.enable()
resource.setrlimit(resource.RLIMIT_CORE, (resource.getrlimit(resource.RLIMIT_CORE)[1],) * 2)
if HARDENS:
    assert harden_process() == ""
keyring = load_keyring(sys.argv[1], 2)
signer, keys = Signer(keyring.seed), [session_key(secret, b"m" * 32) for secret in keyring.secrets.values()]
logging.basicConfig(level=logging.DEBUG)
logging.debug("%r %s %r", keyring, keyring, signer)
print("argv", Path("/proc/self/cmdline").read_bytes(), Path("/proc/self/environ").read_bytes())
print("core", resource.getrlimit(resource.RLIMIT_CORE)[0], ctypes.CDLL(None).prctl(3, 0, 0, 0, 0), flush=True)

def crash(keyring, secret, signer):
    if sys.argv[2] == "raise":
        raise KeyError(keyring, signer)
    os.abort() if sys.argv[2] == "abort" else ctypes.string_at(0)

crash(keyring, keyring.secrets[keyring.active], signer)
"""


def crashed(how: str, folder: Path, *, hardens: bool = True) -> subprocess.CompletedProcess[str]:
    path = key_file(folder / "vehicle.key", KEYRING)
    program = CHILD.replace("HARDENS", str(hardens))
    return subprocess.run(
        [sys.executable, "-c", program, str(path), how], capture_output=True, text=True, cwd=folder, check=False
    )


@pytest.mark.parametrize(
    ("how", "code", "told"),
    [
        ("raise", 1, "KeyError: (Keyring(owner=2"),
        ("abort", -signal.SIGABRT, "Fatal Python error: Aborted"),
        ("fault", -signal.SIGSEGV, "Fatal Python error: Segmentation fault"),
    ],
)
def test_process_that_crashes_tells_no_secret_and_leaves_no_core(how: str, code: int, told: str, tmp_path: Path):
    done = crashed(how, tmp_path)
    assert done.returncode == code
    assert told in done.stderr
    assert "core 0 0\n" in done.stdout
    assert "argv b" in done.stdout
    assert [entry.name for entry in tmp_path.iterdir()] == ["vehicle.key"]
    assert not [part for part in secret_texts(KEYRING) if part in done.stdout + done.stderr]


def test_process_is_dumpable_until_it_is_hardened(tmp_path: Path):
    assert "core 0 0\n" not in crashed("raise", tmp_path, hardens=False).stdout


def test_limit_that_may_not_be_set_is_no_matter_and_a_missing_prctl_is_told(monkeypatch: pytest.MonkeyPatch):
    class Library:
        answer = 0

        def __init__(self, _name: None) -> None: ...

        def prctl(self, *words: int) -> int:
            assert words[:2] == (process.PR_SET_DUMPABLE, 0)
            return self.answer

    def refuse(*_: object) -> None:
        raise PermissionError

    limits: list[tuple[int, tuple[int, int]]] = []
    monkeypatch.setattr("ctypes.CDLL", Library)
    monkeypatch.setattr(resource, "setrlimit", lambda *words: limits.append(words))
    assert harden_process() == ""
    assert limits == [(resource.RLIMIT_CORE, (0, 0))]
    monkeypatch.setattr(resource, "setrlimit", refuse)
    assert harden_process() == ""
    monkeypatch.setattr(Library, "answer", -1)
    assert "PR_SET_DUMPABLE" in harden_process()
    monkeypatch.delattr(Library, "prctl")
    assert "PR_SET_DUMPABLE" in harden_process()
