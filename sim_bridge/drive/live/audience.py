"""People at a live map: is somebody there who may look, and how long the map waits for them, before and after."""

from __future__ import annotations

import os
import sys
from typing import Final

from sim_bridge.drive.interrupts import interrupt_once
from sim_bridge.drive.live.map import Map
from sim_bridge.judge.progress import Progress

LOOK_S: Final = 10.0  # of wall time, for the first look: a browser that is started takes half of it
ASK_EVERY_S: Final = 1.0  # of wall time, if the map's process still runs


def is_attended() -> bool:
    """True on a terminal, where a person reads what we write and can press Ctrl-C; not in continuous integration."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty() and not os.environ.get("CI")


def stay(map_: Map, progress: Progress, now_s: float) -> None:
    """Go on serving the map until Ctrl-C, SIGTERM or SIGHUP, or until its process has ended."""
    interrupt_once()
    try:
        progress.event(now_s, f"the map stays, with the replay: {map_.urls[0]} (Ctrl-C ends it)")
        while map_.gone is None:
            map_.asked(ASK_EVERY_S)  # of a flight that is over nothing is done any more
    except KeyboardInterrupt:
        pass
