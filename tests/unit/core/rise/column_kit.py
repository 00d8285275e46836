"""Columns that are seen: as a lidar sees them, or at once."""

from __future__ import annotations

import math

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.perception.columns.column import LEAST_PASSES, LEVEL_M, Column
from companion.core.perception.columns.column_map import TURNS, ColumnMap
from mission.common.frames import Vec3
from mission.schema.kinds import RAW_LIDARS, SensorClass
from tests.unit.sensors.lidar_kit import scan

ELEVATIONS_DEG = RAW_LIDARS[SensorClass.MULTI_LAYER].elevations_deg


def see_column(
    one: Column, now_s: float, *, times: int = LEAST_PASSES, hidden_up_m: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Level rays through each cell of it, but for those between two heights."""
    half_m = one.half_m
    across = round(2.0 * half_m / 0.5)
    for level in range(one.levels):
        up_m = one.floor_up_m + (level + 0.5) * LEVEL_M
        if hidden_up_m[0] <= up_m <= hidden_up_m[1]:
            continue
        for k in range(across):
            east_m = one.east_m - half_m + 0.5 * (k + 0.5)
            for _ in range(times):
                one.add_ray((one.north_m - 5.0, east_m, -up_m), (1.0, 0.0, 0.0), math.inf, 40.0, now_s)


def see_from(seen: ColumnMap, eye_ned_m: Vec3, now_s: float, *, max_m: float, side: float = 1.0) -> None:
    """A turn of a lidar of layers there, which nothing stops. `side`: -1: it hangs."""
    turn = TURNS * (round(10.0 * now_s) % 80)
    for elevation_deg in ELEVATIONS_DEG:
        piece = scan(
            (math.inf,) * 360, turn=turn, elevation_rad=side * math.radians(elevation_deg), max_m=max_m, age_s=0.0
        )
        seen.integrate(piece, Position(eye_ned_m, ZERO), now_s)
