"""Types of the benches' options, beside those of `sim_bridge.options`: what is wrong is said before anything flies."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Final

from mission.schema.kinds import SensorClass
from mission.schema.sim import Estimates

SENSORS: Final = [sensor.value for sensor in SensorClass]
ESTIMATES: Final = [kind.value for kind in Estimates]


def number(low: float, high: float) -> Callable[[str], float]:
    """A type of numbers from `low` to `high`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: must be a number from {low:g} to {high:g}")
        return value

    return read


def whole(low: int, high: int) -> Callable[[str], int]:
    """A type of whole numbers from `low` to `high`."""

    def read(text: str) -> int:
        if not (text.isdecimal() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number from {low} to {high}")
        return int(text)

    return read


as_density: Final = number(1.0, 1500.0)
"""Trees per hectare: of more, 1.5 m apart at least, not all find a place."""
as_loss: Final = number(0.0, 0.99)
"""Share of beacons that are lost."""
