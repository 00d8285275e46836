"""The study engine: what a file crosses to, rows that survive anything, and what they say together."""

from __future__ import annotations

import io
import json
import math
import re
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from flights import point_masses, short_mission
from rich.console import Console
from study_kit import MISSION, STUDY, fly_but_die_at_seed_2, fly_but_fail_at_seed_2, study, study_file

from mission.problems import MissionError
from sim_bridge import cli
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.fly import fly as fly_once
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.study import engine, program, spec, summary
from sim_bridge.lab.study.jobs import Done, fly_batch
from sim_bridge.lab.study.program import ROWS, fly
from sim_bridge.lab.study.spec import batches


def here(todo: Sequence[engine.Batch]) -> Iterator[tuple[engine.Batch, engine.Result]]:
    """Without processes."""
    return ((batch, fly_batch(batch)) for batch in todo)


def quiet() -> Console:
    return Console(file=io.StringIO())


# --- the file ---


def test_parameters_laws_and_seeds_are_crossed(tmp_path: Path) -> None:
    text = (
        STUDY + 'cross = { radio.transit_range_m = [25, 30] }\n[[run]]\nname = "paper"\nlaw = "algorithm1"\nseeds = 1\n'
    )
    text += "cross_params = { separation_m = [0.5, 1.0, 2.0] }\nset = { limits.speed_max_mps = 4.0 }\n"
    cases = study(tmp_path, text).cases
    seen = {(c.run, c.mission.swarm.size, c.mission.radio.transit_range_m, c.mission.sim.seed) for c in cases}
    assert {s for s in seen if s[0] == "ours"} == {("ours", n, r, s) for n in (2, 3) for r in (25, 30) for s in (1, 2)}
    papers = [c for c in cases if c.run == "paper"]
    assert [(c.settings["swarm.size"], c.settings["params.separation_m"]) for c in papers] == [
        (n, s) for n in (2, 3) for s in (0.5, 1.0, 2.0)
    ]
    assert {c.mission.limits.speed_max_mps for c in papers} == {4.0}
    assert len({c.key for c in cases}) == len(cases) == 8 + 6


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[2, 3]", "[2, 0]"), r"study.toml:5: swarm.size = 0: must be an integer from 1 to 250"),
        (("[2, 3]", "4"), r"study.toml:5: cross.swarm.size = 4: must be an array of at least one value"),
        (("swarm.size", "swarm.sise"), r"study.toml:5: swarm.sise = 2: unknown key; did you mean size\?"),
        (('"ours"\n', '"ours"\nlaw = "boids"\n'), r'study.toml:8: run\[0\].law = "boids": must be one of ours, algori'),
        (
            ('"ours"\n', '"ours"\nbackend = "gazebo"\n'),
            r'study.toml:8: run\[0\].backend = "gazebo": must be one of "po',
        ),
        (
            ('"ours"\n', '"x"\nlaw = "algorithm1"\nbackend = "jsbsim"\n'),
            r'run\[0\].law = "algorithm1": must be "ours" where',
        ),
        (('"ours"\n', '"ours"\nparams = { gain = 1 }\n'), r'study.toml:8: gain = 1: law "ours" has no parameters'),
        (
            ('"ours"\n', '"ours"\nlaw = "algorithm1"\ncross_params = { dt_s = [1, -1] }\n'),
            r"study.toml:9: dt_s = -1: must be a number above 0, at most 10",
        ),
        (("seeds = 2", "seeds = 0"), r"study.toml:3: seeds = 0: must be an integer from 1 to 100000"),
        (("mission.toml", "none.toml"), r'study.toml:2: missions\[0\] = "none.toml": .*/none.toml: no such file'),
        (('missions = ["mission.toml"]\n', ""), r"run\[0\].missions: missing here and in the study"),
        (('[[run]]\nname = "ours"\n', ""), r"study.toml:1: run: missing; must be an array"),
        (
            ('"ours"\n', '"ours"\nmissions = ["mission.toml", "none.toml"]\n'),
            r'study.toml:8: run\[0\].missions\[1\] = "none.toml": .*/none.toml: no such file',
        ),
        (('"ours"\n', '"ours"\ncross = { swarm.size = [4] }\n'), r"crossed twice"),
        (
            ('"ours"\n', '"ours"\ncross = { swarm.size = [4] }\nset = { swarm.size = 8 }\n'),
            r"study.toml:8: run\[0\].cross.swarm.size = \[4\]: also in set",
        ),
        (
            ("swarm.size = [2, 3]", "sim.seed = [4, 5]"),
            r"study.toml:5: cross.sim.seed = \[4, 5\]: the seeds of a study are `seeds` and `first_seed`",
        ),
        (('"ours"\n', '"ours"\nset = { sim.seed = 5 }\n'), r"study.toml:8: run\[0\].set.sim.seed = 5: the seeds of a"),
    ],
)
def test_a_bad_study_is_refused_with_its_place(change: tuple[str, str], told: str, tmp_path: Path) -> None:
    assert change[0] in STUDY
    with pytest.raises(MissionError, match=told):
        study(tmp_path, STUDY.replace(*change))


