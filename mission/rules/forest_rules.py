"""Rules that a mission's forest and sensing must satisfy together with the rest: as mission.rules, which says how."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mission.common.plane import Point, area_m2
from mission.common.problems import Path, shown
from mission.rules.flight_rules import (
    MARGIN_M,
    name_of,
    placement_keys,
    placement_radius_m,
    route_points,
    trunk_clearance_m,
)
from mission.schema.conflict import Conflict, conflict, path_of, show_key
from mission.schema.forest import M2_PER_HA, MAX_STAND_TREES, StandSpec
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.schema.sim import Lidar, ScansVia
from mission.schema.tables import CoverageShape, MissionTables

# Trees put down one after another, each at least s from the others, jam where discs of radius s/2 about them take 0.547
# of the area. At 0.35 one in eight places that are tried is free
PACKED_SHARE = 0.35
BOX_SHARE = 0.05  # of its bounding box that an area takes at least: else most places that are tried lie outside
TAKEOFF_CLEAR_M = 1.0  # of d1, d2 above the ground there


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    yield from _ground(mission)
    yield from _boxes(mission)
    yield from _named_trees(mission)
    if mission.forest.stand is not None:
        if mission.forest.file is not None:
            yield conflict(
                mission, ("forest.file",), "must be left out with [forest.stand]: a stand is grown or measured"
            )
        yield from _diameters(mission, mission.forest.stand)
        yield from _number(mission, mission.forest.stand)
        yield from _trunk_at_d2(mission, mission.forest.stand)
        yield from _crowns(mission, mission.forest.stand)
    if mission.sensing is not None:
        yield from _sight(mission)
        yield from _raw_lidar(mission)
        yield from _room(mission)
    else:
        yield from _lidar_of_none(mission)


def stand_area(mission: MissionTables, spec: StandSpec) -> tuple[Point, ...]:
    """Area in which the stand of `mission` grows: east, north of its vertices, m."""
    if spec.area_enu_m is not None:
        return spec.area_enu_m
    points_enu_m = [point[:2] for point in mission.route.points_enu_m]
    if mission.survey is not None:
        points_enu_m += mission.survey.area_enu_m or ()
    east_m, north_m = zip(*points_enu_m, strict=True)
    west, east = min(east_m) - spec.margin_m, max(east_m) + spec.margin_m
    south, north = min(north_m) - spec.margin_m, max(north_m) + spec.margin_m
    return ((west, south), (east, south), (east, north), (west, north))


def wanted_trees(mission: MissionTables, spec: StandSpec) -> int:
    """Number of trees that grow there, before any are cleared."""
    return round(spec.density_per_ha * area_m2(stand_area(mission, spec)) / M2_PER_HA)


def ground_up_m(mission: MissionTables, east_m: float, north_m: float) -> float:
    """Height of the ground above that at the origin."""
    return mission.forest.grade[0] * east_m + mission.forest.grade[1] * north_m


def _ground(mission: MissionTables) -> Iterator[Conflict]:
    for key, pos_enu_m in route_points(mission):
        above_m = pos_enu_m[2] - ground_up_m(mission, pos_enu_m[0], pos_enu_m[1])
        if any(mission.forest.grade) and above_m <= TAKEOFF_CLEAR_M:
            yield conflict(
                mission,
                (key, "forest.grade"),
                f"is {above_m:.1f} m above the ground there: must be more than {TAKEOFF_CLEAR_M:g} m",
            )


def _named_trees(mission: MissionTables) -> Iterator[Conflict]:
    """Trees have ids in a stem map alone."""
    for key, name in (("route.d1_tree", mission.route.d1_tree), ("route.d2_tree", mission.route.d2_tree)):
        if name is not None and mission.forest.file is None:
            yield conflict(mission, (key,), "is a tree of a stem map: the mission has no forest.file")


def _boxes(mission: MissionTables) -> Iterator[Conflict]:
    """Nobody starts in a box or beside it; at d2 and the stops one stands within the ring's middle, or outside it."""
    start_m = placement_radius_m(mission) + trunk_clearance_m(mission)
    keep_out_m = mission.coverage.keep_out_m
    for index, box in enumerate(mission.forest.boxes):
        path: Path = ("forest", "boxes", index)
        gap_m = box.block.clearance_m(*mission.route.d1_enu_m[:2])
        if gap_m < start_m:
            also = ("route.d1_enu_m", *placement_keys(mission))
            others = ", ".join(show_key(mission, key) for key in also)
            yield Conflict(
                ((*path, "centre_enu_m"), (*path, "length_m"), (*path, "width_m"), *map(path_of, also)),
                shown(box.centre_enu_m),
                f"stands {gap_m:.1f} m from d1: must be at least {start_m:.1f} m, outside the "
                f"starting points ({others})",
            )
        for key, pos_enu_m in route_points(mission)[1:]:
            reach_m = box.block.farthest_m(*pos_enu_m[:2])
            if box.block.clearance_m(*pos_enu_m[:2]) < keep_out_m < reach_m:
                yield Conflict(
                    ((*path, "centre_enu_m"), (*path, "length_m"), ("coverage", "keep_out_m"), path_of(key)),
                    shown(box.centre_enu_m),
                    f"reaches from within {show_key(mission, 'coverage.keep_out_m')} of {name_of(key)} to "
                    f"{reach_m:.2f} m from it: must stand all within, or all outside ({show_key(mission, key)})",
                )


