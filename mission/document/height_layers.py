"""Layers of height: parts of a swarm that do not hear one another fly in different ones (`separation.height_layers`).

All heights are metres above the origin, as in the mission file.
"""

from __future__ import annotations

from typing import Final

from mission.document.model import CoverageShape, Mission

SAME_HEIGHT_M: Final = 1.5  # two whose heights differ by less are beside each other: a hull, and downwash
APART_M: Final = 2.0  # between two layers: that, and what two heights held by range finders are off
LIMIT_M: Final = 0.4  # from the fence's altitudes: more than the safety filter keeps
LAYERS_MOST: Final = 3


def list_layers(mission: Mission) -> tuple[float, ...]:
    """Heights that a mission has room for: its own first, then those below it, then one above.

    Only its own where the route or the coverage is not level, or `separation.height_layers` is off.
    """
    heights_m = {mission.route.d1_enu_m[2]} | {visit.pos_enu_m[2] for visit in mission.visits}
    own_m = mission.route.d1_enu_m[2]
    if not mission.separation.height_layers or len(heights_m) > 1 or mission.coverage.shape is not CoverageShape.RING:
        return (own_m,)
    below = _split(own_m - LIMIT_M - mission.fence.altitude_min_m, LAYERS_MOST - 1)
    above = _split(mission.fence.altitude_max_m - LIMIT_M - own_m, LAYERS_MOST - 1 - len(below))
    return (own_m, *(own_m - apart_m for apart_m in below), *(own_m + apart_m for apart_m in above))


def _split(room_m: float, most: int) -> list[float]:
    """Distances of up to `most` layers from the mission's own height, that have room there."""
    return [k * APART_M for k in range(1, min(most, int(room_m / APART_M + 1e-9)) + 1)]
