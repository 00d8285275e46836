"""A foreign law through election, autopilots, bridge and judge: the example that comes with the documentation."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from sim_bridge.cli import main
from sim_bridge.drive.entrant.law import find_law
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.judge import run_folder
from sim_bridge.lab.judged import judged
from sim_bridge.lab.study import engine
from sim_bridge.lab.study.load import load_study
from tests.flights import flown, short_mission
from tests.study.study_kit import here, study_file

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "velocity_obstacles.py"
HOW_TO = ROOT / "docs" / "how-to" / "fly-your-own-law.md"
AGENTS = """\
schema = 1
missions = ["mission.toml"]
[[run]]
name = "theirs"
backend = "agents"
set = { swarm.size = 2 }
law = "mine.py"
"""


def test_the_example_is_short() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) < 100


def test_the_example_flies_a_mission_and_the_same_again(tmp_path: Path) -> None:
    entrant = Entrant(find_law(str(EXAMPLE)))
    mission = short_mission(swarm={"size": 4})
    outcome, _ = flown(mission, tmp_path / "first", entrant=entrant)
    assert outcome.succeeded, outcome.summary["verdict"]
    assert outcome.summary["verdict"] == f"ARRIVED ({entrant.note()})"
    again, _ = flown(mission, tmp_path / "again", entrant=Entrant(find_law(str(EXAMPLE))))
    assert again.summary["trace_hash"] == outcome.summary["trace_hash"]
    ours, _ = flown(mission, tmp_path / "ours")
    assert ours.summary["trace_hash"] != outcome.summary["trace_hash"]
    kept = json.loads((tmp_path / "first" / run_folder.METRICS_NAME).read_text(encoding="utf-8"))
    assert (kept["law"], kept["law_sha256"]) == ("velocity_obstacles", find_law(str(EXAMPLE)).sha256)
    assert not {"law", "law_sha256", "safety_filter"} & ours.summary.keys()


@pytest.mark.parametrize(
    ("cover", "verdict"),
    [
        (None, "ARRIVED (law my_law"),
        ("    return (0.0, 0.0, 0.0)\n", "INCOMPLETE: coverage not formed: "),
        ("", "ARRIVED (law my_law"),
    ],
)
def test_the_law_of_the_how_to_forms_the_ring_and_one_that_stays_does_not(
    tmp_path: Path, cover: str | None, verdict: str
) -> None:
    """`cover`: what it does instead; empty: there is none."""
    (law,) = re.findall(r"^```python\n(.*?^def start.*?)^```$", HOW_TO.read_text(encoding="utf-8"), re.M | re.S)[:1]
    if cover is not None:
        law, head, _ = re.split(r"(^def cover.*\n)", law, flags=re.M)
        law += cover and head + cover
    (tmp_path / "my_law.py").write_text(law, encoding="utf-8")
    mission = short_mission(swarm={"size": 4})
    outcome, _ = flown(mission, tmp_path / "run", entrant=Entrant(find_law("my_law.py", tmp_path)))
    assert outcome.summary["verdict"].startswith(verdict)
    if cover is None:
        assert f"(law my_law, sha256 {outcome.summary['law_sha256'][:12]})" in HOW_TO.read_text(encoding="utf-8")


def test_a_report_made_anew_still_says_whose_law_it_was(tmp_path: Path) -> None:
    mission = short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)}, coverage={"duration_s": 1.0})
    outcome, _ = flown(mission, tmp_path / "run", entrant=Entrant(safety_filter=False))
    assert outcome.summary["verdict"].endswith("(WITHOUT SAFETY FILTER)")
    assert judged(tmp_path / "run").verdict.text == outcome.summary["verdict"]


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["--law", "nowhere.py"], 2, "law nowhere.py: cannot be read: No such file or directory"),
        (["--law", str(EXAMPLE), "--agents", "processes"], 2, "--agents must be in-process"),
        (
            ["--signed", "--insider", "2@transit:push", "--agents", "processes"],
            2,
            "--signed, with an insider: what lies for a process has not its keys: --agents must be in-process",
        ),
        (
            ["--no-safety-filter", "--autopilots", "udpin://127.0.0.1:14550"],
            2,
            "--no-safety-filter: flies in the bridge",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused(
    args: list[str], code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", str(ROOT / "mission" / "examples" / "lone_tree.toml"), *args]) == code
    assert message in capsys.readouterr().err


def rows(folder: Path) -> list[dict[str, Any]]:
    study = load_study(study_file(folder, AGENTS))
    with engine.Rows(folder / "rows.jsonl") as kept:
        engine.run(study.cases, kept, here)
        return [kept.rows[case.key] for case in study.cases]


def test_a_study_ranks_a_law_and_knows_it_by_its_file(tmp_path: Path) -> None:
    law = tmp_path / "mine.py"
    law.write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    (row,) = rows(tmp_path)
    assert (row["status"], row["law"], row["safety_filter"]) == ("flown", "mine", True)
    assert row["law_sha256"] == find_law(str(EXAMPLE)).sha256
    before = load_study(study_file(tmp_path, AGENTS)).cases
    law.write_text(law.read_text(encoding="utf-8") + "\n# changed\n", encoding="utf-8")
    after = load_study(study_file(tmp_path, AGENTS)).cases
    unfiltered = load_study(study_file(tmp_path, AGENTS + "safety_filter = false\n")).cases
    assert len({case.key for case in (*before, *after, *unfiltered)}) == 3
