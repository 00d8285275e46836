"""Rules that a mission's survey must satisfy together with its sensor, and where that sensor cuts breast height."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mission.schema.conflict import Conflict, conflict
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.schema.tables import AtEnd, MissionTables
from mission.schema.trees import BREAST_HEIGHT_M

LEAST_SPAN_M = 1.5  # of distances at which layers cut breast height: for less, trunks are cut on too little of the way


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    if mission.survey is None:
        return
    yield from _until(mission)
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
    until = None if mission.survey is None else mission.survey.until
    if until is None:
        return
    if mission.route.at_end is AtEnd.HOLD:
        yield conflict(mission, ("route.at_end",), 'never ends coverage: [survey] until needs "return" or "land"')
    if until.after_s >= mission.coverage.duration_s:
        yield conflict(
            mission,
            ("survey.until.after_s", "coverage.duration_s"),
            "must be less than the time that coverage takes at most",
        )


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
