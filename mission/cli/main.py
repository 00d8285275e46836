"""`mission`: check mission files before anything flies, and tell editors what may stand in them."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Sequence

from mission import __version__
from mission.cli import edit, forest, plan
from mission.common.command_line import Parser, add_examples
from mission.common.compiled import STATE
from mission.common.completion import add_print_completion
from mission.common.exit_codes import EXIT_BAD_FILE as EXIT_BAD_FILE
from mission.common.exit_codes import EXIT_DONE as EXIT_DONE
from mission.common.exit_codes import EXIT_ENVIRONMENT as EXIT_ENVIRONMENT
from mission.common.exit_codes import EXIT_INTERRUPTED
from mission.common.problems import MissionError

_ABOUT = """\
A mission file (TOML) says what a swarm flies: from where to where, with how many vehicles, how close they
come to each other and to the trees. This program checks such files, and brings
routes from ground stations and back; nothing flies.
"""

_EXAMPLE = """\
the least that a mission needs, in my.toml:
  schema = 1
  [route]
  d1_enu_m = [0.0, 0.0, 8.0]      # deployment: east, north, up in metres
  d2_enu_m = [130.0, 0.0, 8.0]    # destination
  vel_leader_mps = 3.0

then:
  mission check my.toml
  my.toml: ok: unnamed, 8 vehicles, 130.0 m, 43.3 s at 3.0 m/s; no [origin]: for the simulator alone
    at least 2.1 min in the air: 378 mAh, 8 % of the smallest simulated battery

exit codes: 0 done, 2 wrong usage or a bad file, 3 the environment (an output that cannot be written)
"""

_SCHEMA = """\
Prints the JSON Schema (draft 2020-12) of mission files, for completion and checks while you type, as with
Even Better TOML (taplo) in VS Code:
  mission schema > mission.schema.json
and as the first line of the mission file:
  #:schema ./mission.schema.json
"""


_EXAMPLES = {
    "check": ("mission check my.toml", "mission check --json mission/examples/*.toml"),
    "edit": ("mission edit my.toml --open", "mission edit new.toml --stems stems.csv --open"),
    "schema": ("mission schema > mission.schema.json", "mission schema | less"),
    "forest make": (
        "mission forest make --mission natural_stand.toml --seed 7 --out stems.csv",
        "mission forest make --area-m 200 100 --out stems.csv density_per_ha=600 dbh_mean_m=0.3 'species=[\"pine\"]'",
    ),
    "forest import": (
        "mission forest import plot.csv --utm 32N --out stems.csv",
        'mission forest import plot.txt --column "dbh_mm=D 2024" --column id=Tag --decimal comma --out stems.csv',
    ),
    "forest check": ("mission forest check my.toml", "mission forest check stems.csv --mission my.toml"),
    "forest draw": (
        "mission forest draw my.toml --out plan.svg",
        "mission forest draw stems.csv --ids --mission my.toml --out plan.svg",
    ),
    "import": ("mission import my.plan --out new.toml", "mission import my.plan --mission my.toml --out changed.toml"),
    "export": ("mission export my.toml --out my.plan", "mission export mission/examples/paper.toml --out paper.plan"),
}


def build_parser() -> argparse.ArgumentParser:
    """The command line; also read by the generator of the reference."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = Parser(prog="mission", description=_ABOUT, epilog=_EXAMPLE, formatter_class=raw)
    parser.add_argument("--version", action="version", version=f"understory {__version__}, {STATE}")
    add_print_completion(parser, build_parser)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    check = commands.add_parser(
        "check",
        help="check mission files and list every problem",
        description="Prints a line for each good file on stdout, and every problem of the others on stderr. "
        "A mission without [origin] must be one that the simulated vehicles can fly; one with it is told if it is not.",
        epilog="exit codes: 0 all are good, 2 at least one is not",
    )
    check.add_argument("files", nargs="+", metavar="FILE", help="a mission file (TOML, at most 64 KiB)")
    check.add_argument("--json", action="store_true", help="print one JSON array, an object for each file")

    commands.add_parser(
        "schema",
        help="print the JSON Schema of mission files, for editors",
        description=_SCHEMA,
        formatter_class=raw,
    )
    edit.add_parser(commands)
    forest.add_parser(commands)
    plan.add_parsers(commands)
    add_examples(parser, _EXAMPLES)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code (SystemExit for --help, --version and wrong usage)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that lacks a mission's letters is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    arguments = build_parser().parse_args(argv)
    try:
        code = _run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return EXIT_DONE if arguments.command == "edit" else EXIT_INTERRUPTED
    except MissionError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except OSError as error:  # a full disk or a closed pipe; mission files have their own errors
        if not isinstance(error, BrokenPipeError):
            print(f"mission: cannot write: {os.strerror(error.errno or 0)}", file=sys.stderr)
        # The interpreter flushes once more when it exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_ENVIRONMENT
    return code


def _run(arguments: argparse.Namespace) -> int:
    match arguments.command:
        case "schema":
            from mission.document.model import Mission  # here, as below: --help need not wait for the model
            from mission.schema.json_schema import json_schema

            print(json.dumps(json_schema(Mission), indent=2))
            return EXIT_DONE
        case "edit":
            return edit.run(arguments)
        case "forest":
            return forest.run(arguments)
        case "import":
            return plan.run_import(arguments)
        case "export":
            return plan.run_export(arguments)
        case _:
            from mission.cli import check

            return check.run(arguments.files, as_json=arguments.json)


if __name__ == "__main__":
    sys.exit(main())
