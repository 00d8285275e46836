"""Moving air: a steady wind and the turbulence in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.common.frames import Vec3


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind and turbulence around a vehicle; each vehicle's seed gives its own turbulence.

    `mean_ned_mps` is where the air moves to. `turbulence_mps` is the wind speed at 20 ft (6 m) that scales
    the low-altitude turbulence of MIL-F-8785C: the vertical rms is 10 % of it, the horizontal 20 % at 3 m.
    Gusts are frozen in the air and met by moving through it: a vehicle that hovers in still air feels none.
    """

    mean_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    turbulence_mps: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.mean_ned_mps)):
            raise ValueError(f"mean_ned_mps = {self.mean_ned_mps}: must be finite")
        if not 0.0 <= self.turbulence_mps < math.inf:
            raise ValueError(f"turbulence_mps = {self.turbulence_mps}: must be >= 0 and finite")


CALM = Wind()
