"""Line abreast of a swarm on lanes, in two staggered rows, and the distances of lanes that follow from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mission.lanes.lay import Swath

USEFUL_SHARE: Final = 0.85  # of a sensor's reach: what is passed within that is found
HEARD_SHARE: Final = 0.85  # of the radio's range: so wide a swarm hears all of its own, and each counts the same others
PASS_M: Final = 2.0  # from a lane's end: the leader turns to the next; a turn cut by more would leave that lane askew


@dataclass(frozen=True, slots=True)
class LineAbreast:
    """Places of a swarm that flies lanes: every second one lies behind, as the lanes' axis has it, both ways.

    pitch_m: across, from one to the next. depth_m: along, from one row to the other.
    """

    pitch_m: float
    depth_m: float

    def width_m(self, size: int) -> float:
        """Between the outermost of so many, across."""
        return self.pitch_m * (size - 1)


def line_abreast(*, size: int, soft_m: float, reach_m: float, range_m: float) -> LineAbreast:
    """Line abreast of `size` vehicles that keep `soft_m` apart, measure up to `reach_m` and hear up to `range_m`.

    A stem between two vehicles is within the useful reach of both, unless they keep more than that apart.
    """
    heard_m = HEARD_SHARE * range_m / max(1, size - 1)
    pitch_m = max(soft_m / 2.0, min(USEFUL_SHARE * reach_m, heard_m))  # neighbours of one row are two of these apart
    return LineAbreast(pitch_m, math.sqrt(max(0.0, soft_m * soft_m - pitch_m * pitch_m)))


def swath_of(*, line: LineAbreast, size: int, reach_m: float, lane_m: float | None) -> Swath:
    """The swath of `size` vehicles abreast. `lane_m`: the mission's.

    Between two lanes, too, a stem is within the useful reach of a vehicle on either side of it, and the outermost fly
    the borders along, so that what stands there is passed on two sides.
    """
    wide_m, depth_m = line.width_m(size), line.depth_m if size > 1 else 0.0
    return Swath(lane_m or wide_m + USEFUL_SHARE * reach_m, wide_m, wide_m / 2.0, PASS_M, PASS_M + depth_m)
