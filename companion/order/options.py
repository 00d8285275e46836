"""`companion order` on the command line, without what it needs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

from mission.common.problems import printable

_ABOUT = """\
Orders of the operator's key to a whole swarm: START, HOLD, LAND, ABORT. Any vehicle that hears one passes it on, and
none can make one. The radio is listened to, and the order sent until each vehicle that is heard acts on it.
"""

_MORE = """\
docs/how-to/start-hold-land-abort.md says what each order does, and when to give which.

The count of orders is kept beside the key, in KEY.orders: keep it with the key.

exit codes: 0 each vehicle that is heard acts on it, 1 some do not (they are named), or none is heard, 2 wrong usage,
a bad mission or key, or not confirmed, 3 a port or a file cannot be opened or written
"""

_KINDS = {
    "start": "fly the mission; in the air: go on after a hold",
    "hold": "every vehicle holds where it is, until the next start",
    "land": "the swarm spreads out level and lands, as at the mission's end",
    "abort": "every vehicle lands where it is, now",
}

_GATEWAY = """\
Makes orders of what a ground station commands: MISSION_START is START, DO_PAUSE_CONTINUE is HOLD (param1 = 0) or START
(1), NAV_LAND is ABORT. It answers for component 191 of each vehicle of the mission, and of system 253.
"""

_GATEWAY_MORE = """\
Whoever reaches --ground-station gives orders with the operator's key: keep it to this computer (127.0.0.1).
A START that finds vehicles not ready is refused once, with their names; the same command within 10 s means it.

exit codes: 0 stopped, 2 wrong usage, a bad mission or key, 3 a port or a file cannot be opened or written
"""

FOR_S = 15.0


def add_order_commands(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    *,
    peers: Callable[[str], object],
    ground_station: Callable[[str], object],
    vehicle: Callable[[str], int],
) -> None:
    """`order` with its own commands. The arguments: parsers of URLs, and of a vehicle's number."""
    order = _add(commands, "order", "start, hold, land or abort with the operator's key", _ABOUT, _MORE)
    inner = order.add_subparsers(dest="order_command", required=True, metavar="ORDER")
    for kind, about in _KINDS.items():
        one = _add(inner, kind, about, f"{about[0].upper()}{about[1:]}.", _MORE)
        _add_links(one, peers)
        one.add_argument(
            "--for-s",
            type=_duration,
            default=FOR_S,
            metavar="S",
            help=f"send no longer than this, in seconds (default: {FOR_S:.0f})",
        )
        if kind == "start":
            one.add_argument("--yes", action="store_true", help="ask nothing, whoever is missing")
            one.add_argument(
                "--hand-back",
                type=vehicle,
                default=0,
                metavar="K",
                help="steer this vehicle again, which a pilot has taken over",
            )
    gateway = _add(inner, "gateway", "make orders of a ground station's commands", _GATEWAY, _GATEWAY_MORE)
    _add_links(gateway, peers)
    gateway.add_argument(
        "--ground-station",
        required=True,
        type=ground_station,
        metavar="URL",
        help="link to the ground station, as udpin://127.0.0.1:14590",
    )


def _duration(text: str) -> float:
    try:
        duration_s = float(text)
    except ValueError:
        duration_s = math.nan
    if not 0.0 < duration_s < math.inf:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be a number of seconds above 0")
    return duration_s


def _add_links(one: argparse.ArgumentParser, peers: Callable[[str], object]) -> None:
    one.add_argument("--key", required=True, metavar="FILE", help="the operator's key file")
    one.add_argument("--mission", required=True, metavar="FILE", help="mission file (TOML); the swarm's own")
    one.add_argument("--peers", required=True, type=peers, metavar="URL", help="link to the companions")


def _add(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, about: str, text: str, more: str
) -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    return commands.add_parser(name, help=about, description=text, epilog=more, formatter_class=raw)
