"""A stem's circle, fitted to the rays of many scans at once: robust least squares on the pooled points.

Not the mean of single scans' diameters: a circle through the few rays of one scan has heavy tails. The model: an axis
that may lean, a radius that falls with height by the stated taper, and a second harmonic, by which a section may be an
ellipse; lean and ellipse have priors, and are only as large as the rays make them. Of a ray it is known that
- its range alone is noisy: so ranges are compared, not distances from a circle, which noise makes too wide or too
  narrow; at grazing incidence a range says little, and where it was hit more;
- it tells the nearest within its beam: what it met lies nearer to the axis than its middle, by half of a beam at most.
Residuals weigh by Cauchy's law. The start is Taubin's circle (Taubin 1991, "Estimation of planar curves", IEEE TPAMI
13, 1115-1138) or the trunk as it was tracked, whichever ends better.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.survey.stem_rays import COLUMNS, LEFT, RIGHT
from mission.schema.kinds import RawLidar

Floats = NDArray[np.float64]
LEAST_RAYS: Final = 12
STEPS: Final = 6  # of Gauss-Newton to begin with; scans are then aligned, with one more after each time
RAYS_TAKEN: Final = 300  # of one stem: more make no diameter better
STEP_MAX_M: Final = 0.1
CAUCHY: Final = 2.4  # sigmas: 95 % as efficient as least squares where all is well
ROUGH_M: Final = 0.005  # bark, and what is left of the pose's errors between scans
YAW_SD_RAD: Final = 0.004  # of a ray's bearing, as scans are aligned
LEAN_SD: Final = math.tan(math.radians(2.5))  # prior
ELLIPSE_SHARE: Final = 0.03  # prior: sd of the second harmonic over the radius
SYSTEMATIC_M: Final = 0.004  # of a diameter, whatever the number of rays: beam, bark, taper between cuts
CORRELATED: Final = 4.0  # rays of one scan share its pose: so many count as one
SECTORS: Final = 24  # of the circumference
SECTOR_LEAST: Final = 2  # rays in one that is occupied
INNER: Final = 0.6  # of the radius: a ray that ends within is none of this stem's
REGULAR: Final = 1.0  # 1/m^2: of nothing but one ray many times, too, a step can be worked out
RADIUS_MIN_M: Final = 0.015
RADIUS_MAX_M: Final = 1.5
LEAN_SPAN_M: Final = 0.6  # between low and high rays (10 %, 90 %): for less, lean is not measured


@dataclass(frozen=True, slots=True)
class StemFit:
    """A fitted stem. North and east in the frame of its rays; the axis is that at the height of the cut."""

    north_m: float
    east_m: float
    position_sd_m: float
    diameter_m: float  # at the cut: mean over all directions
    diameter_sd_m: float
    lean_rad: float | None
    arc_share: float
    inner_share: float  # of the rays: they end within the stem
    rms_m: float  # of the residuals, robust
    rays: int


class Cloud:
    """The points with what is known of each."""

    def __init__(
        self, rays: array[float], cut_up_m: float, lidar: RawLidar, taper: float, rays_taken: int = RAYS_TAKEN
    ) -> None:
        """`rays`: those of StemRays; `cut_up_m`: height of the cut, as they have heights.

        `taper`: metres of diameter per metre of height. Of more than `rays_taken` rays every so many are taken.
        """
        rows = np.array(rays, dtype=np.float64).reshape(-1, COLUMNS)
        rows = rows[np.isfinite(rows).all(axis=1) & (rows[:, 6] > 0.0)]  # metres along a ray
        rows = rows[:: 1 + max(0, len(rows) - 1) // rays_taken]
        self.north, self.east, up, self.eye_n, self.eye_e, edge, along, self.scan, self.elevation = rows.T.copy()
        self._aim()
        self.up = up - cut_up_m
        self.range_sd = lidar.range_sd_m * self.level / along
        self.beside_sd = YAW_SD_RAD * self.level
        self.half_beam_m = math.radians(lidar.beam_deg) / 2.0 * along
        self.taper = taper
        # Rays beside which the next one, a step farther out, missed the stem: to their left (1.0) and right (-1.0)
        left, right = np.flatnonzero(edge.astype(int) & LEFT), np.flatnonzero(edge.astype(int) & RIGHT)
        self.edges = np.concatenate([left, right])
        self.sides = np.concatenate([np.ones(len(left)), -np.ones(len(right))])
        self.step_rad = math.radians(lidar.step_deg)

    def _aim(self) -> None:
        to_n, to_e = self.north - self.eye_n, self.east - self.eye_e
        self.level = np.maximum(np.hypot(to_n, to_e), 0.05)
        self.way_n, self.way_e = to_n / self.level, to_e / self.level

    def turn_frame(self, turned: Floats) -> None:
        """Each ray as the odometry's frame has been turned since (3, rays): clockwise about its origin, then moved."""
        cos, sin = np.cos(turned[0]), np.sin(turned[0])
        n, e, eye_n, eye_e = self.north, self.east, self.eye_n, self.eye_e
        self.north, self.east = cos * n - sin * e + turned[1], sin * n + cos * e + turned[2]
        self.eye_n, self.eye_e = cos * eye_n - sin * eye_e + turned[1], sin * eye_n + cos * eye_e + turned[2]
        self._aim()

    def move(self, moved: Floats) -> None:
        """Each ray by its scan's correction (3, rays): shift north and east, turn clockwise about its eye."""
        to_n, to_e = self.north - self.eye_n, self.east - self.eye_e
        cos, sin = np.cos(moved[2]), np.sin(moved[2])
        self.eye_n += moved[0]
        self.eye_e += moved[1]
        self.north = self.eye_n + cos * to_n - sin * to_e
        self.east = self.eye_e + sin * to_n + cos * to_e
        self._aim()

    def begin(self, start: tuple[float, float, float]) -> Solution:
        """The best of Taubin's circle and of `start`: north, east and radius of the trunk as it was tracked."""
        found = [self._solve(_state_of(*circle), STEPS) for circle in (start, _taubin(self, start))]
        return min(found, key=_cost_of)

    def resume(self, state: Floats) -> Solution:
        """From where the same stem was fitted with fewer rays."""
        return self._solve(state, 1)

    def improve(self, solution: Solution, *, last: bool) -> Solution:
        """One step after rays were moved a little; but for the `last` one the residuals after it are predicted."""
        if not math.isfinite(solution.cost):
            return solution
        if last:
            return self._solve(solution.state, 1)
        linear = Linear(self, solution.state)
        state = self._stepped(solution.state, linear)
        linear.off = linear.off + (state - solution.state) @ linear.slopes
        return Solution(state, linear)

    def _stepped(self, state: Floats, linear: Linear) -> Floats:
        try:
            step = -np.linalg.solve(linear.normal, linear.gradient)
        except np.linalg.LinAlgError:  # singular: there is no fit, as its cost then says
            return np.full_like(state, np.nan)
        state = state + np.clip(step, -STEP_MAX_M, STEP_MAX_M)
        state[2] = min(max(state[2], RADIUS_MIN_M), RADIUS_MAX_M)
        return state

    def _solve(self, state: Floats, steps: int) -> Solution:
        """Gauss-Newton from `state`: north, east, radius, lean north and east, ellipse by cosine and sine."""
        linear = Linear(self, state)
        for _ in range(steps):
            state = self._stepped(state, linear)
            linear = Linear(self, state)
        return Solution(state, linear)


