"""A box: an upright block that is no tree, such as a wall or a building."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.common.plane import Point, distance_to_segment_m


@dataclass(frozen=True, slots=True)
class StandBox:
    """An upright block with a rectangle, maybe turned, as its plan.

    east_m, north_m: its middle, metres from the mission's origin. along, across: half its sides. cos, sin: of the turn,
    clockwise from above as headings are; at 0 the first side lies east and west. height_m counts from the ground at
    the middle.
    """

    east_m: float
    north_m: float
    along_m: float
    across_m: float
    height_m: float
    cos: float = 1.0
    sin: float = 0.0

    @property
    def reach_m(self) -> float:
        """From its middle to a corner."""
        return math.hypot(self.along_m, self.across_m)

    def local(self, east_m: float, north_m: float) -> Point:
        """A place in its own frame: along its first side, and across to the left of that."""
        east_m, north_m = east_m - self.east_m, north_m - self.north_m
        return east_m * self.cos - north_m * self.sin, east_m * self.sin + north_m * self.cos

    def corners(self) -> tuple[Point, Point, Point, Point]:
        """East, north of its corners, in order."""
        signs = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
        a, b, c, d = [self._outside(i * self.along_m, j * self.across_m) for i, j in signs]
        return a, b, c, d

    def _outside(self, x: float, y: float) -> Point:
        return self.east_m + x * self.cos + y * self.sin, self.north_m - x * self.sin + y * self.cos

    def clearance_m(self, east_m: float, north_m: float) -> float:
        """Level distance from a place to its surface; 0 inside."""
        x, y = self.local(east_m, north_m)
        return math.hypot(max(0.0, abs(x) - self.along_m), max(0.0, abs(y) - self.across_m))

    def farthest_m(self, east_m: float, north_m: float) -> float:
        """Level distance from a place to its farthest corner."""
        x, y = self.local(east_m, north_m)
        return math.hypot(abs(x) + self.along_m, abs(y) + self.across_m)

    def beside_m(self, a: Point, b: Point) -> float:
        """Least level distance between the straight way from a to b, east and north, and its surface; 0: through it."""
        if self.part_inside(a, b) is not None:
            return 0.0
        ends = min(self.clearance_m(a[0], a[1]), self.clearance_m(b[0], b[1]))
        return min(ends, *[distance_to_segment_m(corner, a, b) for corner in self.corners()])

    def part_inside(self, a: Point, b: Point) -> tuple[float, float] | None:
        """The shares of the level way from a to b at which it enters and leaves; None: it passes by."""
        from_x, from_y = self.local(a[0], a[1])
        to_x, to_y = self.local(b[0], b[1])
        enters, leaves = 0.0, 1.0
        for start, way, half in ((from_x, to_x - from_x, self.along_m), (from_y, to_y - from_y, self.across_m)):
            if way == 0.0:
                if abs(start) >= half:
                    return None
                continue
            first, last = (-half - start) / way, (half - start) / way
            enters, leaves = max(enters, min(first, last)), min(leaves, max(first, last))
        return (enters, leaves) if enters < leaves else None


def box_of(middle_enu_m: Point, *, length_m: float, width_m: float, height_m: float, rotation_deg: float) -> StandBox:
    """By its whole sides and its turn, clockwise from above."""
    turn = math.radians(rotation_deg)
    cos, sin = math.cos(turn), math.sin(turn)
    return StandBox(middle_enu_m[0], middle_enu_m[1], length_m / 2.0, width_m / 2.0, height_m, cos, sin)
