"""A geofence as MAVLink uploads it: polygons and circles in the plane, to be within or to stay out of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3, Wgs84

VERTICES_MIN: Final = 3
_FRAMES = frozenset(
    {
        mav.MAV_FRAME_GLOBAL,
        mav.MAV_FRAME_GLOBAL_INT,
        mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    }
)
_POLYGONS = {
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False}
Point = tuple[float, float]  # north, east of the mission's origin, metres


class FenceError(ValueError):
    """Items that make no fence."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """Vertices in order, either way round."""

    vertices: tuple[Point, ...]

    def holds(self, point: Point) -> bool:
        """Even-odd rule."""
        north, east = point
        inside = False
        before = self.vertices[-1]
        for vertex in self.vertices:
            if (vertex[1] > east) != (before[1] > east):
                crossing = vertex[0] + (east - vertex[1]) / (before[1] - vertex[1]) * (before[0] - vertex[0])
                inside ^= north < crossing
            before = vertex
        return inside


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc."""

    centre: Point
    radius_m: float

    def holds(self, point: Point) -> bool:
        """Edge included."""
        return math.dist(point, self.centre) <= self.radius_m


@dataclass(frozen=True, slots=True)
class Fence:
    """Shapes to be within, and to stay out of. Empty: everywhere is allowed."""

    inclusions: tuple[Polygon | Circle, ...] = ()
    exclusions: tuple[Polygon | Circle, ...] = ()

    def breached(self, pos_ned_m: Vec3, *, within_all: bool) -> bool:
        """Out of the inclusions (of one that is enough to break, or of all of them), or inside an exclusion."""
        point = pos_ned_m[:2]
        held = [shape.holds(point) for shape in self.inclusions]
        outside = bool(held) and not (all(held) if within_all else any(held))
        return outside or any(shape.holds(point) for shape in self.exclusions)


def fence_of(items: Sequence[Any], frame: LocalFrame) -> Fence:
    """The fence that MISSION_ITEM_INTs describe; FenceError says which of them is wrong."""
    shapes: dict[bool, list[Polygon | Circle]] = {True: [], False: []}
    at = 0
    while at < len(items):
        item = items[at]
        if item.frame not in _FRAMES:
            raise FenceError(f"item {at}: frame {item.frame}")
        if item.command in _POLYGONS:
            count = int(item.param1) if VERTICES_MIN <= item.param1 <= len(items) - at else 0
            run = items[at : at + count]
            if not run or any(other.command != item.command or other.param1 != item.param1 for other in run):
                raise FenceError(f"item {at}: not a polygon of {item.param1} vertices")
            vertices = tuple(_point(vertex, frame, at + k) for k, vertex in enumerate(run))
            shapes[_POLYGONS[item.command]].append(Polygon(vertices))
            at += count
        elif item.command in _CIRCLES:
            if not (item.param1 > 0.0 and math.isfinite(item.param1)):
                raise FenceError(f"item {at}: radius {item.param1}")
            shapes[_CIRCLES[item.command]].append(Circle(_point(item, frame, at), item.param1))
            at += 1
        elif item.command == mav.MAV_CMD_NAV_FENCE_RETURN_POINT:
            at += 1
        else:
            raise FenceError(f"item {at}: command {item.command}")
    return Fence(tuple(shapes[True]), tuple(shapes[False]))


def _point(item: Any, frame: LocalFrame, at: int) -> Point:
    lat_deg, lon_deg = item.x / 1e7, item.y / 1e7
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        raise FenceError(f"item {at}: no such place")
    north, east, _ = frame.to_ned(Wgs84(lat_deg, lon_deg, frame.origin.alt_m))
    return north, east
