"""The worst flights of a study, flown once more with everything recorded: the same flights to the bit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sim_bridge.judge import run_folder
from sim_bridge.judge.outcome import Outcome
from sim_bridge.judge.page import PAGE_NAME, write_flight
from sim_bridge.judge.page.replay import Verdict
from sim_bridge.lab.study.backends import BACKENDS, AgentsBackend
from sim_bridge.lab.study.case import Case, MissionCase
from sim_bridge.lab.study.results.page import REPLAYS, worst

Row = dict[str, Any]


def fly_worst(cases: Mapping[str, Case], rows: Sequence[Row], folder: Path, most: int) -> Iterator[tuple[Case, str]]:
    """Fly up to `most` of the worst into `folder`/replays, those that are not there yet; each, and what is to be said.

    Only agents have companions, radio and a record: flights of other backends are left out.
    """
    whole = [row for row, _ in worst(rows) if isinstance(BACKENDS[cases[row["key"]].backend], AgentsBackend)]
    for row in whole[:most]:
        case, run = cases[row["key"]], folder / REPLAYS / row["key"]
        backend = BACKENDS[case.backend]
        assert isinstance(backend, AgentsBackend)
        assert isinstance(case, MissionCase)
        if (run / PAGE_NAME).exists():
            continue
        if run.exists():  # an interrupted one
            shutil.rmtree(run)
        run.mkdir(parents=True)
        outcome = backend.fly_into(case, run)
        same = outcome.summary["trace_hash"] == row.get("trace_hash", outcome.summary["trace_hash"])
        _write(case, run, outcome)
        yield case, "" if same else "flown again, it was another flight: another version, or another machine"


def _write(case: MissionCase, run: Path, outcome: Outcome) -> None:
    title = f"{case.run}, n = {case.mission.swarm.size}, seed {case.mission.sim.seed}"
    verdict = Verdict(outcome.summary["verdict"], outcome.succeeded, outcome.ended)
    recording, faults = run_folder.load(run), run_folder.load_faults(run)
    write_flight(
        recording,
        case.mission,
        run,
        title=title,
        metrics=outcome.metrics,
        verdict=verdict,
        figures=outcome.summary,
        faults=faults,
    )