class Linear:
    """Residuals about a state, with their weights and derivatives."""

    def __init__(self, cloud: Cloud, state: Floats) -> None:
        north, east, radius, lean_n, lean_e, by_cos, by_sin = state
        axis_n, axis_e = north + lean_n * cloud.up - cloud.eye_n, east + lean_e * cloud.up - cloud.eye_e
        # How far the axis is to the right of a ray; half of a beam nearer, of what it met first
        aside = axis_e * cloud.way_n - axis_n * cloud.way_e
        middle = aside
        aside = aside - np.clip(aside, -cloud.half_beam_m, cloud.half_beam_m)
        # The radius in the direction of the hit, which hardly differs from that of the point
        to_n, to_e = cloud.north - cloud.eye_n - axis_n, cloud.east - cloud.eye_e - axis_e
        self.away = np.maximum(np.hypot(to_n, to_e), 1e-6)
        twice_cos = (to_n * to_n - to_e * to_e) / self.away**2
        twice_sin = 2.0 * to_n * to_e / self.away**2
        tapered = radius - 0.5 * cloud.taper * cloud.up
        self.round_m = np.maximum(tapered + by_cos * twice_cos + by_sin * twice_sin, RADIUS_MIN_M)
        # Where the model has the hit: seen from the axis towards the eye, and aside
        sine = np.clip(aside / self.round_m, -1.0, 1.0)
        cosine = np.sqrt(1.0 - sine * sine)
        self.out_n = -cosine * cloud.way_n + sine * cloud.way_e
        self.out_e = -cosine * cloud.way_e - sine * cloud.way_n
        along = axis_n * cloud.way_n + axis_e * cloud.way_e - self.round_m * cosine
        # The range's residual, as far as it is across the bark; and by how much one missed the model
        self.off = -(cloud.level - along) * cosine + np.maximum(np.abs(aside) - self.round_m, 0.0)
        variance = (cloud.range_sd * cosine) ** 2 + (cloud.beside_sd * sine) ** 2 + ROUGH_M**2
        scaled2 = self.off**2 / variance
        spread = max(1.0, 1.4826 * math.sqrt(_median(scaled2)))
        rejected = scaled2 / (CAUCHY * spread) ** 2
        self.weight = 1.0 / ((1.0 + rejected) * variance * spread**2)
        ones = np.ones_like(self.off)
        outwards = [self.out_n, self.out_e, ones, self.out_n * cloud.up, self.out_e * cloud.up, twice_cos, twice_sin]
        self.slopes = slopes = -np.array(outwards)
        edge_slopes, edge_off, edge_weight = self._edges(cloud, middle, np.stack([twice_cos, twice_sin]))
        believed = 1.0 / np.array([LEAN_SD, LEAN_SD, ELLIPSE_SHARE * radius, ELLIPSE_SHARE * radius]) ** 2
        self.normal = ((slopes * self.weight) @ slopes.T + (edge_slopes * edge_weight) @ edge_slopes.T) / CORRELATED
        self.normal[range(3), range(3)] += REGULAR
        self.normal[range(3, 7), range(3, 7)] += believed
        self.gradient = (slopes @ (self.off * self.weight) + edge_slopes @ (edge_off * edge_weight)) / CORRELATED
        self.gradient[3:] += believed * state[3:]
        self.cost = float(np.log1p(scaled2 / CAUCHY**2).sum())
        self.up = cloud.up
        self.bearing = np.arctan2(to_e, to_n)

    def is_of_stem(self) -> NDArray[np.bool_]:
        """Rays whose residuals are as those of most."""
        within_m = 3.0 * max(ROUGH_M, 1.4826 * float(np.median(np.abs(self.off))))
        return np.asarray(np.abs(self.off) < within_m)

    def _edges(self, cloud: Cloud, aside: Floats, twice: Floats) -> tuple[Floats, Floats, Floats]:
        """Slopes, residuals and weights of the stem's edges: each is between a ray that hit and the next, which missed.

        Without them a circle may be too wide: hits alone do not say that there are none farther out.
        """
        at, side = cloud.edges, cloud.sides
        step_m = cloud.step_rad * cloud.level[at]
        off = side * aside[at] + 0.5 * step_m - cloud.half_beam_m[at] - self.round_m[at]
        variance = step_m**2 / 12.0 + cloud.beside_sd[at] ** 2 + ROUGH_M**2
        weight = 1.0 / ((1.0 + off**2 / (variance * CAUCHY**2)) * variance)
        out_n, out_e = side * cloud.way_e[at], -side * cloud.way_n[at]
        up = cloud.up[at]
        outwards = [out_n, out_e, np.ones_like(off), out_n * up, out_e * up, twice[0, at], twice[1, at]]
        return -np.array(outwards), off, weight


