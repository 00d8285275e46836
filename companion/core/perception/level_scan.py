"""One turn of an obstacle sensor as a level scan: each ray by its bearing, and by where the vehicle was at its time.

Of a lidar with layers it has the flattest ray of each bearing, whichever layer's: ahead of a vehicle that leans forward
by 19 degrees one that looks up from it. What is not at the vehicle's height (ground, crowns) counts as not seen.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.events import ObstacleScan, Position
from mission.common.frames import Vec3
from mission.schema.kinds import RAW_LIDARS, SECTORS_SD_M, SensorClass

GROUND_M: Final = 1.0  # a hit below this height above the mission's ground may be the ground
SECTOR_BEAM: Final = 0.35  # of a sector's width: how far its hit is off its middle, rms
VELOCITY_MPS: Final = 0.25  # by raw scans
VELOCITY_BY_SECTORS_MPS: Final = 0.3
LEAST_SHARE: Final = 1.0 / 3.0  # of a turn: what came of less tells no motion
ROUNDS_MAX: Final = 2.0  # of rays that came in disorder: then the lidar does not count its turns


@final
class ScanClass:
    """Accuracy of a class of sensors."""

    __slots__ = ("beam_rad", "bearing_sd_rad", "has_widths", "range_sd_m", "velocity_mps")

    def __init__(self, sensor: SensorClass) -> None:
        lidar = RAW_LIDARS.get(sensor)
        self.has_widths: Final = lidar is not None  # it tells how wide a stem is
        self.range_sd_m: Final = SECTORS_SD_M if lidar is None else lidar.range_sd_m
        # What a velocity by its trunks is wrong where they tell the position to centimetres, level, 99.9 %
        self.velocity_mps: Final = VELOCITY_MPS if self.has_widths else VELOCITY_BY_SECTORS_MPS
        self.beam_rad: Final = 0.0 if lidar is None else math.radians(lidar.beam_deg)
        # Of a sector; of rays a quarter of their step, and of what the axis of a stem is off besides
        self.bearing_sd_rad: Final = (
            SECTOR_BEAM * math.radians(5.0) if lidar is None else 0.25 * math.radians(lidar.step_deg) + 0.003
        )


@final
class LevelScan:
    """Rays in the order of their bearings round the vehicle, whatever the first one's and either way round."""

    __slots__ = ("bearings_rad", "eyes_east_m", "eyes_north_m", "has_looked", "ranges_m", "step_rad")

    def __init__(self, step_rad: float) -> None:
        """`step_rad`: from ray to ray, > 0."""
        self.step_rad: Final = step_rad
        self.bearings_rad: list[float] = []  # from north clockwise
        self.ranges_m: list[float] = []  # level; inf: nothing there, nan: not measured, or not at this height
        self.eyes_north_m: list[float] = []  # where the vehicle was, in the frame of the own odometry
        self.eyes_east_m: list[float] = []
        self.has_looked: list[bool] = []  # of each bearing, whether a ray did; empty: at all of them

    def add_ray(self, bearing_rad: float, range_m: float, eye_north_m: float, eye_east_m: float) -> None:
        """The next ray."""
        self.bearings_rad.append(bearing_rad)
        self.ranges_m.append(range_m)
        self.eyes_north_m.append(eye_north_m)
        self.eyes_east_m.append(eye_east_m)

    @property
    def is_whole(self) -> bool:
        """It goes once round."""
        return (len(self.ranges_m) + 0.5) * self.step_rad >= math.tau

    def sees_beyond(self, north_m: float, east_m: float, by_m: float) -> bool:
        """True if the rays towards a place, and beside it, all went on by so much: nothing was there.

        One that is not measured may have met the foot of a trunk, below the vehicle's height.
        """
        if not self.is_whole:
            return False
        first = self._find_ray(north_m, east_m)
        count = len(self.ranges_m)
        for k in (first - 1, first, first + 1):
            at = k % count
            n, e = north_m - self.eyes_north_m[at], east_m - self.eyes_east_m[at]
            if not self.ranges_m[at] > math.sqrt(n * n + e * e) + by_m:
                return False
        return True

    def looked_at(self, north_m: float, east_m: float) -> bool:
        """A ray of a whole turn went towards a place, whatever it met."""
        return not self.has_looked or self.has_looked[self._find_ray(north_m, east_m) % len(self.has_looked)]

    def is_cut_off(self, first: int, last: int) -> bool:
        """Beside these rays, side by side, is a bearing at which none looked: what they hit may go on there."""
        count = len(self.has_looked)
        return count > 0 and not (self.has_looked[(first - 1) % count] and self.has_looked[(last + 1) % count])

    def _find_ray(self, north_m: float, east_m: float) -> int:
        """Index of the ray towards a place, modulo their number; of a whole turn."""
        n, e = north_m - self.eyes_north_m[0], east_m - self.eyes_east_m[0]
        around = math.remainder(self.bearings_rad[len(self.ranges_m) // 4] - self.bearings_rad[0], math.tau)
        turned_rad = math.atan2(e, n) - self.bearings_rad[0]
        return math.floor((turned_rad if around > 0.0 else -turned_rad) / self.step_rad + 0.5)


@final
class LevelTurn:
    """One turn of a lidar of one layer, of its pieces: its level scan, as soon as they go once round.

    What does not by the time that the next turn begins is a turn all the same: where a mast, a mask or a lost piece
    leaves bearings at which no ray looked, these count as not measured. `begin_piece`, then `add_ray` with each of its
    rays; `take_whole` after each piece, `as_far_as_seen` at last.
    """

    __slots__ = ("_goes_on", "_is_told", "_next_rad", "_pieces", "_rays", "_step_rad")

    def __init__(self, step_rad: float) -> None:
        """`step_rad`: from ray to ray, not 0; its sign says which way the lidar turns."""
        self._step_rad: Final = step_rad
        self._rays = LevelScan(abs(step_rad))  # in the order in which they came
        # Of each piece: when its first ray was measured, that ray's bearing from the body's own ahead, the step, its
        # first ray, and the one behind its last
        self._pieces: list[tuple[float, float, float, int, int]] = []
        self._next_rad = 0.0  # where the next piece begins, if none is lost
        self._goes_on = True  # each piece began where the one before it ended
        self._is_told = False

    def begin_piece(self, measured_s: float, start_rad: float, step_rad: float, count: int) -> None:
        """The next `count` rays: from that bearing on, clockwise from the body's own ahead."""
        rays = self._rays
        if len(rays.ranges_m) * rays.step_rad > ROUNDS_MAX * math.tau:
            self._begin_anew()
        if self._pieces and abs(math.remainder(start_rad - self._next_rad, math.tau)) > rays.step_rad:
            self._goes_on = False
        self._next_rad = start_rad + count * step_rad
        first = len(self._rays.ranges_m)
        self._pieces.append((measured_s, start_rad, step_rad, first, first + count))

    def add_ray(self, bearing_rad: float, range_m: float, eye_north_m: float, eye_east_m: float) -> None:
        """As LevelScan.add_ray."""
        self._rays.add_ray(bearing_rad, range_m, eye_north_m, eye_east_m)

    def take_whole(self) -> LevelScan | None:
        """The turn, once, when its pieces have gone once round, one after the other."""
        if not (self._goes_on and self._rays.is_whole):
            return None
        whole = self._rays
        self._begin_anew()
        return whole

    def as_far_as_seen(self) -> LevelScan | None:
        """A turn that is over and was not told: each ray at its bearing, whatever the order in which pieces came.

        From the ray that was measured first. Bearings at which none looked are not measured, from where the ray before
        them was. None: it was told, or too little of it came.
        """
        if self._is_told or not self._pieces:
            return None
        rays, step_rad = self._rays, self._rays.step_rad
        count = max(1, math.floor(math.tau / step_rad + 0.5))
        side = 1.0 if self._step_rad > 0.0 else -1.0
        pieces = sorted(self._pieces)
        first_rad = pieces[0][1]
        at_ray = [-1] * count  # of each bearing
        for _, start_rad, piece_step_rad, begin, end in pieces:
            for k in range(begin, end):
                turned_rad = side * (start_rad - first_rad + (k - begin) * piece_step_rad)
                at_ray[math.floor(turned_rad / step_rad + 0.5) % count] = k
        if count - at_ray.count(-1) < LEAST_SHARE * count:
            return None
        seen = LevelScan(step_rad)
        last = before = 0
        for k in range(count):
            ray = at_ray[k]
            if ray >= 0:
                last, before = ray, k
            bearing_rad = rays.bearings_rad[last] + side * (k - before) * step_rad
            range_m = rays.ranges_m[last] if ray >= 0 else math.nan
            seen.add_ray(bearing_rad, range_m, rays.eyes_north_m[last], rays.eyes_east_m[last])
            seen.has_looked.append(ray >= 0)
        return seen

    def _begin_anew(self) -> None:
        """Drops all rays: the turn was told, and those that are still to come of it are no other."""
        self._rays, self._pieces = LevelScan(self._rays.step_rad), []
        self._goes_on = self._is_told = True


@final
class FlattestRays:
    """Flattest measured ray of each bearing of one turn of a lidar of several layers."""

    __slots__ = ("_bearings_rad", "_eyes_east_m", "_eyes_north_m", "_missed", "_ranges_m", "slopes", "step_rad")

    def __init__(self, step_rad: float) -> None:
        """`step_rad`: from ray to ray of a layer, > 0."""
        self.step_rad: Final = step_rad
        count = max(1, math.floor(math.tau / step_rad + 0.5))
        self.slopes: Final = [math.inf] * count  # sine of the elevation of the one that is kept
        self._missed: Final = [math.inf] * count  # of the flattest that was not measured
        self._ranges_m: Final = [math.nan] * count
        self._bearings_rad: Final = [0.0] * count
        self._eyes_north_m: Final = [0.0] * count
        self._eyes_east_m: Final = [0.0] * count

    def index_of(self, body_rad: float) -> int:
        """Of a bearing from the body's own ahead."""
        return math.floor(body_rad / self.step_rad + 0.5) % len(self.slopes)

    def put_ray(
        self, index: int, slope: float, bearing_rad: float, range_m: float, eye_ne_m: tuple[float, float]
    ) -> None:
        """A measured ray that is flatter than the one there. Else as LevelScan.add_ray."""
        self.slopes[index] = slope
        self._bearings_rad[index] = bearing_rad
        self._ranges_m[index] = range_m
        self._eyes_north_m[index], self._eyes_east_m[index] = eye_ne_m

    def miss_ray(self, index: int, slope: float) -> None:
        """A ray that was not measured."""
        if slope < self._missed[index]:
            self._missed[index] = slope

    def as_scan(self) -> LevelScan:
        """Bearings that no ray measured count as not measured, from where the ray before them was.

        So do those where a steeper ray went on, which may have gone over what the flattest would have hit.
        """
        scan = LevelScan(self.step_rad)
        count = len(self.slopes)
        known = [k for k in range(count) if self.slopes[k] < math.inf]
        last = known[-1] if known else 0
        before = last - count
        for k in range(count):
            if self.slopes[k] < math.inf:
                last = before = k
            bearing_rad = self._bearings_rad[last] + (k - before) * self.step_rad
            is_over = self._ranges_m[k] == math.inf and self._missed[k] < self.slopes[k]
            range_m = math.nan if is_over else self._ranges_m[k]
            scan.add_ray(bearing_rad, range_m, self._eyes_north_m[last], self._eyes_east_m[last])
        return scan


def level_scan_of(scan: ObstacleScan, own: Position) -> LevelScan:
    """A scan of sectors, from where the vehicle was when it was measured. `own`: its position now."""
    level = LevelScan(abs(scan.step_rad))
    x, y, _ = axes_ned(scan.roll_rad, scan.pitch_rad, scan.yaw_rad)
    eye_n = own.pos_ned_m[0] - own.vel_ned_mps[0] * scan.age_s
    eye_e = own.pos_ned_m[1] - own.vel_ned_mps[1] * scan.age_s
    eye_d = own.pos_ned_m[2] - own.vel_ned_mps[2] * scan.age_s
    for k in range(len(scan.ranges_m)):
        bearing = scan.start_rad + k * scan.step_rad
        ahead, right = math.cos(bearing), math.sin(bearing)
        n, e, d = ahead * x[0] + right * y[0], ahead * x[1] + right * y[1], ahead * x[2] + right * y[2]
        range_m = scan.ranges_m[k]
        if range_m > scan.max_m:
            range_m = math.inf
        elif not -(eye_d + d * range_m) > GROUND_M:
            range_m = math.nan
        level.add_ray(math.atan2(e, n), range_m * math.sqrt(n * n + e * e), eye_n, eye_e)
    return level


def axes_ned(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[Vec3, Vec3, Vec3]:
    """The body's axes ahead, to the right and below, NED."""
    sr, cr, sp, cp = math.sin(roll_rad), math.cos(roll_rad), math.sin(pitch_rad), math.cos(pitch_rad)
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    return (
        (cp * cy, cp * sy, -sp),
        (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp),
        (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp),
    )
