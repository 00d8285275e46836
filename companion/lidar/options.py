"""Values of options of `companion lidar`. Loads no driver: --help needs none."""

from __future__ import annotations

import re
from typing import Final

from companion.lidar.mounting import SECTOR_DEG, SECTORS, sector_at
from mission.schema.kinds import RAW_LIDARS

MODEL_NAMES: Final = ("rplidar-a", "rplidar-s", "ld06", "ld19", "mid360")  # of `models.MODELS`
RAW_NAMES: Final = tuple(sensor.value for sensor in RAW_LIDARS)
_NUMBER: Final = r"(-?\d{1,3}(?:\.\d{1,3})?)"
_INTERVAL: Final = re.compile(rf"{_NUMBER}\.\.{_NUMBER}", re.ASCII)


def parse_mask(text: str) -> frozenset[int]:
    """Sectors that `FROM..TO[,FROM..TO...]` touches: bearings in degrees, clockwise from the one to the other.

    ValueError.
    """
    sectors = set[int]()
    for part in text.split(","):
        from_deg, to_deg = _interval(part, "130..140")
        if not all(abs(deg) <= 360.0 for deg in (from_deg, to_deg)):
            raise ValueError(f"{part!r}: must be FROM..TO, bearings from -360 to 360")
        first, last = sector_at(from_deg), sector_at(to_deg)
        count, goes_deg = (last - first) % SECTORS + 1, (to_deg - from_deg) % 360.0
        if count == 1 and (goes_deg > SECTOR_DEG or (goes_deg == 0.0 and to_deg != from_deg)):  # once round
            count = SECTORS
        sectors.update((first + k) % SECTORS for k in range(count))
    if len(sectors) == SECTORS:
        raise ValueError(f"{text!r}: leaves no sector")
    return frozenset(sectors)


def parse_band(text: str) -> tuple[float, float]:
    """`LOW..HIGH`, in m. ValueError."""
    low_m, high_m = _interval(text, "-0.5..0.5")
    if low_m >= high_m:
        raise ValueError(f"{text!r}: the lower end must be below the upper one")
    return low_m, high_m


def _interval(text: str, example: str) -> tuple[float, float]:
    match = _INTERVAL.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r}: must be FROM..TO, as {example}")
    return float(match[1]), float(match[2])
