"""Vehicles seen: what moves among trunks, and is not heard where it is and moving so; and separation from them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import pytest

from companion.core.model.events import Position
from companion.core.perception.level_scan import level_scan_of
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.obstacle_perception import SensingPerception
from companion.core.perception.own_motion import OwnMotion
from companion.core.perception.vehicles.vehicle_tracks import STANDS_S, TRACKS_MAX, UNSEEN_VEHICLE_S, SeenVehicle
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.perception.scan_kit import FINE, SECTORS, Stem, level_scan, ring, sectors

STEP_S = 0.1
TRUNKS: list[Stem] = [(4.0, 6.0, 0.2), (-5.0, 4.0, 0.15), (6.0, -6.0, 0.25), (-4.0, -5.0, 0.2), (9.0, 1.0, 0.2)]
Course = Callable[[float], tuple[float, float]]


def watch(
    course: Course | None,
    lasts_s: float = 2.0,
    peers: tuple[tuple[float, float, float], ...] = (),
    missed: Mapping[int, int] = MappingProxyType({}),
    trunks: Sequence[Stem] = TRUNKS,
    rays: int = 360,
) -> OwnMotion:
    """A vehicle that hovers among trunks, and sees a hull on that course. `missed`: turn -> ray not measured."""
    motion = OwnMotion(FINE, turns_with_yaw=False)
    own = Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0))
    for k in range(1, round(lasts_s / STEP_S) + 1):
        now_s = STEP_S * k
        hulls = [] if course is None else [(*course(now_s), 0.35)]
        motion.receive_position(own, now_s)
        scan = level_scan([*trunks, *hulls], rays=rays)
        if k in missed:
            scan.ranges_m[missed[k]] = math.nan
        motion.integrate_turn(scan, 0.0, own, peers, now_s)
    return motion


def crossing(t: float) -> tuple[float, float]:
    """From the east to the west, 5 m north, at 2 m/s."""
    return 5.0, 2.5 - 2.0 * t


def test_a_hull_that_moves_is_a_vehicle_where_it_is_and_as_fast_as_it_is() -> None:
    (seen,) = watch(crossing).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.0)
    assert math.dist(seen.rel_ned_m[:2], crossing(2.0)) < 0.15
    assert math.dist(seen.vel_ned_mps, (0.0, -2.0, 0.0)) < 0.3
    assert seen.age_s == pytest.approx(0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("begins_s", [0.0, 2.0])
def test_in_a_dense_stand_a_hull_is_known_on_every_side(side: float, begins_s: float) -> None:
    """Of 60 trunks the first 48 were looked at, and of what is no good trunk yet the first 24, from north on."""

    def passing(t: float) -> tuple[float, float]:
        return (4.0, side * (5.5 - 2.0 * (t - begins_s))) if t > begins_s else (-50.0, 0.0)

    motion = watch(passing, begins_s + 1.0, trunks=ring(60, 11.0), rays=720)
    (seen,) = motion.vehicles.find_vehicles((0.0, 0.0, -4.0), (), begins_s + 1.0)
    assert math.dist(seen.rel_ned_m[:2], passing(begins_s + 1.0)) < 0.15
    assert len(motion.odometry.trunks) >= 58


@pytest.mark.parametrize("ray", [89, 90, 91])
def test_one_that_comes_straight_on_is_known_though_a_ray_of_its_first_sighting_was_missed(ray: int) -> None:
    """Only that turn showed that its way was free."""

    def nearing(t: float) -> tuple[float, float]:
        return 0.1, 9.0 - 2.0 * t

    motion = watch(nearing, 1.0, missed={1: ray})
    assert len(motion.vehicles.find_vehicles((0.0, 0.0, -4.0), (), 1.0)) == 1


def test_one_that_comes_out_from_behind_trunks_is_known_when_it_is_seen_whole() -> None:
    """A row of trunks hides where it was and where it is, and shows it between them; both fly round the row's end."""
    away_m = [1.6 + 0.55 * k for k in range(20)]
    row: list[Stem] = [(-m * math.sqrt(0.5), m * math.sqrt(0.5), 0.2) for m in away_m]
    motion, known_m = OwnMotion(FINE, turns_with_yaw=False), 0.0
    for k in range(1, 31):
        now_s, left_m = STEP_S * k, 2.5 * (STEP_S * k - 3.0)
        own, hull = Position((left_m, 0.0, -4.0), (2.5, 0.0, 0.0)), (0.8, -left_m)
        motion.receive_position(own, now_s)
        scan = level_scan([*row, *TRUNKS, (*hull, 0.35)], (left_m, 0.0), gone_m=(0.25, 0.0))
        motion.integrate_turn(scan, 0.0, own, (), now_s)
        if motion.vehicles.find_vehicles(own.pos_ned_m, (), now_s):
            known_m = max(known_m, math.dist(hull, (left_m, 0.0)))
    assert known_m > 2.5


