"""`mission`: check mission files before anything flies, and tell editors what may stand in them."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mission import __version__, forest_cli, plan_cli, simulator
from mission.check import validated
from mission.load import MAX_PLACE_CHARS, load_document
from mission.model import Mission
from mission.problems import MissionError, Problem, printable
from mission.schema import json_schema

EXIT_DONE = 0
EXIT_BAD_FILE = 2  # argparse uses the same for bad usage
EXIT_ENVIRONMENT = 3

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

exit codes: 0 done, 2 wrong usage or a bad file, 3 the environment (an output that cannot be written)
"""

_SCHEMA = """\
Prints the JSON Schema (draft 2020-12) of mission files, for completion and checks while you type, as with
Even Better TOML (taplo) in VS Code:
  mission schema > mission.schema.json
and as the first line of the mission file:
  #:schema ./mission.schema.json
"""


def build_parser() -> argparse.ArgumentParser:
    """The command line; also read by the generator of the reference."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="mission", description=_ABOUT, epilog=_EXAMPLE, formatter_class=raw, allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"understory {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    check = commands.add_parser(
        "check",
        help="check mission files and list every problem",
        description="Prints a line for each good file on stdout, and every problem of the others on stderr. "
        "A mission without [origin] must be one that the simulated vehicles can fly; one with it is told if it is not.",
        epilog="exit codes: 0 all are good, 2 at least one is not",
        allow_abbrev=False,
    )
    check.add_argument("files", nargs="+", metavar="FILE", help="a mission file (TOML, at most 64 KiB)")
    check.add_argument("--json", action="store_true", help="print one JSON array, an object for each file")

    commands.add_parser(
        "schema",
        help="print the JSON Schema of mission files, for editors",
        description=_SCHEMA,
        formatter_class=raw,
        allow_abbrev=False,
    )
    forest_cli.add_parser(commands)
    plan_cli.add_parsers(commands)
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
            return _schema()
        case "forest":
            return forest_cli.run(arguments)
        case "import":
            return plan_cli.run_import(arguments)
        case "export":
            return plan_cli.run_export(arguments)
        case _:
            return _check(arguments.files, as_json=arguments.json)


def _schema() -> int:
    print(json.dumps(json_schema(Mission), indent=2))
    return EXIT_DONE


def _check(files: Sequence[str], *, as_json: bool) -> int:
    code = EXIT_DONE
    results: list[dict[str, Any]] = []
    for file in files:
        try:
            result, beyond = _checked(file)
        except MissionError as error:
            code = EXIT_BAD_FILE
            result = {"file": file, "ok": False, "problems": [asdict(problem) for problem in error.problems]}
            if not as_json:
                print(error, file=sys.stderr)
        else:
            if not as_json:
                print(_sentence(result))
                for problem in beyond:
                    print(f"  not for the simulator: {problem}")
                for note in result["notes"]:
                    print(f"  {note}")
        results.append(result)
    if as_json:
        print(json.dumps(results, indent=2))
    return code


def _checked(file: str) -> tuple[dict[str, Any], tuple[Problem, ...]]:
    """What `file` flies, and what of it the simulated vehicles cannot: a mission without [origin] is for them alone."""
    values, place, line_of = load_document(file)
    mission = validated(Mission, values, place, line_of)
    beyond = simulator.problems(mission, place, values, line_of)
    if beyond and mission.origin is None:
        raise MissionError(beyond)
    absent, notes = _stand(mission, file)
    beyond += absent
    told = {"beyond_simulator": [asdict(problem) for problem in beyond], "notes": notes}
    return _summary(file, mission) | told, beyond


def _stand(mission: Mission, file: str) -> tuple[tuple[Problem, ...], list[str]]:
    """That its stem map is absent, which only the simulator reads, and where its fence meets crowns.

    MissionError for a map that is there and wrong, or that a mission for the simulator alone lacks.
    """
    if mission.forest.file is None and mission.forest.stand is None:
        return (), []
    from mission.forest_notes import fence_notes
    from mission.stand_beside import stand_beside

    try:
        stand = stand_beside(mission, file)
    except MissionError as error:
        if mission.origin is None or (Path(file).parent / (mission.forest.file or "")).exists():
            raise
        return error.problems, []
    return (), list(fence_notes(stand, mission))


def _summary(file: str, mission: Mission) -> dict[str, Any]:
    return {
        "file": file,
        "ok": True,
        "name": mission.name,
        "vehicles": mission.swarm.size,
        "stops": len(mission.route.stops),
        "distance_m": mission.route.length_m,
        "vel_leader_mps": mission.route.vel_leader_mps,
        "transit_s": mission.route.length_m / mission.route.vel_leader_mps,
        "origin": mission.origin is not None,
        "flies_blind": mission.flies_blind,
        "problems": [],
    }


def _sentence(result: dict[str, Any]) -> str:
    vehicles = "1 vehicle" if result["vehicles"] == 1 else f"{result['vehicles']} vehicles"
    stops = {0: "", 1: " over 1 stop"}.get(result["stops"], f" over {result['stops']} stops")
    return (
        f"{printable(result['file'], MAX_PLACE_CHARS)}: ok: {result['name'] or 'unnamed'}, {vehicles}, "
        f"{result['distance_m']:.1f} m{stops}, "
        f"{result['transit_s']:.1f} s at {result['vel_leader_mps']} m/s"
        f"{'' if result['origin'] else '; no [origin]: for the simulator alone'}"
        f"{'; no [sensing]: vehicles do not see the forest' * result['flies_blind']}"
    )


if __name__ == "__main__":
    sys.exit(main())
