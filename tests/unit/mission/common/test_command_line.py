"""Command lines of the programs: examples that parse, and the nearest of what is unknown."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion import cli as companion_cli
from mission.cli import main as mission_cli
from sim_bridge import cli as bridge_cli

PROGRAMS = {
    "mission": mission_cli.build_parser,
    "companion": companion_cli.build_parser,
    "sim-bridge": bridge_cli.build_parser,
}
PAGE = Path(__file__).parents[4] / "docs" / "reference" / "exit-codes.md"


def commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    inner = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not inner:
        yield parser
    for action in inner:
        for command in action.choices.values():
            yield from commands(command)


COMMANDS = [command.prog for build in PROGRAMS.values() for command in commands(build())]


@pytest.mark.parametrize("prog", COMMANDS)
def test_the_help_of_each_command_has_two_examples_that_parse(prog: str) -> None:
    program = PROGRAMS[prog.split()[0]]
    command = next(one for one in commands(program()) if one.prog == prog)
    text = command.format_help().replace("\\\n", " ")
    shown = text.partition("examples:\n")[2].partition("\n\n")[0]
    lines = [line.strip() for line in shown.splitlines()]
    assert len(lines) >= 2
    for line in lines:
        assert line.startswith(f"{prog}")
        words = shlex.split(line.partition(" > ")[0].partition(" | ")[0])
        assert program().parse_args(words[1:])
    assert all(len(line) <= 120 for line in command.epilog.splitlines()) if command.epilog else False


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("mission check --jsn m.toml", "mission check: error: unrecognized arguments: --jsn; did you mean --json?"),
        ("mission forest draw m.toml --uot x.svg", "are required: --out; did you mean --out?"),
        ("mission forest mkae --out x.csv", "invalid choice: 'mkae' (choose from"),
        ("mission forest mkae --out x.csv", "; did you mean make?"),
        ("companion run --mision m.toml", "--peers; did you mean --mission?"),
        ("companion docter", "; did you mean doctor?"),
        ("companion lidar --mask -10..10", "; a value that begins with - is written --mask=-10..10"),
        ("companion lidar --band-m -.5...5 --check", "; a value that begins with - is written --band-m=-.5...5"),
        ("sim-bridge fly m.toml --sed 3", "unrecognized arguments: --sed 3; did you mean --seed?"),
        ("sim-bridge fly m.toml --agents proceses", "; did you mean processes?"),
        ("sim-bridge report runs/a --agains runs/b", "arguments: --agains runs/b; did you mean --against?"),
        ("sim-bridge fly m.toml --perso px4", "unrecognized arguments: --perso px4; did you mean --personality?"),
        ("mission check --js m.toml", "mission check: error: unrecognized arguments: --js; did you mean --json?"),
        ("companion doctor --verb", "companion doctor: error: unrecognized arguments: --verb"),
        ("sim-bridge study s.toml --quite-else=3", "error: unrecognized arguments: --quite-else=3\n"),
    ],
)
def test_what_is_unknown_is_refused_with_the_nearest_that_is_known(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program, *rest = words.split()
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[program]().parse_args(rest)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("prog", PROGRAMS)
def test_no_command_takes_a_part_of_an_options_name(prog: str) -> None:
    program = PROGRAMS[prog]()
    assert not program.allow_abbrev
    assert [command.prog for command in commands(program) if command.allow_abbrev] == []


def test_exit_codes_of_every_command_stand_on_one_page() -> None:
    rows = re.findall(r"^\| `([^`]+)` \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert [name for name, _ in rows] == COMMANDS
    for name, row in rows:
        command = next(one for one in commands(PROGRAMS[name.split()[0]]()) if one.prog == name)
        codes = (command.epilog or "").replace("\n", " ").partition("exit codes: ")[2]
        told = re.findall(r"(?:^|, )(\d) ", codes)
        cells = [cell.strip() for cell in row.split(" | ")]
        assert len(cells) == 4
        for code in told:
            assert cells[int(code)] not in ("", "-"), f"{name}: {code} stands in its help"