def _diameters(mission: MissionTables, spec: StandSpec) -> Iterator[Conflict]:
    for low, high in (("dbh_min_m", "dbh_mean_m"), ("dbh_mean_m", "dbh_max_m"), ("dbh_max_m", "spacing_min_m")):
        if getattr(spec, low) >= getattr(spec, high):
            yield conflict(mission, (f"forest.stand.{low}", f"forest.stand.{high}"), f"must be less than {high}")


def _number(mission: MissionTables, spec: StandSpec) -> Iterator[Conflict]:
    area = stand_area(mission, spec)
    size_m2 = area_m2(area)
    where = "forest.stand.margin_m" if spec.area_enu_m is None else "forest.stand.area_enu_m"
    trees, bushes = wanted_trees(mission, spec), spec.undergrowth_per_ha * size_m2 / M2_PER_HA
    for key, number in (("density_per_ha", trees), ("undergrowth_per_ha", bushes)):
        if number > MAX_STAND_TREES:
            yield conflict(
                mission,
                (f"forest.stand.{key}", where),
                f"makes {number:.0f} on {size_m2 / M2_PER_HA:.1f} ha: must be at most {MAX_STAND_TREES}",
            )
    share = spec.density_per_ha / M2_PER_HA * math.pi * (spec.spacing_min_m / 2.0) ** 2
    if share > PACKED_SHARE:
        most_m = math.floor(200.0 * math.sqrt(PACKED_SHARE * M2_PER_HA / (math.pi * spec.density_per_ha))) / 100.0
        yield conflict(
            mission,
            ("forest.stand.spacing_min_m", "forest.stand.density_per_ha"),
            f"must be at most {most_m:.2f} m, or so many trees find no place",
        )
    width_m, depth_m = (max(p[axis] for p in area) - min(p[axis] for p in area) for axis in (0, 1))
    if size_m2 < BOX_SHARE * width_m * depth_m:
        yield conflict(
            mission,
            ("forest.stand.area_enu_m",),
            f"takes {size_m2:.0f} m2: must be at least {BOX_SHARE:.0%} of the rectangle, east and north, about it",
        )


def _trunk_at_d2(mission: MissionTables, spec: StandSpec) -> Iterator[Conflict]:
    """The trunk of the ring is one of the stand's, as thick as any."""
    if mission.coverage.shape is not CoverageShape.RING:
        return
    sensing = mission.sensing
    about_m = MARGIN_M if sensing is None else sensing.vehicle_radius_m + sensing.margin_m
    least_m = spec.dbh_max_m / 2.0 + about_m
    if mission.coverage.keep_out_m < least_m:
        yield conflict(
            mission,
            ("coverage.keep_out_m", "forest.stand.dbh_max_m"),
            f"must be at least {least_m:.2f} m: half of dbh_max_m, and {about_m:g} m for a vehicle",
        )


def lowest_crown_m(spec: StandSpec) -> float:
    """Height above the ground at which the crowns of a generated stand begin: those of its thinnest trees."""
    return min(spec.tree(0.0, 0.0, spec.dbh_min_m, species).crown_base_m for species in spec.species)


def crown_band_m(mission: MissionTables, spec: StandSpec) -> tuple[float, float]:
    """Heights above the ground between which a vehicle's centre would be among the crowns of a generated stand."""
    thick = [spec.tree(0.0, 0.0, spec.dbh_max_m, species) for species in spec.species]
    radius_m = MARGIN_M if mission.sensing is None else mission.sensing.vehicle_radius_m
    return lowest_crown_m(spec) - radius_m, max(tree.height_m for tree in thick) + radius_m


