"""`sim-bridge serve`: the command line of a world on the wall clock."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import json
import math
import os
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from mission import simulator
from mission.cli import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.fields import MAX_VEHICLES
from mission.load import MAX_PLACE_CHARS, dump_mission, load_mission
from mission.model import Mission, Personality, ScansVia
from mission.problems import MissionError, printable
from mission.stand_beside import stand_beside
from sim_bridge.drive import notice
from sim_bridge.drive.ports import PORT_MAX, Address
from sim_bridge.drive.server import Pacer, PortPlan, Server, open_ports
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.base import AirframeError
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.autopilot import PROFILES, Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World

SPEED_MIN, SPEED_MAX = 0.01, 100.0
STREAMS = {"px4": PROFILES, "minimal": dict.fromkeys(Link, StreamProfile.MINIMAL)}
_ABOUT = """\
Flies the vehicles of a mission on the wall clock and offers them over UDP on 127.0.0.1 as PX4 does: to ground
stations (QGroundControl, MAVProxy, MAVSDK) and to companions. Prints where to connect; ends with Ctrl-C.
"""
_EXAMPLE = """\
example:
  sim-bridge serve mission/examples/paper.toml -n 3 --ground 127.0.0.1:14550

exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a bad mission, 3 a taken port or a missing package
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `serve`."""
    parser.description = _ABOUT
    parser.epilog = _EXAMPLE
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("mission", metavar="MISSION", help="a mission file (TOML)")
    parser.add_argument("-n", type=int, metavar="N", help=f"number of vehicles, 1..{MAX_VEHICLES} (the mission's)")
    parser.add_argument("--seed", type=int, metavar="S", help="of placement, wind and radio (the mission's)")
    parser.add_argument(
        "--personality",
        choices=[personality.value for personality in Personality],
        help="of every autopilot, instead of the mission's sim.personality and sim.personalities",
    )
    parser.add_argument(
        "--speed",
        type=_speed,
        default=1.0,
        metavar="FACTOR",
        help=f"simulated over wall time, {SPEED_MIN:g}..{SPEED_MAX:g} (1); MAVSDK's own timers want 1",
    )
    parser.add_argument(
        "--ground-port",
        type=_port,
        default=0,
        metavar="P",
        help="for ground stations that connect (a free one)",
    )
    parser.add_argument(
        "--ground",
        type=_loopback,
        metavar="HOST:PORT",
        help="a ground station that listens on this machine, as QGroundControl at 127.0.0.1:14550 (none)",
    )
    parser.add_argument(
        "--first-port", type=_port, default=0, metavar="P", help="vehicle 1's, then counting up (free ones)"
    )
    parser.add_argument(
        "--first-sensor-port",
        type=_port,
        default=0,
        metavar="P",
        help="vehicle 1's obstacle sensor's, then counting up, in a mission with [sensing] (free ones)",
    )
    parser.add_argument(
        "--onboard-to",
        type=_onboard_to,
        metavar="HOST:PORT[+]",
        help="send every vehicle's onboard stream there unasked, as PX4 does; with a + the port counts up (nowhere)",
    )
    parser.add_argument(
        "--streams",
        choices=STREAMS,
        default="px4",
        help="as PX4 by default (400 messages a second for each companion), or only what is asked for (px4)",
    )
    parser.add_argument(
        "--radio-port", type=_port, default=0, metavar="P", help="for the companions' beacons (a free one)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="where to write the mission as flown, for the companions (a temporary file)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, when ready")


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; returns the exit code."""
    try:
        mission = _mission(args)
        has_ports = mission.sensing is not None and mission.sim.lidar.via is ScansVia.LINK
        if args.first_sensor_port and not has_ports:
            why = "has no [sensing]" if mission.sensing is None else "sends scans by way of the autopilots"
            raise StartError(f"--first-sensor-port: {printable(args.mission)} {why}", EXIT_BAD_FILE)
        first_sensor = args.first_sensor_port if has_ports else None
        plan = PortPlan(args.ground_port, args.radio_port, args.first_port, args.ground, first_sensor)
        with _Stop() as stop, contextlib.ExitStack() as stack:
            ports = open_ports(plan, range(1, mission.swarm.size + 1))
            stack.callback(ports.close)
            stand = stand_beside(mission, args.mission)
            world = World(mission, jsbsim_airframes(mission), links=STREAMS[args.streams], stand=stand)
            mission_file = stack.enter_context(_written(mission, args.out))
            onboard = args.onboard_to.of(world.vehicles) if args.onboard_to else None
            server = Server(world, ports, push=args.ground, push_onboard=onboard, say=_to_stderr)
            stack.callback(server.close)
            where = notice.where(mission, mission_file, ports, args.speed)
            print(json.dumps(where) if args.json else notice.table(where, args.ground), flush=True)
            _serve(server, args.speed, stop)
    except MissionError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except StartError as error:
        _to_stderr(str(error))
        return error.exit_code
    except AirframeError as error:
        _to_stderr(str(error))
        return EXIT_ENVIRONMENT
    return EXIT_DONE


