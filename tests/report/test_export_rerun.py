"""A flight as a Rerun recording, looked at by Rerun's own program where the extra is installed."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from sim_bridge import cli
from sim_bridge.judge import run_folder


def test_without_the_extra_it_says_what_to_install(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "sim_bridge.judge.export.rerun_file", raising=False)
    assert cli.main(["export", str(run), "--rrd", "--out", str(tmp_path)]) == 3
    assert "rerun is not installed: in the checkout, pip install -e '.[sim,rerun]'" in capsys.readouterr().err
    assert not (tmp_path / "flight.rrd").exists()


def test_rerun_reads_back_the_poses_of_every_vehicle_and_what_was_said(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    assert cli.main(["export", str(run), "--rrd", "--out", str(tmp_path)]) == 0
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vv", str(tmp_path / "flight.rrd")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    rows: Counter[str] = Counter()
    for number, entity in re.findall(r"with (\d+) rows? .* - (/\S+)", done.stdout):
        rows[entity] += int(number)
    ticks = len(run_folder.load(run).time_s)
    samples = math.ceil(ticks / 2) + (1 if ticks % 2 == 0 else 0)  # every second tick, and the last
    told = ("/map/vehicle_1", "/map/vehicle_3", "/map/swarm/vehicles", "/swarm/leader")
    assert {entity: rows[entity] for entity in told} == dict.fromkeys(told, samples)
    assert rows["/map/trunks"] == rows["/map/crowns"] == 1
    assert rows["/log"] > 3
    assert rows["/vehicle_2/fix"] > 10
