"""Rules of a leader that rises to deliver records: its sensor can have seen the column above the place first."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from mission.schema.conflict import Conflict, conflict
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.schema.tables import CoverageShape, MissionTables

ABOVE_M: Final = 1.0  # of the top: seen free, too, as heights are off
BEFORE_S: Final = 10.0  # in coverage before anybody rises
MARGIN_M: Final = 1.0  # of a sensor's reach: it sees the far side of the column
APPROACH_S: Final = 20.0  # to the column
ALOFT_MAX_S: Final = 90.0  # on the way up, and there
DOWN_MPS: Final = 1.0  # at most: as fast as the safety filter backs off from a ceiling


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    key, top_m = "survey.rise_to_m", mission.rise_to_m
    if top_m is None:
        return
    if top_m <= mission.fence.altitude_max_m:
        yield conflict(mission, (key, "fence.altitude_max_m"), "must be above the height that holds all others")
    if mission.flies_by_ranges:
        yield conflict(mission, (key, "swarm.gnss"), "must be left out: a leader rises by satellite positions alone")
    if mission.coverage.shape is not CoverageShape.RING:
        yield conflict(mission, (key, "coverage.shape"), 'must be left out: others stay below in a "ring" alone')
    if max(visit.duration_s for visit in mission.visits) <= BEFORE_S:
        yield conflict(
            mission, (key, "coverage.duration_s"), f"needs more than {BEFORE_S:g} s of coverage: nobody rests anywhere"
        )
    yield from _sensor(mission, key)


def _sensor(mission: MissionTables, key: str) -> Iterator[Conflict]:
    """A lidar that looks up, as far as the top of the column."""
    sensing = mission.sensing
    if sensing is None:
        return  # a survey has one, or is refused
    view = upward_view(mission)
    if view is None:
        what, also = "has no layers that look up", ""
        if sensing.upside_down and sensing.sensor is SensorClass.MULTI_LAYER:
            what, also = "hangs, and looks 7 degrees up", "sensing.upside_down"
        keys = (key, "sensing.sensor", *([also] if also else []))
        yield conflict(mission, keys, f"needs a sensor that sees the column above: this one {what}")
        return
    away_m, ray_m = view
    if ray_m + MARGIN_M > sensing.range_m:
        yield conflict(
            mission,
            (key, "sensing.range_m"),
            f"is seen from {away_m:.1f} m away and farther, by rays of {ray_m:.1f} m: needs sensing.range_m of at "
            f"least {ray_m + MARGIN_M:.1f}",
        )


def longest_rise_s(mission: MissionTables) -> float:
    """Time by which a leader's rise may prolong coverage; 0: none does. From the ground at worst, and half as fast."""
    return 0.0 if mission.rise_to_m is None else APPROACH_S + ALOFT_MAX_S + 2.0 * mission.rise_to_m / DOWN_MPS


def upward_view(mission: MissionTables) -> tuple[float, float] | None:
    """Level distance from which the steepest layer sees the column's top, and that ray's length; None: none looks up.

    m, from the height of d2.
    """
    sensing, top_m = mission.sensing, mission.rise_to_m
    lidar = None if sensing is None else RAW_LIDARS.get(sensing.sensor)
    if sensing is None or lidar is None or top_m is None or sensing.upside_down or len(lidar.elevations_deg) == 1:
        return None
    steepest = math.radians(max(lidar.elevations_deg))
    up_m = top_m + ABOVE_M - mission.route.d2_enu_m[2]
    return up_m / math.tan(steepest), up_m / math.sin(steepest)
