"""Walls in level scans, and what they tell of the own motion: all across them, nothing along."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.perception.landmarks.stem_clusters import find_stems
from companion.core.perception.landmarks.wall_segments import WallSegment, find_walls, mark_walls
from companion.core.perception.level_scan import LevelScan, ScanClass
from companion.core.perception.obstacle_perception import SensingPerception, build_perception
from companion.core.perception.own_motion import OwnMotion
from tests.unit.core.core_kit import mission
from tests.unit.core.perception.scan_kit import FINE, SECTORS, level_scan

Line = tuple[tuple[float, float], tuple[float, float]]  # from a place to a place, north and east
EAST_WALL: Line = ((-6.0, 4.0), (6.0, 4.0))
NORTH_WALL: Line = ((5.0, -6.0), (5.0, 4.0))
MAX_M = 12.0


def range_to(lines: Sequence[Line], eye: tuple[float, float], bearing_rad: float) -> float:
    """The nearest of them along a ray; inf: none."""
    nearest_m, way_n, way_e = math.inf, math.cos(bearing_rad), math.sin(bearing_rad)
    for (n0, e0), (n1, e1) in lines:
        dn, de = n1 - n0, e1 - e0
        det = way_e * dn - way_n * de
        if abs(det) < 1e-9:
            continue
        n, e = n0 - eye[0], e0 - eye[1]
        away_m, share = (e * dn - n * de) / det, (e * way_n - n * way_e) / det
        if away_m > 0.0 and 0.0 <= share <= 1.0:
            nearest_m = min(nearest_m, away_m)
    return nearest_m if nearest_m <= MAX_M else math.inf


def scan_of(lines: Sequence[Line], eye: tuple[float, float], kind: ScanClass, turned_rad: float = 0.0) -> LevelScan:
    """One turn: of sectors the nearest of ten rays each. `turned_rad`: by which the reported yaw is too large."""
    rays, each = (360, 1) if kind.has_widths else (72, 10)
    step = math.tau / rays
    scan = LevelScan(step)
    for k in range(rays):
        bearings = [(k + (j - (each - 1) / 2.0) / each) * step for j in range(each)]
        scan.add_ray(k * step + turned_rad, min(range_to(lines, eye, one) for one in bearings), *eye)
    return scan


def only(walls: list[WallSegment]) -> WallSegment:
    assert len(walls) == 1
    return walls[0]


@pytest.mark.parametrize(("kind", "off_m"), [(FINE, 0.02), (SECTORS, 0.08)])
@pytest.mark.parametrize("slant_rad", [0.0, 0.3, -0.5])
def test_a_straight_wall_is_found_where_it_is(kind: ScanClass, off_m: float, slant_rad: float) -> None:
    cos, sin = math.cos(slant_rad), math.sin(slant_rad)
    line = ((-6.0 * cos + 4.0 * -sin, 4.0 * cos - 6.0 * sin), (6.0 * cos - 4.0 * sin, 4.0 * cos + 6.0 * sin))
    wall = only(find_walls(scan_of([line], (0.0, 0.0), kind), kind))
    normal = math.atan2(-cos, sin)  # from the wall towards the eye
    assert math.remainder(wall.normal_rad - normal, math.tau) == pytest.approx(0.0, abs=0.03)
    away_m = -(wall.north_m * math.cos(normal) + wall.east_m * math.sin(normal))
    assert away_m == pytest.approx(4.0, abs=off_m)


@pytest.mark.parametrize("kind", [FINE, SECTORS])
def test_two_sides_of_a_corner_are_two_walls_and_no_stems(kind: ScanClass) -> None:
    scan = scan_of([EAST_WALL, NORTH_WALL], (0.0, 0.0), kind)
    walls = find_walls(scan, kind)
    assert len(walls) == 2
    assert find_stems(scan, kind, mark_walls(walls, scan)) == []


def test_trunks_in_a_row_are_no_wall() -> None:
    row = [(float(n), 4.0, 0.2) for n in range(-6, 7, 2)]
    assert find_walls(level_scan(row), FINE) == []


@pytest.mark.parametrize("far_m", [5.0, 9.0])
def test_a_box_in_sectors_is_no_stem_even_where_it_is_taken_for_no_wall(far_m: float) -> None:
    scan = scan_of([((-2.5, far_m), (2.5, far_m))], (0.0, 0.0), SECTORS)
    assert find_stems(scan, SECTORS) == []


BOX: tuple[Line, Line] = (((4.0, 5.0), (9.0, 5.0)), ((4.0, 5.0), (4.0, 18.0)))  # its sides to the west and the south


@pytest.mark.parametrize("eye", [(0.0, 0.0), (0.0, -1.5), (0.8, -0.7)])
def test_a_side_of_a_box_is_a_wall_in_sectors_as_far_as_it_is_seen(eye: tuple[float, float]) -> None:
    """Its last hit is as far off as the wall at the sector's edge, and not in its middle."""
    walls = [wall for wall in find_walls(scan_of(BOX, eye, SECTORS), SECTORS) if wall.tells]
    west_rad = -math.pi / 2.0
    assert min(abs(math.remainder(wall.normal_rad - west_rad, math.tau)) for wall in walls) < 0.05


