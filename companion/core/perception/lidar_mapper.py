"""Rays of a lidar -> the obstacle map: each is placed by where the vehicle was, and how it stood, when it was measured.

The map is level, and trunks are upright: of all that rays hit, what is within BAND_M of the vehicle's own height goes
into the map, and what is lower, down to TRUNK_FROM_M. The ground, undergrowth below and crowns above do not, however
many layers a lidar has. A ray says that a way is free as far as it is within that band, and not beyond.

Points go when a whole turn has passed them: of several layers in a bearing, the nearest hit counts before any ray that
went on above or below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.events import LidarScan, Position
from companion.core.perception.level_scan import GROUND_M, FlattestRays, LevelScan, LevelTurn, axes_ned
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.perception.vehicles.hovering_hulls import HoveringHulls
from companion.core.vehicle.obstacle_sensor_monitor import SENSORS_MAX
from mission.common.frames import Vec3

# Above and below the vehicle: its body of 0.5 m, and how far its height may be off by the time that it is there. PX4's
# wanders by 0.34 to 1.2 m.
BAND_M: Final = 1.0
# So high above the mission's ground what is hit lower down is a trunk too, and no undergrowth: who leans ahead sees
# little else of what it flies at
TRUNK_FROM_M: Final = 2.0
BINS: Final = 180  # of what a turn saw free: some rays in each, or it is taken as not seen
STEEP: Final = 0.5  # sine; a steeper ray leaves the band within 2 m, and says nothing of a way
UNSEEN_M: Final = -1.0
LAYER_RAD: Final = 1e-3  # elevations that differ by more are of two layers
TURN_MAX_S: Final = 2.0  # what comes later is of another turn, though a lidar that began anew numbers it alike


@final
class _Turn:
    """Free way that one sensor's turn has seen until now: level metres by bearing from north, over BINS."""

    __slots__ = ("came_s", "eye_ne_m", "flattest", "hit_m", "level", "measured_s", "number", "reach_m")

    def __init__(self, number: int, came_s: float, measured_s: float, eye_ne_m: tuple[float, float]) -> None:
        self.number: Final = number
        self.came_s: Final = came_s  # its first piece
        self.measured_s: Final = measured_s  # its first ray
        self.eye_ne_m: Final = eye_ne_m  # where its first ray began, about the map's anchor
        self.hit_m: list[float] = [math.inf] * BINS  # the nearest hit
        self.reach_m: list[float] = [UNSEEN_M] * BINS  # the farthest that a ray went within the band
        self.level: LevelTurn | None = None  # of the layer that its sensor has
        self.flattest: FlattestRays | None = None  # instead, where it has several

    def as_far_as_seen(self, now_s: float) -> LevelScan | None:
        """Its level scan, when the next one begins; None: it was told, or too little of it came, or long ago."""
        if now_s - self.measured_s > TURN_MAX_S:
            return None
        if self.flattest is not None:
            return self.flattest.as_scan()
        return None if self.level is None else self.level.as_far_as_seen()

    def note_hit(self, bearing_rad: float, away_m: float) -> None:
        """A ray was stopped within the band."""
        k = _bin(bearing_rad)
        if away_m < self.hit_m[k]:
            self.hit_m[k] = away_m

    def note_reach(self, bearing_rad: float, away_m: float) -> None:
        """A ray went so far within the band."""
        k = _bin(bearing_rad)
        if away_m > self.reach_m[k]:
            self.reach_m[k] = away_m


