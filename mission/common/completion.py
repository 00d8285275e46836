"""`--print-completion bash|zsh`: what lets a shell complete a program's commands, options and files."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from mission.common.exit_codes import EXIT_ENVIRONMENT

SHELLS = ("bash", "zsh")
# Arguments that are files or folders, by the last word of their metavar
FILES = {"FILE", "MISSION", "REPORT", "RECORDING"}
FOLDERS = {"DIR", "FOLDER", "RUN"}


def add_print_completion(parser: argparse.ArgumentParser, whole: Callable[[], argparse.ArgumentParser]) -> None:
    """The option. `whole` makes the parser with the options of all commands."""

    class Print(argparse.Action):
        def __call__(
            self,
            parser: argparse.ArgumentParser,
            namespace: argparse.Namespace,
            values: str | Sequence[Any] | None,
            option_string: str | None = None,
        ) -> None:
            del namespace, option_string
            text = script(whole(), str(values))
            try:
                print(text, flush=True)
            except OSError as error:
                # The interpreter flushes once more when it exits
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                why = f"{parser.prog}: cannot write: {os.strerror(error.errno or 0)}\n"
                parser.exit(EXIT_ENVIRONMENT, None if isinstance(error, BrokenPipeError) else why)
            parser.exit()

    parser.add_argument(
        "--print-completion",
        action=Print,
        choices=SHELLS,
        help="print what completes this program in that shell, and exit",
    )


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that `shell` sources."""
    import shtab  # only here: no other start of a program needs it

    _mark_files(parser, shtab.FILE, shtab.DIRECTORY)
    return shtab.complete(parser, shell=shell)


def _mark_files(parser: argparse.ArgumentParser, file: object, folder: object) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _mark_files(command, file, folder)
        elif isinstance(action.metavar, str):
            word = action.metavar.partition(".")[0]
            if word in FILES or word in FOLDERS:
                action.complete = file if word in FILES else folder  # type: ignore[attr-defined]