@pytest.mark.parametrize("half_m", [2.0, 3.0])
@pytest.mark.parametrize("slant_rad", [0.0, 0.4, 0.8, -0.8])
def test_what_is_seen_of_a_wall_far_off_is_no_stems_in_sectors(half_m: float, slant_rad: float) -> None:
    n, e = half_m * math.cos(slant_rad), half_m * math.sin(slant_rad)
    scan = scan_of([((n, 11.0 + e), (-n, 11.0 - e))], (0.0, 0.0), SECTORS)
    assert find_stems(scan, SECTORS, mark_walls(find_walls(scan, SECTORS), scan)) == []


@pytest.mark.parametrize("corner", [(7.0, 8.5), (7.15, 8.65)])
def test_a_corner_of_a_box_far_off_is_no_stems_in_sectors(corner: tuple[float, float]) -> None:
    n, e = corner
    scan = scan_of([((n, e), (n + 6.0, e)), ((n, e), (n, e + 6.0))], (0.0, 0.0), SECTORS)
    assert sum(range_m < math.inf for range_m in scan.ranges_m) > 1
    assert find_stems(scan, SECTORS, mark_walls(find_walls(scan, SECTORS), scan)) == []


@pytest.mark.parametrize(
    ("kind", "at"), [(FINE, (0.0, 2.5)), (SECTORS, (1.0, 2.0)), (SECTORS, (0.0, 3.0)), (SECTORS, (1.0, 2.7))]
)
def test_a_vehicle_before_a_wall_is_none_of_it(kind: ScanClass, at: tuple[float, float]) -> None:
    """Hidden among the wall's rays it would never be followed, or kept clear of as one that moves."""
    scan = scan_of([EAST_WALL], (0.0, 0.0), kind)
    hull = level_scan([(*at, 0.35)], rays=len(scan.ranges_m))
    scan.ranges_m = [min(both) for both in zip(scan.ranges_m, hull.ranges_m, strict=True)]
    walls = find_walls(scan, kind)
    assert len(walls) > 0
    places = [
        ((s.surface_m + s.radius_m) * math.cos(s.bearing_rad), (s.surface_m + s.radius_m) * math.sin(s.bearing_rad))
        for s in find_stems(scan, kind, mark_walls(walls, scan))
    ]
    assert any(math.dist(place, at) < 0.4 for place in places)


class Beside:
    """Flies north at 2 m/s between walls, and reports its velocity wrongly."""

    def __init__(
        self, lines: Sequence[Line], kind: ScanClass, off_mps: tuple[float, float], motion: OwnMotion | None = None
    ) -> None:
        self.lines, self.kind, self.off_mps = lines, kind, off_mps
        self.motion = OwnMotion(kind, turns_with_yaw=False) if motion is None else motion
        self.now_s, self.true_m, self.told_m = 10.0, (-4.0, 0.0), (0.0, 0.0)
        self.along: list[tuple[float, float]] = []  # others that fly along, heard: from here

    def run(self, lasts_s: float) -> None:
        for k in range(round(lasts_s / 0.05)):
            self.now_s += 0.05
            self.true_m = (self.true_m[0] + 0.05 * 1.0, self.true_m[1])
            # The position errs as its velocity does: without sight nothing is noticed
            told_m = (self.told_m[0] + 0.05 * (1.0 + self.off_mps[0]), self.told_m[1] + 0.05 * self.off_mps[1])
            self.told_m = told_m
            own = Position((*told_m, -4.0), (1.0 + self.off_mps[0], self.off_mps[1], 0.0), self.now_s)
            self.motion.receive_position(own, self.now_s)
            if k % 2 == 0:
                placed = self.motion.correct_position(own)
                north, east = self.true_m
                hulls = [((north + n, east + e), (north + n + 0.6, east + e)) for n, e in self.along]
                scan = scan_of([*self.lines, *hulls], self.true_m, self.kind, self.motion.turn_rad)
                for j in range(len(scan.eyes_north_m)):
                    scan.eyes_north_m[j], scan.eyes_east_m[j] = placed.pos_ned_m[0], placed.pos_ned_m[1]
                heard = [(n + 0.3, e, 0.0) for n, e in self.along]
                self.motion.integrate_turn(scan, 0.0, placed, heard, self.now_s)


