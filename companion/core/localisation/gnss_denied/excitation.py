"""A small motion of each vehicle's own, by which a swarm that flies by ranges sees how it is turned, and bent.

Ranges do not see a formation turn that moves as one (`relative`). Nor do they see one bend where too few brace it: on a
ring of which each measures the next one alone a circle and an ellipse are the same. Both show in which direction those
are that a vehicle measures, once it moves. So one that is too unsure of that flies small circles about its position,
each in a period of its own, until it is sure enough again: by its covariance, not by a timer. Among trees dodging shows
as much.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3

FROM_RAD: Final = math.radians(1.5)
UNTIL_RAD: Final = math.radians(1.0)
# Of a neighbour that it measures, in the shape: a braced formation has 0.05 to 0.15 m
FROM_M: Final = 0.3
UNTIL_M: Final = 0.2
SPEED_MPS: Final = 0.35  # circles of 0.45 to 0.7 m radius
PERIOD_S = (8.0, 12.0)  # each vehicle another: two that circle as one see nothing
EXCITED = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.COVERAGE)  # in these states it is flown
GOLDEN: Final = 0.618034  # multiples of it, less their whole part, are spread evenly


@final
class ExcitationManoeuvre:
    """One vehicle's."""

    __slots__ = ("_period_s", "_phase_rad", "is_on")

    def __init__(self, me: int) -> None:
        share = me * GOLDEN % 1.0
        self._period_s = PERIOD_S[0] + (PERIOD_S[1] - PERIOD_S[0]) * share
        self._phase_rad = math.tau * (me * GOLDEN * GOLDEN % 1.0)
        self.is_on = False

    def velocity(self, rotation_sd_rad: float, now_s: float, *, shape_sd_m: float = 0.0) -> Vec3:
        """NED m/s, to be added to what it desires."""
        is_turned = rotation_sd_rad > (UNTIL_RAD if self.is_on else FROM_RAD)
        self.is_on = is_turned or shape_sd_m > (UNTIL_M if self.is_on else FROM_M)
        if not self.is_on:
            return ZERO
        turn = math.tau * now_s / self._period_s + self._phase_rad
        return (SPEED_MPS * math.cos(turn), SPEED_MPS * math.sin(turn), 0.0)
