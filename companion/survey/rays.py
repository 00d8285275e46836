"""Collects the rays that end on tracked trunks: pure, in the 20 Hz loop, and bounded.

Pieces of a turn wait until the turn is over, since its flattest layer corrects the pose that places all of them. Of a
piece only those rays are looked at that point to a trunk within reach; of steep pieces a few, for the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.events import LidarScan
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.core.perception.landmarks.trunk_tracks import Trunk
from companion.core.perception.level_scan import axes_ned
from companion.survey.ground import Ground
from companion.survey.stem_rays import LEFT, RIGHT, StemRays
from mission.common.frames import Vec3

PIECES_MAX: Final = 512  # of one turn
STEMS_MAX: Final = 64  # in sight: with 54 kB each, 3.5 MB at most
SAME_M: Final = 0.4  # a trunk so near to a stem's axis is that stem
UNSEEN_S: Final = 3.0  # until a stem has been passed
LONGEST_S: Final = 40.0  # one that stays in sight is measured anew: the odometry's frame moves
BEYOND_M: Final = 1.0  # farther than the reach: it is passed
BESIDE_M: Final = 0.3  # of a trunk's surface: what ends there may be of it
STEEP_SINE: Final = 0.25  # rays that point farther down tell of the ground, every so many:
GROUND_EVERY: Final = 9
GROUND_TURNS: Final = 10  # after so many the ground at a stem is found anew
MARGIN_RAD: Final = 0.02  # of the window of bearings and of elevations
UP_COSINE: Final = 0.6  # of the steepest layer, 52 degrees
LEAST_AWAY_M: Final = 0.2
LEAST_STEP_RAD: Final = 1e-5  # from ray to ray; no lidar has so fine ones
LEAST_STEP_SHARE: Final = 0.1  # a vehicle that turns back nearly as fast as its lidar turns: its yaw is wrong
EDGE_M: Final = 0.3  # a ray that went on by so much beside another passed the stem
FRAMES_MAX: Final = 1024  # scans: longer ago than any ray of a stem in sight
TURNS_KEPT: Final = 65536  # until their numbers begin anew: 1.8 hours


@final
class Band:
    """Heights between which rays count; metres up, above the ground at the stem or, with `by_eye`, the lidar's own."""

    __slots__ = ("by_eye", "high_m", "low_m")

    def __init__(self, low_m: float, high_m: float, *, by_eye: bool) -> None:
        self.low_m: Final = low_m
        self.high_m: Final = high_m
        self.by_eye: Final = by_eye


