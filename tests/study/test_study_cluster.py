"""The same study on a real Dask cluster: a scheduler and two workers, started here on free ports."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from sim_bridge import cli
from sim_bridge.lab.study.program import ROWS
from tests.study.study_kit import STUDY, study_file

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.interop,
    # Its own, when the client's event loop ends
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """Its address."""
    address_file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "distributed.cli"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    commands = [
        [*dask[:2], "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"],
        *[[*dask[:2], "distributed.cli.dask_worker", "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard"]] * 2,
    ]
    with ExitStack() as stack:
        for command in commands:
            full = [*command, "--scheduler-file", str(address_file)]
            log = stack.enter_context((tmp_path / "dask.log").open("ab"))
            child = subprocess.Popen(full, env=environment, cwd=tmp_path, stdout=log, stderr=log)
            stack.callback(child.wait)
            stack.callback(child.terminate)
        from distributed import Client

        with Client(scheduler_file=str(address_file), timeout=180) as client:
            client.wait_for_workers(2, timeout=180)
            address = client.scheduler.address
        yield address


def test_rows_of_a_cluster_are_those_of_the_local_pool(scheduler: str, tmp_path: Path) -> None:
    text = STUDY + '[[run]]\nname = "real"\nbackend = "agents"\nseeds = 1\n'
    file = study_file(tmp_path, text)
    rows = []
    for name, options in (("local", ["--workers", "1"]), ("cluster", ["--scheduler", scheduler])):
        assert cli.main(["study", str(file), "--out", str(tmp_path / name), *options]) == 0
        rows.append(sorted((tmp_path / name / ROWS).read_text().splitlines()))
    assert rows[0] == rows[1]
    assert len(rows[0]) == 6
    assert all(json.loads(line)["status"] == "flown" for line in rows[0])
