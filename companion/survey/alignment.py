"""Stems of a window of time fitted together with the poses of the scans that saw them: all of these stand still.

The own motion goes by the flattest layer alone, a few rays of each trunk, and its yaw errs by half a degree from scan
to scan: 4 cm at 5 m, which blurs a stem that is seen from many places. All rays at all stems of a window are many more.
They are solved by turns: each stem given the scans' poses, then each scan's pose given the stems. That is cut into
steps of a millisecond, so that a tick of the flight never waits for a whole fit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.survey.stem_fit import LEAST_RAYS as LEAST_STEM_RAYS
from companion.survey.stem_fit import Cloud, Floats, Linear, Solution, StemFit
from companion.survey.stem_rays import RAYS_MAX, StemRays
from mission.schema.kinds import RawLidar

SHIFT_SD_M: Final = 0.03  # priors of a scan's correction
TURN_SD_RAD: Final = math.radians(0.8)
LEAST_RAYS: Final = 8  # of a scan at all stems: with fewer its pose stays as it is
ROUNDS: Final = 8  # of one step each
SCANS_MAX: Final = 1024  # whose corrections are remembered for the next window: 100 s, 0.2 MB
Frame = tuple[float, float, float]
NOTHING: Final = np.zeros(3)


class ScanCorrections:
    """Corrections of scans' poses, by their number: shift north and east, turn clockwise."""

    def __init__(self) -> None:
        self._of_scan: dict[int, Floats] = {}

    def of(self, scans: Floats) -> Floats:
        """(scans, 3); nothing for those not known."""
        return np.array([self._of_scan.get(int(scan), NOTHING) for scan in scans]).reshape(-1, 3)

    def update(self, scans: Floats, corrections: Floats) -> None:
        """The corrections of these scans; the oldest are forgotten."""
        self._of_scan.update(zip(map(int, scans), corrections, strict=True))
        while len(self._of_scan) > SCANS_MAX:
            del self._of_scan[next(iter(self._of_scan))]


