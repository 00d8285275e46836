"""Options of `sim-bridge serve`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mission.cli.main import EXIT_BAD_FILE
from mission.common.problems import printable
from mission.schema.kinds import MAX_VEHICLES, Estimates, Personality
from sim_bridge.errors import StartError
from sim_bridge.options.ports import PORT_MAX, Address, add_map, loopback, port

SPEED_MIN, SPEED_MAX = 0.01, 100.0
STREAMS = ("px4", "minimal")
_ABOUT = """\
Flies the vehicles of a mission on the wall clock and offers them over UDP on 127.0.0.1 as PX4 does: to ground
stations (QGroundControl, MAVProxy, MAVSDK) and to companions. Prints where to connect; ends with Ctrl-C.
"""
_MORE = """\
exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a bad mission, 3 a taken port or a missing package
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `serve`."""
    parser.description = _ABOUT
    parser.epilog = _MORE
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
        "--estimates",
        choices=[estimates.value for estimates in Estimates],
        help="what autopilots know of position, velocity and yaw, instead of the mission's sim.estimates",
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
        type=port,
        default=0,
        metavar="P",
        help="for ground stations that connect (a free one)",
    )
    parser.add_argument(
        "--ground",
        type=loopback,
        metavar="HOST:PORT",
        help="a ground station that listens on this machine, as QGroundControl at 127.0.0.1:14550 (none)",
    )
    parser.add_argument(
        "--first-port", type=port, default=0, metavar="P", help="vehicle 1's, then counting up (free ones)"
    )
    parser.add_argument(
        "--first-sensor-port",
        type=port,
        default=0,
        metavar="P",
        help="vehicle 1's obstacle sensor's, then counting up, in a mission with [sensing] (free ones)",
    )
    parser.add_argument(
        "--onboard-to",
        type=onboard_to,
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
        "--radio-port", type=port, default=0, metavar="P", help="for the companions' beacons (a free one)"
    )
    parser.add_argument(
        "--keys",
        type=Path,
        metavar="FLEET",
        help="folder of `companion key new`: the commands that are printed sign by it, and orders are the operator's",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="where to write the mission as flown, for the companions (a temporary file)",
    )
    add_map(parser, "")
    parser.add_argument("--json", action="store_true", help="print one JSON object, when ready")


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not SPEED_MIN <= speed <= SPEED_MAX:  # false for NaN
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be {SPEED_MIN:g}..{SPEED_MAX:g}")
    return speed


@dataclass(frozen=True, slots=True)
class OnboardTo:
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


def onboard_to(text: str) -> OnboardTo:
    """HOST:PORT, or HOST:PORT+ for a row."""
    return OnboardTo(loopback(text.removesuffix("+")), text.endswith("+"))
