"""Rules that the parts of a mission must satisfy together: one function per law, each naming the keys it weighs.

The functions assume that every field is valid by itself, and nothing more: they also run on a mission of
which some fields were replaced because they were not (see check.validated): odd combinations are no error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from mission.common.frames import Vec3
from mission.common.problems import Path, dotted, shown
from mission.schema.conflict import Conflict, conflict, order, path_of, show_key
from mission.schema.fault_kinds import FORMS, Needs
from mission.schema.faults import Fault, FaultKind, Lie
from mission.schema.sim import Placement
from mission.schema.tables import AtEnd, CoverageShape, MissionTables

TRUNK_CLEARANCE_M = 1.0  # between a vehicle's starting point and bark, or what sensing keeps of it
# What the companion does with a mission (tests hold these to companion.core): ...
FULL_SPEED_SHARE = 0.7  # ... the leader slows down for a link longer than this share of the range
STOP_SHARE = 0.8  # ... it comes to rest this share of the arrival distance before d2
SPREAD_MPS = 2.0  # ... vehicles spread along a ring at most this fast
MARGIN_M = 0.3  # ... the safety filter keeps this much beyond each limit
# Neighbours in coverage are this much farther apart than the safety filter keeps them, or it would never let go of
# them: the lone tree's ring with n = 16 leaves 5.85 m, and the least separation in seeds 1-3 is 5.26 m; hard_m = 5
TRACKING_M = 0.5
# Of the time to spread over half a ring: R = 100 m with n = 12 and full_range_m = 56 took 1.44 times that, 226 s
WIDE_RING_SHARE = 1.5
LINK_SLACK_M = 2.0  # below the range, for neighbours that a gust moves apart: PX4's hover wanders by up to 0.9 m
RANDOM_STEP = 2.0  # times the spacing: a link of this length joins nearly all random placements
# A disc of radius 0.8 s sqrt(n) holds n points s apart at 0.39 of its area: blue-noise sampling jams at 0.55
DISC_SPREAD = 0.8
START_OFF_M = 2.0  # from where ranging.start_enu_m has a vehicle, at most: the two of a pair together, or one of them


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    for law in (
        _route,
        _distances,
        _speeds,
        _leaders,
        _coverage_spacing,
        _coverage_time,
        _placement,
        _start_beside_tree,
        _trees,
        _single_vehicles,
        _faults,
        _time_limit,
    ):
        yield from law(mission)


def placement_radius_m(mission: MissionTables) -> float:
    """Radius of the disc about d1 that holds the starting points: n, `sim.placement_spacing_m` apart, or as given."""
    n, spacing_m = mission.swarm.size, mission.sim.placement_spacing_m
    if mission.ranging is not None and mission.flies_by_ranges:
        d1 = mission.route.d1_enu_m
        starts = mission.ranging.start_enu_m[:n]  # too few, or none, are said by another law
        return START_OFF_M + max([math.dist(d1[:2], pos_enu_m[:2]) for pos_enu_m in starts], default=0.0)
    if n == 1:
        return 0.0
    match mission.sim.placement:
        case Placement.RING:
            return spacing_m / (2.0 * math.sin(math.pi / n))
        case Placement.GRID:  # half the diagonal of the smallest square that holds them
            return (math.ceil(math.sqrt(n)) - 1) * spacing_m / math.sqrt(2.0)
        case Placement.RANDOM:
            return DISC_SPREAD * spacing_m * math.sqrt(n)


def placement_keys(mission: MissionTables) -> tuple[str, ...]:
    """Keys that `placement_radius_m` comes from."""
    if mission.ranging is not None and mission.flies_by_ranges:
        return ("ranging.start_enu_m",)
    return ("swarm.size", "sim.placement", "sim.placement_spacing_m")


def start_link_m(mission: MissionTables) -> float:
    """The longest link that joins the swarm at the start."""
    return mission.radio.transit_range_m - LINK_SLACK_M


def trunk_clearance_m(mission: MissionTables) -> float:
    """Between a starting point and bark."""
    sensing = mission.sensing
    kept_m = 0.0 if sensing is None else sensing.vehicle_radius_m + sensing.margin_m
    return max(TRUNK_CLEARANCE_M, kept_m)


def coverage_spacing_m(mission: MissionTables) -> float:
    """Distance between neighbours spread evenly in coverage; inf for a vehicle alone.

    Ring: the chord. Sphere: the side of a square of each vehicle's share of the surface, R sqrt(4 pi / n).
    """
    n, radius_m = mission.swarm.size, mission.coverage.radius_m
    if n == 1:
        return math.inf
    if mission.coverage.shape is CoverageShape.RING:
        return 2.0 * radius_m * math.sin(math.pi / n)
    return radius_m * min(2.0, math.sqrt(4.0 * math.pi / n))  # two vehicles are a diameter apart, not more


def route_points(mission: MissionTables) -> list[tuple[str, Vec3]]:
    """The keys of d1, the stops and d2, and where they are; ENU m."""
    keys = (
        "route.d1_enu_m",
        *(f"route.stops.{k}.pos_enu_m" for k in range(len(mission.route.stops))),
        "route.d2_enu_m",
    )
    return list(zip(keys, mission.route.points_enu_m, strict=True))


def legs(mission: MissionTables) -> list[tuple[tuple[str, Vec3], tuple[str, Vec3]]]:
    """From where to where the swarm goes straight: each with its key of `route_points`. Last may be the way home."""
    points = route_points(mission)
    found = [] if mission.lanes else list(pairwise(points))  # `survey_rules` has the ways of lanes
    if mission.route.at_end is AtEnd.RETURN and (mission.route.stops or mission.lanes):  # else it is the way there
        found.append((points[-1], points[0]))
    return found


def name_of(key: str) -> str:
    """`d2`, `stops[0]`"""
    return dotted(path_of(key)[1:]).removesuffix("_enu_m").removesuffix(".pos")


def _route(mission: MissionTables) -> Iterator[Conflict]:
    for (from_key, here), (to_key, there) in legs(mission):
        length_m = math.dist(here, there)
        if length_m == 0.0:
            before = "the deployment point" if "route.d1_enu_m" in (from_key, to_key) else "the place before it"
            yield conflict(mission, (to_key, from_key), f"must differ from {before}")
        elif mission.route.arrival_distance_m >= length_m:
            yield conflict(
                mission,
                ("route.arrival_distance_m", from_key, to_key),
                f"must be less than the {length_m:.1f} m from {name_of(from_key)} to {name_of(to_key)}",
            )


def _distances(mission: MissionTables) -> Iterator[Conflict]:
    yield from order(mission, "separation.hard_m", "separation.soft_m")
    yield from order(mission, "radio.transit_range_m", "radio.full_range_m", equal=True)
    soft_max_m = FULL_SPEED_SHARE * mission.radio.transit_range_m
    if mission.separation.soft_m > soft_max_m:
        yield conflict(
            mission,
            ("separation.soft_m", "radio.transit_range_m"),
            f"must be at most {soft_max_m:.2f} m, {FULL_SPEED_SHARE:.0%} of the range: the leader slows down, and at "
            "last stands still, for neighbours that keep farther apart",
        )
    keep_out_max_m = STOP_SHARE * mission.route.arrival_distance_m - MARGIN_M
    if mission.coverage.keep_out_m > keep_out_max_m:
        yield conflict(
            mission,
            ("coverage.keep_out_m", "route.arrival_distance_m"),
            f"must be at most {keep_out_max_m:.2f} m: the leader comes to rest {STOP_SHARE:g} of arrival_distance_m "
            f"before d2, and {MARGIN_M:g} m more than keep_out_m is kept",
        )
    yield from order(mission, "route.arrival_distance_m", "coverage.radius_m")


def _speeds(mission: MissionTables) -> Iterator[Conflict]:
    yield from order(mission, "route.vel_leader_mps", "limits.speed_max_mps", equal=True)
    for (from_key, here), (to_key, there) in legs(mission):
        length_m = math.dist(here, there)
        climb_mps = mission.route.vel_leader_mps * abs(there[2] - here[2]) / length_m if length_m > 0.0 else 0.0
        if climb_mps > mission.limits.climb_max_mps:
            yield conflict(
                mission,
                ("route.vel_leader_mps", "limits.climb_max_mps", from_key, to_key),
                f"makes the leader climb or descend at {climb_mps:.2f} m/s: must be at most climb_max_mps",
            )


def _leaders(mission: MissionTables) -> Iterator[Conflict]:
    absent = [i for i in mission.swarm.leader_priority if i > mission.swarm.size]
    if absent:
        yield conflict(
            mission,
            ("swarm.leader_priority", "swarm.size"),
            f"has no vehicle {absent[0]}: ids are 1 to {mission.swarm.size}",
        )


def _single_vehicles(mission: MissionTables) -> Iterator[Conflict]:
    for name in ("personalities", "battery_mah"):
        table = getattr(mission.sim, name)
        absent = [i for i in table if i > mission.swarm.size]
        if absent:
            # A file's keys are text.
            paths = (("sim", name, str(absent[0])), ("sim", name), ("swarm", "size"))
            message = f"must be a vehicle id, 1 to {mission.swarm.size} ({show_key(mission, 'swarm.size')})"
            yield Conflict(paths, shown(table[absent[0]]), message)


def _faults(mission: MissionTables) -> Iterator[Conflict]:
    size, limit_s = mission.swarm.size, mission.sim.time_limit_s
    for index, fault in enumerate(mission.sim.faults):
        path: Path = ("sim", "faults", index)
        vehicles = fault.vehicles or ()
        absent = [i for i in vehicles if i > size]
        if absent:
            message = f"has no vehicle {absent[0]}: ids are 1 to {size} ({show_key(mission, 'swarm.size')})"
            yield Conflict(((*path, "vehicles"), ("swarm", "size")), shown(vehicles), message)
        elif fault.kind is FaultKind.PARTITION and len(vehicles) == size:
            message = f"must leave a vehicle to cut off from ({show_key(mission, 'swarm.size')})"
            yield Conflict(((*path, "vehicles"), ("swarm", "size")), shown(vehicles), message)
        yield from _fault_needs(mission, fault, path)
        if limit_s is not None and fault.at_s >= limit_s:
            message = f"must be less than {show_key(mission, 'sim.time_limit_s')}"
            yield Conflict(((*path, "at_s"), ("sim", "time_limit_s")), shown(fault.at_s), message)


def _fault_needs(mission: MissionTables, fault: Fault, path: Path) -> Iterator[Conflict]:
    """Conflicts where what a fault strikes is not there."""
    need = FORMS[fault.kind].needs
    if need is Needs.SATELLITES:
        without = [k for k in fault.vehicles or () if k <= mission.swarm.size and not mission.has_satellites(k)]
        if without:
            message = f"{fault.kind.value} of vehicle {without[0]} {need.value}"
            yield Conflict(((*path, "vehicles"), ("swarm", "gnss")), shown(fault.vehicles), message)
    there = {Needs.SENSING: mission.sensing, Needs.RANGING: mission.ranging, Needs.RECORDS: mission.keeps_records}
    if need is Needs.RANGING and mission.ranging is not None and not mission.has_range_radios:
        message = f"{fault.kind.value} needs range radios ({show_key(mission, 'ranging.radio')})"
        yield Conflict(((*path, "kind"), ("ranging", "radio")), shown(fault.kind.value), message)
    if not there.get(need, True):
        where: Path = ("survey" if need is Needs.RECORDS else need.name.lower(),)
        yield Conflict(((*path, "kind"), where), shown(fault.kind.value), need.value)
    if fault.lie is Lie.TRUNKS and not mission.shares_trunks:
        message = (
            f"needs [ranging], vehicles without satellites ({_who_has_satellites(mission)}),"
            " and a sensing.sensor that tells every ray"
        )
        about = ((*path, "lie"), ("swarm", "gnss"), ("ranging",), ("sensing", "sensor"))
        yield Conflict(about, shown(fault.lie.value), message)
    if fault.lie is Lie.RANGES and not mission.flies_by_ranges:
        message = f"needs [ranging], and vehicles without satellites ({_who_has_satellites(mission)})"
        yield Conflict(((*path, "lie"), ("swarm", "gnss"), ("ranging",)), shown(fault.lie.value), message)


def _who_has_satellites(mission: MissionTables) -> str:
    """In a swarm of one all have them where the leader has."""
    return ", ".join(show_key(mission, key) for key in ("swarm.gnss", "swarm.size"))


def _coverage_spacing(mission: MissionTables) -> Iterator[Conflict]:
    spacing_m = coverage_spacing_m(mission)
    if mission.swarm.size == 1:
        return
    room_m = MARGIN_M + TRACKING_M
    if spacing_m < mission.separation.hard_m + room_m:
        yield conflict(
            mission,
            ("coverage.radius_m", "swarm.size", "separation.hard_m", "coverage.shape"),
            f"leaves {spacing_m:.2f} m between neighbours: must leave at least hard_m and {room_m:g} m",
        )
    if spacing_m > mission.radio.full_range_m - LINK_SLACK_M:
        yield conflict(
            mission,
            ("coverage.radius_m", "swarm.size", "radio.full_range_m", "coverage.shape"),
            f"puts neighbours {spacing_m:.2f} m apart: must be at most full_range_m less {LINK_SLACK_M:g} m",
        )


def _coverage_time(mission: MissionTables) -> Iterator[Conflict]:
    """A ring on which not all hear one another is closed from one side: some spread over half of it."""
    radius_m, range_m = mission.coverage.radius_m, mission.radio.full_range_m
    is_wide_ring = mission.coverage.shape is CoverageShape.RING and 2.0 * radius_m > range_m
    if not is_wide_ring or coverage_spacing_m(mission) > range_m - LINK_SLACK_M:
        return  # one alone is inf m from its neighbours
    least_s = math.ceil(WIDE_RING_SHARE * math.pi * radius_m / SPREAD_MPS)
    at_stops = [(f"route.stops.{k}.duration_s", stop.duration_s) for k, stop in enumerate(mission.route.stops)]
    for key, duration_s in (*at_stops, ("coverage.duration_s", mission.coverage.duration_s)):
        if duration_s is not None and 0.0 < duration_s < least_s:
            yield conflict(
                mission,
                (key, "coverage.radius_m", "radio.full_range_m", "coverage.shape"),
                f"must be at least {least_s} s for a ring wider than full_range_m, or 0 for no coverage",
            )


def _placement(mission: MissionTables) -> Iterator[Conflict]:
    spacing_m = mission.sim.placement_spacing_m
    if mission.swarm.size == 1 or mission.flies_by_ranges:
        return
    if spacing_m < mission.separation.hard_m + MARGIN_M:
        yield conflict(
            mission,
            ("separation.hard_m", "sim.placement_spacing_m"),
            f"must be at most placement_spacing_m less {MARGIN_M:g} m",
        )
    if start_link_m(mission) < (RANDOM_STEP if mission.sim.placement is Placement.RANDOM else 1.0) * spacing_m:
        yield conflict(
            mission,
            ("sim.placement_spacing_m", "radio.transit_range_m", "sim.placement"),
            f"must be at most transit_range_m less {LINK_SLACK_M:g} m, and half of that for random placement: else the "
            "swarm may start as parts that cannot hear one another",
        )


def _start_beside_tree(mission: MissionTables) -> Iterator[Conflict]:
    """Around the trunks at d2 and the stops, nobody starts."""
    d1 = mission.route.d1_enu_m
    start_m = placement_radius_m(mission) + mission.coverage.keep_out_m + MARGIN_M
    for key, pos_enu_m in route_points(mission)[1:]:
        off_m = math.dist(d1[:2], pos_enu_m[:2])
        if mission.coverage.shape is CoverageShape.RING and d1 != pos_enu_m and off_m < start_m:
            also = (key, "coverage.keep_out_m", *placement_keys(mission))
            yield conflict(
                mission,
                ("route.d1_enu_m", *also),
                f"is {off_m:.1f} m from the trunk at {name_of(key)}: must be at least {start_m:.1f} m, for starting "
                f"points outside keep_out_m and {MARGIN_M:g} m",
            )


def _time_limit(mission: MissionTables) -> Iterator[Conflict]:
    """Each way ends at arrival_distance_m or where the coverage begins; those that leave a coverage, at its rim."""
    route, limit_s = mission.route, mission.sim.time_limit_s
    radius_m = mission.coverage.radius_m
    ends_m = max(route.arrival_distance_m, radius_m)
    ways = [max(0.0, math.dist(a, b) - ends_m) for a, b in pairwise(route.points_enu_m)]
    ways = [ways[0], *(max(0.0, way_m - radius_m) for way_m in ways[1:])]
    if route.at_end is AtEnd.RETURN:
        ways.append(max(0.0, math.dist(route.d2_enu_m, route.d1_enu_m) - ends_m))
    least_s = sum(ways) / route.vel_leader_mps + sum(visit.duration_s for visit in mission.visits)
    if limit_s is not None and limit_s <= least_s:
        stay = [f"route.stops.{k}.duration_s" for k, stop in enumerate(route.stops) if stop.duration_s is not None]
        yield conflict(
            mission,
            (
                "sim.time_limit_s",
                *(key for key, _ in route_points(mission)),
                "route.vel_leader_mps",
                *stay,
                "coverage.duration_s",
                "route.at_end",
            ),
            f"must be above {least_s:.1f} s, which the way and the coverage take by themselves",
        )


def _trees(mission: MissionTables) -> Iterator[Conflict]:
    start_m = placement_radius_m(mission) + trunk_clearance_m(mission)
    keep_out_m = mission.coverage.keep_out_m
    for index, tree in enumerate(mission.forest.trees):
        path: Path = ("forest", "trees", index)
        start_gap_m = math.dist(tree.base_enu_m, mission.route.d1_enu_m[:2]) - tree.trunk_radius_m
        if start_gap_m < start_m:
            also = ("route.d1_enu_m", *placement_keys(mission))
            others = ", ".join(show_key(mission, key) for key in also)
            yield Conflict(
                ((*path, "base_enu_m"), (*path, "trunk_radius_m"), *map(path_of, also)),
                shown(tree.base_enu_m),
                f"stands {start_gap_m:.1f} m from d1: must be at least {start_m:.1f} m, outside the "
                f"starting points ({others})",
            )
        for key, pos_enu_m in route_points(mission)[1:]:
            offset_m = math.dist(tree.base_enu_m, pos_enu_m[:2])
            if offset_m < keep_out_m < offset_m + tree.trunk_radius_m:
                yield Conflict(
                    ((*path, "trunk_radius_m"), (*path, "base_enu_m"), ("coverage", "keep_out_m"), path_of(key)),
                    shown(tree.trunk_radius_m),
                    f"reaches {offset_m + tree.trunk_radius_m:.2f} m from {name_of(key)}: must be at most "
                    f"{show_key(mission, 'coverage.keep_out_m')} ({show_key(mission, key)})",
                )
