"""`sim-bridge study`: its files, its exit codes, and the schedulers that it asks."""

from __future__ import annotations

import io
import json
import re
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import pytest
from rich.console import Console

from sim_bridge import cli
from sim_bridge.judge import progress
from sim_bridge.lab.study import program
from sim_bridge.lab.study.program import ROWS, fly
from tests.study.study_kit import quiet, study, study_file


def test_program_flies_a_study_writes_its_summary_and_flies_nothing_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = study_file(tmp_path), tmp_path / "out"
    assert cli.main(["study", str(file), "--out", str(out), "--workers", "2"]) == 0
    shown = capsys.readouterr().out
    assert "4 flights" in shown
    rows = (out / ROWS).read_bytes()
    groups = json.loads((out / "summary.json").read_text())
    assert [(g["run"], g["n"], g["seeds"], g["arrived"]) for g in groups] == [("ours", 2, 2, 2), ("ours", 3, 2, 2)]
    assert groups[0]["overhead_last_high"] >= groups[0]["overhead_last_mean"] >= groups[0]["overhead_last_low"]
    header, *lines = (out / "summary.csv").read_text().splitlines()
    assert header.startswith("run,law,backend,n,seeds,")
    assert header.endswith(",swarm.size")
    assert len(lines) == 2
    assert (out / "plots" / "arrival_last_s.png").read_bytes().startswith(b"\x89PNG")
    assert cli.main(["study", str(file), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == groups
    assert (out / ROWS).read_bytes() == rows


def test_no_scheduler_there_is_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(program, "CONNECT_S", 0.5)
    out = ["--out", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:1"]
    assert cli.main(["study", str(study_file(tmp_path)), *out]) == 3
    assert re.search(r"127\.0\.0\.1:1", capsys.readouterr().err)


@pytest.mark.parametrize("address", ["foo", "", "127.0.0.1:28786:1", "foo://127.0.0.1:1", "tcp://x:99999", "x:0"])
def test_what_is_no_address_of_a_scheduler_is_refused(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["study", str(study_file(tmp_path)), "--out", str(tmp_path / "out"), "--scheduler", address])
    assert ended.value.code == 2
    assert f"argument --scheduler: {address!r}: must be HOST:PORT" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["host-1.lan:8786", "tcp://127.0.0.1:8786", "tls://[::1]:8786"])
def test_addresses_of_schedulers(address: str) -> None:
    parser = cli.build_parser()
    assert parser.parse_args(["study", "FILE", "--scheduler", address]).scheduler == address


def test_a_scheduler_without_workers_is_waited_for_with_a_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    executor = ThreadPoolExecutor(1)

    class Client:
        """A cluster whose worker comes when it is waited for."""

        def __init__(self, *_args: object, **_kwargs: object) -> None:
            self.workers: dict[str, int] = {}

        def __enter__(self) -> Client:
            return self

        def __exit__(self, *_: object) -> None:
            executor.shutdown()

        def nthreads(self) -> dict[str, int]:
            return self.workers

        def wait_for_workers(self, count: int) -> None:
            self.workers = {"a": count}

        def get_executor(self) -> Executor:
            assert self.workers
            return executor

    monkeypatch.setattr(distributed, "Client", Client)
    told = io.StringIO()
    rows = fly(study(tmp_path), tmp_path, Console(file=told), scheduler="tcp://there:8786")
    assert len(rows) == 4
    assert told.getvalue().count("waiting for workers of tcp://there:8786") == 1


def test_rows_come_back_in_the_order_of_the_study(tmp_path: Path) -> None:
    flown = study(tmp_path)
    rows = fly(flown, tmp_path, quiet(), workers=1)
    assert [row["key"] for row in rows] == [case.key for case in flown.cases]


def test_a_study_that_is_not_on_a_terminal_gives_signs_of_life(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SILENT_MAX_S", 0.01)
    told = io.StringIO()
    fly(study(tmp_path), tmp_path, Console(file=told), workers=1)
    assert re.search(r"^.*: 4 of 4 flights to go: \d+ s$", told.getvalue(), re.MULTILINE)
