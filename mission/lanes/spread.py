"""Width of a swarm in transit, across its course, and the distance of lanes that follows from it."""

from __future__ import annotations

import math
from typing import Final

from mission.lanes.lay import Swath

USEFUL_SHARE: Final = 0.85  # of a sensor's reach: what is passed within that is found

# Of that width. A swarm follows its leader round a turn on the inside, so at the far border it is not as wide; and most
# of it is behind its leader, who flies on beyond the border until they have come to it.
INSET_SHARE: Final = 0.25
BEYOND_SHARE: Final = 0.5
PASS_M: Final = 2.0  # from a lane's end: the leader turns to the next; a turn cut by more would leave that lane askew


def spread_m(size: int, soft_m: float) -> float:
    """Between the outermost vehicles, across the course: as measured, see docs/explanation/lanes.md; m."""
    return soft_m * (math.sqrt(size) - 1.0)


def swath_of(*, size: int, soft_m: float, reach_m: float, lane_m: float | None) -> Swath:
    """The swath of `size` vehicles that keep `soft_m` apart and measure up to `reach_m`. `lane_m`: the mission's.

    Between two lanes, and between two vehicles of one, a stem is within the useful reach of one on either side of it.
    """
    wide_m = spread_m(size, soft_m)
    return Swath(
        lane_m or wide_m + USEFUL_SHARE * reach_m, wide_m, INSET_SHARE * wide_m, PASS_M + BEYOND_SHARE * wide_m
    )