@final
class LidarMapper:
    """One vehicle's. Feed it every piece of a scan with `integrate_rays`."""

    __slots__ = ("_elevations_rad", "_hulls", "_layered", "_map", "_turns")

    def __init__(self, obstacles: ObstacleMap, hulls: HoveringHulls) -> None:
        """`hulls`: of lidars of several layers they get the rays, too."""
        self._map: Final = obstacles
        self._hulls: Final = hulls
        self._turns: dict[int, _Turn] = {}
        self._elevations_rad: dict[int, float] = {}  # of each sensor's first piece
        self._layered: set[int] = set()  # sensors of several layers

    def integrate_rays(
        self, scan: LidarScan, own: Position, now_s: float, ignore: Sequence[Vec3] = ()
    ) -> LevelScan | None:
        """Takes in a piece; a turn's level scan when it is whole, placed as its pieces were.

        It is by the last piece of a turn; of several layers, and where it does not go once round, by the first of the
        next. `own`: position now; `ignore`: where neighbours are, relative (NED m).
        """
        first, last = scan.first_attitude_rad, scan.last_attitude_rad
        if not scan.can_be or not own.is_finite:
            return None
        before = self._turns.get(scan.sensor)
        turn = self._turn_of(scan, own, now_s)
        if turn is None:
            return None
        level, flattest = self._choose_level(scan, turn), turn.flattest
        count = len(scan.ranges_m)
        if level is not None:
            level.begin_piece(now_s - scan.age_s, scan.start_rad, scan.step_rad, count)
        # Roll and pitch as in its middle; the yaw of each ray between first and last, about the body's own axis
        yawed = math.remainder(last[2] - first[2], math.tau)
        x, y, z = axes_ned((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0, first[2] + yawed / 2.0)
        step = scan.step_rad + (yawed / (count - 1) if count > 1 else 0.0)
        bearing = scan.start_rad - (yawed / 2.0 if count > 1 else 0.0)
        flat, down = math.cos(scan.elevation_rad), -math.sin(scan.elevation_rad)
        ahead, right = flat * math.cos(bearing), flat * math.sin(bearing)
        cos_step, sin_step = math.cos(step), math.sin(step)
        for k in range(count):
            range_m = scan.ranges_m[k]
            n = ahead * x[0] + right * y[0] + down * z[0]
            e = ahead * x[1] + right * y[1] + down * z[1]
            d = ahead * x[2] + right * y[2] + down * z[2]
            if level is not None:
                _add_level_ray(level, scan, k, (n, e, d), own)
            if range_m == range_m:  # measured
                if flattest is not None:
                    _add_flat_ray(flattest, scan, k, (n, e, d), own)
                self._take_ray(scan, k, (n, e, d), own, turn, now_s, ignore)
            elif flattest is not None:
                flattest.miss_ray(flattest.index_of(scan.start_rad + k * scan.step_rad), abs(d))
            ahead, right = ahead * cos_step - right * sin_step, right * cos_step + ahead * sin_step
        whole = None if level is None else level.take_whole()
        if whole is None and before is not None and before is not turn:
            return before.as_far_as_seen(now_s)
        return whole

    def _choose_level(self, scan: LidarScan, turn: _Turn) -> LevelTurn | None:
        """The level turn of the one layer that the sensor has; None: it has several, or a piece of it shows nothing."""
        first_rad = self._elevations_rad.setdefault(scan.sensor, scan.elevation_rad)
        if abs(scan.elevation_rad - first_rad) > LAYER_RAD:
            self._layered.add(scan.sensor)
        if scan.step_rad == 0.0:
            return None
        if scan.sensor in self._layered:
            turn.level = None
            if turn.flattest is None:
                turn.flattest = FlattestRays(abs(scan.step_rad))
        elif turn.level is None:
            turn.level = LevelTurn(scan.step_rad)
        return turn.level

    def _take_ray(
        self, scan: LidarScan, k: int, way_ned: Vec3, own: Position, turn: _Turn, now_s: float, ignore: Sequence[Vec3]
    ) -> None:
        """A ray that was measured, by its direction."""
        n, e, d = way_ned
        range_m, slope = scan.ranges_m[k], abs(d)
        is_hit = range_m <= scan.max_m and _is_of_trunk(d * range_m, own.pos_ned_m[2])
        if not is_hit and slope >= STEEP:
            return  # at once: most rays of a lidar that looks up
        flat, bearing = math.sqrt(n * n + e * e), math.atan2(e, n)
        age_s = scan.age_s - k * scan.ray_time_s
        if is_hit:
            turn.note_hit(bearing, flat * range_m)
            vel = own.vel_ned_mps
            off_n, off_e, off_d = (
                n * range_m - vel[0] * age_s,
                e * range_m - vel[1] * age_s,
                d * range_m - vel[2] * age_s,
            )
            if -(own.pos_ned_m[2] + off_d) > GROUND_M and not self._map.is_neighbour(off_n, off_e, off_d, ignore):
                here_n, here_e = self._map.place(own.pos_ned_m[0], own.pos_ned_m[1])
                self._map.hit(here_n + off_n, here_e + off_e, now_s)
        if turn.flattest is not None and flat > 0.0:
            went_m = flat * range_m if range_m <= scan.max_m else math.inf
            self._hulls.note_ray(bearing, way_ned, flat, went_m, _eye_of(scan, k, own))
        if slope < STEEP:
            self._map.mark_flattest(bearing, d / flat, now_s - age_s, turn.measured_s)
            reach_m = range_m if range_m < scan.max_m else scan.max_m
            turn.note_reach(bearing, flat * (reach_m if slope * reach_m <= BAND_M else BAND_M / slope))

    def _turn_of(self, scan: LidarScan, own: Position, now_s: float) -> _Turn | None:
        """The turn that a piece belongs to; the one before is whole by then. None: too many sensors."""
        turn = self._turns.get(scan.sensor)
        if turn is not None and turn.number == scan.turn and now_s - scan.age_s - turn.measured_s <= TURN_MAX_S:
            return turn
        if turn is None and len(self._turns) >= SENSORS_MAX:
            return None
        self._map.note_sensor(scan.sensor, scan.max_m)
        self._map.forget(now_s)
        vel, age_s = own.vel_ned_mps, scan.age_s
        north_m, east_m = self._map.place(own.pos_ned_m[0] - vel[0] * age_s, own.pos_ned_m[1] - vel[1] * age_s)
        if turn is not None:
            free_m = [min(turn.hit_m[k], turn.reach_m[k]) for k in range(BINS)]
            middle_n, middle_e = (turn.eye_ne_m[0] + north_m) / 2.0, (turn.eye_ne_m[1] + east_m) / 2.0
            self._map.clear_passed(middle_n, middle_e, free_m, turn.came_s)
        turn = self._turns[scan.sensor] = _Turn(scan.turn, now_s, now_s - age_s, (north_m, east_m))
        return turn


def _add_level_ray(level: LevelTurn, scan: LidarScan, k: int, way_ned: Vec3, own: Position) -> None:
    """A ray of the one layer."""
    eye_n, eye_e = _eye_of(scan, k, own)
    level.add_ray(math.atan2(way_ned[1], way_ned[0]), _level_m(scan, k, way_ned, own), eye_n, eye_e)


def _add_flat_ray(flattest: FlattestRays, scan: LidarScan, k: int, way_ned: Vec3, own: Position) -> None:
    """A measured ray of one of several layers, where it is flatter than those before it."""
    index, slope = flattest.index_of(scan.start_rad + k * scan.step_rad), abs(way_ned[2])
    if slope < flattest.slopes[index]:
        bearing_rad, range_m = math.atan2(way_ned[1], way_ned[0]), _level_m(scan, k, way_ned, own)
        flattest.put_ray(index, slope, bearing_rad, range_m, _eye_of(scan, k, own))


def _level_m(scan: LidarScan, k: int, way_ned: Vec3, own: Position) -> float:
    """Level range of a ray; inf: nothing stopped it, nan: what did is not at the vehicle's height."""
    n, e, d = way_ned
    range_m = scan.ranges_m[k]
    if range_m > scan.max_m:
        return math.inf
    if not _is_of_trunk(d * range_m, own.pos_ned_m[2]) or -(own.pos_ned_m[2] + d * range_m) <= GROUND_M:
        return math.nan
    return range_m * math.sqrt(n * n + e * e)


def _eye_of(scan: LidarScan, k: int, own: Position) -> tuple[float, float]:
    """Position of the vehicle when that ray was measured, north and east."""
    age_s = scan.age_s - k * scan.ray_time_s
    return own.pos_ned_m[0] - own.vel_ned_mps[0] * age_s, own.pos_ned_m[1] - own.vel_ned_mps[1] * age_s


def _is_of_trunk(lower_m: float, down_m: float) -> bool:
    """A hit so much below the vehicle, which is at `down_m`: no crown, no undergrowth."""
    return lower_m >= -BAND_M and (lower_m <= BAND_M or -(down_m + lower_m) >= TRUNK_FROM_M)


def _bin(bearing_rad: float) -> int:
    return math.floor(bearing_rad / math.tau * BINS + 0.5) % BINS
