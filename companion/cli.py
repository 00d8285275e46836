"""`companion`: the program on the vehicle's companion computer."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import io
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime

from companion import help_texts
from companion.mavlink.endpoint import Endpoint
from companion.preflight.report import clearance
from companion.shell.flight_log import FlightLog, Watch, summary
from companion.shell.links import Link, LinkError, open_link
from companion.shell.runner import Runner, Stop
from companion.shell.service import Service
from companion.shell.urls import AUTOPILOT_SCHEMES, PEERS_SCHEMES, Scheme, Url, UrlError, parse_url
from mission import __version__
from mission.compiled import STATE
from mission.load import load_mission
from mission.model import Mission
from mission.problems import MissionError, printable

EXIT_DONE = 0
EXIT_BROKEN = 1  # a broken invariant; the traceback is in the log
EXIT_REFUSED = 2  # wrong usage or a bad mission; argparse uses the same
EXIT_ENVIRONMENT = 3  # a port, a device or a file that cannot be opened


def build_parser() -> argparse.ArgumentParser:
    """The command line; also read by the generator of the reference."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="companion",
        description=help_texts.ABOUT,
        epilog=help_texts.EXAMPLE,
        formatter_class=raw,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"understory {__version__}, {STATE}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = commands.add_parser(
        "run",
        help="fly one vehicle's part of a mission",
        description=help_texts.RUN,
        epilog=help_texts.RUN_MORE,
        formatter_class=raw,
        allow_abbrev=False,
    )
    run.add_argument(
        "--mission",
        required=True,
        metavar="FILE",
        help="mission file (TOML) with an [origin]; the swarm's own",
    )
    run.add_argument(
        "--id",
        required=True,
        type=_vehicle_id,
        metavar="K",
        help="this vehicle's number, 1 to the mission's swarm.size; also its autopilot's MAVLink system id",
    )
    run.add_argument(
        "--autopilot",
        required=True,
        type=_url(AUTOPILOT_SCHEMES),
        metavar="URL",
        help="link to the autopilot",
    )
    run.add_argument(
        "--peers", required=True, type=_url(PEERS_SCHEMES), metavar="URL", help="link to the other companions"
    )
    run.add_argument(
        "--obstacles",
        type=_url(AUTOPILOT_SCHEMES),
        metavar="URL",
        help="link to the obstacle sensor's driver, in a mission with [sensing]; without it, scans are taken from the "
        "autopilot's link",
    )
    run.add_argument(
        "--ranges",
        type=_url(AUTOPILOT_SCHEMES),
        metavar="URL",
        help="link to the range radio's driver, in a mission with swarm.gnss; it may also share that of --obstacles",
    )
    run.add_argument(
        "--preflight",
        metavar="REPORT",
        help="what `companion preflight --report` wrote; without a passing one of this mission and vehicle, at most "
        "12 h old, nothing is armed",
    )
    run.add_argument(
        "--waive",
        type=_names,
        default=(),
        metavar="CHECK[,CHECK...]",
        help="take these failed checks of the report as accepted; `all`: arm without any report, as in the simulator",
    )
    run.add_argument("--clock", choices=("monotonic", "vehicle"), default="monotonic", help="default: monotonic")
    run.add_argument("--log", metavar="FILE", help="append the flight log to FILE; default: stderr")
    _add_preflight(commands)
    _add_doctor(commands)
    return parser


