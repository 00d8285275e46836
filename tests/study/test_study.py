"""The study engine: rows that survive anything."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from sim_bridge.drive.fly import Flight
from sim_bridge.drive.fly import fly as fly_once
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.study import engine
from sim_bridge.lab.study.jobs import Done, fly_batch
from sim_bridge.lab.study.results import summary
from tests.flights import point_masses, short_mission
from tests.study.study_kit import STUDY, fly_but_die_at_seed_2, fly_but_fail_at_seed_2, here, study


def test_same_study_twice_gives_the_same_rows_to_the_bit(tmp_path: Path) -> None:
    flown = study(tmp_path, STUDY + '[[run]]\nname = "paper"\nlaw = "algorithm1"\n')
    lines = []
    for name in ("first", "again"):
        with engine.Rows(tmp_path / name) as rows:
            engine.run(flown.cases, rows, here)
        lines.append(sorted((tmp_path / name).read_bytes().splitlines()))
    assert lines[0] == lines[1]
    assert len(lines[0]) == len(flown.cases) == 8


def test_a_full_stack_flight_is_a_row_and_the_same_twice(tmp_path: Path) -> None:
    flown = study(tmp_path, STUDY.replace("seeds = 2", "seeds = 1").replace("[2, 3]", "[2]") + 'backend = "agents"\n')
    found = [fly_batch(flown.cases).figures[0] for _ in range(2)]
    assert found[0] == found[1]
    assert found[0]["arrived"]
    assert found[0]["ended"] == "coverage complete"
    assert "wall_time_s" not in found[0]
    assert found[0]["coverage_gap_deg"] is not None


def test_a_flight_that_only_its_outcome_is_wanted_of_is_the_same_and_writes_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def soon(flight: Flight) -> None:
        if flight.world.now_s > 8.0:
            raise KeyboardInterrupt

    (tmp_path / "here").mkdir()
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "here"))
    summaries = []
    for folder in (tmp_path / "run", None):
        with Progress(io.StringIO()) as progress:
            outcome = fly_once(short_mission(), folder, progress, in_process=True, airframes=point_masses, watch=soon)
        summaries.append({k: v for k, v in outcome.summary.items() if k not in ("wall_time_s", "real_time_factor")})
    assert summaries[0] == summaries[1]
    assert summaries[0]["sim_time_s"] > 8.0
    assert {"metrics.json", "mission.toml", "vehicle-1.tlog"} <= {file.name for file in (tmp_path / "run").iterdir()}
    assert list((tmp_path / "here").iterdir()) == []
    with Progress(io.StringIO()) as progress, pytest.raises(ValueError, match="folder = None"):
        fly_once(short_mission(), None, progress)


def test_an_interrupted_study_goes_on_where_it_was(tmp_path: Path) -> None:
    flown = study(tmp_path)
    whole, path = tmp_path / "whole", tmp_path / "rows"
    with engine.Rows(whole) as rows:
        engine.run(flown.cases, rows, here)

    def interrupted(todo: Sequence[engine.Batch]) -> Iterator[tuple[engine.Batch, engine.Result]]:
        yield next(iter(here(todo)))
        raise KeyboardInterrupt

    with engine.Rows(path) as rows, pytest.raises(KeyboardInterrupt):
        engine.run(flown.cases, rows, interrupted)
    assert 0 < len(path.read_bytes().splitlines()) < len(flown.cases)
    with path.open("ab") as file:
        file.write(whole.read_bytes()[:40])  # as a power cut leaves it

    again: list[str] = []

    def noted(todo: Sequence[engine.Batch]) -> Iterator[tuple[engine.Batch, engine.Result]]:
        again.extend(case.key for batch in todo for case in batch)
        return here(todo)

    before = [json.loads(line)["key"] for line in path.read_bytes().splitlines()[:-1]]
    with engine.Rows(path) as rows:
        engine.run(flown.cases, rows, noted)
    assert sorted(before + again) == sorted(case.key for case in flown.cases)
    assert sorted(path.read_bytes().splitlines()) == sorted(whole.read_bytes().splitlines())


def test_a_flight_does_not_change_with_what_else_is_left_to_fly(tmp_path: Path) -> None:
    flown = study(tmp_path, STUDY.replace("seeds = 2", "seeds = 5"))
    three = [case for case in flown.cases if case.mission.swarm.size == 3]
    together = fly_batch(tuple(three)).figures
    assert list(together) == [fly_batch((case,)).figures[0] for case in three]


@pytest.mark.parametrize("retry", [False, True])
@pytest.mark.parametrize("bad", ["nonsense", "[]", '{"key": "a"}', "without status", "without arrived", "listed key"])
def test_a_line_that_is_no_row_is_named(bad: str, retry: bool, tmp_path: Path) -> None:
    row = engine.flown_row(study(tmp_path).cases[0], {"arrived": True})
    changed = {
        "without status": {key: value for key, value in row.items() if key != "status"},
        "without arrived": {key: value for key, value in row.items() if key != "arrived"},
        "listed key": row | {"key": []},
    }
    line = json.dumps(changed[bad]) if bad in changed else bad
    (tmp_path / "rows").write_text(f"{json.dumps(row)}\n{line}\n", encoding="utf-8")
    with pytest.raises(engine.RowsError, match=r"rows:2: not a row of a study"):
        engine.Rows(tmp_path / "rows", retry=retry)


def test_a_flight_that_fails_is_a_row_and_is_flown_again_on_request_only(tmp_path: Path) -> None:
    flown = study(tmp_path)
    calls: list[int] = []

    def job(todo: Sequence[engine.Batch]) -> Iterator[tuple[engine.Batch, engine.Result]]:
        calls.append(sum(map(len, todo)))
        for alone in [(case,) for batch in todo for case in batch]:
            future: Future[Done] = executor.submit(fly_but_fail_at_seed_2, alone)
            yield alone, future.exception() or future.result()

    with ThreadPoolExecutor(1) as executor:
        for retry in (False, False, True):
            with engine.Rows(tmp_path / "rows", retry=retry) as rows:
                engine.run(flown.cases, rows, job)
    assert calls == [4, 0, 2]
    failed = [row for row in rows.rows.values() if row["status"] == "failed"]
    assert [(row["seed"], row["error"]) for row in failed] == [(2, "ValueError: no such flight")] * 2
    groups = summary.summarise(rows.rows.values())
    assert [(group.flights, group.failed, group.arrived) for group in groups] == [(2, 1, 1)] * 2


def test_a_worker_that_dies_costs_its_own_flights_only(tmp_path: Path) -> None:
    flown = study(tmp_path, STUDY.replace("seeds = 2", "seeds = 3").replace("[2, 3]", "[2]"))
    with engine.Pool(1) as pool, engine.Rows(tmp_path / "rows") as rows:
        engine.run(flown.cases, rows, lambda todo: pool.fly(todo, job=fly_but_die_at_seed_2))
    died = {row["seed"]: row["error"] for row in rows.rows.values() if row["status"] == "failed"}
    assert died == {2: "the worker process died"}
    assert sum(row["status"] == "flown" for row in rows.rows.values()) == 2


def test_a_scheduler_that_goes_away_is_the_environments_fault(tmp_path: Path) -> None:
    class Gone(Executor):
        def submit(self, *_args: object, **_kwargs: object) -> Future[Done]:  # type: ignore[override]
            future: Future[Done] = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    flown = study(tmp_path)
    with engine.Rows(tmp_path / "rows") as rows, pytest.raises(ConnectionError, match="scheduler"):
        engine.run(flown.cases, rows, engine.fly_on_cluster(Gone(), 2))
