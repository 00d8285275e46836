"""`sim-bridge fly --zenoh`: options that fit neither each other nor the mission, and a library that is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mission.document.load import dump_mission
from sim_bridge import cli
from tests.flights import short_mission


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    file = tmp_path / "mission.toml"
    file.write_text(dump_mission(short_mission(swarm={"size": 2})), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--zenoh-scans", "1"], "--zenoh-scans and --ros-domain want --zenoh"),
        (["--ros-domain", "3"], "--zenoh-scans and --ros-domain want --zenoh"),
        (["--zenoh", "--zenoh-scans", "1,9"], "--zenoh-scans 9: the mission has vehicles 1 to 2"),
        (["--zenoh", "--zenoh-scans", "1"], "--zenoh-scans: the mission must have [sensing]"),
        (
            ["--zenoh", "--autopilots", "udpin://127.0.0.1:14540"],
            "--zenoh: flies in the bridge alone, not over --autopilots",
        ),
    ],
)
def test_what_cannot_be_is_refused_before_there_is_a_folder(
    options: list[str], message: str, mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["fly", str(mission), "--out", str(mission.parent / "run"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (mission.parent / "run").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--zenoh-scans", "0"], "0: must be ids of vehicles, as 1,2,3"),
        (["--zenoh-scans", "1,,2"], "1,,2: must be ids of vehicles"),
        (["--ros-domain", "233"], "233: must be 0..232"),
    ],
)
def test_values_that_make_no_sense_are_refused(
    options: list[str], message: str, mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["fly", str(mission), "--zenoh", *options])
    assert message in capsys.readouterr().err


def test_a_domain_of_the_environment_that_makes_no_sense_is_refused(
    mission: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    assert cli.main(["fly", str(mission), "--out", str(mission.parent / "run"), "--zenoh"]) == 2
    assert "ROS_DOMAIN_ID = many: must be 0..232" in capsys.readouterr().err
    assert not (mission.parent / "run").exists()


def test_without_the_extra_it_says_what_to_install(
    mission: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ros2_topics", "zenoh_session"):
        monkeypatch.delitem(sys.modules, f"sim_bridge.drive.live.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "zenoh", None)
    assert cli.main(["fly", str(mission), "--out", str(mission.parent / "run"), "--zenoh"]) == 3
    assert "is not installed: in the checkout, pip install -e '.[sim,zenoh]'" in capsys.readouterr().err
    assert not (mission.parent / "run").exists()
