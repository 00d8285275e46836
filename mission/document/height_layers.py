"""Layers of height: parts of a swarm that do not hear one another fly in different ones (`separation.height_layers`).

All heights are metres above the origin, as in the mission file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from mission.rules.flight_rules import route_points
from mission.rules.forest_rules import TAKEOFF_CLEAR_M, crown_band_m, ground_up_m, lowest_crown_m
from mission.schema.conflict import Conflict, conflict
from mission.schema.tables import CoverageShape, MissionTables

SAME_HEIGHT_M: Final = 1.5  # two whose heights differ by less are beside each other: a hull, and downwash
APART_M: Final = 2.0  # between two layers: that, and what two heights held by range finders are off
LIMIT_M: Final = 0.4  # from the fence's altitudes: more than the safety filter keeps
OVER_BUSHES_M: Final = 0.8  # a hull's half, what its height is off by over their tops, and a hand's breadth
LAYERS_MOST: Final = 3


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Layers among the crowns of a generated stand, where the fence has room for them."""
    stand = mission.forest.stand
    if stand is None or not mission.separation.height_layers:
        return
    low_m, high_m = crown_band_m(mission, stand)
    own_m, *others_m = list_layers(mission)
    grounds_m = [ground_up_m(mission, *pos_enu_m[:2]) for _, pos_enu_m in route_points(mission)]
    for layer_m in others_m:
        if not any(low_m < layer_m - ground_m < high_m for ground_m in grounds_m):
            continue
        key, must_be = exclude_layer(layer_m, own_m)
        yield conflict(
            mission,
            ("separation.height_layers", key),
            f"makes a layer {layer_m:.1f} m up, among crowns, the lowest from {lowest_crown_m(stand):.1f} m above the "
            f"ground: {key} must be {must_be}",
        )
        return


def exclude_layer(layer_m: float, own_m: float) -> tuple[str, str]:
    """The altitude of the fence that makes room for a layer, and what leaves it none, in words.

    `own_m`: the mission's own height.
    """
    if layer_m > own_m:
        return "fence.altitude_max_m", f"less than {layer_m + LIMIT_M:.1f} m"
    return "fence.altitude_min_m", f"more than {layer_m - LIMIT_M:.1f} m"


def list_layers(mission: MissionTables) -> tuple[float, ...]:
    """Heights that a mission has room for: its own first, then those below it, then one above.

    Only its own where the route or the coverage is not level, for a swarm of one, or where `separation.height_layers`
    is off.
    """
    own_m = mission.route.d1_enu_m[2]
    if not mission.separation.height_layers or mission.swarm.size == 1 or find_slope(mission):
        return (own_m,)
    low_m, high_m = find_room_m(mission)
    below = _split(own_m - low_m, LAYERS_MOST - 1)
    above = _split(high_m - own_m, LAYERS_MOST - 1 - len(below))
    return (own_m, *(own_m - apart_m for apart_m in below), *(own_m + apart_m for apart_m in above))


def find_slope(mission: MissionTables) -> str:
    """Key and value by which the route or the coverage is not level; empty: both are."""
    if mission.coverage.shape is not CoverageShape.RING:
        return f'coverage.shape = "{mission.coverage.shape.value}"'
    own_m = mission.route.d1_enu_m[2]
    for name, pos_enu_m in mission.named_places:
        if pos_enu_m[2] != own_m:
            return f"{name} is {pos_enu_m[2]:g} m up, d1 {own_m:g} m"
    return ""


def find_room_m(mission: MissionTables) -> tuple[float, float]:
    """Lowest and highest height of a layer: inside the fence's altitudes, above the ground as d1 and d2 have to be.

    And above the undergrowth of a generated stand.
    """
    fence = mission.fence
    low_m = max(fence.altitude_min_m + LIMIT_M, highest_ground_m(mission) + find_room_over_ground_m(mission))
    return low_m, fence.altitude_max_m - LIMIT_M


def find_room_over_ground_m(mission: MissionTables) -> float:
    """Height above the ground that every layer has: that of d1 and d2, or OVER_BUSHES_M above the undergrowth."""
    stand = mission.forest.stand
    bushes_m = 0.0 if stand is None or stand.undergrowth_per_ha == 0.0 else stand.undergrowth_height_m + OVER_BUSHES_M
    return max(TAKEOFF_CLEAR_M, bushes_m)


def highest_ground_m(mission: MissionTables) -> float:
    """Highest ground along the way and about it, as wide as a ring or a line abreast."""
    beside_m = spread_m(mission) * math.hypot(*mission.forest.grade)
    return max([ground_up_m(mission, east_m, north_m) for east_m, north_m, _ in mission.way_enu_m]) + beside_m


def spread_m(mission: MissionTables) -> float:
    """Distance of a vehicle from the way: a ring's radius, or half of a line abreast on lanes."""
    return max(mission.coverage.radius_m, mission.swath.spread_m / 2.0 if mission.lanes else 0.0)


def _split(room_m: float, most: int) -> list[float]:
    """Distances of up to `most` layers from the mission's own height, that have room there."""
    return [k * APART_M for k in range(1, min(most, int(room_m / APART_M + 1e-9)) + 1)]
