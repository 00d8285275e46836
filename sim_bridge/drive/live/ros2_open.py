"""`--zenoh` of `sim-bridge fly`: its options against the mission, and the topics of a flight."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_ENVIRONMENT
from mission.common.problems import printable
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from sim_bridge.errors import StartError
from sim_bridge.options.fly import DOMAIN_MAX

if TYPE_CHECKING:
    from sim_bridge.drive.live.ros2_topics import Flown

DOMAIN_VARIABLE: Final = "ROS_DOMAIN_ID"  # as ROS 2 itself reads it


def check_options(args: argparse.Namespace, mission: Mission) -> None:
    """StartError where they do not fit each other, or the mission. A flight by others' scans goes in real time."""
    if args.zenoh is None:
        if args.zenoh_scans or args.ros_domain is not None:
            raise StartError("--zenoh-scans and --ros-domain want --zenoh", EXIT_BAD_FILE)
        return
    if args.autopilots is not None:
        raise StartError("--zenoh: flies in the bridge alone, not over --autopilots", EXIT_BAD_FILE)
    if not args.zenoh_scans:
        return
    absent = [k for k in args.zenoh_scans if k > mission.swarm.size]
    if absent:
        raise StartError(
            f"--zenoh-scans {absent[0]}: the mission has vehicles 1 to {mission.swarm.size}", EXIT_BAD_FILE
        )
    if mission.sensing is None or mission.sensing.sensor is not SensorClass.SECTORS:
        raise StartError('--zenoh-scans: the mission must have [sensing], with sensor = "sectors"', EXIT_BAD_FILE)
    args.speed = 1.0 if args.speed is None else args.speed


def open_topics(args: argparse.Namespace, mission: Mission, stack: ExitStack) -> Callable[[Flown], None] | None:
    """Publisher to be called after each tick; None: nothing is published. StartError: no library, or nobody there."""
    if args.zenoh is None:
        return None
    domain = _domain_of(os.environ.get(DOMAIN_VARIABLE, "")) if args.ros_domain is None else args.ros_domain
    try:
        from sim_bridge.drive.live.ros2_topics import Ros2Topics
        from sim_bridge.drive.live.zenoh_session import ZenohSession
    except ModuleNotFoundError as error:
        why = f"--zenoh: {error.name} is not installed: in the checkout, pip install -e '.[sim,zenoh]'"
        raise StartError(why, EXIT_ENVIRONMENT) from None
    session = ZenohSession(args.zenoh, domain)
    stack.callback(session.close)
    return Ros2Topics(session, range(1, mission.swarm.size + 1), args.zenoh_scans).publish


def _domain_of(text: str) -> int:
    if not text:
        return 0
    number = int(text) if text.isascii() and text.isdecimal() and len(text) <= 3 else -1
    if not 0 <= number <= DOMAIN_MAX:
        raise StartError(f"{DOMAIN_VARIABLE} = {printable(text)}: must be 0..{DOMAIN_MAX}", EXIT_BAD_FILE)
    return number
