"""`companion run` that is stopped, or breaks: what waited for the disk is on it, or is told as lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from companion.cloud.returns_reader import read_returns
from companion.records.record import RecordKind
from companion.records.store import RecordStore
from tests.programs.companion_kit import MISSION

LIMIT_S = 120.0
SURVEYS = '[sensing]\nrange_m = 12.0\nsensor = "scan-1deg"\n[survey]\n'
# Its loop does what one tick does with records, in five of which a disk would be waited for, and ends.
FLOWN = """
import sys, time
from companion import cli
from companion.cloud.returns import encode_returns
from companion.records.store import RecordStore, StoreError
from companion.shell.runner import Runner
from tests.unit.cloud.cloud_kit import returns_at

def fly(runner):
    for k in range(5):
        runner.endpoint.records.append(1, b"stem", 0.05 * k)
        runner.endpoint.records.frames(0.05 * k, 0)
        runner._returns.append([encode_returns(returns_at())])
    assert how != "breaks"

def fail(store, batch):
    raise StoreError("disk full")

Runner.by_monotonic = fly
how = sys.argv.pop(1)
if how == "full":
    RecordStore.write = fail
sys.exit(cli.main(sys.argv[1:]))
"""


def flown(folder: Path, how: str) -> tuple[int, str]:
    """Exit code and log."""
    mission, log = folder / "m.toml", folder / "flight.log"
    mission.write_text(MISSION + SURVEYS)
    options = ["--unsigned", "--waive", "all", f"--mission={mission}", "--id=1", f"--log={log}"]
    options += [f"--{kind}=udpout://127.0.0.1:9" for kind in ("autopilot", "peers", "sensor=lidar")]
    command = [sys.executable, "-c", FLOWN, how, "run", *options, f"--records={folder / 'a.db'}"]
    return subprocess.run(command, timeout=LIMIT_S, check=False).returncode, log.read_text()


@pytest.mark.parametrize(("how", "code"), [("ends", 0), ("breaks", 1)])
def test_what_waited_for_the_disk_is_on_it(tmp_path: Path, how: str, code: int) -> None:
    ended, log = flown(tmp_path, how)
    assert (ended, "LOST" in log) == (code, False)
    assert len(list(RecordStore(tmp_path / "a.db", 1, lambda: 1).records(RecordKind.STEM))) == 5
    assert len(read_returns(tmp_path / "a.returns")[0]) == 5


def test_what_the_disk_does_not_take_by_the_end_is_told_as_lost(tmp_path: Path) -> None:
    ended, log = flown(tmp_path, "full")
    assert ended == 0
    assert "records: 5 LOST: not on the disk by the end" in log
    assert "records: disk full: kept in memory" in log