def _add_preflight(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    preflight = commands.add_parser(
        "preflight",
        help="check one vehicle before its flight",
        description=help_texts.PREFLIGHT,
        epilog=help_texts.PREFLIGHT_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    preflight.add_argument("--mission", required=True, metavar="FILE", help="mission file (TOML) with an [origin]")
    preflight.add_argument("--id", required=True, type=_vehicle_id, metavar="K", help="this vehicle's number")
    preflight.add_argument(
        "--autopilot", required=True, type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="link to the autopilot"
    )
    preflight.add_argument(
        "--obstacles", type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="the obstacle sensor's, as for `companion run`"
    )
    preflight.add_argument(
        "--apply", action="store_true", help="set wrong parameters and the fence, and read them back; never while armed"
    )
    preflight.add_argument("--key", metavar="FILE", help="the swarm's key, to be checked as a file")
    preflight.add_argument("--report", metavar="FILE", help="write the report to FILE, for `companion run --preflight`")
    preflight.add_argument("--json", action="store_true", help="print the report as JSON instead of a table")


def _add_doctor(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    doctor = commands.add_parser(
        "doctor",
        help="look for what is wrong with this computer and its links",
        description=help_texts.DOCTOR,
        epilog=help_texts.DOCTOR_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    doctor.add_argument("--autopilot", type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="listen there for heartbeats")
    doctor.add_argument("--peers", type=_url(PEERS_SCHEMES), metavar="URL", help="listen there for other companions")
    doctor.add_argument(
        "--obstacles",
        type=_url(AUTOPILOT_SCHEMES),
        metavar="URL",
        help="listen there for obstacle sensors",
    )
    doctor.add_argument("--json", action="store_true", help="print JSON instead of a table")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code (SystemExit for --help, --version and wrong usage)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that lacks a letter is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    arguments = build_parser().parse_args(argv)
    if arguments.command == "doctor":
        from companion.doctor import doctor  # not kept by a flight

        return doctor(arguments)
    try:
        mission = mission_of(arguments)
        if arguments.command == "preflight":
            from companion.preflight.command import preflight  # not kept by a flight

            return preflight(arguments, mission)
    except RefusedError as refusal:
        return _refused(refusal)
    return run(arguments, mission)


def run(arguments: argparse.Namespace, mission: Mission) -> int:
    """`companion run`, its command line parsed and its mission loaded (`mission_of`); returns the exit code."""
    try:
        with ExitStack() as opened:
            return _run(arguments, mission, opened)
    except RefusedError as refusal:
        return _refused(refusal)


def _refused(refusal: RefusedError) -> int:
    print(f"companion: {refusal}", file=sys.stderr)
    return refusal.code


class RefusedError(Exception):
    """The flight cannot start."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


def _vehicle_id(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{printable(text)!r} is no vehicle id: 1 to 250 (set UNDERSTORY_ID in /etc/understory/companion.env)"
        ) from None


def _url(allowed: frozenset[Scheme]) -> Callable[[str], Url]:
    def parse(text: str) -> Url:
        try:
            return parse_url(text, allowed)
        except UrlError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse


def _names(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    if not all(name.isidentifier() for name in names):  # checks are named as the parameters: letters, digits, _
        raise argparse.ArgumentTypeError(f"{printable(text)!r}: must be names of checks, with commas between them")
    return names


def mission_of(arguments: argparse.Namespace) -> Mission:
    """The mission, fit for a real flight of this vehicle. RefusedError."""
    path: str = arguments.mission
    vehicle_id: int = arguments.id
    try:
        mission = load_mission(path)
    except MissionError as error:
        raise RefusedError(EXIT_REFUSED, f"the mission is refused\n{error}") from None
    if not 1 <= vehicle_id <= mission.swarm.size:
        raise RefusedError(
            EXIT_REFUSED, f"--id {vehicle_id}: {printable(path)} has the vehicles 1 to {mission.swarm.size}"
        )
    if mission.origin is None:
        raise RefusedError(
            EXIT_REFUSED,
            f"{printable(path)}: a real flight needs [origin], where on Earth its frame starts. Add\n"
            "  [origin]\n  lat_deg = ...\n  lon_deg = ...\n  alt_m = ...  # of the ground, above sea level",
        )
    obstacles: Url | None = arguments.obstacles
    if obstacles is not None and mission.sensing is None:
        raise RefusedError(
            EXIT_REFUSED,
            f"--obstacles {obstacles}: {printable(path)} has no [sensing], so nothing would fly by this sensor. Add "
            "the table to the mission of all vehicles, or leave the option out",
        )
    ranges: Url | None = getattr(arguments, "ranges", None)  # preflight has none
    if ranges is not None and not mission.flies_by_ranges:
        raise RefusedError(
            EXIT_REFUSED,
            f"--ranges {ranges}: {printable(path)} has satellites on all vehicles (swarm.gnss), so nothing "
            "would fly by this radio",
        )
    if arguments.command == "run" and mission.flies_by_ranges and ranges is None and obstacles is None:
        raise RefusedError(
            EXIT_REFUSED,
            f"{printable(path)}: not all vehicles have satellites (swarm.gnss), so --ranges is needed: the link "
            "to the range radio's driver",
        )
    return mission


def _run(arguments: argparse.Namespace, mission: Mission, opened: ExitStack) -> int:
    """Open what the flight needs, fly, say why it ended."""
    by_vehicle = arguments.clock == "vehicle"
    obstacles: Url | None = arguments.obstacles
    stop = opened.enter_context(Stop())
    log_fd = _log_fd(arguments.log, opened)
    log = FlightLog(log_fd)
    autopilot = _open("--autopilot", arguments.autopilot, opened, may_be_absent=True)
    peers = _open("--peers", arguments.peers, opened)
    sensor = None if obstacles is None else _open("--obstacles", obstacles, opened, may_be_absent=True, hears_all=True)
    ranges: Url | None = arguments.ranges
    radio = None if ranges is None else _open("--ranges", ranges, opened, may_be_absent=True, hears_all=True)
    endpoint = Endpoint(
        mission,
        arguments.id,
        autopilot_is_stream=arguments.autopilot.scheme is Scheme.SERIAL,
        sensor_is_stream=obstacles is not None and obstacles.scheme is Scheme.SERIAL,
        ranges_are_stream=ranges is not None and ranges.scheme is Scheme.SERIAL,
    )
    cleared = clearance(arguments.preflight, arguments.waive, arguments.mission, arguments.id, now_unix_s=time.time())
    endpoint.agent.ground(cleared.grounded)
    endpoint.agent.waive(",".join(cleared.waived), cleared.unknown)
    watch = Watch(log, endpoint, autopilot, peers, sensor)
    service = Service(os.environ, os.getpid())
    opened.callback(service.close)
    runner = Runner(endpoint, autopilot, peers, watch, stop, service, sensor, radio)
    log.line(None, _start_line(arguments, mission))
    for link, url in ((autopilot, arguments.autopilot), (sensor, obstacles), (radio, ranges)):
        if (
            link is not None and url is not None and not link.up
        ):  # USB is late at boot; the companion says so in its status too
            log.line(
                None,
                f"no {url.place}: is it plugged in? Opened once it is there (ls /dev/tty* /dev/serial/by-id lists all)",
            )
    faulthandler.enable(log_fd)  # where it hung: the watchdog ends a hung companion by SIGABRT
    opened.callback(faulthandler.disable)
    if cleared.waived:
        log.line(None, f"preflight WAIVED: {', '.join(cleared.waived)}")
    if cleared.unknown:
        log.line(None, cleared.unknown)
    log.line(None, f"GROUNDED, nothing is armed: {cleared.grounded}" if cleared.grounded else "cleared to arm")
    gc.collect()
    gc.freeze()  # what is there now stays: later collections need not look at it
    try:
        if by_vehicle:
            runner.by_vehicle(endpoint.hello())
        else:
            runner.by_monotonic()
    except Exception:  # noqa: BLE001  not swallowed: the process ends here, and setpoints with it
        log.broken(runner.now_s, traceback.format_exc())
        return EXIT_BROKEN
    service.stopping()
    log.line(
        runner.now_s,
        f"stopped by {stop.reason}, nothing is commanded any more; ticks {runner.ticks}, "
        f"missed {runner.missed}, {summary(watch.counters())}, log lines lost {log.lost}",
    )
    return EXIT_DONE


def _start_line(arguments: argparse.Namespace, mission: Mission) -> str:
    utc = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    obstacles = "" if arguments.obstacles is None else f"obstacles {arguments.obstacles}, "
    ranges = "" if arguments.ranges is None else f"ranges {arguments.ranges}, "
    return (
        f"companion {__version__}, {STATE}, vehicle {arguments.id} of {mission.swarm.size}, "
        f"mission {mission.name or 'unnamed'!r}, autopilot {arguments.autopilot}, peers {arguments.peers}, "
        f"{obstacles}{ranges}clock {arguments.clock}, started {utc}"
    )


def _log_fd(path: str | None, opened: ExitStack) -> int:
    if path is None:
        return sys.stderr.fileno()
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK
    try:
        fd = os.open(path, flags, 0o644)
    except (OSError, ValueError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or str(error)
        raise RefusedError(
            EXIT_ENVIRONMENT, f"--log {printable(path)}: cannot be opened for writing: {reason}"
        ) from None
    opened.callback(os.close, fd)
    return fd


def _open(option: str, url: Url, opened: ExitStack, *, may_be_absent: bool = False, hears_all: bool = False) -> Link:
    try:
        link = open_link(url, may_be_absent=may_be_absent, hears_all=hears_all)
    except LinkError as error:
        raise RefusedError(EXIT_ENVIRONMENT, f"{option} {error}") from None
    opened.callback(link.close)
    return link


if __name__ == "__main__":
    sys.exit(main())
