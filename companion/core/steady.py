"""The own velocity of a vehicle that flies by odometry: less the noise that its model cannot have flown, and the bias.

Flow and visual-inertial odometers tell velocities with a decimetre per second of noise. A last stage that verifies each
setpoint to a stop, before a trunk half a metre away, would brake and dodge by that.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.stopping import DEAD_S, LAG_S
from companion.core.types import ZERO
from mission.frames import Vec3

FOLLOW: Final = 0.25  # of what the model has not foretold, in each tick: noise of 0.1 m/s becomes 0.05
BIAS_MAX_MPS: Final = 0.15  # of what is believed of it: three standard deviations


@final
class Steady:
    """One vehicle's, level, along its own north. To be asked once a tick."""

    __slots__ = ("_asked", "_dead_ticks", "_fresh", "_vel")

    def __init__(self, tick_s: float) -> None:
        self._dead_ticks: Final = round(DEAD_S / tick_s)
        self._asked: list[tuple[float, float]] = []  # setpoints under way
        self._vel = (0.0, 0.0)
        self._fresh = True  # what is told next is taken as it is

    def rest(self) -> None:
        """It is not steered: what it flies follows no setpoint that is known here."""
        self._asked.clear()
        self._fresh = True

    def velocity(self, told: Vec3, asked: Vec3, *, acceleration_mps2: float, dt_s: float) -> Vec3:
        """NED m/s of an odometer that tells `told`, and that was asked to fly `asked` in the tick before."""
        if self._fresh or not (math.isfinite(told[0]) and math.isfinite(told[1])):
            self._vel, self._fresh = (told[0], told[1]), False
            return told
        self._asked.append((asked[0], asked[1]))
        north, east = self._vel
        if len(self._asked) > self._dead_ticks:
            s_n, s_e = self._asked.pop(0)
            d_n, d_e = (s_n - north) * (dt_s / LAG_S), (s_e - east) * (dt_s / LAG_S)
            size, most_mps = math.hypot(d_n, d_e), acceleration_mps2 * dt_s
            if size > most_mps:
                d_n, d_e = d_n * most_mps / size, d_e * most_mps / size
            north, east = north + d_n, east + d_e
        self._vel = (north + FOLLOW * (told[0] - north), east + FOLLOW * (told[1] - east))
        return (self._vel[0], self._vel[1], told[2])


def drift_of(bias_ne_mps: tuple[float, float]) -> Vec3:
    """NED m/s, true less told, of an odometer with that bias (told less true)."""
    north, east = bias_ne_mps
    size = math.hypot(north, east)
    if not size > 0.0:
        return ZERO
    share = min(1.0, BIAS_MAX_MPS / size)
    return (-share * north, -share * east, 0.0)