class JointFit:
    """Some stems and the scans that saw them. `steps` until it ends; then `fit_of` each stem."""

    def __init__(
        self,
        stems: Sequence[tuple[StemRays, float]],
        lidar: RawLidar,
        taper: float,
        corrections: ScanCorrections,
        frames: Mapping[int, Frame] = MappingProxyType({}),
        frame: Frame = (0.0, 0.0, 0.0),
        known: Mapping[StemRays, Floats] = MappingProxyType({}),
    ) -> None:
        """`stems`: each with the height of its cut, as its rays have heights; `taper`: as `stem_fit.Cloud`.

        `known`: the state of a stem when it was fitted last, to go on from.

        `frames`: of the odometry when a scan was placed, `frame`: now (`ScanOdometry.frame`).
        """
        self._known: Final = known
        self._frames: Final = frames
        self._frame: Final = frame
        self._stems: Final = stems
        self._lidar: Final = lidar
        self._taper: Final = taper
        self._corrections: Final = corrections
        self._ended: Final = ScanCorrections()  # as they were when all was fitted
        self._clouds: Final[dict[int, Cloud]] = {}  # by the stem's index; of one with too few rays there is none
        self._solutions: Final[dict[int, Solution]] = {}

    def steps(self) -> Iterator[None]:
        """Goes on by one step whenever it is asked."""
        for k, (stem, cut_m) in enumerate(self._stems):
            cloud = Cloud(stem.rays, cut_m, self._lidar, self._taper)
            if len(cloud.scan) < LEAST_STEM_RAYS:
                continue
            self._place(cloud, self._corrections)
            self._clouds[k] = cloud
            known = self._known.get(stem)
            self._solutions[k] = (
                cloud.begin((stem.north_m, stem.east_m, stem.radius_m)) if known is None else cloud.resume(known)
            )
            yield
        if not self._clouds:
            return
        for k_round in range(ROUNDS):
            self._align_scans()
            yield
            for k, cloud in self._clouds.items():
                self._solutions[k] = cloud.improve(self._solutions[k], last=k_round == ROUNDS - 1)
                yield
        scans = np.unique(np.concatenate([cloud.scan for cloud in self._clouds.values()]))
        self._ended.update(scans, self._corrections.of(scans))  # others go on from there meanwhile

    def cloud_of(self, k: int) -> tuple[Cloud, NDArray[np.bool_]] | None:
        """All rays of a stem by the poses that it was fitted with, and which of them the fit counts; None: no fit.

        Of a scan of which no ray was fitted none counts: nothing has corrected it.
        """
        solution = self._solutions.get(k)
        if solution is None or not math.isfinite(solution.cost):
            return None
        stem, cut_m = self._stems[k]
        cloud = Cloud(stem.rays, cut_m, self._lidar, self._taper, rays_taken=RAYS_MAX)
        self._place(cloud, self._ended)
        return cloud, Linear(cloud, solution.state).is_of_stem() & np.isin(cloud.scan, self._clouds[k].scan)

    def _place(self, cloud: Cloud, corrections: ScanCorrections) -> None:
        """Each ray as the frame has been turned since, and as its scan is corrected."""
        scans, index = np.unique(cloud.scan, return_inverse=True)
        cloud.turn_frame(np.array([self._turned_since(int(scan)) for scan in scans])[index].T)
        cloud.move(corrections.of(scans)[index].T)

    def _turned_since(self, scan: int) -> Frame:
        """Turn and shift of a scan's places since it was placed."""
        then, now = self._frames.get(scan, self._frame), self._frame
        turn = now[0] - then[0]
        cos, sin = math.cos(turn), math.sin(turn)
        return turn, now[1] - cos * then[1] + sin * then[2], now[2] - sin * then[1] - cos * then[2]

    def state_of(self, k: int) -> Floats | None:
        """The state that a stem was fitted to; None: it was not, there is none to go on from."""
        solution = self._solutions.get(k)
        return None if solution is None or not math.isfinite(solution.cost) else solution.state

    def fit_of(self, k: int) -> StemFit | None:
        """The stem as fitted; None: no circle."""
        solution = self._solutions.get(k)
        return None if solution is None else solution.told()

    def _align_scans(self) -> None:
        """Each scan's shift and turn, by all its rays, given the stems."""
        fitted = [k for k, solution in self._solutions.items() if math.isfinite(solution.cost)]
        if not fitted:
            return
        clouds, solutions = [self._clouds[k] for k in fitted], [self._solutions[k] for k in fitted]
        scans, index = np.unique(np.concatenate([cloud.scan for cloud in clouds]), return_inverse=True)
        slopes: list[Floats] = []
        for cloud, solution in zip(clouds, solutions, strict=True):
            out_n, out_e = solution.linear.out_n, solution.linear.out_e
            turning = out_e * (cloud.north - cloud.eye_n) - out_n * (cloud.east - cloud.eye_e)
            slopes.append(np.stack([out_n, out_e, turning]))
        slope = np.concatenate(slopes, axis=1)
        off = np.concatenate([solution.linear.off for solution in solutions])
        weight = np.concatenate([solution.linear.weight for solution in solutions])
        count = len(scans)
        normal, gradient = np.zeros((count, 3, 3)), np.zeros((count, 3))
        for i in range(3):
            gradient[:, i] = np.bincount(index, slope[i] * off * weight, count)
            for j in range(i, 3):
                normal[:, i, j] = normal[:, j, i] = np.bincount(index, slope[i] * slope[j] * weight, count)
        before = self._corrections.of(scans)
        believed = np.array([SHIFT_SD_M, SHIFT_SD_M, TURN_SD_RAD]) ** -2.0
        normal += np.diag(believed)
        gradient += believed * before
        moved = np.asarray(-np.linalg.solve(normal, gradient[:, :, None])[:, :, 0], dtype=np.float64)
        moved[np.bincount(index, minlength=count) < LEAST_RAYS] = 0.0
        self._corrections.update(scans, before + moved)
        first = 0
        for cloud in clouds:
            last = first + len(cloud.scan)
            cloud.move(moved[index[first:last]].T)
            first = last
