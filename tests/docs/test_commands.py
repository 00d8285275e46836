"""The commands in the documentation: programs, subcommands, options and targets of make are there."""

from __future__ import annotations

import argparse
import importlib.util
import re
import shlex
from collections.abc import Iterator

import pytest
from test_docs import BLOCK, NAMES, PAGES, ROOT

import companion.cli
import mission.cli.main
import sim_bridge.cli

PARSERS = {"mission": mission.cli.main, "companion": companion.cli, "sim-bridge": sim_bridge.cli}
PROMPTED = re.compile(r"^\$ (.+(?:\n {4,}.+)*)", re.MULTILINE)  # what goes on is indented
SPAN = re.compile(r"(?<!`)`((?:mission|companion|sim-bridge|make) [^`\n]+)`(?!`)")
TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
TARGETS.add("px4_sitl")  # PX4's own
FIRST = re.compile(r"[|><;&]|\.\.\.")  # what follows is the shell's, or left out


def commands() -> Iterator[tuple[str, str]]:
    """What is typed after a prompt, on one line each, with the page that it stands on."""
    for page, name in zip(PAGES, NAMES, strict=True):
        for kind, block in BLOCK.findall(page.read_text(encoding="utf-8")):
            if kind in ("console", ""):
                for line in PROMPTED.findall(block):
                    yield name, line.replace("\\\n", " ").replace("\n", " ")


def words_of(line: str) -> list[str]:
    """Of the first command, without what only the shell reads."""
    words = shlex.split(line, comments=True)
    ends = [k for k, word in enumerate(words) if FIRST.match(word)]
    return words[: ends[0]] if ends else words


def options(parser: argparse.ArgumentParser) -> Iterator[str]:
    """All of a program and its subcommands."""
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from options(command)


def test_the_commands_are_many() -> None:
    """Or the tests below would find nothing wrong for want of any."""
    typed = [words_of(line)[0] for _, line in commands()]
    assert {"mission", "companion", "sim-bridge", "make", "python"} <= set(typed)
    assert len(typed) > 50


@pytest.mark.parametrize(("page", "line"), [c for c in commands() if words_of(c[1])], ids=lambda text: text[:60])
def test_what_is_typed_after_a_prompt_is_understood(page: str, line: str) -> None:
    program, *arguments = words_of(line)
    if program in PARSERS:
        if "..." in line:
            assert {word for word in arguments if word.startswith("--")} <= set(
                options(PARSERS[program].build_parser())
            )
            return
        try:
            PARSERS[program].build_parser().parse_args(arguments)
        except SystemExit:
            pytest.fail(f"{page}: {line}")
    elif program == "make":
        assert {word for word in arguments if "=" not in word} <= TARGETS
    elif program.startswith("python") and arguments[:1] == ["-m"] and arguments[1] not in ("venv", "pip"):
        assert importlib.util.find_spec(arguments[1]) is not None


@pytest.mark.parametrize("name", NAMES)
def test_options_and_targets_in_the_text_exist(name: str) -> None:
    wrong = []
    for span in SPAN.findall(BLOCK.sub("", (ROOT / name).read_text(encoding="utf-8"))):
        program, *rest = span.split()
        if program == "make":
            wrong += [span] * (rest[0] not in TARGETS and "=" not in rest[0])
            continue
        known = set(options(PARSERS[program].build_parser()))
        wrong += [span for word in rest if word.startswith("--") and word.partition("=")[0] not in known]
    assert not wrong
