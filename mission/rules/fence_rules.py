"""Rules of the fence: as mission.rules, which says how."""

from __future__ import annotations

from collections.abc import Iterator

from mission.common.plane import clearance_m, distance_to_segment_m, edges, meet
from mission.rules.flight_rules import MARGIN_M, legs, name_of, placement_keys, placement_radius_m, route_points
from mission.schema.conflict import Conflict, conflict, order
from mission.schema.tables import FENCE_SLACK_M, CoverageShape, MissionTables

TAKEOFF_SHORT_M = 1.0  # the companion takes a take-off for done that ends this far below its altitude


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    yield from _altitudes(mission)
    yield from _boundary(mission)


def _altitudes(mission: MissionTables) -> Iterator[Conflict]:
    yield from order(mission, "fence.altitude_min_m", "fence.altitude_max_m")
    low_m = mission.fence.altitude_min_m + MARGIN_M
    high_m = mission.fence.altitude_max_m - MARGIN_M
    if low_m > high_m:
        if mission.fence.altitude_min_m < mission.fence.altitude_max_m:
            yield conflict(
                mission,
                ("fence.altitude_min_m", "fence.altitude_max_m"),
                f"must be at least {2 * MARGIN_M:g} m below altitude_max_m: {MARGIN_M:g} m are kept from each",
            )
        return
    for key, pos_enu_m in route_points(mission):
        if not low_m <= pos_enu_m[2] <= high_m:
            yield conflict(
                mission,
                (key, "fence.altitude_min_m", "fence.altitude_max_m"),
                f"must be inside the fence's altitudes, {MARGIN_M:g} m from each",
            )
            return
    if mission.route.d1_enu_m[2] <= TAKEOFF_SHORT_M:
        yield conflict(
            mission,
            ("route.d1_enu_m",),
            f"must be more than {TAKEOFF_SHORT_M:g} m up: a take-off may end that far below its altitude",
        )
    radius_m = mission.coverage.radius_m
    for key, pos_enu_m in route_points(mission)[1:]:
        up_m = pos_enu_m[2]
        if mission.coverage.shape is CoverageShape.SPHERE and not low_m + radius_m <= up_m <= high_m - radius_m:
            yield conflict(
                mission,
                ("coverage.radius_m", key, "fence.altitude_min_m", "fence.altitude_max_m", "coverage.shape"),
                f"reaches from {up_m - radius_m:.1f} to {up_m + radius_m:.1f} m: must be inside the fence, "
                f"{MARGIN_M:g} m from each altitude",
            )


def _boundary(mission: MissionTables) -> Iterator[Conflict]:
    """Inside are d1 with the starting points, stops and d2 with their coverage, slack, and the way between."""
    polygon = mission.fence.polygon_enu_m
    if polygon is None:
        return
    fence = "fence.polygon_enu_m"
    outside = set()
    for key, pos_enu_m in route_points(mission):
        clear_m = clearance_m(pos_enu_m[:2], polygon)
        also: tuple[str, ...]
        if key == "route.d1_enu_m":
            room_m, also = placement_radius_m(mission), placement_keys(mission)
            what = f"{room_m:.1f} m for the starting points"
        else:
            room_m, also = mission.coverage.radius_m, ("coverage.radius_m",)
            what = "radius_m"
        if clear_m < 0.0:
            yield conflict(mission, (key, fence), "must be inside the fence")
        elif clear_m < room_m + FENCE_SLACK_M:
            yield conflict(
                mission,
                (key, fence, *also),
                f"is {clear_m:.1f} m inside the fence: must be at least {what} and {FENCE_SLACK_M:.0f} m of slack",
            )
        if clear_m < (0.0 if key == "route.d1_enu_m" else room_m + FENCE_SLACK_M):
            outside.add(key)
    for (from_key, here), (to_key, there) in legs(mission):
        if from_key in outside or to_key in outside:
            continue
        way_m = min(distance_to_segment_m(vertex, here[:2], there[:2]) for vertex in polygon)
        if way_m < FENCE_SLACK_M or any(meet(here[:2], there[:2], a, b) for a, b in edges(polygon)):
            yield conflict(
                mission,
                (fence, from_key, to_key),
                f"must hold the straight way {name_of(from_key)} to {name_of(to_key)}, with {FENCE_SLACK_M:.0f} m of "
                "slack",
            )