@pytest.mark.parametrize("kind", [FINE, SECTORS])
def test_a_velocity_towards_a_wall_is_corrected_and_one_along_it_is_as_without(kind: ScanClass) -> None:
    flight = Beside([((-20.0, 4.0), (20.0, 4.0))], kind, (0.3, -0.3))
    flight.run(4.0)
    assert flight.motion.odometry.corrected_along == pytest.approx((0.0, -1.0), abs=0.05)
    otherwise = (0.11, 0.07, 0.02)
    bias = flight.motion.velocity_bias(otherwise)
    assert bias[1] == pytest.approx(0.3, abs=0.07)  # truly it flies along the wall
    assert bias[0] == pytest.approx(0.11, abs=0.05)
    assert bias[2] == 0.02


@pytest.mark.parametrize(("lines", "tells"), [([((-20.0, 4.0), (20.0, 4.0))], False), ([EAST_WALL, NORTH_WALL], True)])
def test_one_wall_tells_the_motion_across_it_alone(lines: list[Line], *, tells: bool) -> None:
    """Along it the reported velocity errs as before: no margin is given up."""
    perception = build_perception(mission(sensing={"sensor": "scan-1deg"}), 1)
    assert isinstance(perception, SensingPerception)
    flight = Beside(lines, FINE, (0.3, -0.3), perception.motion)
    flight.run(4.0)
    assert perception.sees_motion is tells
    assert (perception.motion.odometry.shift_sd_m(flight.now_s) < 0.1) is tells


@pytest.mark.parametrize("kind", [FINE, SECTORS])
def test_pieces_of_a_wall_behind_others_that_fly_along_are_no_trunks(kind: ScanClass) -> None:
    """They would go along with the eye: a vehicle thought that it stood, and dropped a true fix."""
    wall: Line = ((-30.0, 4.0), (30.0, 4.0))
    flight = Beside([wall], kind, (0.0, 0.0))
    flight.run(1.5)
    flight.along = [(n, 2.0) for n in (-3.4, -2.2, 1.4, 2.6)]
    flight.run(6.0)
    assert flight.motion.odometry.is_corrected(flight.now_s)
    on_wall = [t for t in flight.motion.odometry.trunks if t.is_good and abs(t.east_m - 4.0) < 0.5]
    assert on_wall == []
    assert math.hypot(*flight.motion.odometry.shift_m) < 0.5


@pytest.mark.parametrize("corner", [(2.0, 8.0), (3.0, 9.0), (4.0, 10.0)])
def test_a_box_that_is_passed_turns_no_heading(corner: tuple[float, float]) -> None:
    """Its sides, seen in a few sectors each, were taken for trunks that slid along: by 13 degrees."""
    n, e = corner
    flight = Beside([((n, e), (n + 6.0, e)), ((n, e), (n, e + 8.0))], SECTORS, (0.0, 0.0))
    for _ in range(40):
        flight.run(0.2)
        assert abs(flight.motion.odometry.turn_rad) < math.radians(1.0)
    assert math.hypot(*flight.motion.odometry.shift_m) < 0.1


@pytest.mark.parametrize("anew", [True, False])
def test_a_second_place_that_ranges_tell_is_flown_by_beside_a_wall(anew: bool) -> None:
    """Else the jump of what is reported is taken for an estimator's, and off again."""
    flight = Beside([((-20.0, 4.0), (20.0, 4.0))], FINE, (0.0, 0.0))
    flight.run(3.0)
    motion, north = flight.motion, flight.told_m[0]
    for k in range(4):
        place = Position((north + (5.0 if k > 1 else 0.0), 0.0, -4.0), ZERO, flight.now_s + 0.05 * k)
        if k == 2 and anew:
            motion.reckon_anew()
        flown = motion.receive_position(place, flight.now_s + 0.05 * k, reckons=True)
    assert flown.pos_ned_m[0] == pytest.approx(north + (5.0 if anew else 0.0), abs=0.3)


def test_two_walls_that_cross_tell_all() -> None:
    flight = Beside([((-20.0, 4.0), (20.0, 4.0)), ((5.0, -10.0), (5.0, 4.0))], FINE, (0.3, -0.3))
    flight.run(4.0)
    assert flight.motion.odometry.corrected_along is None
    assert flight.motion.velocity_bias(ZERO) == pytest.approx((-0.3, 0.3, 0.0), abs=0.06)


def test_walls_that_are_gone_correct_nothing_any_more() -> None:
    flight = Beside([((-20.0, 4.0), (20.0, 4.0))], FINE, (0.0, -0.3))
    flight.run(3.0)
    flight.lines = []
    flight.run(6.0)
    assert flight.motion.velocity_bias(ZERO) == ZERO