def _crowns(mission: MissionTables, spec: StandSpec) -> Iterator[Conflict]:
    """Vehicles fly between the trunks, below every crown, or above all trees."""
    low_m, high_m = crown_band_m(mission, spec)
    for key, pos_enu_m in route_points(mission):
        above_m = pos_enu_m[2] - ground_up_m(mission, pos_enu_m[0], pos_enu_m[1])
        if low_m < above_m < high_m:
            also = ["dbh_min_m", "crown_base_share", "species"]
            also += [] if spec.height_mean_m is None else ["height_mean_m"]
            yield conflict(
                mission,
                (key, *(f"forest.stand.{name}" for name in also)),
                f"is {above_m:.1f} m above the ground, among crowns: must be at most {low_m:.2f} m, below all, or at "
                f"least {high_m:.2f} m",
            )


def _sight(mission: MissionTables) -> Iterator[Conflict]:
    """The sensor sees farther than the vehicle takes to stop, and often enough."""
    sensing = mission.sensing
    assert sensing is not None
    speed_mps = mission.route.vel_leader_mps
    braking_m = speed_mps / sensing.rate_hz + speed_mps**2 / (2.0 * mission.limits.acceleration_max_mps2)
    least_m = braking_m + sensing.vehicle_radius_m + sensing.margin_m
    if sensing.range_m < least_m:
        yield conflict(
            mission,
            ("sensing.range_m", "route.vel_leader_mps", "limits.acceleration_max_mps2", "sensing.rate_hz"),
            f"must be at least {least_m:.2f} m: the way of one scan, that of braking, vehicle_radius_m and margin_m",
        )
    if sensing.stale_s < 2.0 / sensing.rate_hz:
        yield conflict(
            mission,
            ("sensing.stale_s", "sensing.rate_hz"),
            f"must be at least {2.0 / sensing.rate_hz:g} s, two scans: one that comes late or not at all is no fault",
        )
    if mission.sim.lidar.delay_s >= sensing.stale_s:
        yield conflict(
            mission,
            ("sim.lidar.delay_s", "sensing.stale_s"),
            f"must be less than {sensing.stale_s:g} s: vehicles do not notice a constant delay, and hit trunks",
        )


def _raw_lidar(mission: MissionTables) -> Iterator[Conflict]:
    """A lidar sees no farther than its class does, has layers to turn over, and a link of its own."""
    sensing = mission.sensing
    assert sensing is not None
    lidar = RAW_LIDARS.get(sensing.sensor)
    if lidar is not None and sensing.range_m > lidar.range_max_m:
        yield conflict(mission, ("sensing.range_m", "sensing.sensor"), f"must be at most {lidar.range_max_m:g} m")
    if lidar is not None and mission.sim.lidar.via is ScansVia.AUTOPILOT:
        yield conflict(
            mission, ("sim.lidar.via", "sensing.sensor"), 'must be "link": no autopilot forwards SWARM_LIDAR_SCAN'
        )
    if sensing.upside_down and sensing.sensor is not SensorClass.MULTI_LAYER:
        yield conflict(mission, ("sensing.upside_down", "sensing.sensor"), "must be false but with multi-layer")


def _lidar_of_none(mission: MissionTables) -> Iterator[Conflict]:
    """Errors of an obstacle sensor that no vehicle has. A written out mission names those by default."""
    for name, value in Lidar():
        if getattr(mission.sim.lidar, name) != value:
            keys = (f"sim.lidar.{name}",)
            yield conflict(mission, keys, "needs [sensing]: without it no vehicle has an obstacle sensor")


def _room(mission: MissionTables) -> Iterator[Conflict]:
    sensing = mission.sensing
    assert sensing is not None
    about_m = sensing.vehicle_radius_m + sensing.margin_m
    if mission.separation.hard_m < 2.0 * about_m:
        yield conflict(
            mission,
            ("separation.hard_m", "sensing.vehicle_radius_m", "sensing.margin_m"),
            f"must be at least {2.0 * about_m:g} m: both vehicles' vehicle_radius_m and margin_m",
        )
    if mission.coverage.keep_out_m < about_m:
        yield conflict(
            mission,
            ("coverage.keep_out_m", "sensing.vehicle_radius_m", "sensing.margin_m"),
            f"must be at least {about_m:g} m: vehicle_radius_m and margin_m",
        )
    stand = mission.forest.stand
    if stand is not None and stand.clearing_m < about_m:
        yield conflict(
            mission,
            ("forest.stand.clearing_m", "sensing.vehicle_radius_m", "sensing.margin_m"),
            f"must be at least {about_m:g} m: vehicle_radius_m and margin_m",
        )
