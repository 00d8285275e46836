"""Options of `sim-bridge fly`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from mission.common.problems import printable
from mission.schema.kinds import Estimates, Personality
from sim_bridge.options.fault_forms import GRAMMAR, OPTIONS
from sim_bridge.options.ports import PORT_FIELD, add_map

ROUTER = "tcp/localhost:7447"  # where rmw_zenohd listens
DOMAIN_MAX = 232  # of ROS 2
SPEED_MIN = 0.01  # slower, a flight takes days


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge fly`."""
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission file (TOML)")
    parser.add_argument("-n", type=int, metavar="N", help="vehicles, 1..250, instead of the mission's swarm.size")
    parser.add_argument("--seed", type=int, metavar="S", help="instead of the mission's sim.seed")
    parser.add_argument(
        "--personality",
        choices=[personality.value for personality in Personality],
        help="of every autopilot, instead of the mission's sim.personality and sim.personalities",
    )
    parser.add_argument(
        "--estimates",
        choices=[estimates.value for estimates in Estimates],
        help="what simulated autopilots know of position, velocity and yaw, instead of the mission's sim.estimates",
    )
    parser.add_argument(
        "--speed",
        type=_speed,
        default=None,
        metavar="max|FACTOR",
        help="as fast as it goes (max, the default), or so many times real time",
    )
    parser.add_argument(
        "--airframe",
        choices=("jsbsim", "point-mass"),
        help="jsbsim (the default): quadrotors with flight dynamics. point-mass: bodies that follow their commanded "
        "velocity with a lag of 0.3 s, in still air: quicker, for a first look",
    )
    parser.add_argument(
        "--agents",
        choices=("processes", "in-process"),
        help="each companion a program of its own (default, without --law), or all in this one; the flight is the same "
        "to the bit",
    )
    parser.add_argument(
        "--signed",
        action="store_true",
        help="with keys of this flight: frames of the radio are signed, and the start is an order of the operator's "
        "key. Companions that are processes have theirs in the run folder, in keys/, readable by you alone",
    )
    add_entrant(parser)
    wrong = parser.add_argument_group("simulated faults", f"Besides the mission's [[sim.faults]]. {GRAMMAR}")
    for kind, (forms, example, what) in OPTIONS.items():
        repeated = f"{what}, as {example}; may be repeated"
        wrong.add_argument(
            f"--{kind.value}", dest=kind.value, action="append", default=[], metavar=forms[0], help=repeated
        )
    external = parser.add_argument_group(
        "external autopilots",
        "Fly over PX4 or ArduPilot that runs elsewhere, in a simulator or in hardware, on the wall clock. "
        "Vehicle k's has the system id k. Without an [origin], the first vehicle's home is below d1.",
    )
    external.add_argument(
        "--autopilots",
        metavar="URL",
        help=f"udpin://HOST:PORT (they send to us) or udpout://HOST:PORT (we send to them); PORT {PORT_FIELD}: one "
        "for each vehicle, else all share it",
    )
    external.add_argument(
        "--launch",
        metavar="COMMAND",
        help="start one for each vehicle, and end it with the flight; {index} from 0, {sysid} from 1 and "
        f"{PORT_FIELD} are filled in; no shell",
    )
    external.add_argument(
        "--first-port", type=int, metavar="P", help=f"vehicle 1's {PORT_FIELD}, then counting up (free ones)"
    )
    add_ros2(parser)
    parser.add_argument(
        "--black-box",
        action="store_true",
        help="each companion records every input and output in the run folder's black-box/, for `companion replay`",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="run folder, new or empty (default: under runs/)")
    parser.add_argument("-v", "--verbose", action="store_true", help="print all figures, not only the verdict")
    parser.add_argument("--json", action="store_true", help="metrics.json's content on standard output")
    add_map(parser, "; the flight slows down to 5 times real time while somebody looks")
    parser.add_argument(
        "--open",
        action="store_true",
        help="show the map in the browser, or without one the replay when it is over; nothing without a display",
    )
    parser.add_argument(
        "--stay",
        action=argparse.BooleanOptionalAction,
        help="with --map: wait some seconds for the first look, and keep the map, with the replay in it, until Ctrl-C "
        "when the flight is over (default: on a terminal)",
    )


def add_ros2(parser: argparse.ArgumentParser) -> None:
    """Adds the options for what ROS 2 sees of the flight."""
    ros2 = parser.add_argument_group(
        "ROS 2 over Zenoh",
        "In the bridge alone: topics of each vehicle while it flies, as rmw_zenoh_cpp 0.2.4 and later have them "
        "(docs/how-to/fly-with-ros-2.md). Needs the extra `zenoh`.",
    )
    ros2.add_argument(
        "--zenoh",
        nargs="?",
        const=ROUTER,
        metavar="ENDPOINT",
        help=f"publish odometry, scans, setpoints, battery, state and the clock by the router or peer there ({ROUTER})",
    )
    ros2.add_argument(
        "--zenoh-scans",
        type=_vehicles,
        default=(),
        metavar="VEHICLES",
        help="ids as 1,2,3: their scans are what others publish on /vehicle_K/scan, and are not simulated; the flight "
        "goes in real time where --speed says nothing else",
    )
    ros2.add_argument(
        "--ros-domain", type=_domain, metavar="N", help="default: that of ROS_DOMAIN_ID in the environment, else 0"
    )


def _vehicles(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isascii() and part.isdecimal() and len(part) <= 3 and int(part) for part in parts):
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be ids of vehicles, as 1,2,3")
    return tuple(sorted({int(part) for part in parts}))


def _domain(text: str) -> int:
    number = int(text) if text.isascii() and text.isdecimal() and len(text) <= 3 else -1
    if not 0 <= number <= DOMAIN_MAX:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be 0..{DOMAIN_MAX}")
    return number


def add_entrant(parser: argparse.ArgumentParser) -> None:
    """Adds the options for what flies in place of ours."""
    entrant = parser.add_argument_group("another law", "In the bridge alone, with all agents in this program.")
    entrant.add_argument(
        "--law",
        metavar="LAW",
        help="law of movement in place of ours: a .py file, the name of an installed law, or a module that can be "
        "imported (docs/how-to/fly-your-own-law.md)",
    )
    entrant.add_argument(
        "--no-safety-filter",
        dest="safety_filter",
        action="store_false",
        help="fly what the law desires, within the speed limits; the verdict says so",
    )


def _speed(text: str) -> float | None:
    if text == "max":
        return None
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not SPEED_MIN <= factor < math.inf:  # false for NaN
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be max, or a factor of at least {SPEED_MIN:g}")
    return factor