def test_trunks_and_a_hull_that_stands_are_no_moving_vehicles() -> None:
    assert watch(None).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.0) == []
    assert watch(lambda _: (5.0, 2.5)).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.0) == []


def test_trunks_of_a_thicket_that_sectors_take_for_one_another_are_mostly_no_vehicles() -> None:
    """1,100 trees/ha, flown past at 2.5 m/s: stems seem to hop from trunk to trunk, through what nobody saw free."""
    rng, trunks = random.Random(3), list[Stem]()
    while len(trunks) < 110:
        north, east = rng.uniform(-5.0, 35.0), rng.uniform(-12.0, 12.0)
        if abs(east) > 1.2 and all(math.dist((north, east), trunk[:2]) > 1.2 for trunk in trunks):
            trunks.append((north, east, rng.uniform(0.08, 0.25)))
    motion, found = OwnMotion(SECTORS, turns_with_yaw=False), 0
    for k in range(1, 110):
        now_s, own = STEP_S * k, Position((0.25 * k, 0.0, -4.0), (2.5, 0.0, 0.0))
        motion.receive_position(own, now_s)
        scan = sectors(trunks, (0.25 * k, 0.0), 0.0)
        motion.integrate_turn(level_scan_of(scan, motion.correct_position(own)), 0.0, own, (), now_s)
        found += bool(motion.vehicles.find_vehicles(own.pos_ned_m, (), now_s))
    assert found < 40


@pytest.mark.parametrize(("heard", "is_kept_from"), [((2,), True), ((2, 3), False)])
def test_by_sectors_somebody_is_looked_for_only_while_somebody_is_not_heard(
    heard: tuple[int, ...], is_kept_from: bool
) -> None:
    flown = mission(sensing={}, swarm={"size": 3})
    assert flown.sensing is not None
    perception = SensingPerception(flown, flown.sensing)
    own = Position((0.0, 0.0, -8.0), (0.0, 0.0, 0.0))
    for k in range(1, 21):
        now_s = STEP_S * k
        perception.correct_odometry(own, now_s)
        hull = (*crossing(now_s), 0.35)
        perception.integrate_scan(sectors([*TRUNKS, hull], (0.0, 0.0), 0.0), own, now_s, ())
    far = [neighbour(k, (20.0, 20.0, 0.0)) for k in heard]
    assert bool(perception.find_vehicles(own.pos_ned_m, far, 2.0)) is is_kept_from


def test_one_that_stops_is_a_vehicle_still_and_an_obstacle_after_a_while() -> None:
    def stops(t: float) -> tuple[float, float]:
        return 5.0, 2.5 - 2.0 * min(t, 1.5)

    assert (
        len(watch(stops, 1.5 + 0.5 * STANDS_S).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 1.5 + 0.5 * STANDS_S)) == 1
    )
    assert watch(stops, 3.0 + STANDS_S).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 3.0 + STANDS_S) == []


def test_one_that_stops_where_a_neighbour_is_heard_stays_a_vehicle_and_no_trunk_becomes_one() -> None:
    """Two kept 4.4 m instead of 5: one stood and was a trunk by then, and both reported themselves farther off."""

    def stops(t: float) -> tuple[float, float]:
        return 5.0, 2.5 - 2.0 * min(t, 1.5)

    lasts_s, beside = 3.0 + 2.0 * STANDS_S, (5.4, -0.9, 0.0)
    (seen,) = watch(stops, lasts_s, peers=(beside,)).vehicles.find_vehicles((0.0, 0.0, -4.0), (), lasts_s)
    assert math.dist(seen.rel_ned_m[:2], stops(lasts_s)) < 0.15
    assert watch(None, lasts_s, peers=((*TRUNKS[0][:2], 0.0),)).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 3.0) == []


def test_one_that_is_heard_where_it_is_and_moving_so_is_that_neighbour() -> None:
    motion = watch(crossing)
    heard = neighbour(2, rel_ned_m=(*crossing(2.0), 0.0), vel_ned_mps=(0.0, -2.0, 0.0))
    (seen,) = motion.vehicles.find_vehicles((0.0, 0.0, -4.0), (heard,), 2.0)
    assert seen.heard
    assert seen.gives_way is heard.gives_way


