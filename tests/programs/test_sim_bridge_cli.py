"""`sim-bridge`'s command line: what is imported for it, and what is said where something is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from mission import __version__
from sim_bridge import cli

VERSION = f"understory {__version__}, "
# Prints which modules of ours and of the [sim] extra are there when the program has ended.
CHILD = """
import sys
from sim_bridge import cli
try:
    cli.main(sys.argv[1:])
except SystemExit as ended:
    print("exit code", ended.code)
roots = {"mission", "companion", "sim_bridge", "numpy", "scipy", "matplotlib", "PIL", "rich", "jsbsim", "pydantic"}
print("loaded", *sorted(name for name in sys.modules if name.partition(".")[0] in roots))
"""


@pytest.mark.parametrize(("option", "answer"), [("--version", VERSION), ("--help", "lone_tree.toml")])
def test_version_and_help_import_no_command(option: str, answer: str) -> None:
    done = subprocess.run([sys.executable, "-c", CHILD, option], capture_output=True, text=True, check=True)
    *said, code, loaded = done.stdout.splitlines()
    assert answer in "\n".join(said)
    assert code == "exit code 0"
    ours = [
        "mission",
        "mission.common",
        "mission.common.command_line",
        "mission.common.compiled",
        "mission.common.completion",
        "mission.common.exit_codes",
        "sim_bridge",
        "sim_bridge.cli",
    ]
    assert loaded.split() == ["loaded", *ours]


@pytest.fixture
def imported(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the command line imports; stand-ins for it, which end with 0."""
    names: list[str] = []

    def import_module(name: str) -> object:
        names.append(name)
        return SimpleNamespace(configure=lambda parser: parser.add_argument("--to"), run=lambda _args: 0)

    monkeypatch.setattr(cli, "importlib", SimpleNamespace(import_module=import_module))
    return names


@pytest.mark.parametrize("command", cli.PROGRAMS)
def test_a_command_imports_its_own_modules_alone(command: str, imported: list[str]) -> None:
    assert cli.main([command, "--to", "fly"]) == 0
    assert imported == [f"sim_bridge.options.{command}", cli.MODULES[command]]


@pytest.mark.parametrize("argv", [[], ["hover"], ["--sideways"], ["-h", "fly"], ["--version", "fly"]])
def test_what_is_no_command_imports_one_at_most(argv: list[str], imported: list[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(argv)
    assert len(imported) <= 1


def test_all_commands_are_configured_for_whoever_wants_the_whole(imported: list[str]) -> None:
    cli.build_parser()
    assert imported == [f"sim_bridge.options.{command}" for command in cli.PROGRAMS]


@pytest.mark.parametrize("module", ["sim_bridge.drive.serve.program", "mission.common.problems"])
def test_a_missing_library_is_named_with_what_to_install(
    module: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert cli.main(["serve", "mission.toml"]) == cli.ENVIRONMENT
    assert f"{module} is not installed: in the checkout, pip install -e '.[sim]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["conformance", "none.tlog"], 2, "none.tlog: no such file"),
        (["conformance", "."], 2, ".: is a directory: must be a file"),
        (["search", "--flights", "1", "--out", "file/run"], 3, "file/run: Not a directory"),
    ],
)
def test_an_error_of_a_file_is_told_in_words(
    words: list[str],
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert cli.main(words) == code
    assert capsys.readouterr().err == f"sim-bridge: {said}\n"


@pytest.mark.parametrize("how", [[], ["-u"]])  # -u: each line is written at once
@pytest.mark.parametrize(
    ("reader", "said"),
    [("pipe", ""), ("/dev/full", "sim-bridge: No space left on device\n")],
)
def test_a_reader_that_leaves_early_is_no_error_to_tell_of(
    reader: str, said: str, how: list[str], tmp_path: Path
) -> None:
    row = {"key": "a", "run": "r", "law": "ours", "backend": "point_mass", "n": 1, "seed": 1, "settings": {}}
    (tmp_path / "rows.jsonl").write_text(json.dumps(row | {"status": "failed", "error": "none"}) + "\n")
    if reader == "pipe":
        ours, theirs = os.pipe()
        os.close(ours)
    else:
        theirs = os.open(reader, os.O_WRONLY)
    process = [sys.executable, *how, "-m", "sim_bridge.cli", "report", str(tmp_path)]
    try:
        done = subprocess.run(process, stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(theirs)
    assert (done.returncode, done.stderr) == (3, said)
