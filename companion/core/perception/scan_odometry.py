"""Scan odometry: the own position and heading corrected by trunks, which stand still.

An estimator's position wanders by decimetres and its yaw is wrong by degrees, and all that a scan sees is placed by
them. Here an error-state filter holds what is to be added to what is reported: `shift_m` to the position (north, east),
and `turn_rad` to the yaw. Its third angle is how far the trunks' frame is turned from the one of reported motion, by
which the trunks are turned as soon as it is known. A good trunk that is seen again measures shift and turn; flying
makes the third angle observable.

Where nothing is seen the shift stays as it is, and the position moves as reported, to the bit. Only differences of
reported positions count (rule 5). Source: an EKF on landmarks whose own filters are independent of the pose's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.events import Position
from companion.core.perception.landmarks.hulls import HULL_SHARE, is_heard_hull, leave_out_hulls
from companion.core.perception.landmarks.stem_clusters import find_stems
from companion.core.perception.landmarks.trunk_tracks import Sighting, Trunk, TrunkTracks, chi2_of, turned_about
from companion.core.perception.landmarks.wall_segments import find_walls, mark_walls
from companion.core.perception.landmarks.wall_tracks import WallSighting, WallTracks, one_direction
from companion.core.perception.level_scan import LevelScan, ScanClass
from mission.common.frames import Vec3

SHIFT_M2_PER_S: Final = 0.1 * 0.1  # a position's error changes by 0.18 m in 1 s (95 %, level)
RECKONS_M2_PER_S: Final = 0.5 * 0.5  # of one without a fix by up to 1.25 m
SHIFT_M_PER_MPS: Final = 0.05  # and by how much later it is than the scan, where the velocity changes
TURN_RAD2_PER_S: Final = math.radians(0.8) ** 2  # a yaw wanders by 1 to 3 degrees, within a quarter of a minute
TURN_SHARE: Final = 0.02  # of a turn, by which the yaw errs in it
FRAME_SD_RAD: Final = math.radians(4.0)  # a yaw's error when trunks are first seen
FRAME_RAD2_PER_S: Final = math.radians(0.1) ** 2
JUMP_M: Final = 0.5  # a position that jumps so far against the velocity: its estimator was reset
GAP_S: Final = 1.0  # without a position for longer, or a scan: nothing can be said of the way between
HUBER_CHI2: Final = 4.0  # beyond, a measurement counts less
FRESH_S: Final = 0.5  # so long after trunks corrected it last the pose counts as corrected
LEAST_TRUNKS: Final = 2  # seen again in a scan: one alone tells no turn
EXPECTED_LEAST: Final = 4  # so many good trunks should be seen: then it is noticed when they are not
MATCHED_SHARE: Final = 0.3
MISSED_MAX: Final = 5  # scans in a row without them: begin anew


@final
class ScanOdometry:
    """One vehicle's: `receive_position` with each reported position, `integrate_scan` with each whole turn."""

    __slots__ = (
        "_cov",
        "_kind",
        "_missed",
        "_scanned_s",
        "_thick_m",
        "_told",
        "_told_s",
        "_tracks",
        "_turns_with_yaw",
        "_walls",
        "_yaw_rad",
        "corrected_along",
        "corrected_by",
        "corrected_s",
        "fixed_m2",
        "fixed_s",
        "frame",
        "reckons",
        "shift_m",
        "turn_rad",
    )

    def __init__(self, kind: ScanClass, *, turns_with_yaw: bool = False, hull_m: float = 0.0) -> None:
        """`turns_with_yaw`: reported motion is in the vehicle's own axes (no GNSS): the yaw's error turns it.

        `hull_m`: a vehicle's radius.
        """
        self._kind: Final = kind
        self._thick_m: Final = HULL_SHARE * hull_m if kind.has_widths else 0.0  # what is thinner is no vehicle
        self._turns_with_yaw: Final = turns_with_yaw
        self._tracks: Final = TrunkTracks()
        self._walls: Final = WallTracks()
        self.shift_m: tuple[float, float] = (0.0, 0.0)  # true less reported, but for where the odometry began
        self.turn_rad = 0.0  # to be added to the reported yaw
        # Its autopilot has no fix: what is reported drifts, and a drift aside looks as if the frame were turned
        self.reckons = False
        # How places of before are turned by now: clockwise, rad, then moved north and east, m
        self.frame: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self.corrected_s = -math.inf  # when trunks or walls corrected it last
        self.corrected_by = 0  # trunks that did so then
        # The one level direction (unit vector) in which walls alone did so then; None: in all
        self.corrected_along: tuple[float, float] | None = None
        self.fixed_s = -math.inf  # when trunks or walls corrected it in all directions last
        self.fixed_m2 = 0.0  # variance of the shift then, of the worse axis
        # Covariance of shift north, east, turn, frame: 16 numbers, by rows
        self._cov: list[float] = [0.0] * 16
        self._told: Position | None = None  # reported last
        self._told_s = -math.inf  # when it came
        self._scanned_s = -math.inf
        self._yaw_rad = 0.0
        self._missed = 0
        self._cov[15] = 0.0 if turns_with_yaw else FRAME_SD_RAD * FRAME_SD_RAD

    @property
    def trunks(self) -> Sequence[Trunk]:
        """The tracked ones, as of the last scan."""
        return self._tracks.trunks

    def is_corrected(self, now_s: float) -> bool:
        """Trunks or walls have corrected the pose lately."""
        return now_s - self.corrected_s <= FRESH_S

    def shift_sd_m(self, now_s: float) -> float:
        """Standard deviation of the shift, of an axis; inf: trunks and walls never told it in all directions."""
        grows_m2 = RECKONS_M2_PER_S if self.reckons else SHIFT_M2_PER_S
        return math.sqrt(self.fixed_m2 + grows_m2 * max(0.0, now_s - self.fixed_s))

    @property
    def frame_rad2(self) -> float:
        """Variance of how far the trunks' frame is turned from the one of reported motion."""
        return self._cov[15]

    def turn_frame(self, by_rad: float) -> None:
        """Turns the trunks' frame about the vehicle: it was turned by reported motion that was not true."""
        if by_rad != 0.0:
            self._turn_frame((), (), -by_rad)

    def correct_place(self, pos_ned_m: Vec3) -> Vec3:
        """A reported position, corrected."""
        if self.shift_m == (0.0, 0.0):
            return pos_ned_m
        return (pos_ned_m[0] + self.shift_m[0], pos_ned_m[1] + self.shift_m[1], pos_ned_m[2])

    def receive_position(self, own: Position, now_s: float) -> None:
        """A reported position: its way since the last is the odometry's, turned as far as is known."""
        before, heard_s = self._told, now_s - self._told_s
        self._told, self._told_s = own, now_s
        if before is None or not (self._tracks.trunks or self._walls.walls):
            return
        if heard_s > GAP_S:
            self.restart(now_s)
            return
        since_s, vel, was = own.since_s(before, heard_s), own.vel_ned_mps, before.vel_ned_mps
        changed_mps = math.hypot(vel[0] - was[0], vel[1] - was[1])
        mean = (0.5 * (vel[0] + was[0]), 0.5 * (vel[1] + was[1]))
        dn, de = own.pos_ned_m[0] - before.pos_ned_m[0], own.pos_ned_m[1] - before.pos_ned_m[1]
        off_n, off_e = dn - mean[0] * since_s, de - mean[1] * since_s
        if math.hypot(off_n, off_e) > JUMP_M + 0.5 * changed_mps * since_s:
            self.shift_m = (self.shift_m[0] - off_n, self.shift_m[1] - off_e)
            dn, de = dn - off_n, de - off_e
        if self._turns_with_yaw and self.turn_rad != 0.0:
            cos, sin = math.cos(self.turn_rad) - 1.0, math.sin(self.turn_rad)
            self.shift_m = (self.shift_m[0] + cos * dn - sin * de, self.shift_m[1] + sin * dn + cos * de)
        self._propagate(dn, de)
        late_m = SHIFT_M_PER_MPS * changed_mps
        grows_m2 = (RECKONS_M2_PER_S if self.reckons else SHIFT_M2_PER_S) * since_s + late_m * late_m
        self._cov[0] += grows_m2
        self._cov[5] += grows_m2
        self._cov[10] += TURN_RAD2_PER_S * since_s
        if not self._turns_with_yaw:
            self._cov[15] += FRAME_RAD2_PER_S * since_s

    def integrate_scan(
        self, scan: LevelScan, yaw_rad: float, neighbours: Sequence[Vec3], now_s: float, *, unheard: int = 0
    ) -> list[Sighting]:
        """A whole turn, placed by the corrected pose; returns its stems, each with the trunk that it is taken for.

        `yaw_rad`: as reported; `neighbours`: reported positions, in the frame of the scan: stems there are no trunks.
        `unheard`: vehicles in the air of which nobody knows where they are: as many of the stems may be theirs.
        """
        if now_s - self._scanned_s > GAP_S:
            self.restart(now_s)
        turned_rad = abs(math.remainder(yaw_rad - self._yaw_rad, math.tau))
        self._yaw_rad, self._scanned_s = yaw_rad, now_s
        sd_rad = TURN_SHARE * turned_rad
        self._cov[10] += sd_rad * sd_rad
        self._tracks.forget(now_s)
        self._walls.forget(now_s)
        if not (self._tracks.trunks or self._walls.walls):
            self._begin_frame(now_s)
        segments = find_walls(scan, self._kind)
        seen = [Sighting(stem) for stem in find_stems(scan, self._kind, mark_walls(segments, scan))]
        walls = [WallSighting(segment) for segment in segments if segment.tells]
        for wall in walls:
            self._walls.match_segment(wall, self._wall_pose_m2(wall))
        heading_sd_rad = math.sqrt(self._heading_rad2())
        sightings = [
            one for one in seen if not (is_heard_hull(one, neighbours, heading_sd_rad) or self._is_of_wall(one))
        ]
        for sighting in sightings:
            self._tracks.match_stem(sighting, self._pose_m2(sighting))
        matched = self._correct_pose(seen, walls, unheard, now_s)
        for sighting in sightings:
            self._tracks.update_trunk(sighting, now_s)
        for wall in walls:
            self._walls.update_wall(wall, now_s)
        self._note_missed(matched, scan, now_s)
        return seen

    def _is_of_wall(self, sighting: Sighting) -> bool:
        """Cut off from a wall by what stands before it, or seen along it: it would go along with the eye."""
        return self._walls.has_piece(sighting.north_m, sighting.east_m)

    def _heading_rad2(self) -> float:
        """Variance of how far what is seen is turned from the frame of reported motion."""
        p = self._cov
        return max(0.0, p[15] + p[10] + 2.0 * p[11])

    def _correct_pose(
        self, sightings: Sequence[Sighting], walls: Sequence[WallSighting], unheard: int, now_s: float
    ) -> int:
        """By good trunks and walls that were seen again; the number of all such trunks. Places all sightings by it."""
        good = [s for s in sightings if s.trunk is not None and s.trunk.is_good]
        found = leave_out_hulls(good, unheard, self._thick_m, LEAST_TRUNKS)
        found_walls = [w for w in walls if w.wall is not None and w.wall.is_good]
        shift_n = shift_e = turn_rad = frame_rad = 0.0
        if len(found) >= LEAST_TRUNKS or found_walls:
            found.sort(key=_chi2_of_sighting)
            for sighting in found:
                trunk = sighting.trunk
                assert trunk is not None
                sighting.place_stem(turn_rad, (shift_n, shift_e), trunk.radius_m)
                nn, ne, ee = sighting.covariance
                d_n, d_e, d_turn, d_frame = self._update(
                    (trunk.north_m - sighting.north_m, trunk.east_m - sighting.east_m),
                    sighting.moves_m_per_rad(turn_rad, trunk.radius_m),
                    (nn + trunk.nn_m2, ne + trunk.ne_m2, ee + trunk.ee_m2),
                )
                shift_n, shift_e = shift_n + d_n, shift_e + d_e
                turn_rad, frame_rad = turn_rad + d_turn, frame_rad + d_frame
            for wall in found_walls:
                for turns in (True, False):  # its direction, then how far off it is
                    wall.place(turn_rad, (shift_n, shift_e))
                    d_n, d_e, d_turn, d_frame = self._update_by_wall(wall, turns=turns)
                    shift_n, shift_e = shift_n + d_n, shift_e + d_e
                    turn_rad, frame_rad = turn_rad + d_turn, frame_rad + d_frame
            self.shift_m = (self.shift_m[0] + shift_n, self.shift_m[1] + shift_e)
            self.turn_rad += turn_rad
            self.corrected_s, self.corrected_by = now_s, len(found)
            self.corrected_along = None if len(found) >= LEAST_TRUNKS else one_direction(found_walls)
            if self.corrected_along is None:
                self.fixed_s, self.fixed_m2 = now_s, max(self._cov[0], self._cov[5])
        for sighting in sightings:
            known = sighting.trunk
            radius_m = sighting.stem.radius_m if known is None else known.radius_m
            sighting.place_stem(turn_rad, (shift_n, shift_e), radius_m)
        for wall in walls:
            wall.place(turn_rad, (shift_n, shift_e))
        if frame_rad != 0.0 and self._told is not None:
            self._turn_frame(sightings, walls, frame_rad)
        return len(good)

    def _turn_frame(self, sightings: Sequence[Sighting], walls: Sequence[WallSighting], frame_rad: float) -> None:
        """The trunks' frame turned out to be turned by so much: turn it back, about the vehicle."""
        assert self._told is not None
        north_m, east_m, _ = self.correct_place(self._told.pos_ned_m)
        self._tracks.turn_about(north_m, east_m, -frame_rad)
        self._walls.turn_about(north_m, east_m, -frame_rad)
        for wall in walls:
            wall.north_m, wall.east_m = turned_about(north_m, east_m, (wall.north_m, wall.east_m), -frame_rad)
            wall.normal_rad -= frame_rad
        for sighting in sightings:
            sighting.north_m, sighting.east_m = turned_about(
                north_m, east_m, (sighting.north_m, sighting.east_m), -frame_rad
            )
        self.turn_rad -= frame_rad
        moved = turned_about(north_m, east_m, (self.frame[1], self.frame[2]), -frame_rad)
        self.frame = (self.frame[0] - frame_rad, *moved)

    def _update(
        self, residual: tuple[float, float], by_turn: tuple[float, float], noise: tuple[float, float, float]
    ) -> tuple[float, float, float, float]:
        """One measurement of a place, of which shift and turn are part; what each of the four states changes by."""
        p = self._cov
        by_n, by_e = by_turn
        # Columns of P H': each state with the place north, and east
        a = [p[4 * k] + p[4 * k + 2] * by_n for k in range(4)]
        b = [p[4 * k + 1] + p[4 * k + 2] * by_e for k in range(4)]
        s_nn = a[0] + by_n * a[2]
        s_ne = b[0] + by_n * b[2]
        s_ee = b[1] + by_e * b[2]
        r_n, r_e = residual
        chi2 = chi2_of(r_n, r_e, s_nn + noise[0], s_ne + noise[1], s_ee + noise[2])
        wider = 1.0 if chi2 <= HUBER_CHI2 else math.sqrt(chi2 / HUBER_CHI2)
        s_nn, s_ne, s_ee = s_nn + wider * noise[0], s_ne + wider * noise[1], s_ee + wider * noise[2]
        det = s_nn * s_ee - s_ne * s_ne
        if not det > 0.0:
            return 0.0, 0.0, 0.0, 0.0
        gains_n = [(a[k] * s_ee - b[k] * s_ne) / det for k in range(4)]
        gains_e = [(b[k] * s_nn - a[k] * s_ne) / det for k in range(4)]
        if self.reckons:
            gains_n[3] = gains_e[3] = 0.0
        for i in range(4):
            for j in range(i, 4):
                p[4 * i + j] -= gains_n[i] * a[j] + gains_e[i] * b[j]
                p[4 * j + i] = p[4 * i + j]
        moved = [gains_n[k] * r_n + gains_e[k] * r_e for k in range(4)]
        return moved[0], moved[1], moved[2], moved[3]

    def _update_by_wall(self, sighting: WallSighting, *, turns: bool) -> tuple[float, float, float, float]:
        """One measurement along a wall's normal, or with `turns` of its direction; as `_update`."""
        wall, segment, p = sighting.wall, sighting.segment, self._cov
        assert wall is not None
        if turns:
            by_n = by_e = 0.0
            by_turn = 1.0
            off = math.remainder(wall.normal_rad - sighting.normal_rad, math.tau)
            noise = wall.normal_rad2 + segment.normal_sd_rad * segment.normal_sd_rad
        else:
            off, along_m = wall.offset_of(sighting.north_m, sighting.east_m)
            off = -off
            by_n, by_e = math.cos(wall.normal_rad), math.sin(wall.normal_rad)
            turn_n, turn_e = sighting.moves_m_per_rad()
            by_turn = by_n * turn_n + by_e * turn_e
            noise = wall.variance_m2(along_m) + segment.offset_sd_m * segment.offset_sd_m
        column = [p[4 * k] * by_n + p[4 * k + 1] * by_e + p[4 * k + 2] * by_turn for k in range(4)]
        pose = column[0] * by_n + column[1] * by_e + column[2] * by_turn
        chi2 = off * off / (pose + noise)
        if chi2 > HUBER_CHI2:
            noise *= math.sqrt(chi2 / HUBER_CHI2)
        gains = [one / (pose + noise) for one in column]
        gains[3] = 0.0  # one wall cannot tell a turned frame from a wrong velocity: that angle is considered, no more
        for i in range(4):
            for j in range(i, 4):
                p[4 * i + j] -= gains[i] * column[j]
                p[4 * j + i] = p[4 * i + j]
        return gains[0] * off, gains[1] * off, gains[2] * off, 0.0

    def _wall_pose_m2(self, sighting: WallSighting) -> tuple[float, float]:
        """Variances of a wall's offset and direction by the errors of shift and turn."""
        p = self._cov
        n, e = math.cos(sighting.normal_rad), math.sin(sighting.normal_rad)
        turn_n, turn_e = sighting.moves_m_per_rad()
        t = n * turn_n + e * turn_e
        by_shift = n * n * p[0] + 2.0 * n * e * p[1] + e * e * p[5]
        return by_shift + 2.0 * t * (n * p[2] + e * p[6]) + t * t * p[10], p[10]

    def _propagate(self, dn: float, de: float) -> None:
        """The covariance over a way: where the frame is turned, or the motion with the yaw, so is the way."""
        p = self._cov
        k = 2 if self._turns_with_yaw else 3
        for j in range(4):  # F P
            p[j] -= de * p[4 * k + j]
            p[4 + j] += dn * p[4 * k + j]
        for i in range(4):  # (F P) F'
            p[4 * i] -= de * p[4 * i + k]
            p[4 * i + 1] += dn * p[4 * i + k]

    def _pose_m2(self, sighting: Sighting) -> tuple[float, float, float]:
        """Covariance of a stem's place by the errors of shift and turn."""
        p = self._cov
        by_n, by_e = sighting.moves_m_per_rad(0.0, sighting.stem.radius_m)
        return (
            p[0] + 2.0 * by_n * p[2] + by_n * by_n * p[10],
            p[1] + by_e * p[2] + by_n * p[6] + by_n * by_e * p[10],
            p[5] + 2.0 * by_e * p[6] + by_e * by_e * p[10],
        )

    def _note_missed(self, matched: int, scan: LevelScan, now_s: float) -> None:
        """Good trunks that should be seen, and are not, scan after scan: the pose is not what it was."""
        fresh = [t for t in self._tracks.trunks if t.is_good and now_s - t.seen_s <= FRESH_S + 0.1]
        expected = sum([scan.looked_at(trunk.north_m, trunk.east_m) for trunk in fresh])
        seen = len(scan.ranges_m) > 0
        if seen and expected >= EXPECTED_LEAST and matched < MATCHED_SHARE * expected:
            self._missed += 1
            if self._missed >= MISSED_MAX:
                self.disprove(now_s)
        else:
            self._missed = 0

    def restart(self, now_s: float) -> None:
        """Forgets the trunks: none corrects anything before it is good again. The shift stays, so nothing jumps."""
        self._tracks.trunks.clear()
        self._walls.walls.clear()
        self._missed = 0
        self._begin_frame(now_s)

    def disprove(self, now_s: float) -> None:
        """Begins as one that was never corrected, as its trunks move or are missing. The shift stays: nothing jumps."""
        self.corrected_s = self.fixed_s = -math.inf
        self.fixed_m2, self.corrected_by, self.corrected_along = 0.0, 0, None
        self.restart(now_s)

    def _begin_frame(self, now_s: float) -> None:
        """Trunks that are seen next stand as the pose has them: to them it is exact, their frame errs as the yaw."""
        unseen_s = max(0.0, now_s - max(self.corrected_s, 0.0))
        frame_rad2 = self._heading_rad2() + TURN_RAD2_PER_S * unseen_s
        self._cov = [0.0] * 16
        if not self._turns_with_yaw:
            self._cov[15] = min(FRAME_SD_RAD * FRAME_SD_RAD, frame_rad2)


def _chi2_of_sighting(sighting: Sighting) -> float:
    return sighting.chi2
