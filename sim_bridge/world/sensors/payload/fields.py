"""Light, temperature and humidity of a stand.

They are made up, to have a truth with a shape: light falls off with the metres of crown straight above by
Beer and Lambert's law, air is warmer to the north, cooler with height, cooler and moister where less light falls.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from mission.common.frames import Vec3
from mission.stand.stand import Stand
from sim_bridge.world.sensors.satellites import Crowns

LIGHT_LX: Final = 40_000.0  # in the open, under an overcast sky
EXTINCTION_PER_M: Final = 0.25  # of light, for each metre of crown
TEMPERATURE_C: Final = 18.0  # at the origin's ground, in the open
NORTH_C_PER_M: Final = 0.02
LAPSE_C_PER_M: Final = -0.0065
SHADE_C: Final = -2.0  # in full shade
HUMIDITY_PCT: Final = 60.0  # in the open
SHADE_PCT: Final = 15.0  # in full shade
_UP: Final = np.array([[0.0, 0.0, 1.0]])


class Fields(NamedTuple):
    """Truth at one place."""

    light_lx: float
    temperature_c: float
    humidity_pct: float


class FieldsOfStand:
    """Light, temperature and humidity of a stand."""

    def __init__(self, stand: Stand) -> None:
        self._crowns = Crowns(stand)

    def at(self, pos_ned_m: Vec3) -> Fields:
        """The truth there. NED metres from the mission's origin."""
        share = math.exp(-EXTINCTION_PER_M * float(self._crowns.metres(pos_ned_m, _UP)[0]))
        warm_c = NORTH_C_PER_M * pos_ned_m[0] - LAPSE_C_PER_M * pos_ned_m[2]
        return Fields(
            LIGHT_LX * share,
            TEMPERATURE_C + warm_c + SHADE_C * (1.0 - share),
            min(100.0, HUMIDITY_PCT + SHADE_PCT * (1.0 - share)),
        )
