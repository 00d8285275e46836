"""What the programs load before they know what to do, and what they print for shells."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAMS = {"mission": "mission.cli.main", "companion": "companion.cli", "sim-bridge": "sim_bridge.cli"}
# Each takes a tenth of a second and more
HEAVY = {
    "pydantic",
    "numpy",
    "scipy",
    "matplotlib",
    "rich",
    "jsbsim",
    "pymavlink",
    "mavsdk",
    "psutil",
    "serial",
    "shtab",
}
OURS = {"mission.document.model", "companion.mavlink.dialect", "companion.core.model.events"}
# Asks a program's every command for its help, and prints as JSON what has been imported by each time.
CHILD = """
import argparse, contextlib, importlib, io, json, sys
cli = importlib.import_module(sys.argv[1])
said, loaded = {}, {}
def ask(*words):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        cli.main([*words])
    said[" ".join(words)], loaded[" ".join(words)] = out.getvalue(), sorted(sys.modules)
def commands(parser, *before):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield (*before, name)
                yield from commands(command, *before, name)
ask("--version")
ask("--help")
for words in [*commands(cli.build_parser())]:
    ask(*words, "--help")
print(json.dumps([said, loaded]))
"""


@pytest.mark.parametrize("module", PROGRAMS.values())
def test_neither_version_nor_any_help_loads_what_takes_long(module: str) -> None:
    done = subprocess.run([sys.executable, "-c", CHILD, module], capture_output=True, text=True, check=True)
    said, loaded = json.loads(done.stdout)
    assert len(said) > 4
    for words, names in loaded.items():
        assert words == "--version" or said[words].startswith("usage: ")
        roots = {name.partition(".")[0] for name in names}
        assert not roots & HEAVY | OURS.intersection(names), words


def script(program: str, shell: str) -> str:
    """What the program prints for the shell."""
    command = [sys.executable, "-m", PROGRAMS[program], "--print-completion", shell]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    ("words", "answers"),
    [
        (["mission", "fore"], ("forest",)),
        (["mission", "check", "lone"], ("lone_tree.toml",)),
        (["mission", "forest", "draw", "--o"], ("--out",)),
        (["companion", ""], ("run", "preflight", "doctor")),
        (["companion", "run", "--clock", ""], ("monotonic", "vehicle")),
        (["companion", "run", "--mission", "lone"], ("lone_tree.toml",)),
        (["sim-bridge", "st"], ("study",)),
        (["sim-bridge", "fly", "--pers"], ("--personality",)),
        (["sim-bridge", "report", "ru"], ("runs",)),
    ],
    ids=" ".join,
)
def test_bash_completes_commands_options_choices_and_files(
    words: list[str], answers: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "lone_tree.toml").touch()
    (tmp_path / "runs").mkdir()
    name = words[0].replace("-", "_")
    quoted = " ".join(f"'{word}'" for word in words)
    ask = f'COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; _shtab_{name}; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(
        ["bash", "--norc", "-c", f"{script(words[0], 'bash')}\n{ask}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    told = set(done.stdout.split())
    assert set(answers) <= told
    assert words[-1] == "" or set(answers) == told


@pytest.mark.parametrize("program", PROGRAMS)
def test_zsh_gets_a_completion_of_every_command(program: str) -> None:
    text = script(program, "zsh")
    assert text.startswith(f"#compdef {program}\n")
    assert "_files" in text
    if zsh := shutil.which("zsh"):
        subprocess.run([zsh, "-n"], input=text, text=True, check=True)


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(("reader", "said"), [("pipe", ""), ("/dev/full", "cannot write: No space left on device")])
def test_a_reader_of_the_completion_that_has_enough_ends_it_quietly(program: str, reader: str, said: str) -> None:
    if reader == "pipe":
        ours, theirs = os.pipe()
        os.close(ours)
    else:
        theirs = os.open(reader, os.O_WRONLY)
    command = [sys.executable, "-m", PROGRAMS[program], "--print-completion", "zsh"]
    try:
        done = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(theirs)
    assert (done.returncode, done.stderr) == (3, f"{program}: {said}\n" if said else "")


@pytest.mark.parametrize(("reader", "said"), [("pipe", ""), ("/dev/full", "cannot write: No space left on device")])
def test_a_report_of_the_companion_that_cannot_be_written_is_told_without_a_traceback(reader: str, said: str) -> None:
    if reader == "pipe":
        ours, theirs = os.pipe()
        os.close(ours)
    else:
        theirs = os.open(reader, os.O_WRONLY)
    command = [sys.executable, "-m", "companion", "doctor"]
    try:
        done = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(theirs)
    assert (done.returncode, done.stderr) == (3, f"companion: {said}\n" if said else "")
    closed = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *command], stderr=subprocess.PIPE, text=True, check=False)
    assert "Traceback" not in closed.stderr


def test_another_shell_is_refused_by_name() -> None:
    command = [sys.executable, "-m", "mission.cli.main", "--print-completion", "tcsh"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "tcsh" in done.stderr
    assert "zsh" in done.stderr