class Solution:
    """The end of an iteration."""

    def __init__(self, state: Floats, linear: Linear) -> None:
        self.state: Final = state
        self.linear: Final = linear
        self.cost: Final = linear.cost if np.isfinite(state).all() else math.inf

    def told(self) -> StemFit | None:
        """With its errors; None: they cannot be told."""
        if not math.isfinite(self.cost) or len(self.linear.off) < LEAST_RAYS:
            return None
        linear, (north, east, radius, lean_n, lean_e, _, _) = self.linear, self.state
        try:
            covariance = np.linalg.inv(linear.normal)
        except np.linalg.LinAlgError:
            return None
        if not (np.isfinite(covariance).all() and (np.diag(covariance) > 0.0).all()):  # ill-conditioned
            return None
        of_stem = linear.is_of_stem()
        sectors = np.floor(linear.bearing[of_stem] * (SECTORS / math.tau)).astype(np.intp) % SECTORS
        occupied = np.count_nonzero(np.bincount(sectors, minlength=SECTORS) >= SECTOR_LEAST)
        low, high = np.percentile(linear.up, (10.0, 90.0))
        return StemFit(
            north_m=float(north),
            east_m=float(east),
            position_sd_m=math.sqrt(float(covariance[0, 0] + covariance[1, 1])),
            diameter_m=2.0 * float(radius),
            diameter_sd_m=math.hypot(2.0 * math.sqrt(float(covariance[2, 2])), SYSTEMATIC_M),
            lean_rad=math.atan(math.hypot(lean_n, lean_e)) if high - low > LEAN_SPAN_M else None,
            arc_share=occupied / SECTORS,
            inner_share=float(np.mean(linear.away < INNER * linear.round_m)),
            rms_m=1.4826 * float(np.median(np.abs(linear.off))),
            rays=len(linear.off),
        )


