"""The safety filter beside trunks, in flight: whatever is wished and whichever pushes, none is touched."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO, add, norm, scale, sub
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.disturbance import DisturbanceEstimator
from companion.core.safety.response_model import DEAD_S, LAG_S, Disturbance
from companion.core.safety.safety_filter import SafetyFilter
from companion.mavlink.makes.ardupilot import ARDUPILOT
from mission.common.frames import Vec3
from sim_bridge.world.autopilot.guidance import Shaper
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import applied

FILTER = SafetyFilter.of(mission())
CLEAR_M, MARGIN_M = 0.65, 0.3
DT_S = 0.05
SEEN = [False] * 72


class PointMass:
    """The model, with a dead time of whole ticks."""

    def __init__(self, pos: Vec3, vel: Vec3, dead_ticks: int) -> None:
        self.pos, self.vel = pos, vel
        self.under_way = [vel] * dead_ticks

    def step(self, told: Vec3) -> None:
        self.under_way.append(told)
        goal = self.under_way.pop(0)
        for _ in range(5):
            dt_s = DT_S / 5
            change = scale(sub(goal, self.vel), -math.expm1(-dt_s / LAG_S))
            most = 3.0 * dt_s
            change = change if norm(change) <= most else scale(change, most / norm(change))
            self.pos = add(self.pos, scale(add(self.vel, scale(change, 0.5)), dt_s))
            self.vel = add(self.vel, change)


@pytest.mark.parametrize("dead_ticks", [0, 1, 2])
@pytest.mark.parametrize("seed", range(2))
def test_point_mass_never_touches_a_mapped_point_whatever_is_wished_and_whoever_pushes(
    seed: int, dead_ticks: int
) -> None:
    rng = random.Random(seed)
    assert dead_ticks * DT_S <= DEAD_S
    nearest_m, moved_m = math.inf, 0.0
    for _ in range(8):
        body = PointMass((rng.uniform(-20, 20), rng.uniform(-20, 20), -8.0), ZERO, dead_ticks)
        trunks = [(rng.uniform(-30, 30), rng.uniform(-30, 30)) for _ in range(rng.randrange(20, 160))]
        trunks = [(n, e) for n, e in trunks if math.hypot(n - body.pos[0], e - body.pos[1]) > CLEAR_M]
        last: Vec3 = ZERO
        pushers = [(rng.uniform(-7, 7), rng.uniform(-7, 7), 0.0) for _ in range(rng.randrange(3))]
        for k in range(120):
            if k % 15 == 0:
                wish = (rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(-1, 1))
            around = [
                neighbour(i + 2, rel, vel_ned_mps=(rng.uniform(-3, 3), rng.uniform(-3, 3), 0.0))
                for i, rel in enumerate(pushers)
            ]
            north, east, _ = body.pos
            points = LocalObstacleCloud(7.35, SEEN)
            points.add_points([n - north for n, _ in trunks], [e - east for _, e in trunks], CLEAR_M)
            own = Position(body.pos, body.vel)
            last = applied(FILTER, wish, last, own, around, [], dt_s=DT_S, points=points)
            body.step(last)
            moved_m += norm(body.vel) * DT_S
            for n, e in trunks:
                nearest_m = min(nearest_m, math.hypot(n - body.pos[0], e - body.pos[1]))
    assert moved_m > 30.0
    assert nearest_m > CLEAR_M - MARGIN_M / 3.0  # the body's radius is a margin away: two thirds of it are left


class Copter:
    """Velocities with limited jerk, as ArduPilot shapes them, and a dead time of 0.25 s."""

    def __init__(self) -> None:
        self.pos: Vec3 = (0.0, 0.0, -8.0)
        self.vel: Vec3 = ZERO
        self.under_way: list[Vec3] = [ZERO] * 5
        self._shaper = Shaper()

    def step(self, told: Vec3) -> None:
        self.under_way.append(told)
        goal = self.under_way.pop(0)
        for _ in range(5):
            self.vel = self._shaper.track_velocity(
                goal, DT_S / 5, accel_mps2=2.5, jerk_mps3=7.0, lag_s=0.25, lead_s=0.0
            )
            self.pos = add(self.pos, scale(self.vel, DT_S / 5))


def wander_among_trunks(body: Copter | PointMass, gusts: DisturbanceEstimator, seed: int) -> tuple[float, float]:
    """Wishes at random, among trunks once it has been felt for 10 s: distance from the nearest, and way; metres."""
    rng, last = random.Random(seed), ZERO
    trunks: list[tuple[float, float]] = []
    nearest_m, moved_m = math.inf, 0.0
    for k in range(1600):
        if k % 20 == 0:
            wish = (rng.uniform(-4, 4), rng.uniform(-4, 4), 0.0)
        gusts.estimate_disturbance((body.vel[0], body.vel[1]), (last[0], last[1]), DT_S, 3.0)
        north, east, _ = body.pos
        if k >= 200 and k % 200 == 0:  # others, wherever it is, and has come to rest clear of
            trunks = [(north + rng.uniform(-25, 25), east + rng.uniform(-25, 25)) for _ in range(100)]
            trunks = [(n, e) for n, e in trunks if math.hypot(n - north, e - east) > 4.0]
        points = LocalObstacleCloud(7.35, SEEN)
        points.add_points([n - north for n, _ in trunks], [e - east for _, e in trunks], CLEAR_M)
        felt = Disturbance(ZERO, 0.0, gusts.under_way(DT_S, 3.0), gusts.dead_s)
        own = Position(body.pos, body.vel)
        last = applied(FILTER, wish, last, own, dt_s=DT_S, points=points, disturbance=felt)
        body.step(last)
        moved_m += norm(body.vel) * DT_S
        for n, e in trunks:
            nearest_m = min(nearest_m, math.hypot(n - body.pos[0], e - body.pos[1]))
    return nearest_m, moved_m


@pytest.mark.parametrize("seed", range(2))
def test_vehicle_that_turns_with_limited_jerk_touches_no_mapped_point_once_it_has_been_felt(seed: int) -> None:
    gusts = DisturbanceEstimator()
    gusts.adopt_shaping(ARDUPILOT.traits.shaping)
    nearest_m, moved_m = wander_among_trunks(Copter(), gusts, seed)
    assert moved_m > 30.0
    assert nearest_m > CLEAR_M - MARGIN_M


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_vehicle_whose_setpoints_act_late_keeps_clear_in_turns_once_it_has_been_felt(seed: int) -> None:
    """0.25 s, as in JSBSim: a turn goes on for as long as the setpoints that began it are under way."""
    nearest_m, moved_m = wander_among_trunks(PointMass((0.0, 0.0, -8.0), ZERO, 5), DisturbanceEstimator(), seed)
    assert moved_m > 100.0
    assert nearest_m > CLEAR_M - MARGIN_M / 6.0  # what a verified way may give


@pytest.mark.parametrize("noise_m", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("dead_ticks", [0, 2, 5])
def test_vehicle_that_is_pushed_at_a_trunk_does_not_touch_it_within_a_minute(dead_ticks: int, noise_m: float) -> None:
    """Each verification gives way to rounding and noise by a centimetre; they must not add up."""
    rng = random.Random(1)
    pos_m = vel_mps = told_mps = 0.0
    trunk_m = CLEAR_M
    under_way = [0.0] * dead_ticks
    for _ in range(1200):
        own = Position((pos_m, 0.0, -8.0), (vel_mps, 0.0, 0.0))
        points = LocalObstacleCloud(7.35, SEEN)
        points.add_points([trunk_m - pos_m + rng.gauss(0.0, noise_m)], [0.0], CLEAR_M)
        told = applied(FILTER, (3.0, 0.0, 0.0), (told_mps, 0.0, 0.0), own, [], [], dt_s=DT_S, points=points)
        told_mps = told[0]
        under_way.append(told_mps)
        change = (under_way.pop(0) - vel_mps) * -math.expm1(-DT_S / 0.3)
        vel_mps += max(-3.0 * DT_S, min(3.0 * DT_S, change))
        pos_m += vel_mps * DT_S
    assert trunk_m - pos_m > 0.35 + 0.05  # the hull, and some


@pytest.mark.parametrize("speed_mps", [1.5, 2.4, 3.0])
@pytest.mark.parametrize("braking_mps2", [1.5, 3.0])
def test_follower_keeps_its_distance_when_the_one_before_it_stops_at_a_trunk_and_cannot_give_way(
    speed_mps: float, braking_mps2: float
) -> None:
    """Told 0.2 s late; the body follows with a dead time of 0.25 s and a lag of 0.3 s, as autopilots in JSBSim do."""
    points = LocalObstacleCloud(7.35, [False] * 72)  # nothing near the follower
    own_m, own_mps, told_mps = 0.0, speed_mps, speed_mps
    front = [(9.0, speed_mps)]  # place and speed, tick by tick
    under_way = [speed_mps] * 5
    least_m = math.inf
    for _ in range(160):
        its_m, its_mps = front[-1]
        its_mps = max(0.0, its_mps - braking_mps2 * DT_S)
        front.append((its_m + its_mps * DT_S, its_mps))
        told_m, told_its_mps = front[max(0, len(front) - 5)]
        rel_m = told_m + 0.2 * told_its_mps - own_m  # as its beacon has it flying on
        own = Position((own_m, 0.0, -8.0), (own_mps, 0.0, 0.0))
        around = [neighbour(2, (rel_m, 0.0, 0.0), vel_ned_mps=(told_its_mps, 0.0, 0.0))]
        last = (told_mps, 0.0, 0.0)
        told_mps = applied(FILTER, (3.0, 0.0, 0.0), last, own, around, [], dt_s=DT_S, points=points)[0]
        under_way.append(told_mps)
        change = (under_way.pop(0) - own_mps) * -math.expm1(-DT_S / 0.3)
        own_mps += max(-3.0 * DT_S, min(3.0 * DT_S, change))
        own_m += own_mps * DT_S
        least_m = min(least_m, front[-1][0] - own_m)
    assert least_m > FILTER.hard_separation_m - 0.6


def rest_beside(
    trunks: list[tuple[float, float]],
    *,
    wrong_mps: tuple[float, float],
    dead_ticks: int,
    noise_m: float,
    wish: Vec3 = ZERO,
    pusher: Vec3 | None = None,
) -> tuple[float, float]:
    """Half a minute: the least distance from a trunk, and the way (m) of the last 20 s.

    `wrong_mps`: the true velocity is that much more than the reported one, by which setpoints are flown.
    """
    rng = random.Random(1)
    pos, vel, last = (0.0, 0.0), (0.0, 0.0), ZERO
    under_way = [(0.0, 0.0)] * dead_ticks
    nearest_m, way_m = math.inf, 0.0
    for k in range(600):
        reported = Position((*pos, -8.0), (vel[0] - wrong_mps[0], vel[1] - wrong_mps[1], 0.0))
        points = LocalObstacleCloud(7.35, SEEN)
        seen = [(n - pos[0] + rng.gauss(0.0, noise_m), e - pos[1] + rng.gauss(0.0, noise_m)) for n, e in trunks]
        points.add_points([n for n, _ in seen], [e for _, e in seen], CLEAR_M)
        around = [] if pusher is None else [neighbour(2, sub(pusher, (*pos, 0.0)))]
        last = applied(FILTER, wish, last, reported, around, [], dt_s=DT_S, points=points)
        under_way.append((last[0] + wrong_mps[0], last[1] + wrong_mps[1]))
        goal = under_way.pop(0)
        share = -math.expm1(-DT_S / LAG_S)
        vel = vel[0] + share * (goal[0] - vel[0]), vel[1] + share * (goal[1] - vel[1])
        pos = pos[0] + vel[0] * DT_S, pos[1] + vel[1] * DT_S
        nearest_m = min([nearest_m, *[math.dist(pos, trunk) for trunk in trunks]])
        way_m += math.hypot(*vel) * DT_S if k >= 200 else 0.0
    return nearest_m, way_m


@pytest.mark.parametrize("wish", [ZERO, (0.5, 0.0, 0.0), (0.3, 1.0, 0.0)])
@pytest.mark.parametrize("dead_ticks", [0, 2, 5])
def test_vehicle_at_rest_beside_a_trunk_does_not_drift_into_it_by_a_wrong_velocity(wish: Vec3, dead_ticks: int) -> None:
    """By as much as velocities are wrong that trunks have corrected."""
    nearest_m, _ = rest_beside([(0.7, 0.0)], wrong_mps=(0.25, 0.0), dead_ticks=dead_ticks, noise_m=0.02, wish=wish)
    assert nearest_m > 0.35 + 0.05  # the hull, and some


@pytest.mark.parametrize("half_m", [0.45, 0.5, 0.55, 0.6, 0.65, 0.8])
@pytest.mark.parametrize("dead_ticks", [0, 2, 5])
def test_vehicle_between_two_trunks_is_not_driven_to_and_fro(half_m: float, dead_ticks: int) -> None:
    gap = [(half_m, 0.0), (-half_m, 0.0)]
    nearest_m, way_m = rest_beside(gap, wrong_mps=(0.0, 0.0), dead_ticks=dead_ticks, noise_m=0.02)
    assert nearest_m > min(half_m, CLEAR_M) - 0.1
    assert way_m < 1.0  # 5 cm/s


def test_vehicle_that_gets_away_from_a_trunk_is_not_pushed_at_a_neighbour() -> None:
    nearest_m, _ = rest_beside([(0.5, 0.0)], wrong_mps=(0.0, 0.0), dead_ticks=2, noise_m=0.0, pusher=(-5.3, 0.0, 0.0))
    assert nearest_m == pytest.approx(0.5, abs=0.02)  # it is at `hard_separation_m` and its margin: it stays


@pytest.mark.parametrize("speed_mps", [0.0, 0.6, 1.3])
def test_vehicle_that_passes_within_its_clearance_gets_away_and_does_not_only_brake(speed_mps: float) -> None:
    """As in a stem map: it came to rest 0.4 m from the bark, where 0.65 m are kept, and drifted on."""
    points = LocalObstacleCloud(7.35, SEEN)
    points.add_points([0.12, 0.06, -0.05, -0.12], [0.42, 0.42, 0.43, 0.44], CLEAR_M)
    own, last = Position((0.0, 0.0, -8.0), (speed_mps, 0.05, 0.0)), (-0.12, 0.05, 0.0)
    told = applied(FILTER, (2.5, -0.5, 0.0), last, own, dt_s=DT_S, points=points)
    assert told[1] < -0.05
