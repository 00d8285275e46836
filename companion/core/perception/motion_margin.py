"""Margin towards what is seen: more than the mission's while the own motion is known less well than that covers.

A way is reckoned with the own velocity, and until a setpoint acts on what scans show meanwhile the vehicle goes astray
by as much as that velocity is wrong. How wrong it may be follows from the class of the sensor and from how well trunks
and walls tell the position, as the scan odometry knows it. `python -m tests.bench own-motion --clearances` measures it:
docs/explanation/own-motion.md has the figures.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.perception.level_scan import ScanClass

COVERED_M: Final = 0.3  # by the mission's margin, or by less where that is less
POINT_M: Final = 0.08  # less than a clearance to the nearest point of a trunk is believed too large, 99.9 %
# Until a setpoint acts on what is seen: a turn of the sensor, 0.25 s as in JSBSim, and the lag
ACTS_S: Final = 0.65
PER_S: Final = 2.0  # by how much more a velocity may be wrong for each metre of the position's standard deviation
UNTOLD_MPS: Final = 0.9  # 99.9 % of what reported ones are wrong, level, and a tenth more


def velocity_error_mps(kind: ScanClass, shift_sd_m: float) -> float:
    """Error of the own velocity against what is seen, level, 99.9 %; `shift_sd_m`: as of `ScanOdometry`."""
    return min(UNTOLD_MPS, kind.velocity_mps + PER_S * shift_sd_m)


def find_wider_m(kind: ScanClass, shift_sd_m: float, margin_m: float) -> float:
    """Metres more than the mission's margin; 0 where trunks tell the own motion as well as that reckons with."""
    strays_m = ACTS_S * velocity_error_mps(kind, shift_sd_m)
    return max(0.0, math.sqrt(POINT_M * POINT_M + strays_m * strays_m) - min(margin_m, COVERED_M))
