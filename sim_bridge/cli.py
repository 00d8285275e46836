"""`sim-bridge`: fly swarms of simulated UAVs, or offer simulated vehicles to any MAVLink client."""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import os
import select
import signal
import sys
from collections.abc import Collection, Iterator, Sequence
from typing import TextIO

from mission import __version__
from mission.common.command_line import Parser, add_examples
from mission.common.compiled import STATE
from mission.common.completion import add_print_completion

DONE, MISSION_FAILED, USAGE, ENVIRONMENT = 0, 1, 2, 3
EXAMPLE = """examples:
  sim-bridge fly mission/examples/lone_tree.toml           8 agents fly to a tree, as fast as it goes
  sim-bridge fly mission/examples/paper.toml -n 12         the paper's flight with 12
  sim-bridge fly MISSION --kill leader@40                  the vehicle that leads then loses its companion
  sim-bridge fly MISSION --autopilots 'udpin://127.0.0.1:{port}' --first-port 14540     over PX4s that run already
  sim-bridge serve mission/examples/lone_tree.toml -n 1    one vehicle for QGroundControl, MAVProxy or MAVSDK

exit codes: 0 done, 1 the mission failed or a study missed a limit, 2 usage or a bad file,
3 the environment (port taken, library missing)
"""
# Command -> what it does. Its options: `configure(parser)` of sim_bridge.options.COMMAND.
PROGRAMS = {
    "fly": "fly one mission with n companions against JSBSim, and report",
    "serve": "offer the mission's vehicles to MAVLink clients, on the wall clock",
    "study": "fly many flights: parameters and seeds crossed, a row of each, and a summary",
    "search": "fly random missions with random faults, and shrink those that fail",
    "report": "figures, verdict and replay of a run folder anew; the page of a study",
    "export": "write a flight in the formats of other tools: MCAP, ROS 2 bag, KML, GPX, GeoJSON",
    "conformance": "compare the simulated autopilots with recorded flights of PX4 and ArduCopter",
}
# Command -> command lines, in its help.
EXAMPLES = {
    "fly": (
        "sim-bridge fly mission/examples/lone_tree.toml --open",
        "sim-bridge fly mission/examples/lone_tree.toml -n 4 --seed 7 --kill leader@40",
    ),
    "serve": (
        "sim-bridge serve mission/examples/lone_tree.toml -n 1",
        "sim-bridge serve mission/examples/paper.toml -n 3 --ground 127.0.0.1:14550",
    ),
    "study": (
        "sim-bridge study mission/studies/forest_size.toml --seeds 3 --out quick",
        "sim-bridge study my_study.toml --workers 4 --replay 3 --open",
    ),
    "search": ("sim-bridge search --flights 100 --out found", "sim-bridge search --hours 8 --seed 1000 --shrink 3"),
    "report": ("sim-bridge report runs/my-flight --open", "sim-bridge report my_study --json"),
    "export": ("sim-bridge export runs/my-flight --kml --gpx", "sim-bridge export runs/my-flight --mcap --out shared"),
    "conformance": ("sim-bridge conformance", "sim-bridge conformance my_flight.tlog --json"),
}
# Command -> the module whose `run(args) -> exit code` it is.
MODULES = {
    "fly": "sim_bridge.drive.fly_program",
    "serve": "sim_bridge.drive.serve.program",
    "study": "sim_bridge.lab.study.program",
    "search": "sim_bridge.lab.search.program",
    "report": "sim_bridge.lab.report",
    "export": "sim_bridge.judge.export",
    "conformance": "sim_bridge.conformance",
}


def build_parser(commands: Collection[str] = tuple(PROGRAMS)) -> argparse.ArgumentParser:
    """The command line, with the options of `commands`; the others are only named."""
    parser: argparse.ArgumentParser = Parser(prog="sim-bridge", description=__doc__, epilog=EXAMPLE)
    parser.add_argument("--version", action="version", version=f"understory {__version__}, {STATE}")
    add_print_completion(parser, build_parser)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in PROGRAMS.items():
        command = subparsers.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if name in commands:
            importlib.import_module(f"sim_bridge.options.{name}").configure(command)
    add_examples(parser, {name: lines for name, lines in EXAMPLES.items() if name in commands})
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run; the exit code."""
    _open_closed_streams()
    try:
        code = _main(argv)
    except KeyboardInterrupt:
        code = MISSION_FAILED
        _print_error("interrupted")
    left = _has_no_reader(sys.stdout)
    if not _flushed(sys.stdout):
        if not left:
            _print_error("standard output cannot be written")
        code = ENVIRONMENT
    _flushed(sys.stderr)
    return code


def _open_closed_streams() -> None:
    """A closed standard stream becomes /dev/null: else the next file or socket would get its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115


def _flushed(stream: TextIO) -> bool:
    """False when it cannot be written; then it goes to /dev/null: the interpreter flushes once more at its end."""
    try:
        stream.flush()
    except OSError:
        with contextlib.suppress(OSError):  # a stream without a number
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return False
    return True


def _has_no_reader(stream: TextIO) -> bool:
    """A pipe whose reader has ended, as `head` does: no error to tell of."""
    try:
        watched = select.poll()
        watched.register(stream.fileno(), 0)  # errors are told unasked
        return any(events & select.POLLERR for _, events in watched.poll(0))
    except (OSError, ValueError):  # no file, or a closed one
        return False


def _print_error(text: object) -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"sim-bridge: {text}", file=sys.stderr)


@contextlib.contextmanager
def _ended_at_once() -> Iterator[None]:
    """Ctrl-C ends the program within: nothing has begun, and an import that is interrupted may swallow it."""

    def end(_number: int, _frame: object) -> None:
        _print_error("interrupted")
        os._exit(MISSION_FAILED)

    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextlib.contextmanager
def _not_collecting() -> Iterator[None]:
    """Pauses garbage collection while loading: what that makes stays. Saves a tenth of the time that loading takes."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _main(argv: Sequence[str] | None) -> int:
    words = sys.argv[1:] if argv is None else argv
    command = [word for word in words if not word.startswith("-")][:1]  # no option before it takes a value
    try:
        with _ended_at_once(), _not_collecting():
            args = build_parser(command).parse_args(argv)
            # Only now: --help and --version need none of these, and without the extra they are not there
            program = importlib.import_module(MODULES[args.command])
            from mission.common.files import os_words
            from mission.common.problems import MissionError
            from sim_bridge.errors import StartError
            from sim_bridge.world.airframe.base import AirframeError
    except ModuleNotFoundError as error:
        _print_error(f"{error.name} is not installed: in the checkout, pip install -e '.[sim]'")
        return ENVIRONMENT

    try:
        code: int = program.run(args)
    except MissionError as error:
        with contextlib.suppress(OSError):
            print(error, file=sys.stderr)
        return USAGE
    except StartError as error:
        _print_error(error)
        return error.exit_code
    except FileExistsError as error:
        _print_error(os_words(error))
        return USAGE
    except AirframeError as error:
        _print_error(error)
        return ENVIRONMENT
    except OSError as error:
        if not (isinstance(error, BrokenPipeError) and _has_no_reader(sys.stdout)):
            _print_error(os_words(error))
        return ENVIRONMENT
    return code


if __name__ == "__main__":
    sys.exit(main())