@pytest.mark.parametrize(
    ("rel_ned_m", "vel_ned_mps"),
    [((5.0, 1.5, 0.0), (0.0, -2.0, 0.0)), ((*crossing(2.0), 0.0), (0.0, 2.0, 0.0))],
    ids=["elsewhere", "moving otherwise"],
)
def test_a_report_alone_hides_no_vehicle(
    rel_ned_m: tuple[float, float, float], vel_ned_mps: tuple[float, float, float]
) -> None:
    liar = neighbour(2, rel_ned_m=rel_ned_m, vel_ned_mps=vel_ned_mps)
    (seen,) = watch(crossing).vehicles.find_vehicles((0.0, 0.0, -4.0), (liar,), 2.0)
    assert not seen.heard


def test_one_that_is_reported_there_is_still_seen() -> None:
    """A stem beside a reported position is no trunk, and may be a vehicle that nobody reported."""
    peers = ((*crossing(1.0), 0.0),)
    assert len(watch(crossing, peers=peers).vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.0)) == 1


def test_one_that_is_hidden_goes_on_for_a_while_and_is_forgotten() -> None:
    motion = watch(crossing)
    (seen,) = motion.vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.5)
    assert math.dist(seen.rel_ned_m[:2], crossing(2.5)) < 0.4
    assert seen.sd_m > 0.1
    assert motion.vehicles.find_vehicles((0.0, 0.0, -4.0), (), 2.0 + UNSEEN_VEHICLE_S + 0.1) == []


def test_tracks_are_bounded() -> None:
    motion = OwnMotion(FINE, turns_with_yaw=False)
    own = Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0))
    for k in range(40):
        ring = [(7.0 * math.cos(0.21 * j + 0.3 * k), 7.0 * math.sin(0.21 * j + 0.3 * k), 0.1) for j in range(30)]
        motion.receive_position(own, STEP_S * k)
        motion.integrate_turn(level_scan(ring), 0.0, own, (), STEP_S * k)
        assert len(motion.vehicles._tracks) <= TRACKS_MAX


def test_the_safety_filter_keeps_separation_from_a_vehicle_that_is_only_seen() -> None:
    flown = mission()
    safety_filter = SafetyFilter.of(flown)
    own = Position((0.0, 0.0, -8.0), (2.0, 0.0, 0.0))
    cloud = LocalObstacleCloud(math.inf, (False,))

    def setpoint(*seen: SeenVehicle) -> float:
        around = Surroundings(own, (), {}, cloud, seen=seen, commanded_ned_mps=(2.0, 0.0, 0.0))
        return safety_filter.apply((2.0, 0.0, 0.0), around, dt_s=0.05).vel_ned_mps[0]

    hard_m = flown.separation.hard_m
    still = SeenVehicle((hard_m + 0.5, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1, 0.0)
    nearing = SeenVehicle((hard_m + 3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), 0.1, 0.0)
    leaving = SeenVehicle((hard_m + 3.0, 0.0, 0.0), (3.0, 0.0, 0.0), 0.1, 0.0)
    assert setpoint() == pytest.approx(2.0)
    assert setpoint(still) < 0.5
    assert setpoint(nearing) < 0.0 or setpoint(nearing) == pytest.approx(0.0)
    assert setpoint(leaving) == pytest.approx(2.0)


def test_a_neighbour_that_reports_itself_farther_off_than_it_is_seen_is_kept_from_where_it_is_seen() -> None:
    """Positions of the same satellites are up to 0.3 m off an axis: two kept 4.2 m instead of 4.5."""
    flown = mission()
    safety_filter = SafetyFilter.of(flown)
    own = Position((0.0, 0.0, -8.0), (1.0, 0.0, 0.0))
    cloud, hard_m = LocalObstacleCloud(math.inf, (False,)), flown.separation.hard_m
    told = neighbour(2, rel_ned_m=(hard_m + 1.2, 0.0, 0.0))

    def setpoint(*seen: SeenVehicle) -> float:
        around = Surroundings(own, (told,), {}, cloud, seen=seen, commanded_ned_mps=(1.0, 0.0, 0.0))
        return safety_filter.apply((1.0, 0.0, 0.0), around, dt_s=0.05).vel_ned_mps[0]

    def at(distance_m: float, *, gives_way: bool = True) -> SeenVehicle:
        place = (distance_m, 0.0, 0.0)
        return SeenVehicle(place, (0.0, 0.0, 0.0), 0.05, 0.0, heard=True, gives_way=gives_way)

    assert setpoint(at(hard_m + 0.6)) < setpoint() - 0.1
    assert setpoint(at(hard_m + 2.5)) == pytest.approx(setpoint())  # seen farther off it frees nothing
    # Steered by a pilot, or held, it gives no way: nobody leaves it half of the braking
    assert setpoint(at(hard_m + 0.6, gives_way=False)) < setpoint(at(hard_m + 0.6)) - 0.1
