"""Command lines of the programs: what is unknown is told with the nearest that is known, and help has examples."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NoReturn

_CHOICE = re.compile(r"invalid choice: '?([^' ]*)'? \(choose from (.*)\)", re.DOTALL)
_NAME = re.compile(r"[\w-]+")
_NO_VALUE = re.compile(r"argument (\S+): expected one argument")
_BELOW_ZERO = re.compile(r"-[\d.]")  # argparse knows a negative number, but nothing else that begins like one
CLOSE = 0.6  # as like as two names must be


class Formatter(argparse.HelpFormatter):
    """Keeps a text of several lines as it is, and wraps one of a single line."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" not in text.strip():
            return super()._fill_text(text, width, indent)
        return "".join(indent + line for line in text.splitlines(keepends=True))


class Parser(argparse.ArgumentParser):
    """A program's, and those of its commands: a command refuses what it does not know itself, with its own usage.

    An option is its whole name: what a script abbreviates would come to mean another with the next release.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"formatter_class": Formatter, "allow_abbrev": False, **options})
        self._words: list[str] = []  # that it is given

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """As argparse has it, but that nothing is left over."""
        self._words = list(sys.argv[1:] if args is None else args)
        found, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}{self._hint(left)}")
        return found, left

    def error(self, message: str) -> NoReturn:
        """Exit code 2, with the usage; what is none of ours, a choice or an option, with the nearest that is."""
        wrong = _CHOICE.search(message)
        if wrong:
            message += _nearest(wrong[1], _NAME.findall(wrong[2]))
        elif no_value := _NO_VALUE.match(message):
            message += self._join_hint(no_value[1].split("/"))
        elif message.startswith("the following arguments are required"):  # one of which may be there, misspelt
            message += self._hint(self._words)
        super().error(message)

    def _join_hint(self, flags: Sequence[str]) -> str:
        """The option of these that is followed by a value taken for an option, as it is to be written."""
        given = (pair for pair in pairwise(self._words) if pair[0] in flags and _BELOW_ZERO.match(pair[1]))
        return next((f"; a value that begins with - is written {flag}={value}" for flag, value in given), "")

    def _hint(self, words: Sequence[str]) -> str:
        """Option that the first unknown of `words` that is like one is meant for."""
        known = self._option_string_actions
        flags = (word.partition("=")[0] for word in words if word.startswith("--"))
        return next(filter(None, (_nearest(flag, list(known)) for flag in flags if flag not in known)), "")


def _nearest(word: str, known: Sequence[str]) -> str:
    from difflib import get_close_matches  # only for what is wrong

    near = get_close_matches(word, known, n=1, cutoff=CLOSE)
    if not near and len(word) > len("--"):
        near = [name for name in known if name.startswith(word)]
    return f"; did you mean {near[0]}?" if near else ""


def add_examples(parser: argparse.ArgumentParser, examples: Mapping[str, Sequence[str]]) -> None:
    """Writes command lines below the help of each command, as `forest draw`, before what stands there."""
    for command, lines in examples.items():
        at = parser
        for word in command.split():
            (inner,) = (action for action in at._actions if isinstance(action, argparse._SubParsersAction))
            at = inner.choices[word]
        shown = "\n".join(f"  {line}" for line in lines)
        at.epilog = f"examples:\n{shown}\n" + (f"\n{at.epilog}" if at.epilog else "")
