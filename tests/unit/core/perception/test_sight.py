"""What was looked at lately: behind a trunk that is near nothing is free, until it was seen past it."""

from __future__ import annotations

import math

import pytest

from companion.core.guidance.course_planner import HOLD_S, CoursePlanner
from companion.core.model.events import Position
from companion.core.perception.level_scan import LevelScan, level_scan_of
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.sight import KEPT, KEPT_S, Sight, SightHistory
from companion.core.safety.response_model import CALM, DEAD_S, Disturbance, ResponseModel
from tests.unit.core.perception.scan_kit import Stem, level_scan, sectors

NEAR: Stem = (2.5, 0.9, 0.2)
HIDDEN = (6.9, 2.48)  # in one line with it
CLEAR_M = 0.65


def turn(eye: tuple[float, float], stems: list[Stem]) -> LevelScan:
    """A turn of sectors."""
    return level_scan_of(sectors(stems, eye, 0.0), Position((*eye, -4.0), (0.0, 0.0, 0.0)))


def sight(*turns: LevelScan, here: tuple[float, float] = (0.0, 0.0)) -> Sight:
    return Sight(list(turns), here, 8.0)


def test_nothing_is_free_behind_a_trunk_that_is_near() -> None:
    seen = sight(turn((0.0, 0.0), [NEAR]))
    assert not seen.is_free(*HIDDEN)
    assert seen.is_free(6.9, -2.0)
    assert not sight(level_scan([NEAR])).is_free(*HIDDEN)


def test_what_another_turn_saw_past_it_is_free() -> None:
    assert sight(turn((0.0, 0.0), [NEAR]), turn((4.0, -3.0), [NEAR])).is_free(*HIDDEN)


def test_a_way_is_looked_at_in_all_of_its_width() -> None:
    """By rays of a degree there is room for a trunk between three looks (search, seed 32030)."""
    hidden_by = [(1.7, 0.44, 0.05)]
    seen = sight(level_scan(hidden_by))
    assert seen.is_free(6.0, 0.0)
    assert seen.is_free(6.0, 0.6)
    assert not seen.is_way_free((0.0, 0.0), (1.0, 0.0), 3.9)
    assert sight(level_scan([(1.7, -2.0, 0.05)])).is_way_free((0.0, 0.0), (1.0, 0.0), 6.0)


@pytest.mark.parametrize("first_deg", range(-4, 4))
def test_a_trunk_of_which_two_rays_met_the_foot_stands_in_the_way_wherever_it_is_between_two_looks(
    first_deg: int,
) -> None:
    """A vehicle that leaned ahead saw those beside it go on, and met it at 1.5 m/s (search, seed 32030 anew)."""
    scan = level_scan([])
    for deg in (first_deg, first_deg + 1):
        scan.ranges_m[deg % 360] = math.nan  # 2 m below the vehicle: not at its height
    assert not sight(scan).is_way_free((0.0, 0.0), (1.0, 0.0), 6.5)
    scan.ranges_m[:] = [math.inf] * 360
    assert sight(scan).is_way_free((0.0, 0.0), (1.0, 0.0), 6.5)


def test_what_was_out_of_range_then_was_not_seen() -> None:
    """A vehicle that came from there took a trunk's place for free, as no ray had met anything (search, seed 32048)."""
    assert not sight(turn((-5.0, -4.0), [NEAR]), here=(0.0, 0.0)).is_free(7.0, -4.0)


def test_all_is_free_to_one_that_has_no_whole_turn() -> None:
    history = SightHistory()
    part = LevelScan(math.tau / 72)
    part.add_ray(0.0, 3.0, 0.0, 0.0)
    history.note_turn(1, part, 0.0)
    assert history.seen_from((0.0, 0.0, 0.0), 8.0).is_free(*HIDDEN)


def test_turns_are_few_and_apart_and_forgotten() -> None:
    history = SightHistory()
    for k in range(100):
        history.note_turn(1, turn((0.05 * k, 0.0), []), 0.1 * k)
        assert len(history._turns) <= KEPT
    eyes_m = [one.eyes_north_m[0] for one in history._turns]
    assert eyes_m[0] == 0.05 * 99
    assert eyes_m[1] - eyes_m[-1] > 0.5
    history.note_turn(1, turn((9.0, 0.0), []), 9.9 + KEPT_S + 0.1)
    assert len(history._turns) == 1


def test_what_one_of_two_half_turn_lidars_saw_stays_until_it_has_seen_anew() -> None:
    """A turn of the other one never takes its place: what is ahead would be seen every other time."""
    history = SightHistory()
    for k in range(12):
        half = turn((0.01 * k, 0.0), [])
        for bearing in range(72):
            if (bearing < 18 or bearing >= 54) is (k % 2 == 1):
                half.ranges_m[bearing] = math.nan
        history.note_turn(1 + k % 2, half, 0.05 * k)
        if k > 0:
            seen = history.seen_from((0.01 * k, 0.0, 0.0), 8.0)
            assert seen.is_free(5.0, 0.0)
            assert seen.is_free(-5.0, 0.0)


def test_a_vehicle_comes_to_rest_where_it_has_looked() -> None:
    """A trunk beside its way hides what may stand behind it (search, seed 31024: hit at 3 m/s)."""
    stems, desired, response = [(4.8, 1.05, 0.1)], (3.5, 0.0), ResponseModel(2.0, 1.4)
    seen = sight(turn((0.0, 0.0), stems))
    rests_in_sight = []
    for looks in (False, True):
        cloud = LocalObstacleCloud(7.35, [False] * 72, sight=seen if looks else None)
        cloud.add_points([4.8], [0.95], CLEAR_M)
        planner = CoursePlanner(response)
        planned = planner.plan(desired, desired, desired, cloud, [], wider_m=0.0, reach_m=math.inf)
        assert planned is not None
        speed_mps = math.hypot(*planned)
        start, ahead_m = (DEAD_S * desired[0], 0.0), HOLD_S * speed_mps + response.way_m(speed_mps)
        n, e = planned[0] / speed_mps, planned[1] / speed_mps
        rests_in_sight.append(seen.is_way_free(start, (n, e), ahead_m))
    assert rests_in_sight == [False, True]


def test_the_way_begins_where_a_setpoint_acts() -> None:
    """ArduPilot answers after a third of a second: at 3 m/s it rests a metre later than if it had answered at once."""
    stems, response = [(5.9, 0.3, 0.05)], ResponseModel(2.0, 1.4)
    seen = sight(turn((0.0, 0.0), stems))
    cloud = LocalObstacleCloud(7.35, [False] * 72, sight=seen)
    planner = CoursePlanner(response)
    at_once = planner._is_way_seen(cloud, (3.0, 0.0), (3.0, 0.0), CALM)
    late = planner._is_way_seen(cloud, (3.0, 0.0), (3.0, 0.0), Disturbance(under_way=(1.2, 0.0, 0.0, 0.0), dead_s=0.5))
    assert (at_once, late) == (True, False)
