"""A study's page: its answer first, how its figures spread, and its worst flights, to be replayed."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from sim_bridge import cli
from sim_bridge.judge.page.about import STUDY
from sim_bridge.judge.page.coding import unpack
from sim_bridge.lab.study.backends import AgentsBackend
from sim_bridge.lab.study.results.page import answer, document, worst
from sim_bridge.lab.study.results.summary import summarise
from tests.study.study_kit import STUDY as STUDY_FILE
from tests.study.study_kit import study_file

AGENTS = STUDY_FILE.replace("swarm.size = [2, 3]", "swarm.size = [2]") + 'backend = "agents"\n'


def row(seed: int, run: str = "ours", **values: Any) -> dict[str, Any]:
    return {
        "key": f"{run}-{seed}",
        "run": run,
        "law": run,
        "backend": "agents",
        "n": 8,
        "seed": seed,
        "settings": {"swarm.size": 8},
        "status": "flown",
        "error": "",
        "arrived": True,
        "contacts": 0,
        "min_separation_m": 5.0 + seed / 10,
        "overhead_last": 0.1 * seed,
        **values,
    }


def missed(reached: bool) -> dict[str, Any]:
    limit = {"run": "ours", "case": "", "figure": "min_separation_m", "statistic": "worst", "must": 5.0, "seen": 4.2}
    return {**limit, "reached": reached}


FLOWN = "1 of 1 flights arrived, with no contacts, never nearer than 5.10 m."


def test_the_answer_counts_arrivals_and_contacts() -> None:
    rows = [row(1), row(2, contacts=1, min_separation_m=0.5), row(3, arrived=False)]
    assert answer(rows, summarise(rows), []) == (
        "UNSAFE: 2 of 3 flights arrived (1 UNSAFE, 1 INCOMPLETE), with 1 contact, never nearer than 0.50 m."
    )


def test_the_verdict_is_the_first_word_whatever_arrived() -> None:
    rows = [row(1, grade="ARRIVED"), row(2, grade="UNSAFE"), row(3, grade="DEGRADED")]
    told = answer(rows, summarise(rows), [])
    assert told.startswith("UNSAFE: 3 of 3 flights arrived (1 UNSAFE, 1 DEGRADED), with no contacts")
    assert answer(rows[:1], summarise(rows[:1]), []).startswith("ARRIVED: 1 of 1 flights arrived, with no")
    told = answer(rows, summarise(rows), [missed(True)])
    assert told.startswith("PASSED: the limit reached. 3 of 3 flights arrived (1 UNSAFE, 1 DEGRADED)")


def test_every_limit_that_is_missed_is_named_with_its_unit_up_to_six() -> None:
    share = {**missed(False), "case": "size=4", "figure": "overhead_last", "must": 0.05, "seen": 0.123}
    wide = [{**missed(False), "case": f"size={n}", "seen": seen} for n, seen in ((4, 4.2), (8, 3.1), (12, 4.0))]
    others = [{**missed(False), "run": f"run {k}"} for k in range(6)]
    told = answer([row(1)], summarise([row(1)]), [missed(True), share, *wide, *others])
    assert told.startswith(
        "FAILED: 10 of 11 limits missed: ours size=4: overhead of the last, %: worst 12.3, must be at most 5; "
        "ours size=8: least separation, m: worst 3.1, must be at least 5 (3 cases); run 0: least"
    )
    assert "; and 2 more. 1 of 1 flights arrived" in told
    none = {**missed(False), "seen": None}
    assert "worst not of every flight, must be at least 5" in answer([row(1)], summarise([row(1)]), [none])


def test_the_answer_tells_runs_apart_and_flights_that_never_ended_count_as_not_arrived() -> None:
    failed = {**row(2, "other"), "status": "failed", "error": "died"}
    rows = [row(1), row(1, "other"), failed]
    assert answer(rows, summarise(rows), []) == (
        "FAILED: ours: 1 of 1 flights arrived, with no contacts, never nearer than 5.10 m; "
        "other: 1 of 2 flights arrived, with no contacts, never nearer than 5.10 m."
    )


@pytest.mark.parametrize(
    ("verdicts", "begins"),
    [
        ([missed(True)], "PASSED: the limit reached. "),
        ([missed(True)] * 3, "PASSED: all 3 limits reached. "),
        (
            [missed(True), missed(False)],
            "FAILED: 1 of 2 limits missed: ours: least separation, m: worst 4.2, must be at least 5. ",
        ),
    ],
    ids=["reached", "all reached", "missed"],
)
def test_limits_come_first_in_the_answer(verdicts: list[dict[str, Any]], begins: str) -> None:
    rows = [row(1)]
    assert answer(rows, summarise(rows), verdicts) == f"{begins}{FLOWN}"


def test_the_worst_flights_are_those_that_failed_and_the_worst_of_each_figure() -> None:
    rows = [row(1), row(2), row(3), row(4, arrived=False, contacts=2), row(5, contacts=2)]
    found = {one["seed"]: why for one, why in worst(rows)}
    assert found == {
        4: "not arrived; worst of contacts: 2",
        5: "2 contacts; worst of overhead of the last, %: 50",
        1: "worst of least separation, m: 5.1",
    }
    assert worst([row(1), row(1)]) == []


def test_every_key_of_a_study_is_documented(tmp_path: Path) -> None:
    found = document(tmp_path, [row(1), row(2)], [missed(True)], "a study")
    assert found["must"][0]["figure"] == "least separation, m"
    inner = found["figures"][0]
    keys = {key for key in found if key not in ("figures", "worst")} | {"figures[].name"}
    keys |= {f"figures[].cases[].{key}" for key in inner["cases"][0]} | {f"worst[].{key}" for key in found["worst"][0]}
    assert keys == set(STUDY)


def test_every_seed_is_in_the_distribution_of_its_case(tmp_path: Path) -> None:
    rows = [row(1), row(2), row(1, "other", overhead_last=None)]
    found = document(tmp_path, rows, [], "a study")
    assert found["title"] == "a study"
    drawn = {figure["name"]: figure["cases"] for figure in found["figures"]}
    assert [case["seeds"] for case in drawn["least separation, m"]] == [[[1, 5.1], [2, 5.2]], [[1, 5.1]]]
    overhead = drawn["overhead of the last, %"]
    assert [(case["name"], case["seeds"], case["mean"]) for case in overhead] == [
        ("ours", [[1, 10.0], [2, 20.0]], 15.0)
    ]
    assert found["worst"][0]["replay"] is None


def test_worst_flights_are_flown_again_the_same_to_the_bit_and_linked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = study_file(tmp_path, AGENTS), tmp_path / "out"
    command = ["study", str(file), "--out", str(out), "--workers", "1", "--replay", "1"]
    assert cli.main(command) == 0
    said = capsys.readouterr()
    assert f"report: {out / 'report.html'}" in said.out
    assert re.search(r"replayed: ours, seed \d\n", said.err)  # and not that it was another flight
    assert cli.main(["report", str(out)]) == 0
    assert capsys.readouterr().out.startswith("INCOMPLETE: 2 of 2 flights arrived (2 INCOMPLETE), with no contacts")
    held = re.search(r'id="data">([^<]*)<', (out / "report.html").read_text(encoding="utf-8"))
    assert held is not None
    found = unpack(held[1])
    links = [one["replay"] for one in found["worst"] if one["replay"]]
    assert len(links) == 1
    assert (out / links[0]).is_file()
    rows = {one["key"]: one for one in map(json.loads, (out / "rows.jsonl").read_text().splitlines())}
    run = (out / links[0]).parent
    assert json.loads((run / "metrics.json").read_text())["trace_hash"] == rows[run.name]["trace_hash"]
    monkeypatch.setattr(AgentsBackend, "fly_into", None)  # what is there is not flown again
    assert cli.main(command) == 0


def test_a_damaged_row_is_refused_by_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rows.jsonl").write_text("{}\n")
    assert cli.main(["report", str(tmp_path)]) == 2
    assert "rows.jsonl:1: not a row of a study" in capsys.readouterr().err