def _median(values: Floats) -> float:
    """The upper one of two."""
    half = len(values) // 2
    return float(np.partition(values, half)[half])


def _state_of(north_m: float, east_m: float, radius_m: float) -> Floats:
    return np.array([north_m, east_m, min(max(radius_m, RADIUS_MIN_M), RADIUS_MAX_M), 0.0, 0.0, 0.0, 0.0])


def _cost_of(solution: Solution) -> float:
    return solution.cost


def _taubin(cloud: Cloud, otherwise: tuple[float, float, float]) -> tuple[float, float, float]:
    """North, east and radius of Taubin's circle through the points; `otherwise` where there is none."""
    mean_n, mean_e = float(cloud.north.mean()), float(cloud.east.mean())
    n, e = cloud.north - mean_n, cloud.east - mean_e
    square = n * n + e * e
    level = float(square.mean())
    if not level > 0.0 or len(n) < 3:
        return otherwise
    design = np.column_stack([(square - level) / (2.0 * math.sqrt(level)), n, e])
    try:
        _, _, found = np.linalg.svd(design, full_matrices=False)
    except np.linalg.LinAlgError:
        return otherwise
    first, second, third = found[2]
    lead = first / (2.0 * math.sqrt(level))
    if abs(lead) < 1e-9:
        return otherwise
    centre_n, centre_e = -second / (2.0 * lead), -third / (2.0 * lead)
    radius = math.sqrt(max(0.0, centre_n**2 + centre_e**2 + level))
    if not RADIUS_MIN_M < radius < RADIUS_MAX_M:
        return otherwise
    return mean_n + float(centre_n), mean_e + float(centre_e), radius