def test_what_a_run_sets_is_not_crossed_by_the_study(tmp_path: Path) -> None:
    text = STUDY + 'set = { swarm.size = 8 }\n[[run]]\nname = "crossed"\n'
    found = {(c.run, c.mission.swarm.size, c.settings["swarm.size"]) for c in study(tmp_path, text).cases}
    assert found == {("ours", 8, 8), ("crossed", 2, 2), ("crossed", 3, 3)}


def test_too_many_flights_are_refused_before_any_is_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def built(*_: object) -> None:
        pytest.fail("a flight was built")

    monkeypatch.setattr(spec, "Case", built)
    text = STUDY.replace("seeds = 2", "seeds = 30000") + '[[run]]\nname = "more"\n'
    told = r"study.toml:8: run\[1\]: 120000 flights up to here: at most 100000 in all"
    with pytest.raises(MissionError, match=told):
        study(tmp_path, text)


def test_program_refuses_a_bad_study_with_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file(tmp_path, STUDY.replace("[2, 3]", "[2, 0]"))
    assert cli.main(["study", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "swarm.size = 0: must be an integer" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_seeds_of_the_same_point_mass_case_fly_together_and_others_alone(tmp_path: Path) -> None:
    text = STUDY + '[[run]]\nname = "real"\nbackend = "agents"\n'
    found = [{(c.run, c.mission.swarm.size) for c in batch} for batch in batches(study(tmp_path, text).cases, 2)]
    assert all(len(kinds) == 1 for kinds in found)
    assert len(found) == 2 + 4


@pytest.mark.parametrize("backend", ["point-mass", "agents", "jsbsim"])
def test_autopilots_of_a_study_are_as_wrong_as_recorded_unless_told(backend: str, tmp_path: Path) -> None:
    run = f'[[run]]\nname = "{{}}"\nbackend = "{backend}"\n'
    text = STUDY + run.format("default") + run.format("exact") + 'set = { sim.estimates = "exact" }\n'
    text += run.format("both") + 'cross = { sim.estimates = ["exact", "recorded"] }\n'
    cases = study(tmp_path, text).cases
    flown = {name: {c.mission.sim.estimates for c in cases if c.run == name} for name in ("default", "exact", "both")}
    told = {c.settings.get("sim.estimates") for c in cases if c.run == "default"}
    assert flown["exact"] == {"exact"}
    assert flown["both"] == {"exact", "recorded"}
    assert (flown["default"], told) == (
        ({"exact"}, {None}) if backend == "point-mass" else ({"recorded"}, {"recorded"})
    )


def test_a_mission_file_that_says_what_its_estimates_are_is_flown_so(tmp_path: Path) -> None:
    file = study_file(tmp_path, STUDY + 'backend = "agents"\n')
    (tmp_path / "mission.toml").write_text(MISSION + '[sim]\nestimates = "exact"\n', encoding="utf-8")
    assert {(c.mission.sim.estimates, c.settings.get("sim.estimates")) for c in spec.load_study(file).cases} == {
        ("exact", None)
    }


def test_program_says_which_runs_fly_by_wrong_estimates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = STUDY.replace("seeds = 2", "seeds = 1").replace("[2, 3]", "[1]")
    file = study_file(tmp_path, text + '[[run]]\nname = "stack"\nbackend = "agents"\n')
    assert cli.main(["study", str(file), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    told = capsys.readouterr().err.splitlines()[0]
    assert 'sim.estimates = "recorded"' in told
    assert told.endswith(": stack")


def test_studies_that_come_along_say_what_their_estimates_are() -> None:
    """Their figures stand in the documentation."""
    for file in sorted((Path(spec.__file__).parent / "examples").glob("*.toml")):
        for run in tomllib.loads(file.read_text(encoding="utf-8"))["run"]:
            if run.get("backend", "point-mass") != "point-mass":
                assert "estimates" in run.get("set", {}).get("sim", {}), f"{file.name}: {run['name']}"


# --- rows ---


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


# --- the program ---


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


# --- the summary ---


def test_interval_is_students() -> None:
    found = summary.spread([1.0, 2.0, 3.0, 4.0])
    assert found is not None
    assert (found.mean, found.worst) == (2.5, 4.0)
    assert found.sd == pytest.approx(1.2909944)
    # t(0.975, 3) = 3.182446 of any table
    assert found.high == pytest.approx(2.5 + 3.182446 * 1.2909944 / math.sqrt(4), rel=1e-6)
    assert found.low == pytest.approx(5.0 - (found.high or 0.0))
    alone = summary.spread([2.0], min)
    assert alone is not None
    assert (alone.sd, alone.low, alone.worst) == (None, None, 2.0)
    assert summary.spread([]) is None


def test_worst_is_the_least_where_less_is_worse() -> None:
    row = {"run": "a", "law": "ours", "backend": "point-mass", "n": 2, "settings": {}, "status": "flown"}
    rows = [{**row, "arrived": True, "min_separation_m": m, "overhead_last": m / 100} for m in (5.0, 7.0)]
    figures = summary.summarise(rows)[0].figures
    assert (figures["min_separation_m"].worst, figures["overhead_last"].worst) == (5.0, 0.07)


@pytest.mark.parametrize("terminal", [True, False])
def test_the_table_is_read_at_80_columns(terminal: bool) -> None:
    row = {"run": "the whole stack", "law": "ours", "backend": "point-mass", "status": "flown", "arrived": True}
    figures = dict.fromkeys(summary.SHOWN, 123.456)
    rows = [row | figures | {"n": n, "settings": {"swarm.size": n}, "contacts": k} for n in (4, 8) for k in (0, 7)]
    told = io.StringIO()
    summary.print_table(summary.summarise(rows), Console(file=told, width=80, force_terminal=terminal, no_color=True))
    text = re.sub(r"\x1b\[[0-9;]*m", "", told.getvalue())
    lines = [line.rstrip() for line in text.splitlines() if line.strip().startswith("the whole stack")]
    assert (max(map(len, text.splitlines())) <= 80) == terminal
    assert len(lines) > 2 if terminal else len(lines) == 2
    assert sum(line.count(" ± ") for line in lines) == 2 * len(summary.SHOWN)
    assert all(re.search(r"  size=[48]  +2/2  ", line) for line in lines)
    for heading in summary.SHOWN.values():
        assert text.count(heading) == 1


def test_overhead_over_one_alone_is_by_the_same_run_and_settings_but_size() -> None:
    def row(n: int, speed: float, overhead: float, run: str = "a") -> summary.Row:
        settings = {"swarm.size": n, "route.vel_leader_mps": speed}
        row = {"run": run, "law": "ours", "backend": "point-mass", "n": n, "settings": settings, "status": "flown"}
        return {**row, "arrived": True, "overhead_leader": overhead, "overhead_last": 2.0 * overhead}

    rows = [row(1, 3.0, 0.02), row(1, 3.0, 0.04), row(8, 3.0, 0.05), row(8, 0.7, 0.05), row(8, 3.0, 0.05, run="b")]
    found = [group.figures.get("over_alone_last") for group in summary.summarise(rows)]
    assert found[1] is not None
    assert found[1].mean == pytest.approx(1.1 / 1.03 - 1.0)
    assert found[2:] == [None, None]
