"""What the parts of a mission must satisfy together: one function per law, each naming the keys it weighs.

The functions assume that every field is valid by itself, and nothing more: they also run on a mission of
which some fields were replaced because they were not (see check.validated): odd combinations are no error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mission.problems import Path, dotted, shown

if TYPE_CHECKING:
    from mission.model import Mission

FENCE_SLACK_M = 5.0  # overshoot and gusts on the ring, and room to brake before the fence
TRUNK_CLEARANCE_M = 1.0  # between a vehicle's starting point and bark
# A disc of radius 0.8 s sqrt(n) holds n points s apart at 0.39 of its area: blue-noise sampling jams at 0.55
DISC_SPREAD = 0.8

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Conflict:
    """Fields that do not go together.

    The first path is the one to blame, `value` what it holds, as shown; the message gives the others' values.
    """

    paths: tuple[Path, ...]
    value: str
    message: str


class ConflictError(ValueError):
    """Raised inside validation; carries the conflicts to whoever knows the lines."""

    def __init__(self, conflicts: tuple[Conflict, ...]) -> None:
        self.conflicts = conflicts
        super().__init__("; ".join(f"{dotted(c.paths[0])} = {c.value}: {c.message}" for c in conflicts))


def conflicts(mission: Mission) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    for law in (
        _route,
        _distances,
        _speeds,
        _leaders,
        _coverage_spacing,
        _altitudes,
        _boundary,
        _placement,
        _trees,
        _single_vehicles,
        _faults,
    ):
        yield from law(mission)


def placement_radius_m(mission: Mission) -> float:
    """Radius of the disc about d1 that holds n starting points, `sim.placement_spacing_m` apart."""
    n, spacing_m = mission.swarm.size, mission.sim.placement_spacing_m
    if n == 1:
        return 0.0
    match mission.sim.placement.value:
        case "ring":
            return spacing_m / (2.0 * math.sin(math.pi / n))
        case "grid":  # half the diagonal of the smallest square that holds them
            return (math.ceil(math.sqrt(n)) - 1) * spacing_m / math.sqrt(2.0)
        case _:
            return DISC_SPREAD * spacing_m * math.sqrt(n)


def coverage_spacing_m(mission: Mission) -> float:
    """Distance between neighbours spread evenly in coverage; inf for a vehicle alone.

    Ring: the chord. Sphere: the side of a square of each vehicle's share of the surface, R sqrt(4 pi / n).
    """
    n, radius_m = mission.swarm.size, mission.coverage.radius_m
    if n == 1:
        return math.inf
    if mission.coverage.shape.value == "ring":
        return 2.0 * radius_m * math.sin(math.pi / n)
    return radius_m * min(2.0, math.sqrt(4.0 * math.pi / n))  # two vehicles are a diameter apart, not more


def _path(key: str) -> Path:
    return tuple(key.split("."))


def _value(mission: Mission, key: str) -> Any:
    section, name = key.split(".")
    return getattr(getattr(mission, section), name)


def _say(mission: Mission, key: str) -> str:
    """`radio.full_range_m = 55.0`"""
    return f"{key} = {shown(_value(mission, key))}"


def _conflict(mission: Mission, keys: Sequence[str], requirement: str) -> Conflict:
    """`requirement`, then the other keys and their values."""
    others = ", ".join(_say(mission, key) for key in keys[1:])
    return Conflict(tuple(map(_path, keys)), shown(_value(mission, keys[0])), f"{requirement} ({others})")


def _order(mission: Mission, low: str, high: str, *, equal: bool = False) -> Iterator[Conflict]:
    low_value, high_value = _value(mission, low), _value(mission, high)
    if low_value > high_value or (low_value == high_value and not equal):
        requirement = "must be at most" if equal else "must be less than"
        yield Conflict((_path(low), _path(high)), shown(low_value), f"{requirement} {_say(mission, high)}")


def _route(mission: Mission) -> Iterator[Conflict]:
    length_m = mission.route.length_m
    if length_m == 0.0:
        yield _conflict(mission, ("route.d2_enu_m", "route.d1_enu_m"), "must differ from the deployment point")
    elif mission.route.arrival_distance_m >= length_m:
        yield _conflict(
            mission,
            ("route.arrival_distance_m", "route.d1_enu_m", "route.d2_enu_m"),
            f"must be less than the {length_m:.1f} m from d1 to d2",
        )


def _distances(mission: Mission) -> Iterator[Conflict]:
    yield from _order(mission, "separation.hard_m", "separation.soft_m")
    yield from _order(mission, "separation.soft_m", "radio.transit_range_m")
    yield from _order(mission, "radio.transit_range_m", "radio.full_range_m", equal=True)
    yield from _order(mission, "coverage.keep_out_m", "route.arrival_distance_m")
    yield from _order(mission, "route.arrival_distance_m", "coverage.radius_m")


def _speeds(mission: Mission) -> Iterator[Conflict]:
    yield from _order(mission, "route.vel_leader_mps", "limits.speed_max_mps", equal=True)
    route = mission.route
    if route.length_m == 0.0:
        return
    climb_mps = route.vel_leader_mps * abs(route.d2_enu_m[2] - route.d1_enu_m[2]) / route.length_m
    if climb_mps > mission.limits.climb_max_mps:
        yield _conflict(
            mission,
            ("route.vel_leader_mps", "limits.climb_max_mps", "route.d1_enu_m", "route.d2_enu_m"),
            f"makes the leader climb or descend at {climb_mps:.2f} m/s: must be at most climb_max_mps",
        )


def _leaders(mission: Mission) -> Iterator[Conflict]:
    absent = [i for i in mission.swarm.leader_priority if i > mission.swarm.size]
    if absent:
        yield _conflict(
            mission,
            ("swarm.leader_priority", "swarm.size"),
            f"has no vehicle {absent[0]}: ids are 1 to {mission.swarm.size}",
        )


def _single_vehicles(mission: Mission) -> Iterator[Conflict]:
    for name in ("personalities", "battery_mah"):
        table = getattr(mission.sim, name)
        absent = [i for i in table if i > mission.swarm.size]
        if absent:
            # A file's keys are text.
            paths = (("sim", name, str(absent[0])), ("sim", name), ("swarm", "size"))
            message = f"must be a vehicle id, 1 to {mission.swarm.size} ({_say(mission, 'swarm.size')})"
            yield Conflict(paths, shown(table[absent[0]]), message)


def _faults(mission: Mission) -> Iterator[Conflict]:
    size, limit_s = mission.swarm.size, mission.sim.time_limit_s
    for index, fault in enumerate(mission.sim.faults):
        path: Path = ("sim", "faults", index)
        vehicles = fault.vehicles or ()
        absent = [i for i in vehicles if i > size]
        if absent:
            message = f"has no vehicle {absent[0]}: ids are 1 to {size} ({_say(mission, 'swarm.size')})"
            yield Conflict(((*path, "vehicles"), ("swarm", "size")), shown(vehicles), message)
        elif fault.kind.value == "partition" and len(vehicles) == size:
            message = f"must leave a vehicle to cut off from ({_say(mission, 'swarm.size')})"
            yield Conflict(((*path, "vehicles"), ("swarm", "size")), shown(vehicles), message)
        if limit_s is not None and fault.at_s >= limit_s:
            message = f"must be less than {_say(mission, 'sim.time_limit_s')}"
            yield Conflict(((*path, "at_s"), ("sim", "time_limit_s")), shown(fault.at_s), message)


def _coverage_spacing(mission: Mission) -> Iterator[Conflict]:
    spacing_m = coverage_spacing_m(mission)
    if mission.swarm.size == 1:
        return
    if spacing_m < mission.separation.hard_m:
        yield _conflict(
            mission,
            ("coverage.radius_m", "swarm.size", "separation.hard_m", "coverage.shape"),
            f"leaves {spacing_m:.2f} m between neighbours: must leave at least hard_m",
        )
    if spacing_m > mission.radio.full_range_m:
        yield _conflict(
            mission,
            ("coverage.radius_m", "swarm.size", "radio.full_range_m", "coverage.shape"),
            f"puts neighbours {spacing_m:.2f} m apart: must be at most full_range_m",
        )


def _altitudes(mission: Mission) -> Iterator[Conflict]:
    yield from _order(mission, "fence.altitude_min_m", "fence.altitude_max_m")
    low_m, high_m = mission.fence.altitude_min_m, mission.fence.altitude_max_m
    if low_m >= high_m:
        return
    for key, up_m in (
        ("route.d1_enu_m", mission.route.d1_enu_m[2]),
        ("route.d2_enu_m", mission.route.d2_enu_m[2]),
    ):
        if not low_m <= up_m <= high_m:
            yield _conflict(
                mission,
                (key, "fence.altitude_min_m", "fence.altitude_max_m"),
                "must be inside the fence's altitudes",
            )
            return
    up_m, radius_m = mission.route.d2_enu_m[2], mission.coverage.radius_m
    if mission.coverage.shape.value == "sphere" and not low_m + radius_m <= up_m <= high_m - radius_m:
        yield _conflict(
            mission,
            (
                "coverage.radius_m",
                "route.d2_enu_m",
                "fence.altitude_min_m",
                "fence.altitude_max_m",
                "coverage.shape",
            ),
            f"reaches from {up_m - radius_m:.1f} to {up_m + radius_m:.1f} m: must be inside the fence",
        )


def _boundary(mission: Mission) -> Iterator[Conflict]:
    """Inside are d1 with the starting points, d2 with the coverage, slack about both, and the way between."""
    polygon = mission.fence.polygon_enu_m
    if polygon is None:
        return
    d1, d2 = mission.route.d1_enu_m[:2], mission.route.d2_enu_m[:2]
    placed_m = placement_radius_m(mission)
    fence = "fence.polygon_enu_m"
    start = ("route.d1_enu_m", fence, "swarm.size", "sim.placement", "sim.placement_spacing_m")
    if clearance_m(d1, polygon) < 0.0:
        yield _conflict(mission, ("route.d1_enu_m", fence), "must be inside the fence")
    elif clearance_m(d1, polygon) < placed_m + FENCE_SLACK_M:
        yield _conflict(
            mission,
            start,
            f"is {clearance_m(d1, polygon):.1f} m inside the fence: must be at least "
            f"{placed_m:.1f} m for the starting points and {FENCE_SLACK_M:.0f} m of slack",
        )
    if clearance_m(d2, polygon) < 0.0:
        yield _conflict(mission, ("route.d2_enu_m", fence), "must be inside the fence")
    elif clearance_m(d2, polygon) < mission.coverage.radius_m + FENCE_SLACK_M:
        yield _conflict(
            mission,
            ("route.d2_enu_m", fence, "coverage.radius_m"),
            f"is {clearance_m(d2, polygon):.1f} m inside the fence: must be at least radius_m and "
            f"{FENCE_SLACK_M:.0f} m of slack",
        )
    elif clearance_m(d1, polygon) >= 0.0 and any(_meet(d1, d2, a, b) for a, b in _edges(polygon)):
        yield _conflict(mission, (fence, "route.d1_enu_m", "route.d2_enu_m"), "must hold the straight way d1 to d2")


def _placement(mission: Mission) -> Iterator[Conflict]:
    if mission.swarm.size == 1:
        return
    yield from _order(mission, "separation.hard_m", "sim.placement_spacing_m")
    yield from _order(mission, "sim.placement_spacing_m", "radio.transit_range_m")


def _trees(mission: Mission) -> Iterator[Conflict]:
    start_m = placement_radius_m(mission) + TRUNK_CLEARANCE_M
    keep_out_m = mission.coverage.keep_out_m
    for index, tree in enumerate(mission.forest.trees):
        path: Path = ("forest", "trees", index)
        start_gap_m = math.dist(tree.base_enu_m, mission.route.d1_enu_m[:2]) - tree.trunk_radius_m
        if start_gap_m < start_m:
            also = ("route.d1_enu_m", "swarm.size", "sim.placement", "sim.placement_spacing_m")
            others = ", ".join(_say(mission, key) for key in also)
            yield Conflict(
                ((*path, "base_enu_m"), (*path, "trunk_radius_m"), *map(_path, also)),
                shown(tree.base_enu_m),
                f"stands {start_gap_m:.1f} m from d1: must be at least {start_m:.1f} m, outside the "
                f"starting points ({others})",
            )
        offset_m = math.dist(tree.base_enu_m, mission.route.d2_enu_m[:2])
        if offset_m < keep_out_m < offset_m + tree.trunk_radius_m:
            yield Conflict(
                (
                    (*path, "trunk_radius_m"),
                    (*path, "base_enu_m"),
                    ("coverage", "keep_out_m"),
                    ("route", "d2_enu_m"),
                ),
                shown(tree.trunk_radius_m),
                f"reaches {offset_m + tree.trunk_radius_m:.2f} m from d2: must be at most "
                f"{_say(mission, 'coverage.keep_out_m')} ({_say(mission, 'route.d2_enu_m')})",
            )


# Plane geometry


def _edges(polygon: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    return ((polygon[i - 1], polygon[i]) for i in range(len(polygon)))


def _turn(a: Point, b: Point, c: Point) -> float:
    """> 0 if a, b, c turn left, 0 if they are in line."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _within_box(a: Point, b: Point, p: Point) -> bool:
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the segments ab and cd share a point."""
    t1, t2, t3, t4 = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if ((t1 > 0 > t2) or (t2 > 0 > t1)) and ((t3 > 0 > t4) or (t4 > 0 > t3)):
        return True
    return (
        (t1 == 0 and _within_box(a, b, c))
        or (t2 == 0 and _within_box(a, b, d))
        or (t3 == 0 and _within_box(c, d, a))
        or (t4 == 0 and _within_box(c, d, b))
    )


def _distance_to_segment_m(p: Point, a: Point, b: Point) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    along = 0.0 if square == 0.0 else min(1.0, max(0.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square))
    return math.hypot(p[0] - a[0] - along * dx, p[1] - a[1] - along * dy)


def clearance_m(point: Point, polygon: Sequence[Point]) -> float:
    """Distance from `point` to the boundary, negative outside. Even-odd rule; m."""
    inside = False
    for a, b in _edges(polygon):
        if (a[1] > point[1]) != (b[1] > point[1]) and (_turn(a, b, point) > 0) == (b[1] > a[1]):
            inside = not inside
    distance_m = min(_distance_to_segment_m(point, a, b) for a, b in _edges(polygon))
    return distance_m if inside else -distance_m


def polygon_fault(polygon: Sequence[Point]) -> str:
    """Why `polygon` is not a simple polygon; empty if it is one."""
    n = len(polygon)
    seen: dict[Point, int] = {}
    for index, vertex in enumerate(polygon):
        first = seen.setdefault(vertex, index)
        if first != index:
            return f"must not repeat a vertex: [{first}] and [{index}] are the same (it closes by itself)"
    edges = list(_edges(polygon))  # edge i ends in vertex i
    for i in range(n):
        for j in range(i + 1, n):
            neighbours = j == i + 1 or (i == 0 and j == n - 1)
            (a, b), (c, d) = edges[i], edges[j]
            if neighbours:  # they share one vertex and may share no more: no folding back
                far, shared, other = (a, b, d) if j == i + 1 else (b, a, c)
                crossing = _turn(far, shared, other) == 0 and _dot(far, shared, other) > 0
            else:
                crossing = _meet(a, b, c, d)
            if crossing:
                return f"must be a simple polygon: the edges that end in vertices [{i}] and [{j}] cross or touch"
    return ""


def _dot(a: Point, corner: Point, b: Point) -> float:
    """> 0 if corner -> a and corner -> b point the same way."""
    return (a[0] - corner[0]) * (b[0] - corner[0]) + (a[1] - corner[1]) * (b[1] - corner[1])
