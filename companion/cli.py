"""`companion`: the program on the vehicle's companion computer."""

from __future__ import annotations

import argparse
import gc
import io
import sys
from collections.abc import Callable, Sequence

from companion import help_texts
from companion.journal.options import add_black_box_option, add_replay_command
from companion.keys.options import add_key_commands
from companion.lidar.options import MODEL_NAMES, RAW_NAMES, parse_band, parse_mask
from companion.order.options import add_order_commands
from companion.radio_options import add_base_keys, add_preflight_keys, add_run_keys
from companion.sensor_options import add_sensor_options
from companion.shell.urls import AUTOPILOT_SCHEMES, PEERS_SCHEMES, Scheme, Url, UrlError, parse_url
from companion.stand.form_height import FORM_HEIGHT_M
from companion.watch.address import PORT, address_of
from mission import __version__
from mission.common.command_line import Parser, add_examples
from mission.common.compiled import STATE
from mission.common.completion import add_print_completion
from mission.common.exit_codes import EXIT_ENVIRONMENT
from mission.common.problems import printable


def build_parser() -> argparse.ArgumentParser:
    """The command line; also read by the generator of the reference."""
    raw = argparse.RawDescriptionHelpFormatter
    parser: argparse.ArgumentParser = Parser(
        prog="companion",
        description=help_texts.ABOUT,
        epilog=help_texts.EXAMPLE,
        formatter_class=raw,
    )
    parser.add_argument("--version", action="version", version=f"understory {__version__}, {STATE}")
    add_print_completion(parser, build_parser)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = commands.add_parser(
        "run",
        help="fly one vehicle's part of a mission",
        description=help_texts.RUN,
        epilog=help_texts.RUN_MORE,
        formatter_class=raw,
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
        "--autopilot", required=True, type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="link to the autopilot"
    )
    run.add_argument(
        "--peers", required=True, type=_url(PEERS_SCHEMES), metavar="URL", help="link to the other companions"
    )
    add_sensor_options(run, "link to a sensor's driver, as obstacles=udpin://127.0.0.1:14570; may be repeated")
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
    add_run_keys(run)
    run.add_argument("--clock", choices=("monotonic", "vehicle"), default="monotonic", help="default: monotonic")
    run.add_argument("--log", metavar="FILE", help="append the flight log to FILE; default: stderr")
    run.add_argument(
        "--records",
        metavar="FILE",
        help="database of what is measured, of a mission with [survey]; a companion that starts again goes on with it; "
        "default: beside the flight log, or in $STATE_DIRECTORY, one for each mission and vehicle",
    )
    add_black_box_option(run)
    add_replay_command(commands)
    _add_preflight(commands)
    _add_doctor(commands)
    _add_watch(commands)
    _add_lidar(commands)
    _add_base(commands)
    _add_stand(commands)
    add_key_commands(commands)
    add_order_commands(commands, peers=_url(PEERS_SCHEMES), ground_station=_url(PEERS_SCHEMES), vehicle=_vehicle_id)
    add_examples(parser, help_texts.EXAMPLES)
    return parser