@final
class _Piece:
    """A piece of a turn, and the pose that it came with."""

    __slots__ = ("now_s", "pose", "scan")

    def __init__(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        self.scan: Final = scan
        self.pose: Final = pose
        self.now_s: Final = now_s


@final
class RayCollector:
    """One vehicle's. `integrate` with each piece, `take_passed` for the stems that have been passed."""

    __slots__ = (
        "_band",
        "_pieces",
        "_reach_m",
        "_stems",
        "_turn",
        "_turns",
        "frame",
        "frames",
        "ground",
        "lost",
        "times_s",
    )

    def __init__(self, band: Band, reach_m: float) -> None:
        """`reach_m`: level, from the lidar to a trunk's axis."""
        self._band: Final = band
        self._reach_m: Final = reach_m
        self._pieces: list[_Piece] = []
        self._stems: list[StemRays] = []
        self._turn = (-1, -1)  # sensor and number of the one that is coming in
        self._turns = 0
        self.ground: Final = Ground()
        self.frame: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the odometry now, and as scans were placed
        self.frames: Final[dict[int, tuple[float, float, float]]] = {}
        self.times_s: Final[dict[int, float]] = {}  # when scans were placed
        self.lost = 0  # pieces beyond PIECES_MAX

    def integrate(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        """A piece; the first of a turn places the turn before."""
        if (scan.sensor, scan.turn) != self._turn:
            self._place_turn(pose, now_s)
            self._turn = (scan.sensor, scan.turn)
        if not pose.airborne or not _is_finite(scan, pose):
            return
        if len(self._pieces) >= PIECES_MAX:
            self.lost += 1
            return
        self._pieces.append(_Piece(scan, pose, now_s))

    @property
    def stems(self) -> Sequence[StemRays]:
        """Stems in sight."""
        return self._stems

    def take_passed(self, now_s: float, pose: ScanPose | None) -> list[StemRays]:
        """Stems that are in sight no more; all of them where the vehicle is not in the air."""
        landed = pose is None or not pose.airborne
        passed: list[StemRays] = []
        left: list[StemRays] = []
        for stem in self._stems:
            is_far = pose is not None and _level_m(stem, pose.pos_ned_m) > self._reach_m + BEYOND_M
            is_over = landed or is_far or now_s - stem.last_s > UNSEEN_S or now_s - stem.born_s > LONGEST_S
            (passed if is_over else left).append(stem)
        self._stems = left
        return passed

    # --- inside ---

    def _place_turn(self, pose: ScanPose, now_s: float) -> None:
        """The turn that is over, as the pose is corrected by now."""
        pieces, self._pieces = self._pieces, []
        if not pieces:
            return
        self._match_trunks(pose.trunks, pose, now_s)
        self._turns = (self._turns + 1) % TURNS_KEPT
        self.frame = self.frames[self._turns] = pose.frame
        self.times_s[self._turns] = now_s
        if len(self.frames) > FRAMES_MAX:
            oldest = next(iter(self.frames))
            del self.frames[oldest], self.times_s[oldest]
        group: _Group | None = None
        for piece in pieces:
            if group is None or not group.has(piece.scan):
                group = self._group_of(piece, pose)
            for target in group.targets:
                self._take_rays(group, piece.scan, target)
            if not self._band.by_eye:
                self._take_ground(group, piece.scan)

    def _match_trunks(self, trunks: Sequence[Trunk], pose: ScanPose, now_s: float) -> None:
        for trunk in trunks:
            if not trunk.is_good or now_s - trunk.seen_s > 0.5:
                continue
            stem = self._stem_at(trunk.north_m, trunk.east_m)
            if stem is None:
                n, e = trunk.north_m - pose.pos_ned_m[0], trunk.east_m - pose.pos_ned_m[1]
                if n * n + e * e > self._reach_m * self._reach_m or len(self._stems) >= STEMS_MAX:
                    continue
                stem = StemRays(trunk.north_m, trunk.east_m, trunk.radius_m, now_s)
                self._stems.append(stem)
            stem.north_m, stem.east_m, stem.radius_m = trunk.north_m, trunk.east_m, trunk.radius_m
            stem.last_s = now_s
            stem.to_mission_ne_m, stem.frame_sd_m = pose.to_mission_ne_m, pose.frame_sd_m

    def _stem_at(self, north_m: float, east_m: float) -> StemRays | None:
        best: StemRays | None = None
        least = SAME_M * SAME_M
        for stem in self._stems:
            n, e = stem.north_m - north_m, stem.east_m - east_m
            if n * n + e * e < least:
                best, least = stem, n * n + e * e
        return best

    def _group_of(self, piece: _Piece, pose: ScanPose) -> _Group:
        """The place and axes of a piece, which those of other layers beside it share; with the stems that it sees."""
        scan, then = piece.scan, piece.pose
        first, last = scan.first_attitude_rad, scan.last_attitude_rad
        count = len(scan.ranges_m)
        yawed = math.remainder(last[2] - first[2], math.tau)
        yaw = first[2] + yawed / 2.0 + pose.turn_rad
        group = _Group(scan, axes_ned((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0, yaw))
        group.step = scan.step_rad + (yawed / (count - 1) if count > 1 else 0.0)
        if abs(group.step) < LEAST_STEP_SHARE * abs(scan.step_rad):
            group.step = scan.step_rad
        group.start = scan.start_rad - (yawed / 2.0 if count > 1 else 0.0)
        # The eye in the middle of the piece, corrected by what the turn has shown since
        age_s = scan.age_s - 0.5 * (count - 1) * scan.ray_time_s
        pos, vel = then.pos_ned_m, then.vel_ned_mps
        group.eye_n = pos[0] - vel[0] * age_s + pose.shift_ne_m[0] - then.shift_ne_m[0]
        group.eye_e = pos[1] - vel[1] * age_s + pose.shift_ne_m[1] - then.shift_ne_m[1]
        group.eye_d = pos[2] - vel[2] * age_s
        group.vel = vel
        group.at_s = piece.now_s - age_s
        for stem in self._stems:
            n, e = stem.north_m - group.eye_n, stem.east_m - group.eye_e
            away_m = math.sqrt(n * n + e * e)
            if stem.radius_m + LEAST_AWAY_M < away_m < self._reach_m:
                low_d, high_d = self._band_down_m(group, stem)
                target = _Target(stem, low_d, high_d, (stem.radius_m + BESIDE_M) / away_m + MARGIN_RAD)
                target.low_rad, target.low_up_rad = group.seen_from(n, e, low_d)
                target.high_rad, target.high_up_rad = group.seen_from(n, e, high_d)
                if group.may_see(target):
                    group.targets.append(target)
        return group

    def _band_down_m(self, group: _Group, stem: StemRays) -> tuple[float, float]:
        """Lower and upper end of the band, down from the lidar."""
        if self._band.by_eye:
            return -self._band.low_m, -self._band.high_m
        if stem.ground_up_m is None or self._turns % GROUND_TURNS == 0:
            stem.ground_up_m = self.ground.height_up_m(stem.north_m, stem.east_m)
        eye_up_m = -group.eye_d - (0.0 if stem.ground_up_m is None else stem.ground_up_m)
        return eye_up_m - self._band.low_m, eye_up_m - self._band.high_m

    def _take_rays(self, group: _Group, scan: LidarScan, target: _Target) -> None:
        """Rays of a piece that point to a stem, and end at it within the band of heights."""
        window = group.window_of(target, scan.elevation_rad)
        if window is None:
            return
        stem, count = target.stem, len(scan.ranges_m)
        beside_m = stem.radius_m + BESIDE_M
        up_m = -group.eye_d
        for k in range(window[0], window[1] + 1):
            at = k % group.around
            if at >= count:
                continue
            range_m = scan.ranges_m[at]
            if not scan.min_m < range_m <= scan.max_m:  # not measured, or nothing there
                continue
            w_n, w_e, w_d = group.direction_of(at, scan.elevation_rad)
            down_m = w_d * range_m
            if not target.high_d <= down_m <= target.low_d:
                continue
            late_s = (at - 0.5 * (count - 1)) * scan.ray_time_s
            eye_n, eye_e = group.eye_n + group.vel[0] * late_s, group.eye_e + group.vel[1] * late_s
            hit_n, hit_e = eye_n + w_n * range_m, eye_e + w_e * range_m
            off_n, off_e = hit_n - stem.north_m, hit_e - stem.east_m
            if off_n * off_n + off_e * off_e <= beside_m * beside_m:
                turn = float(self._turns)
                edge = float(group.edge_of(scan, at))
                row = (hit_n, hit_e, up_m - down_m, eye_n, eye_e, edge, range_m, turn, scan.elevation_rad)
                stem.add(row, group.at_s + late_s)

    def _take_ground(self, group: _Group, scan: LidarScan) -> None:
        """Some rays of a steep piece."""
        if -math.sin(scan.elevation_rad) < STEEP_SINE:
            return
        for k in range(self._turns % GROUND_EVERY, len(scan.ranges_m), GROUND_EVERY):
            range_m = scan.ranges_m[k]
            if scan.min_m < range_m <= scan.max_m:
                w_n, w_e, w_d = group.direction_of(k, scan.elevation_rad)
                if w_d > STEEP_SINE:
                    n, e = group.eye_n + w_n * range_m, group.eye_e + w_e * range_m
                    self.ground.add(n, e, -group.eye_d - w_d * range_m, group.at_s)


@final
class _Target:
    """A stem as a group of pieces sees it: bearing and elevation of its band's lower and upper end, body axes."""

    __slots__ = ("half_rad", "high_d", "high_rad", "high_up_rad", "low_d", "low_rad", "low_up_rad", "stem")

    def __init__(self, stem: StemRays, low_d: float, high_d: float, half_rad: float) -> None:
        self.stem: Final = stem
        self.low_d: Final = low_d  # down from the lidar
        self.high_d: Final = high_d
        self.half_rad: Final = half_rad  # half of its width
        self.low_rad = self.low_up_rad = self.high_rad = self.high_up_rad = 0.0


@final
class _Group:
    """Pieces of several layers that were measured at one time: their place and axes."""

    __slots__ = ("around", "at_s", "axes", "eye_d", "eye_e", "eye_n", "first", "start", "step", "targets", "vel")

    def __init__(self, first: LidarScan, axes: tuple[Vec3, Vec3, Vec3]) -> None:
        self.first: Final = first
        self.axes: Final = axes
        self.around: Final = max(1, round(math.tau / abs(first.step_rad)))  # rays of a whole turn
        self.start = self.step = 0.0
        self.eye_n = self.eye_e = self.eye_d = self.at_s = 0.0
        self.vel: Vec3 = (0.0, 0.0, 0.0)
        self.targets: list[_Target] = []

    def has(self, scan: LidarScan) -> bool:
        """True for a piece beside its first one."""
        first = self.first
        return (
            scan.start_rad == first.start_rad
            and len(scan.ranges_m) == len(first.ranges_m)
            and scan.age_s == first.age_s
            and scan.first_attitude_rad == first.first_attitude_rad
        )

    def direction_of(self, k: int, elevation_rad: float) -> Vec3:
        """Direction of a ray, NED."""
        x, y, z = self.axes
        bearing = self.start + k * self.step
        level, down = math.cos(elevation_rad), -math.sin(elevation_rad)
        ahead, right = level * math.cos(bearing), level * math.sin(bearing)
        return (
            ahead * x[0] + right * y[0] + down * z[0],
            ahead * x[1] + right * y[1] + down * z[1],
            ahead * x[2] + right * y[2] + down * z[2],
        )

    def edge_of(self, scan: LidarScan, at: int) -> int:
        """Sides, LEFT and RIGHT, on which the ray beside one was measured and went on: there the stem ends."""
        beyond_m = scan.ranges_m[at] + EDGE_M
        before = at > 0 and scan.ranges_m[at - 1] > beyond_m  # false for NaN
        after = at + 1 < len(scan.ranges_m) and scan.ranges_m[at + 1] > beyond_m
        left, right = (before, after) if self.step > 0.0 else (after, before)
        return (LEFT if left else 0) + (RIGHT if right else 0)

    def seen_from(self, n: float, e: float, d: float) -> tuple[float, float]:
        """Bearing and elevation of a place in the body's axes."""
        x, y, z = self.axes
        ahead = n * x[0] + e * x[1] + d * x[2]
        right = n * y[0] + e * y[1] + d * y[2]
        below = n * z[0] + e * z[1] + d * z[2]
        return math.atan2(right, ahead), -math.atan2(below, math.sqrt(ahead * ahead + right * right))

    def may_see(self, target: _Target) -> bool:
        """Some of these pieces' rays point to it."""
        count = len(self.first.ranges_m)
        wide = (target.half_rad / UP_COSINE) / abs(self.step) + 1.0
        for bearing in (target.low_rad, target.high_rad):
            middle = self._index_of(bearing)
            if middle - wide < count or middle + wide >= self.around:
                return True
        return False

    def window_of(self, target: _Target, elevation_rad: float) -> tuple[int, int] | None:
        """Indices, round the turn, of the rays of a layer that may end on a stem; None: it passes above or below."""
        low, high = target.low_up_rad, target.high_up_rad
        if not low - MARGIN_RAD <= elevation_rad <= high + MARGIN_RAD:
            return None
        rises = high - low
        share = min(1.0, max(0.0, (elevation_rad - low) / rises)) if rises > 1e-6 else 0.5
        bearing = target.low_rad + share * math.remainder(target.high_rad - target.low_rad, math.tau)
        middle = self._index_of(bearing)
        wide = min(target.half_rad / max(1e-6, math.cos(elevation_rad)) / abs(self.step), 0.5 * self.around)
        return math.ceil(middle - wide), math.floor(middle + wide)

    def _index_of(self, bearing: float) -> float:
        """Of the ray at a bearing, from the first one on round."""
        middle = math.remainder(bearing - self.start, math.tau) / self.step
        return middle + self.around if middle < 0.0 else middle


def _is_finite(scan: LidarScan, pose: ScanPose) -> bool:
    """True unless a number of either is none."""
    numbers = scan.age_s + scan.ray_time_s + scan.start_rad + scan.elevation_rad + pose.turn_rad + sum(pose.frame)
    for three in (pose.pos_ned_m, pose.vel_ned_mps, scan.first_attitude_rad, scan.last_attitude_rad):
        numbers += three[0] + three[1] + three[2]
    return abs(scan.step_rad) > LEAST_STEP_RAD and numbers - numbers == 0.0


def _level_m(stem: StemRays, pos_ned_m: Vec3) -> float:
    return math.hypot(stem.north_m - pos_ned_m[0], stem.east_m - pos_ned_m[1])
