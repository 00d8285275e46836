"""One vehicle's survey: scans and poses in, records of stems and of its way out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from companion.cloud.returns import OF_STEM, POINT, StemReturns, encode_returns
from companion.core.model.events import LidarScan
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.survey.alignment import JointFit, ScanCorrections
from companion.survey.grading import grade_fit
from companion.survey.ground import GROUND_SD_M
from companion.survey.observation import STEM_KIND, Grade, StemObservation, encode
from companion.survey.rays import STEMS_MAX, Band, RayCollector
from companion.survey.standing_vehicles import StandingVehicles
from companion.survey.stem_fit import LEAST_RAYS, Floats, StemFit
from companion.survey.stem_rays import COLUMNS, StemRays
from companion.survey.taper import Taper, is_at_breast_height
from companion.survey.track import TRACK_KIND, TrackPoint, encode_track
from mission.document.model import Mission
from mission.rules.survey_rules import cut_distances_m
from mission.schema.kinds import RAW_LIDARS
from mission.schema.trees import BREAST_HEIGHT_M

TRACK_S: Final = 2.0
# Of the mean between the odometry's frame and the mission's: satellites wander faster, and the odometry drifts slower
ANCHOR_S: Final = 12.0
ANCHOR_BY_RANGES_S: Final = 30.0  # the way to d2, by which followers without satellites know it, wanders by a metre
TRACKED_S: Final = 0.3  # lately
POSE_SD_M: Final = 0.02  # of the own motion during a pass
LEVEL_BAND_M: Final = 0.6  # above and below a lidar of one layer: it leans by 5 degrees, 0.6 m at 7 m
BREAST_BAND_M: Final = 0.8  # above and below breast height
# Of the height of a level cut above the ground at the stem: a barometer's, and ground that is not that of the origin
FLIGHT_HEIGHT_SD_M: Final = 0.7
LIDAR_HEIGHT_SD_M: Final = 0.3  # of a lidar above the point that the autopilot's height is of
Place = tuple[float, float]
QUEUE_MAX: Final = 2 * STEMS_MAX
BATCH: Final = 5  # so many stems that have been passed are fitted together, with all that are in sight
WAITS_S: Final = 6.0  # or fewer, when the first has waited for so long
CONTEXT_RAYS: Final = 60  # a stem in sight with fewer aligns nothing
CONTEXT_MAX: Final = 8
SD_MAX_M: Final = 1.0  # of a diameter: a fit that tells nothing
RETURNS_MAX: Final = 256  # passes that wait to be taken: 7 MB
# A tick: nothing waits on the ground but systemd's watchdog, 1.5 s. By count, as a replay has the same; up to 3 ms each
STEPS_LANDED: Final = 20


class _Fitted(NamedTuple):
    """A stem that was fitted."""

    stem: StemRays
    joint: JointFit
    k: int  # of the stem there
    cut: tuple[float, float, float]
    anchor_ne_m: Place
    observation: StemObservation | None


class Surveyor:
    """`integrate` each piece of a scan, then `take_records` once a tick; one fit a tick at most."""

    def __init__(self, mission: Mission, vehicle_id: int, *, keeps_returns: bool = False) -> None:
        """ValueError when the mission has no [survey]. `keeps_returns`: those of stems, for `take_returns`."""
        survey, sensing = mission.survey, mission.sensing
        if survey is None or sensing is None:
            raise ValueError("the mission has no [survey]")
        self._vehicle_id: Final = vehicle_id
        self._lidar: Final = RAW_LIDARS[sensing.sensor]
        self._altitude_min_m: Final = mission.fence.altitude_min_m
        self._dbh_min_m: Final = survey.dbh_min_m
        self._reach_m: Final = min(survey.reach_m, sensing.range_m)
        self._taper: Final = Taper(survey.taper_cm_per_m / 100.0, survey.taper_sd_cm_per_m / 100.0)
        self._cuts_breast: Final = cut_distances_m(mission) is not None
        if self._cuts_breast:
            band = Band(BREAST_HEIGHT_M - BREAST_BAND_M, BREAST_HEIGHT_M + BREAST_BAND_M, by_eye=False)
        else:
            band = Band(-LEVEL_BAND_M, LEVEL_BAND_M, by_eye=True)
        self.collector: Final = RayCollector(band, self._reach_m)
        self._passed: deque[StemRays] = deque(maxlen=QUEUE_MAX)  # the oldest go, unmeasured: a fit has no time limit
        self._standing: Final = StandingVehicles()
        self._hulls: set[StemRays] = set()  # stems beside which one stood while they were tracked
        self._waits_since_s: float | None = None
        self._corrections: Final = ScanCorrections()
        self._known: dict[StemRays, Floats] = {}  # states of stems in sight, as fitted with the last batch
        self._work: Iterator[list[StemObservation]] | None = None  # the batch that is being fitted
        self._anchor_s: Final = ANCHOR_S if mission.has_satellites(vehicle_id) else ANCHOR_BY_RANGES_S
        self._anchor_ne_m: tuple[float, float] | None = None  # mission's frame less the odometry's, slowly
        self._anchors: dict[StemRays, tuple[Place, Place]] = {}  # the same when a stem was tracked first and last
        self._tracked_s = -math.inf
        self._ticked_s: float | None = None
        self._keeps_returns: Final = keeps_returns
        self._fitted: deque[_Fitted] = deque(maxlen=QUEUE_MAX)  # passes whose returns are to be put together
        self._returns: deque[bytes] = deque(maxlen=RETURNS_MAX)  # the oldest go, where nobody takes them
        side = -1.0 if sensing.upside_down else 1.0
        self._layers_rad: Final = np.radians(side * np.array(self._lidar.elevations_deg))

    def integrate(self, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        """A piece of a scan, and the pose of its tick.

        Below the fence's least altitude a vehicle takes off or lands, among saplings and bushes: nothing is measured.
        """
        if -pose.pos_ned_m[2] >= self._altitude_min_m:
            self.collector.integrate(scan, pose, now_s)

    def take_records(self, pose: ScanPose | None, now_s: float) -> list[tuple[int, bytes]]:
        """Once a tick: kinds and bodies of records that are finished."""
        found: list[tuple[int, bytes]] = []
        if pose is not None:
            self._standing.note(pose.standing_ne_m, now_s)
            self._follow_frame(pose, now_s)
            if pose.airborne and now_s - self._tracked_s >= TRACK_S:
                self._tracked_s = now_s
                found.append((TRACK_KIND, encode_track(self._track_point(pose, now_s))))
        self._passed.extend(self.collector.take_passed(now_s, pose))
        landed = pose is None or not pose.airborne
        for _ in range(STEPS_LANDED if landed else 1):
            if self._work is None and self._is_due(now_s, landed=landed):
                self._work = self._fit_batch()
            if self._work is None:
                break
            measured = next(self._work, None)
            if measured is None:
                self._work = None
            else:
                found += [(STEM_KIND, encode(observation)) for observation in measured]
        for _ in range(min(len(self._fitted), STEPS_LANDED if landed else 1)):
            self._keep_returns(self._fitted.popleft())
        return found

    def take_returns(self) -> list[bytes]:
        """Passes of stems that were fitted, as `companion.cloud.returns` encodes them, since last asked."""
        found = list(self._returns)
        self._returns.clear()
        return found

    # --- inside ---

    def _follow_frame(self, pose: ScanPose, now_s: float) -> None:
        """The odometry does not jump and the satellites do not drift: the mean of what is between tells both."""
        since_s = 0.0 if self._ticked_s is None else now_s - self._ticked_s
        self._ticked_s = now_s
        anchor, told = self._anchor_ne_m, pose.to_mission_ne_m
        if anchor is None or not pose.airborne:
            anchor = told
        share = -math.expm1(-max(0.0, since_s) / self._anchor_s)
        anchor = (anchor[0] + share * (told[0] - anchor[0]), anchor[1] + share * (told[1] - anchor[1]))
        self._anchor_ne_m = anchor
        for stem in self.collector.stems:
            if now_s - stem.last_s <= TRACKED_S:
                self._anchors[stem] = (self._anchors.get(stem, (anchor, anchor))[0], anchor)
                if self._standing.is_near(stem.north_m, stem.east_m):  # then: the frames of the two drift apart
                    self._hulls.add(stem)

    def _track_point(self, pose: ScanPose, now_s: float) -> TrackPoint:
        anchor = self._anchor_ne_m or (0.0, 0.0)
        north_m, east_m = pose.pos_ned_m[0] + anchor[0], pose.pos_ned_m[1] + anchor[1]
        return TrackPoint(self._vehicle_id, now_s, north_m, east_m, pose.frame_sd_m, self._reach_m, anchor)

    def _is_due(self, now_s: float, *, landed: bool) -> bool:
        """Stems wait that are to be fitted now."""
        if not self._passed:
            self._waits_since_s = None
            return False
        if self._waits_since_s is None:
            self._waits_since_s = now_s
        return landed or len(self._passed) >= BATCH or now_s - self._waits_since_s >= WAITS_S

    def _fit_batch(self) -> Iterator[list[StemObservation]]:
        """Fits those that wait, step by step; the last step has what was measured."""
        done = frozenset(self._passed)
        passed = [stem for stem in self._passed if stem.count >= LEAST_RAYS and self._may_be_tree(stem)]
        self._passed.clear()
        in_sight = [stem for stem in self.collector.stems if stem.count >= CONTEXT_RAYS and self._may_be_tree(stem)]
        context = in_sight[:CONTEXT_MAX]
        cuts = [self._cut_of(stem) for stem in (*passed, *context)]
        stems = [(stem, cut[0]) for stem, cut in zip((*passed, *context), cuts, strict=True)]
        frames, frame = self.collector.frames, self.collector.frame
        known = self._known
        joint = JointFit(stems, self._lidar, self._taper.per_m, self._corrections, frames, frame, known)
        for _ in joint.steps():
            yield []
        states = {stem: joint.state_of(len(passed) + k) for k, stem in enumerate(context)}
        self._known = {stem: state for stem, state in states.items() if state is not None}
        fits = [joint.fit_of(k) for k in range(len(passed))]
        measured = [
            None if fit is None else self._observe_stem(stem, fit, cut)
            for stem, fit, cut in zip(passed, fits, cuts, strict=False)
        ]
        if self._keeps_returns:
            self._fitted += [
                _Fitted(stem, joint, k, cuts[k], self._anchor_of(stem), measured[k]) for k, stem in enumerate(passed)
            ]
        self._hulls &= {*self.collector.stems, *self._passed}
        self._anchors = {stem: held for stem, held in self._anchors.items() if stem not in done}
        yield [observation for observation in measured if observation is not None]

    def _may_be_tree(self, stem: StemRays) -> bool:
        """False where a vehicle stands, or stood while the stem was in sight."""
        return stem not in self._hulls and not self._standing.is_near(stem.north_m, stem.east_m)

    def _observe_stem(self, stem: StemRays, fit: StemFit, cut: tuple[float, float, float]) -> StemObservation | None:
        """A stem that was fitted; None: it is thinner than asked for, or nothing is known of it."""
        _, cut_up_m, cut_sd_m = cut
        dbh_m, dbh_sd_m = self._taper.at_breast_height(fit.diameter_m, fit.diameter_sd_m, cut_up_m, cut_sd_m)
        if dbh_m < self._dbh_min_m or not fit.diameter_sd_m < SD_MAX_M:
            return None
        measured = is_at_breast_height(cut_up_m)
        grade, reason = grade_fit(fit, dbh_sd_m)
        if grade is Grade.GOOD and not measured:
            grade, reason = Grade.FAIR, f"by taper from {cut_up_m:.1f} m"
        anchor_n_m, anchor_e_m = self._anchor_of(stem)
        return StemObservation(
            vehicle_id=self._vehicle_id,
            first_s=stem.born_s,
            last_s=max(stem.born_s, stem.ray_s),
            north_m=fit.north_m + anchor_n_m,
            east_m=fit.east_m + anchor_e_m,
            position_sd_m=math.hypot(fit.position_sd_m, POSE_SD_M),
            frame_sd_m=stem.frame_sd_m,
            cut_up_m=cut_up_m,
            diameter_m=fit.diameter_m,
            diameter_sd_m=fit.diameter_sd_m,
            dbh_m=dbh_m,
            dbh_sd_m=dbh_sd_m,
            is_dbh_measured=measured,
            lean_rad=fit.lean_rad,
            arc_share=fit.arc_share,
            rays=fit.rays,
            grade=grade,
            reason=reason,
        )

    def _anchor_of(self, stem: StemRays) -> Place:
        """Mission's frame less the odometry's, north and east, while a stem was tracked."""
        first, last = self._anchors.get(stem, (self._anchor_ne_m or (0.0, 0.0),) * 2)
        return 0.5 * (first[0] + last[0]), 0.5 * (first[1] + last[1])

    def _keep_returns(self, fitted: _Fitted) -> None:
        """All rays that were pooled for a stem, as the fit has them; a millisecond."""
        found = fitted.joint.cloud_of(fitted.k)
        if found is None:
            return
        cloud, is_of_stem = found
        stem, (cut_m, cut_up_m, cut_sd_m) = fitted.stem, fitted.cut
        times_s = self.collector.times_s
        points = np.zeros(len(cloud.scan), dtype=POINT)
        points["north_m"], points["east_m"] = cloud.north - stem.north_m, cloud.east - stem.east_m
        points["up_m"] = cloud.up + cut_m
        points["at_s"] = [times_s.get(int(scan), stem.ray_s) - stem.born_s for scan in cloud.scan]
        points["ring"] = np.argmin(np.abs(cloud.elevation[:, None] - self._layers_rad), axis=1)
        points["flags"] = OF_STEM * is_of_stem
        told = StemReturns(
            vehicle_id=self._vehicle_id,
            body=b"" if fitted.observation is None else encode(fitted.observation),
            first_s=stem.born_s,
            north_m=stem.north_m + fitted.anchor_ne_m[0],
            east_m=stem.east_m + fitted.anchor_ne_m[1],
            ground_up_m=cut_m - cut_up_m if cut_sd_m == GROUND_SD_M else None,
            points=points,
        )
        self._returns.append(encode_returns(told))

    def _cut_of(self, stem: StemRays) -> tuple[float, float, float]:
        """Height of the cut as its rays have it; the same above the ground at the stem; the error of that."""
        heights = sorted(stem.rays[2::COLUMNS])
        middle_m = heights[len(heights) // 2]
        if not self._cuts_breast:
            return middle_m, middle_m, math.hypot(FLIGHT_HEIGHT_SD_M, LIDAR_HEIGHT_SD_M)
        ground_m = self.collector.ground.height_up_m(stem.north_m, stem.east_m)
        if ground_m is None:
            ground_m = stem.ground_up_m
        if ground_m is None:
            return middle_m, middle_m, math.hypot(FLIGHT_HEIGHT_SD_M, LIDAR_HEIGHT_SD_M)
        nearest_m = min(max(BREAST_HEIGHT_M, heights[0] - ground_m), heights[-1] - ground_m)
        return ground_m + nearest_m, nearest_m, GROUND_SD_M