def _add_preflight(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    preflight = commands.add_parser(
        "preflight",
        help="check one vehicle before its flight",
        description=help_texts.PREFLIGHT,
        epilog=help_texts.PREFLIGHT_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    preflight.add_argument("--mission", required=True, metavar="FILE", help="mission file (TOML) with an [origin]")
    preflight.add_argument("--id", required=True, type=_vehicle_id, metavar="K", help="this vehicle's number")
    preflight.add_argument(
        "--autopilot", required=True, type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="link to the autopilot"
    )
    add_sensor_options(preflight, "as for `companion run`")
    preflight.add_argument(
        "--apply", action="store_true", help="set wrong parameters and the fence, and read them back; never while armed"
    )
    add_preflight_keys(preflight)
    preflight.add_argument("--report", metavar="FILE", help="write the report to FILE, for `companion run --preflight`")
    preflight.add_argument("--json", action="store_true", help="print the report as JSON instead of a table")


def _add_doctor(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    doctor = commands.add_parser(
        "doctor",
        help="look for what is wrong with this computer and its links",
        description=help_texts.DOCTOR,
        epilog=help_texts.DOCTOR_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    doctor.add_argument("--autopilot", type=_url(AUTOPILOT_SCHEMES), metavar="URL", help="listen there for heartbeats")
    doctor.add_argument("--peers", type=_url(PEERS_SCHEMES), metavar="URL", help="listen there for other companions")
    add_sensor_options(doctor, "listen there for a sensor's driver; may be repeated")
    doctor.add_argument("--key", metavar="FILE", help="check this key file, and show whose it is")
    doctor.add_argument("--json", action="store_true", help="print JSON instead of a table")


def _add_watch(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    watch = commands.add_parser(
        "watch",
        help="show the swarm on a tablet, from its beacons",
        description=help_texts.WATCH,
        epilog=help_texts.WATCH_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    watch.add_argument(
        "--peers", required=True, type=_url(PEERS_SCHEMES), metavar="URL", help="where the companions are heard"
    )
    watch.add_argument(
        "--listen",
        type=_checked(address_of),
        default=("127.0.0.1", PORT),
        metavar="ADDRESS[:PORT]",
        help=f"where tablets reach this computer, with a token (default: 127.0.0.1:{PORT}, this computer alone)",
    )
    watch.add_argument("--mission", metavar="FILE", help="draw its places, and look at its fence")
    watch.add_argument(
        "--key",
        metavar="FILE",
        help="the operator's key file: show only what the swarm has signed, and say who else speaks (with --mission)",
    )
    watch.add_argument(
        "--orders",
        action="store_true",
        help="take START, HOLD, LAND and ABORT from the page, and send them with the key (with --key and --mission)",
    )
    watch.add_argument(
        "--map", metavar="FILE", help="MBTiles of pictures, or an image with its world file (a metre grid)"
    )
    watch.add_argument("--utm", metavar="ZONE", help="of an image whose world file is in UTM: 32N, or EPSG:32632")


def _add_lidar(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    lidar = commands.add_parser(
        "lidar",
        help="read a lidar, and send what it sees to the companion",
        description=help_texts.LIDAR,
        epilog=help_texts.LIDAR_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    lidar.add_argument("--model", required=True, choices=MODEL_NAMES, help="the lidar")
    lidar.add_argument(
        "--lidar",
        required=True,
        type=_url(frozenset({Scheme.SERIAL, Scheme.UDP_IN})),
        metavar="URL",
        help="where it is read: its serial port and baud rate; of a mid360 this computer's address and port (56301)",
    )
    lidar.add_argument("--id", type=_vehicle_id, metavar="K", help="this vehicle's number; needed but for --check")
    lidar.add_argument(
        "--to",
        type=_url(frozenset({Scheme.UDP_OUT})),
        metavar="URL",
        help="where `companion run --sensor obstacles=URL` waits; needed but for --check",
    )
    lidar.add_argument("--component", type=int, default=196, metavar="N", help="MAVLink component id (default: 196)")
    lidar.add_argument(
        "--yaw-deg",
        type=float,
        default=0.0,
        metavar="DEG",
        help="bearing, clockwise from the nose, at which the lidar's zero looks (default: 0)",
    )
    lidar.add_argument("--upside-down", action="store_true", help="it hangs, turned over about the axis of its zero")
    lidar.add_argument(
        "--mask",
        type=_checked(parse_mask),
        default=frozenset(),
        metavar="FROM..TO[,...]",
        help="bearings that the airframe blocks, clockwise from the nose: said to be unknown",
    )
    lidar.add_argument(
        "--range-m", type=float, metavar="M", help="as far as `nothing there` is to be believed (default: its maker's)"
    )
    lidar.add_argument(
        "--raw",
        choices=RAW_NAMES,
        help="send every ray (SWARM_LIDAR_SCAN) to `companion run --sensor lidar=URL`, as the mission's sensing.sensor "
        "says, instead of sectors",
    )
    lidar.add_argument(
        "--band-m",
        type=_checked(parse_band),
        metavar="LOW..HIGH",
        help="of a mid360's sectors: heights above it that count as obstacles, in the vehicle's own frame "
        "(default: -0.5..0.5)",
    )
    lidar.add_argument(
        "--configure",
        metavar="ADDRESS[:PORT]",
        help="of a mid360: tell the lidar at this IPv4 address to send its points to the address of --lidar",
    )
    lidar.add_argument(
        "--check", action="store_true", help="send nothing; check the mounting with you walking about it"
    )


def _add_base(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    base = commands.add_parser(
        "base",
        help="collect the swarm's records on a computer at the base",
        description=help_texts.BASE,
        epilog=help_texts.BASE_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    base.add_argument("mission", metavar="MISSION", help="mission file (TOML) with [survey]; the swarm's own")
    add_base_keys(base)
    base.add_argument("--listen", required=True, type=_url(PEERS_SCHEMES), metavar="URL", help="link to the companions")
    base.add_argument(
        "--records",
        required=True,
        metavar="FILE",
        help="database of what is collected; one that is there is gone on with",
    )


def _add_stand(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    stand = commands.add_parser(
        "stand",
        help="make stem map, stand table and report from surveyed records",
        description=help_texts.STAND,
        epilog=help_texts.STAND_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    stand.add_argument(
        "records",
        nargs="+",
        metavar="RECORDS",
        help="stores of records (SQLite), the base station's or vehicles': each record counts once",
    )
    stand.add_argument("--mission", required=True, metavar="FILE", help="mission file (TOML) that was flown")
    stand.add_argument("--out", required=True, metavar="DIR", help="folder for the files; it is made")
    stand.add_argument(
        "--form-height-m",
        type=_form_height_m,
        default=FORM_HEIGHT_M,
        metavar="M",
        help=f"volume over basal area of this stand, from your tables (default: {FORM_HEIGHT_M:.1f}, Denzin's)",
    )
    stand.add_argument("--cloud", nargs="+", default=[], metavar="FILE", help=help_texts.CLOUD)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code (SystemExit for --help, --version and wrong usage)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that lacks a letter is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    arguments = build_parser().parse_args(argv)
    # Each command loads what it needs, and --help none of it
    if arguments.command == "doctor":
        from companion.doctor import doctor

        return doctor(arguments)
    if arguments.command == "replay":
        from companion.journal.command import replay

        return replay(arguments)
    if arguments.command == "watch":
        from companion.watch.command import watch

        return watch(arguments)
    if arguments.command == "stand":
        return _make_stand(arguments)
    if arguments.command == "lidar":
        from companion.lidar.command import read_lidar

        return read_lidar(arguments)
    if arguments.command == "base":
        from companion.base.command import base

        return base(arguments)
    if arguments.command == "key":
        from companion.keys.command import key

        return key(arguments)
    if arguments.command == "order":
        from companion.order.command import order

        return order(arguments)
    gc.disable()  # what loading makes stays
    from companion import run_command

    gc.freeze()
    gc.enable()
    return run_command.main(arguments)


def _vehicle_id(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{printable(text)!r} is no vehicle id: 1 to 250 (set UNDERSTORY_ID in /etc/understory/companion.env)"
        ) from None


def _make_stand(arguments: argparse.Namespace) -> int:
    try:
        from companion.stand.command import stand
    except ModuleNotFoundError as error:  # vehicles do without numpy and scipy
        why = f"{error.name} is not installed: in the checkout, pip install -e '.[stand]'"
        print(f"companion: stand: {why}", file=sys.stderr)
        return EXIT_ENVIRONMENT
    return stand(arguments)


def _form_height_m(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 1.0 <= value <= 60.0:
        raise argparse.ArgumentTypeError(f"{printable(text)!r}: must be from 1 to 60 m")
    return value


def _url(allowed: frozenset[Scheme]) -> Callable[[str], Url]:
    def parse(text: str) -> Url:
        try:
            return parse_url(text, allowed)
        except UrlError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse


def _checked(parse: Callable[[str], object]) -> Callable[[str], object]:
    """`parse`, whose ValueError says what is wrong: argparse would leave that out."""

    def checked(text: str) -> object:
        try:
            return parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return checked


def _names(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    if not all(name.isidentifier() for name in names):  # checks are named as the parameters: letters, digits, _
        raise argparse.ArgumentTypeError(f"{printable(text)!r}: must be names of checks, with commas between them")
    return names


if __name__ == "__main__":
    sys.exit(main())
