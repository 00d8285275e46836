"""The lidars that there are: driver and range of each. Ranges are their makers', for white targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from companion.lidar.driver import Driver
from companion.lidar.ldrobot import LdLidar
from companion.lidar.livox import Mid360
from companion.lidar.rplidar import RpLidar
from companion.lidar.sectors import Limits


@dataclass(frozen=True, slots=True)
class Model:
    """One kind of lidar."""

    title: str
    limits: Limits
    make: Callable[[], Driver]
    rays_a_turn: int | None = None  # where they are known, at 10 turns a second


_LD = Limits(0.02, 12.0)
_LD_RAYS: Final = 450  # 4,500 a second
# To add one: its driver beside these (driver.py is the contract), and a line here.
MODELS: Final[dict[str, Model]] = {
    # An A3 sees 25 m; but the 4,000 samples/s of its standard scan are rays of scan-1deg, which ends at 12 m
    "rplidar-a": Model("Slamtec RPLIDAR A1, A2, A3", Limits(0.15, 12.0), RpLidar),
    # 16 bits of 1/4 mm end at 16.4 m, however far an S sees
    "rplidar-s": Model("Slamtec RPLIDAR S1, S2", Limits(0.2, 16.0), RpLidar),
    "ld06": Model("LDROBOT LD06", _LD, LdLidar, _LD_RAYS),
    "ld19": Model("LDROBOT LD19", _LD, LdLidar, _LD_RAYS),
    # 200,000 points/s that never repeat: in 0.1 s some 270 for each sector
    "mid360": Model("Livox Mid-360", Limits(0.1, 40.0, period_s=0.1), Mid360),
}
