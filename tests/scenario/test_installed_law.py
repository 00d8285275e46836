"""A law in a package of its own, as the how-to has it: built, installed, found by its name, flown, ranked, searched."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from sim_bridge import cli
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.lab.search import program
from sim_bridge.lab.search.draw import Drawn
from sim_bridge.lab.study.case import Backend
from tests.flights import short_mission
from tests.installed_kit import pip_install

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "docs" / "examples" / "queue_law"
HOW_TO = ROOT / "docs" / "how-to" / "fly-your-own-law.md"
MAIN = "from sim_bridge.cli import main; raise SystemExit(main())"
MISSION = """\
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [25.0, 0.0, 8.0]
vel_leader_mps = 3.0
[swarm]
size = 2
[coverage]
duration_s = 25.0
"""
STUDY = """\
schema = 1
missions = ["mission.toml"]
[[run]]
name = "ours"
backend = "agents"
[[run]]
name = "mine"
backend = "agents"
law = "queue"
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, installed as it stands, without a network."""
    return pip_install(PACKAGE, tmp_path_factory.mktemp("law"))


def run_program(site: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(site), str(ROOT)))}
    command = [sys.executable, "-c", MAIN, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_example_package_is_at_most_30_lines_and_stands_in_the_how_to() -> None:
    files = [file for file in sorted(PACKAGE.iterdir()) if file.suffix in (".py", ".toml")]
    assert [file.name for file in files] == ["pyproject.toml", "queue_law.py"]
    assert sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files) <= 30
    blocks = re.findall(r"^```\w+\n(.*?)^```$", HOW_TO.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for file in files:
        assert file.read_text(encoding="utf-8") in blocks


def test_an_installed_law_is_flown_by_its_name(site: Path, tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(MISSION, encoding="utf-8")
    done = run_program(site, tmp_path, "fly", "mission.toml", "--law", "queue", "--out", "run")
    assert done.returncode == 0, done.stderr
    assert re.search(r"^ARRIVED \(law queue, sha256 \w{12}\)", done.stdout, re.MULTILINE)
    kept = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert kept["law"] == "queue"


def test_a_study_ranks_an_installed_law_beside_ours(site: Path, tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(MISSION, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    done = run_program(site, tmp_path, "study", "study.toml", "--workers", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in (tmp_path / "out" / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    assert {(row["run"], row["law"], row["status"], row["arrived"]) for row in rows} == {
        ("ours", "ours", "flown", True),
        ("mine", "queue", "flown", True),
    }
    without = run_program(tmp_path, tmp_path, "study", "study.toml", "--workers", "1", "--out", "again")
    assert without.returncode == 2
    assert 'law = "queue": must be "ours" where backend = "agents"' in without.stderr


def test_a_search_flies_an_installed_law(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def tiny(seed: int, _attacked_share: float) -> Drawn:
        late = 20.0 if seed == 8 else 200.0  # no time to arrive
        sim = {"seed": seed, "time_limit_s": late}
        return Drawn(short_mission(swarm={"size": 2}, route={"d2_enu_m": (20.0, 0.0, 4.0)}, sim=sim), 0)

    monkeypatch.setattr(program, "draw", tiny)
    monkeypatch.syspath_prepend(str(site))
    command = ["search", "--backend", "point-mass", "--seed", "7", "--flights", "2", "--workers", "1", "--out"]
    assert cli.main([*command, str(tmp_path / "out"), "--law", "queue"]) == 1
    lines = (tmp_path / "out" / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    rows = {row["seed"]: row for row in map(json.loads, lines)}
    assert {row["law"] for row in rows.values()} == {"queue"}
    assert rows[7]["verdict"].startswith("ARRIVED (law queue, sha256 ")
    assert rows[8]["verdict"].startswith("INCOMPLETE: ")
    flies_it_again = "sim-bridge search --backend point-mass --law queue --seed 8 --flights 1"
    assert flies_it_again in capsys.readouterr().err
    ours = program._case(7, Backend.AGENTS, BY_OURS, 0.0).key
    assert rows[7]["key"] != ours == program._case(7, Backend.AGENTS, Entrant(), 0.0).key
    unknown = tmp_path / "other"
    assert cli.main([*command, str(unknown), "--law", "nosuch"]) == 2
    named = "law nosuch: no such module: must be a .py file, the name of an installed law (queue)"
    assert named in capsys.readouterr().err
    assert not unknown.exists()