def _serve(server: Server, speed: float, stop: _Stop) -> None:
    pacer = Pacer(time.monotonic(), speed)
    while not stop.asked:
        share = server.turn(pacer)
        if share is not None:
            _to_stderr(f"this machine reaches {share * speed:.2f} x real time, not {speed:g}: going on at that")


class _Stop:
    """SIGINT and SIGTERM ask to stop; they no longer interrupt."""

    def __init__(self) -> None:
        self.asked = False
        self._before: list[tuple[signal.Signals, Any]] = []

    def __enter__(self) -> _Stop:
        self._before = [(n, signal.signal(n, self._ask)) for n in (signal.SIGINT, signal.SIGTERM)]
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True


def _to_stderr(message: str) -> None:
    print(f"sim-bridge serve: {message}", file=sys.stderr, flush=True)


def _mission(args: argparse.Namespace) -> Mission:
    mission = load_mission(args.mission)
    if args.personality is not None:
        mission = mission.with_personality(args.personality)
    if args.n is not None:
        mission = mission.with_size(args.n, place="-n")
    if args.seed is not None:
        mission = mission.with_seed(args.seed)
    simulator.check(mission, str(args.mission))
    simulator.needs_satellites(mission, str(args.mission), "`serve` has no range radios: `sim-bridge fly` has")
    return mission if mission.origin else mission.with_origin(DEFAULT_ORIGIN)


@contextlib.contextmanager
def _written(mission: Mission, out: Path | None) -> Iterator[Path]:
    """The mission as flown, in `out`, or in a temporary file for as long as it is served."""
    with contextlib.ExitStack() as stack:
        try:
            if out is None:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="understory-"))
                out = Path(folder, "mission.toml")
            out.write_text(dump_mission(mission), encoding="utf-8")
        except OSError as error:
            place = printable(str(out or tempfile.gettempdir()), MAX_PLACE_CHARS)
            reason = os.strerror(error.errno or 0)
            raise StartError(f"--out: cannot write {place}: {reason}", EXIT_ENVIRONMENT) from None
        yield out.absolute()


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not SPEED_MIN <= speed <= SPEED_MAX:  # false for NaN
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be {SPEED_MIN:g}..{SPEED_MAX:g}")
    return speed


def _port(text: str) -> int:
    port = int(text) if text.isascii() and text.isdecimal() and len(text) <= 5 else 0
    if not 1 <= port <= PORT_MAX:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be 1..{PORT_MAX}")
    return port


@dataclass(frozen=True, slots=True)
class _OnboardTo:
    """One address for all vehicles, or vehicle 1's of a row."""

    first: Address
    counts_up: bool

    def of(self, ids: Iterable[int]) -> dict[int, Address]:
        """By vehicle id. StartError when the row does not end in time."""
        host, port = self.first
        addresses = {k: (host, port + k - 1 if self.counts_up else port) for k in ids}
        if any(number > PORT_MAX for _, number in addresses.values()):
            raise StartError(f"--onboard-to: port {port} and up is too high for so many vehicles", EXIT_BAD_FILE)
        return addresses


def _onboard_to(text: str) -> _OnboardTo:
    return _OnboardTo(_loopback(text.removesuffix("+")), text.endswith("+"))


def _loopback(text: str) -> Address:
    """HOST:PORT, with a host that is this machine: the bridge speaks to no other."""
    host, _, port = text.rpartition(":")
    try:
        address = socket.gethostbyname(host)
    except (OSError, UnicodeError):
        address = ""
    if not address or not ipaddress.ip_address(address).is_loopback:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be on this machine, as 127.0.0.1:14550")
    return address, _port(port)
