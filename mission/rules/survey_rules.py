"""Rules that a mission's survey must satisfy together with its sensor, and where that sensor cuts breast height."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from mission.common.plane import way_clearance_m
from mission.lanes.spread import PASS_M
from mission.schema.conflict import Conflict, conflict
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.schema.tables import FENCE_SLACK_M, MAX_LANES, AtEnd, MissionTables
from mission.schema.trees import BREAST_HEIGHT_M

LANE_ABOVE_M = 1.0  # of a lane above the ground
LEAST_SPAN_M = 1.5  # of distances at which layers cut breast height: for less, trunks are cut on too little of the way


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    if mission.survey is None:
        return
    yield from _until(mission)
    yield from _lanes(mission)
    if mission.sensing is None:
        needed = f"missing; [survey] needs [sensing] with a lidar that tells every ray: sensor is one of {_classes()}"
        yield Conflict((("sensing",), ("survey",)), "", needed)
    elif mission.sensing.sensor is SensorClass.SECTORS:
        yield conflict(
            mission,
            ("sensing.sensor",),
            f"cannot be surveyed with: 72 sectors of 5 degrees tell how near a stem is, and no diameter. One of "
            f"{_classes()} does; or leave [survey] out",
        )


def _until(mission: MissionTables) -> Iterator[Conflict]:
    """Coverage can end before its time: there is some, and something comes after it."""
    survey = mission.survey
    if survey is None or survey.until is None or survey.area_enu_m is not None:  # lanes can end after the first
        return
    if mission.route.at_end is AtEnd.HOLD:
        yield conflict(mission, ("route.at_end",), 'never ends coverage: [survey] until needs "return" or "land"')
    if survey.until.after_s >= mission.coverage.duration_s:
        yield conflict(
            mission,
            ("survey.until.after_s", "coverage.duration_s"),
            "must be less than the time that coverage takes at most",
        )


def _lanes(mission: MissionTables) -> Iterator[Conflict]:
    """Lanes that the fence, the ground and the beacons have room for."""
    survey, key = mission.survey, "survey.area_enu_m"
    if survey is None or survey.area_enu_m is None:
        return
    if mission.route.stops:
        yield conflict(mission, ("route.stops", key), "must be left out: lanes are flown instead")
    keys = (key, "survey.lane_m", "swarm.size", "separation.soft_m")
    lanes = mission.lanes
    if not 0 < len(lanes) <= MAX_LANES:
        made = f"{len(lanes)}" if lanes else "too many"
        yield conflict(
            mission,
            keys,
            f"takes {made} lanes, {mission.swath.lane_m:.1f} m apart: must be at most {MAX_LANES}; a smaller area, or "
            "more vehicles",
        )
        return
    yield from _lanes_in_fence(mission, keys)
    yield from _lanes_in_time(mission, keys)
    _, first, *_ = way = mission.way_enu_m
    climb_m = abs(first[2] - way[0][2])
    to_m = math.dist(way[0], first)
    climb_mps = mission.route.vel_leader_mps * climb_m / to_m if climb_m else 0.0
    if climb_mps > mission.limits.climb_max_mps:
        yield conflict(
            mission,
            ("route.d1_enu_m", "route.d2_enu_m", "route.vel_leader_mps", "limits.climb_max_mps", key),
            f"makes the leader climb or descend at {climb_mps:.2f} m/s to lane 1: must be at most climb_max_mps",
        )
    for east_m, north_m, up_m in way[1:-1]:
        above_m = up_m - mission.forest.grade[0] * east_m - mission.forest.grade[1] * north_m
        if any(mission.forest.grade) and above_m <= LANE_ABOVE_M:
            yield conflict(
                mission,
                ("route.d2_enu_m", "forest.grade", key),
                f"is {above_m:.1f} m above the ground at the lane's end ({east_m:.1f}, {north_m:.1f}): must be more "
                f"than {LANE_ABOVE_M:g} m",
            )
            return


def _lanes_in_time(mission: MissionTables, keys: tuple[str, ...]) -> Iterator[Conflict]:
    """The way takes less than the simulator's time limit; a turn is cut by twice PASS_M at most."""
    limit_s = mission.sim.time_limit_s
    way_m = mission.way_m - mission.route.arrival_distance_m - 2.0 * PASS_M * len(mission.visits)
    least_s = way_m / mission.route.vel_leader_mps + mission.coverage.duration_s
    if limit_s is not None and limit_s <= least_s:
        yield conflict(
            mission,
            ("sim.time_limit_s", *keys, "route.vel_leader_mps", "coverage.duration_s"),
            f"must be above {least_s:.1f} s, which {len(mission.lanes)} lanes take by themselves",
        )


def _lanes_in_fence(mission: MissionTables, keys: tuple[str, ...]) -> Iterator[Conflict]:
    """The first way that comes too near to the fence: to, on, between and from lanes; these with the swarm's width."""
    fence, way = mission.fence.polygon_enu_m, mission.way_enu_m
    if fence is None:
        return
    half_m = mission.swath.spread_m / 2.0
    for leg, (here, there) in enumerate(pairwise(way)):
        is_between = 0 < leg < len(way) - 2
        room_m = FENCE_SLACK_M + (half_m if is_between else 0.0)
        clear_m = way_clearance_m(here[:2], there[:2], fence)
        if clear_m < room_m:
            what = f"lane {(leg + 1) // 2}" if leg % 2 else f"the way to lane {leg // 2 + 1}"
            what = "the way to d2" if leg == len(way) - 2 else what
            need = f"{FENCE_SLACK_M:.0f} m of slack" + (f" and {half_m:.1f} m of the swarm" * is_between)
            yield conflict(
                mission,
                (*keys, "fence.polygon_enu_m"),
                f"needs {what}, from ({here[0]:.1f}, {here[1]:.1f}) to ({there[0]:.1f}, {there[1]:.1f}), which is "
                f"{max(clear_m, 0.0):.1f} m inside the fence: must be at least {need}",
            )
            return


def _classes() -> str:
    return ", ".join(f'"{kind}"' for kind in RAW_LIDARS)


def cut_distances_m(mission: MissionTables) -> tuple[float, float] | None:
    """Level distances between which the lidar's layers cut a trunk at breast height; None: no layer does in reach.

    Over level ground, from the height of d1.
    """
    survey, sensing = mission.survey, mission.sensing
    lidar = None if sensing is None else RAW_LIDARS.get(sensing.sensor)
    if survey is None or sensing is None or lidar is None:
        return None
    side = -1.0 if sensing.upside_down else 1.0
    falls = [math.tan(math.radians(-side * elevation)) for elevation in lidar.elevations_deg]
    above_m = mission.route.d1_enu_m[2] - BREAST_HEIGHT_M
    steepest, reach_m = max(falls), min(survey.reach_m, sensing.range_m)
    if len(falls) == 1 or steepest <= 0.0 or above_m <= 0.0:
        return None
    nearest_m = above_m / steepest
    return (nearest_m, reach_m) if reach_m - nearest_m >= LEAST_SPAN_M else None
