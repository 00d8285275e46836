"""`sim-bridge`: fly swarms of simulated UAVs, or offer simulated vehicles to any MAVLink client."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import version
from types import ModuleType

from mission.problems import MissionError
from sim_bridge import fly, report, server
from sim_bridge.airframe.base import AirframeError
from sim_bridge.report.run_folder import RunFolderError

DONE, MISSION_FAILED, USAGE, ENVIRONMENT = 0, 1, 2, 3
EXAMPLE = """examples:
  sim-bridge fly mission/examples/lone_tree.toml           8 agents fly to a tree, as fast as it goes
  sim-bridge fly mission/examples/paper.toml -n 12         the paper's flight with 12
  sim-bridge serve mission/examples/lone_tree.toml -n 1    one vehicle for QGroundControl, MAVProxy or MAVSDK

exit codes: 0 done, 1 the mission failed, 2 usage or a bad file, 3 the environment (port taken, library missing)
"""
PROGRAMS: dict[str, tuple[ModuleType, str]] = {
    "fly": (fly, "fly one mission with n companions against JSBSim, and report"),
    "serve": (server, "offer the mission's vehicles to MAVLink clients, on the wall clock"),
    "report": (report, "print the figures of a run folder again, and redraw its picture"),
}


def build_parser() -> argparse.ArgumentParser:
    """The whole command line, for parsing and for the reference."""
    parser = argparse.ArgumentParser(
        prog="sim-bridge",
        description=__doc__,
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('understory')}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, text) in PROGRAMS.items():
        module.configure(commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + "."))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run; the exit code."""
    args = build_parser().parse_args(argv)
    module, _ = PROGRAMS[args.command]
    try:
        code: int = module.run(args)
    except MissionError as error:
        print(error, file=sys.stderr)
        return USAGE
    except (RunFolderError, FileExistsError) as error:
        print(f"sim-bridge: {error}", file=sys.stderr)
        return USAGE
    except (AirframeError, OSError) as error:
        print(f"sim-bridge: {error}", file=sys.stderr)
        return ENVIRONMENT
    return code


if __name__ == "__main__":
    sys.exit(main())
