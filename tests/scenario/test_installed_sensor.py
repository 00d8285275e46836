"""A sensor in a package of its own, as the how-to has it: built, installed, named by a mission, flown and studied."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.installed_kit import pip_install

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "docs" / "examples" / "rangefinder"
HOW_TO = ROOT / "docs" / "how-to" / "add-a-sensor.md"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
STUDY = """\
schema = 1
missions = ["mission.toml"]
[[run]]
name = "ahead"
backend = "agents"
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, installed as it stands, without a network."""
    return pip_install(PACKAGE, tmp_path_factory.mktemp("sensor"))


def run_program(module: str, path: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", module, *arguments]
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def paths(site: Path) -> str:
    return os.pathsep.join((str(site), str(ROOT)))


def how_to_mission() -> str:
    """The mission that the how-to shows."""
    (text,) = [
        text
        for kind, text in BLOCK.findall(HOW_TO.read_text(encoding="utf-8"))
        if kind == "toml" and text.startswith("schema = 1\n")
    ]
    return text


def test_the_example_package_stands_in_the_how_to() -> None:
    blocks = {text for _, text in BLOCK.findall(HOW_TO.read_text(encoding="utf-8"))}
    for name in ("pyproject.toml", "rangefinder.py", "rangefinder_model.py"):
        assert (PACKAGE / name).read_text(encoding="utf-8") in blocks


@pytest.mark.parametrize("agents", ["processes", "in-process"])
def test_a_mission_that_names_it_is_flown_by_it(site: Path, tmp_path: Path, agents: str) -> None:
    (tmp_path / "mission.toml").write_text(how_to_mission(), encoding="utf-8")
    flown = ("fly", "mission.toml", "--agents", agents, "--black-box", "--out", "run")
    done = run_program("sim_bridge.cli", paths(site), tmp_path, *flown)
    assert done.returncode == 0, done.stderr
    if agents == "processes":
        for vehicle in (1, 2):
            log = (tmp_path / "run" / "companions" / f"companion-{vehicle}.log").read_text(encoding="utf-8")
            assert "rangefinder 180 (component): heard" in log
    (box, *_) = sorted((tmp_path / "run" / "black-box").rglob("*.mcap"))
    replayed = run_program("companion", paths(site), tmp_path, "replay", str(box))
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    without = run_program("companion", str(ROOT), tmp_path, "replay", str(box))
    assert "rangefinder: no installed package has an entry point understory.sensors" in without.stdout + without.stderr


def test_a_study_flies_it_and_without_the_package_nothing_begins(site: Path, tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(how_to_mission(), encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    done = run_program("sim_bridge.cli", paths(site), tmp_path, "study", "study.toml", "--workers", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    (row,) = [json.loads(line) for line in (tmp_path / "out" / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    assert (row["status"], row["arrived"]) == ("flown", True)
    without = run_program("sim_bridge.cli", str(ROOT), tmp_path, "fly", "mission.toml", "--out", "run")
    assert without.returncode == 2
    assert "rangefinder: no installed package" in without.stderr


def test_mission_check_says_what_is_not_installed_here(site: Path, tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(how_to_mission(), encoding="utf-8")
    there = run_program("mission.cli.main", paths(site), tmp_path, "check", "mission.toml")
    absent = run_program("mission.cli.main", str(ROOT), tmp_path, "check", "mission.toml")
    note = "sensors: rangefinder is in no package that is installed here"
    assert (there.returncode, absent.returncode) == (0, 0)
    assert note not in there.stdout
    assert note in absent.stdout
