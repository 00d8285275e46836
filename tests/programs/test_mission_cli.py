"""The `mission` program."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

import mission
from mission import __version__
from mission.cli import check, edit
from mission.cli.main import build_parser, main
from mission.common.compiled import STATE

EXAMPLES = Path(mission.__file__).parent / "examples"
LONE_TREE = str(EXAMPLES / "lone_tree.toml")


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    file = tmp_path / "bad.toml"
    file.write_text("schema = 1\n[route]\nvel_leader_mps = 99\n")
    return file


def test_check_tells_in_a_line_what_a_good_file_flies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", LONE_TREE]) == 0
    out, err = capsys.readouterr()
    figures = "8 vehicles, 130.0 m, 43.3 s at 3.0 m/s; no [origin]: for the simulator alone"
    assert out == (
        f"{LONE_TREE}: ok: lone tree, {figures}\n"
        "  at least 1.8 min in the air: 332 mAh, 7 % of the smallest simulated battery\n"
    )
    assert err == ""


def test_check_tells_of_a_forest_that_vehicles_do_not_see(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES / "managed_stand.toml").read_text()
    blind = tmp_path / "blind.toml"
    blind.write_text(re.sub(r"\[sensing\].*\n(.+\n)*", "", text))
    assert main(["check", str(blind), str(EXAMPLES / "managed_stand.toml")]) == 0
    first, second = [line for line in capsys.readouterr().out.splitlines() if ": ok: " in line]
    assert first.endswith("; no [sensing]: vehicles do not see the forest")
    assert "[sensing]" not in second


@pytest.mark.parametrize(
    ("crown_base_share", "altitude_max_m", "size", "told"),
    [
        ("", 5.2, 7, "2 layers of height: the mission's, 4.4 m, and 2.4 m; parts without the majority may share one"),
        (
            "crown_base_share = 0.8\n",
            8.0,
            8,
            "3 layers of height: the mission's, 4.4 m, and 2.4 and 6.4 m; parts without the majority may share one, "
            "and of two halves neither has it",
        ),
        (
            "",
            5.2,
            2,
            "2 layers of height: the mission's, 4.4 m, and 2.4 m; two that part have no majority, and share the other: "
            "nothing keeps them apart by height",
        ),
    ],
)
def test_check_names_the_layers_of_height(
    crown_base_share: str,
    altitude_max_m: float,
    size: int,
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = (EXAMPLES / "natural_stand.toml").read_text().replace("size = 8", f"size = {size}")
    layered = tmp_path / "layered.toml"
    text = text.replace("altitude_min_m = 2.0", "altitude_min_m = 1.6")
    higher = text.replace("altitude_max_m = 5.2", f"altitude_max_m = {altitude_max_m}")
    layered.write_text(higher.replace("[forest.stand]\n", f"[forest.stand]\n{crown_base_share}"))
    assert main(["check", str(layered)]) == 0
    assert told in [line.strip() for line in capsys.readouterr().out.splitlines()]
    layered.write_text(text.replace("altitude_min_m = 1.6", "altitude_min_m = 3.5"))
    assert main(["check", str(layered)]) == 0
    assert (
        "1 layer of height, as another would be 2 m below or above the mission's, 4.4 m, and there is room from 3.9 m "
        "(0.4 m above fence.altitude_min_m) to 4.8 m (0.4 m below fence.altitude_max_m): parts that do not hear each "
        "other may meet"
    ) in capsys.readouterr().out
    layered.write_text(text.replace("height_layers = true", "height_layers = false"))
    assert main(["check", str(layered)]) == 0
    assert "one height for all: parts that do not hear each other may meet" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("sim", "told"),
    [
        ("", False),
        ('estimates = "recorded"', True),
        ('estimates = "2026-11"\npersonality = "ardupilot"', True),
        ('estimates = "recorded"\nrange_finder = true', False),
    ],
)
def test_check_says_that_a_barometer_holds_no_layer(
    sim: str, told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    layered = tmp_path / "layered.toml"
    layered.write_text(f"{Path(LONE_TREE).read_text()}\n[separation]\nheight_layers = true\n[sim]\n{sim}\n")
    assert main(["check", str(layered)]) == 0
    assert ("heights by a barometer, wrong by up to 1.2 m rms: those of two" in capsys.readouterr().out) is told


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"size = 8": "size = 1"}, "1 layer of height: a swarm of one does not part"),
        ({"d2_enu_m = [130.0, 0.0, 8.0]": "d2_enu_m = [130.0, 0.0, 9.0]"}, "a level route and ring, and d2 is 9 m up"),
        (
            {"[[forest.trees]]": "[forest]\ngrade = [0.04, 0.0]\n[[forest.trees]]", "max_m = 30.0": "max_m = 10.0"},
            "from 6.8 m (1 m above the ground, 5.8 m up within 15 m of the way) to 9.6 m",
        ),
    ],
)
def test_check_says_why_there_is_one_layer_of_height(
    changes: dict[str, str], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(LONE_TREE).read_text() + "\n[separation]\nheight_layers = true\n"
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    layered = tmp_path / "layered.toml"
    layered.write_text(text)
    assert main(["check", str(layered)]) == 0
    assert why in capsys.readouterr().out


def test_check_lists_every_problem_of_a_bad_file_on_stderr_and_goes_on(
    bad: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(bad), LONE_TREE]) == 2
    out, err = capsys.readouterr()
    assert "ok: lone tree" in out
    assert err.splitlines() == [
        f"{bad}:2: route.d1_enu_m: missing; must be an array of 3, each a number from -20000 to 20000",
        f"{bad}:2: route.d2_enu_m: missing; must be an array of 3, each a number from -20000 to 20000",
        f"{bad}:3: route.vel_leader_mps = 99: must be a number from 0.05 to 30",
    ]


def test_check_json_is_one_object_for_each_file(bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--json", LONE_TREE, str(bad)]) == 2
    out, err = capsys.readouterr()
    good, refused = json.loads(out)
    assert err == ""
    assert (good["ok"], good["name"], good["vehicles"], good["distance_m"]) == (True, "lone tree", 8, 130.0)
    assert refused["ok"] is False
    assert refused["problems"][2] == {
        "place": str(bad),
        "line": 3,
        "key": "route.vel_leader_mps",
        "value": "99",
        "message": "must be a number from 0.05 to 30",
    }


def test_schema_prints_a_valid_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    jsonschema.Draft202012Validator.check_schema(json.loads(capsys.readouterr().out))


def test_version_is_the_packages_and_says_whether_it_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"understory {__version__}, {STATE}\n"


@pytest.mark.parametrize("argv", [[], ["check"], ["fly"], ["check", "--jsn", "x"]])
def test_wrong_usage_is_exit_code_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(argv)
    assert caught.value.code == 2
    assert "usage: mission" in capsys.readouterr().err


def test_the_example_in_the_help_is_a_mission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    epilog = build_parser().epilog or ""
    file = tmp_path / "my.toml"
    file.write_text(epilog.split("my.toml:\n")[1].split("\nthen:")[0])

    assert main(["check", str(file)]) == 0
    said = capsys.readouterr().out.replace(str(file), "my.toml").strip()
    assert all(line.strip() in epilog for line in said.splitlines())


@pytest.mark.parametrize(("words", "code"), [(["check", LONE_TREE], 130), (["edit", "new.toml"], 0)])
def test_ctrl_c_ends_it_quietly(
    words: list[str], code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(check, "run", interrupted)
    monkeypatch.setattr(edit, "run", interrupted)
    assert main(words) == code
    assert capsys.readouterr() == ("", "")


def test_a_reader_that_leaves_early_gets_no_traceback() -> None:
    command = [sys.executable, "-m", "mission.cli.main", "schema"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        program.stdout.close()
        assert program.stderr.read() == b""
        assert program.wait() == 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_told_in_words() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "mission.cli.main", "schema"], stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert done.returncode == 3
    assert done.stderr == b"mission: cannot write: No space left on device\n"
