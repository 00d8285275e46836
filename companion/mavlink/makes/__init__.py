"""The makes of autopilot that a companion flies, one entry each. To add one: docs/how-to/add-an-autopilot-make.md."""

from __future__ import annotations

from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.installed import load_makes
from companion.mavlink.makes.make import Make
from companion.mavlink.makes.px4 import PX4

MAKES: dict[str, Make] = {make.key: make for make in (PX4, ARDUPILOT)}


def load_installed_makes() -> None:
    """Adds those of installed packages; before anything flies. EntryPointError: one of them cannot be flown."""
    load_makes(MAKES)


def installed_makes() -> list[Make]:
    """Makes of installed packages that were loaded."""
    return [make for make in MAKES.values() if make not in (PX4, ARDUPILOT)]


def make_of(autopilot: int) -> Make | None:
    """By HEARTBEAT.autopilot (MAV_AUTOPILOT); None: a make that is not flown."""
    return next((make for make in MAKES.values() if make.autopilot == autopilot), None)
