"""The way round what stands still."""

from __future__ import annotations

import math

import pytest

from companion.core.guidance import avoidance
from companion.core.guidance.avoidance import find_clear_position
from companion.core.guidance.open_sky_planner import KeepOut, turn_course
from companion.core.model.vectors import ZERO, add, norm, scale, sub
from mission.common.frames import Vec3

CLEAR_M = 5.7


# --- past the tree ---


def passes(ref: Vec3, dest: Vec3, *, to_the_right: bool = True) -> Vec3:
    return avoidance.pass_tree(ref, dest, clear_m=6.0, to_the_right=to_the_right)


def test_one_that_would_fly_at_the_tree_passes_it_on_the_nearer_side() -> None:
    north = (3.0, 0.0, 0.0)
    assert passes(north, (12.0, 2.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))  # 4 m short of 6, 4 s to go
    assert passes(north, (12.0, -2.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert passes((0.0, 3.0, 0.0), (2.0, 12.0, 0.0)) == pytest.approx((-1.0, 0.0, 0.0))
    assert passes(north, (12.0, 2.0, -9.0)) == passes(north, (12.0, 2.0, 0.0))


def test_dead_ahead_of_the_tree_the_side_is_given() -> None:
    assert passes((3.0, 0.0, 0.0), (12.0, 0.0, 0.0), to_the_right=True)[1] > 1.0
    assert passes((3.0, 0.0, 0.0), (12.0, 0.0, 0.0), to_the_right=False)[1] < -1.0


@pytest.mark.parametrize(
    ("ref", "dest"),
    [
        ((3.0, 0.0, 0.0), (12.0, 6.5, 0.0)),  # clear of it
        ((3.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),  # past it
        ((3.0, 0.0, 0.0), (60.0, 0.0, 0.0)),  # far from it
        ((0.1, 0.0, 0.0), (12.0, 0.0, 0.0)),  # hardly moving
    ],
)
def test_whoever_is_clear_of_the_tree_goes_straight_on(ref: Vec3, dest: Vec3) -> None:
    assert passes(ref, dest) == ZERO


@pytest.mark.parametrize("ahead_m", [0.01, 1.0, 5.0])
def test_sideways_speed_is_limited_close_to_the_tree(ahead_m: float) -> None:
    assert norm(passes((3.0, 0.0, 0.0), (ahead_m, 1.0, 0.0))) <= avoidance.PASS_LIMIT_MPS


# --- round those that hover silent ---


def obstacles(places: list[Vec3]) -> list[KeepOut]:
    return [KeepOut(place, CLEAR_M) for place in places]


def round_them(wanted: Vec3, silent: list[Vec3], *, up_m: float = 0.0, side: int = 0) -> tuple[Vec3, int]:
    return turn_course(wanted, obstacles(silent), to_goal_m=100.0, room_up_m=up_m, room_down_m=0.0, side=side)


def flown(silent: list[Vec3], *, up_m: float = 0.0) -> list[Vec3]:
    """Places of one that wants 40 m north at 3 m/s."""
    pos, side, way = ZERO, 0, [ZERO]
    for _ in range(2000):
        to_goal = sub((40.0, 0.0, 0.0), pos)
        if norm(to_goal) < 1.0:
            break
        wanted = scale(to_goal, 3.0 / norm(to_goal))
        around = [sub(place, pos) for place in silent]
        course, side = turn_course(
            wanted, obstacles(around), to_goal_m=norm(to_goal), room_up_m=up_m, room_down_m=0.0, side=side
        )
        pos = add(pos, scale(course, 0.05))
        way.append(pos)
    return way


def test_free_way_is_not_changed() -> None:
    wanted = (3.0, 0.0, 0.0)
    assert round_them(wanted, []) == (wanted, 0)
    assert round_them(wanted, [(10.0, 6.0, 0.0), (-3.0, 0.0, 0.0), (40.0, 0.0, 0.0)]) == (wanted, 0)


def test_what_hangs_behind_the_goal_is_not_in_the_way() -> None:
    wanted = (3.0, 0.0, 0.0)
    turned = turn_course(wanted, obstacles([(16.0, 0.0, 0.0)]), to_goal_m=9.0, room_up_m=0.0, room_down_m=0.0, side=0)
    assert turned == (wanted, 0)


@pytest.mark.parametrize(
    "silent",
    [
        [(20.0, 0.0, 0.0)],
        [(20.0, 0.0, 0.0), (22.0, 8.0, 0.0), (18.0, -7.0, 0.0)],
        [(15.0, 3.0, 0.0), (25.0, -3.0, 0.0), (20.0, 10.0, 0.0)],
    ],
    ids=["dead ahead", "a row", "staggered"],
)
def test_they_are_passed_clear_and_the_goal_is_reached(silent: list[Vec3]) -> None:
    way = flown(silent)
    assert math.dist(way[-1], (40.0, 0.0, 0.0)) <= 1.0
    assert min(math.dist(place, other) for place in way for other in silent) >= CLEAR_M - 0.2


def test_one_in_the_midst_of_them_climbs_out_where_the_ceiling_leaves_room() -> None:
    ring = [(8.0 * math.cos(math.tau * k / 6), 8.0 * math.sin(math.tau * k / 6), 0.0) for k in range(6)]
    way = flown(ring, up_m=12.0)
    assert math.dist(way[-1], (40.0, 0.0, 0.0)) <= 1.0
    assert min(math.dist(place, other) for place in way for other in ring) >= CLEAR_M - 0.2


def test_side_once_taken_is_kept_though_the_other_would_be_as_good() -> None:
    dead_ahead = [(12.0, 0.0, 0.0)]
    for side in (1, -1):
        course, taken = round_them((3.0, 0.0, 0.0), dead_ahead, side=side)
        assert taken == side
        assert math.copysign(1.0, course[1]) == side


@pytest.mark.parametrize("off_m", [0.0, 0.3, -1.0])
def test_trunk_on_the_way_is_passed_level_at_every_height(off_m: float) -> None:
    """Climbing over it is no way: it stands from the ground up."""
    pos, side = ZERO, 0
    for _ in range(2000):
        to_goal = sub((40.0, 0.0, 0.0), pos)
        if norm(to_goal) < 1.0:
            break
        trunk = KeepOut((20.0 - pos[0], off_m - pos[1], 6.0), 2.7, upright=True)
        course, side = turn_course(
            scale(to_goal, 1.0 / norm(to_goal)),
            [trunk],
            to_goal_m=norm(to_goal),
            room_up_m=20.0,
            room_down_m=6.0,
            side=side,
        )
        pos = add(pos, scale(course, 0.05))
        assert math.hypot(20.0 - pos[0], off_m - pos[1]) >= 2.5
    assert norm(sub((40.0, 0.0, 0.0), pos)) < 1.0
    assert pos[2] == pytest.approx(0.0, abs=0.5)


# --- goals give way ---


def test_goal_where_nobody_hangs_stays() -> None:
    assert find_clear_position((20.0, 0.0, 0.0), [(10.0, 0.0, 0.0)], clear_m=6.0) == (20.0, 0.0, 0.0)


@pytest.mark.parametrize("silent", [[(20.0, 0.0, 0.0)], [(20.0, 0.0, 0.0), (14.0, 0.0, 0.0), (20.0, 7.0, 0.0)]])
def test_goal_gives_way_to_those_that_hang_there(silent: list[Vec3]) -> None:
    place = find_clear_position((20.0, 0.0, 0.0), silent, clear_m=6.0)
    assert all(math.dist(place, other) >= 6.0 for other in silent)
    assert math.dist(place, (20.0, 0.0, 0.0)) <= 13.0
    assert place[2] == 0.0


def test_of_places_as_near_the_one_on_this_side_is_taken() -> None:
    assert find_clear_position((20.0, 0.0, 0.0), [(20.0, 0.0, 0.0)], clear_m=6.0) == pytest.approx((14.0, 0.0, 0.0))
