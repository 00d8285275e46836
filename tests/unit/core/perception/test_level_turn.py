"""Turns that do not go once round are turns: what no ray looked at is not measured, and never free."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.events import LidarScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.landmarks.stem_clusters import find_stems
from companion.core.perception.level_scan import LevelScan
from companion.core.perception.lidar_mapper import TURN_MAX_S, LidarMapper
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.perception.scan_odometry import ScanOdometry
from companion.core.perception.vehicles.hovering_hulls import HoveringHulls
from tests.unit.core.perception.scan_kit import FINE, range_to, ring
from tests.unit.sensors.lidar_kit import scan

INF = math.inf
HERE = Position((0.0, 0.0, -4.0), ZERO)
TREES = [(3.0, 1.0, 0.1), (-4.0, 2.0, 0.15), (1.0, -6.0, 0.2), (-2.0, -3.0, 0.1), (0.5, 7.0, 0.2)]
RANGES_M = [range_to(TREES, (0.0, 0.0), math.radians(deg), 12.0) for deg in range(360)]
TURN_S = 0.1


def piece(at: int, turn: int = 1, *, side: int = 1, rays: int = 90, sensor: int = 196, **changes: object) -> LidarScan:
    """One of a turn's: the rays of a quarter of it, a degree apart; every one tells what stands in TREES."""
    bearings = [side * (at * 90 + k) for k in range(rays)]
    fields = {
        "sensor": sensor,
        "turn": turn,
        "start_rad": math.remainder(math.radians(bearings[0]), math.tau),
        "step_rad": side * math.radians(1.0),
        "age_s": TURN_S * (1.0 - at / 4),
        "ray_time_s": TURN_S / 360,
    }
    return scan(tuple(RANGES_M[deg % 360] for deg in bearings), **fields | changes)


def turns_of(
    pieces: Iterable[LidarScan], now_s: float = 10.0, mapper: LidarMapper | None = None
) -> list[LevelScan | None]:
    mapper = mapper or LidarMapper(ObstacleMap(), HoveringHulls())
    return [mapper.integrate_rays(one, HERE, now_s + TURN_S * one.turn) for one in pieces]


def by_degree(turn: LevelScan) -> dict[int, float]:
    bearings = [round(math.degrees(bearing)) % 360 for bearing in turn.bearings_rad]
    return dict(zip(bearings, turn.ranges_m, strict=True))


def assert_tells(turn: LevelScan, looked: set[int]) -> None:
    """All bearings once, in their order; where a ray looked what it met."""
    assert turn.is_whole
    told = by_degree(turn)
    assert sorted(told) == list(range(360))
    for deg, range_m in told.items():
        assert range_m == pytest.approx(RANGES_M[deg] if deg in looked else math.nan, nan_ok=True, abs=1e-9)
    steps = {
        round(math.degrees(math.remainder(turn.bearings_rad[k] - turn.bearings_rad[k - 1], math.tau)))
        for k in range(360)
    }
    assert steps in ({1}, {-1})
    for deg in range(360):
        n, e = 8.0 * math.cos(math.radians(deg)), 8.0 * math.sin(math.radians(deg))
        beside = {(deg + k) % 360 for k in (-1, 0, 1)}
        is_free = beside <= looked and all(RANGES_M[k] == INF for k in beside)
        assert turn.sees_beyond(n, e, 0.5) is is_free


def test_a_turn_that_goes_once_round_is_told_by_its_last_piece_and_no_more() -> None:
    told = turns_of([piece(at, turn) for turn in (1, 2) for at in range(4)])
    assert [one is not None for one in told] == [False, False, False, True] * 2
    assert told[3] is not None
    assert told[3].has_looked == []
    assert_tells(told[3], set(range(360)))


@pytest.mark.parametrize("lost", range(4))
@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_of_which_a_piece_is_lost_is_told_when_the_next_begins(lost: int, side: int) -> None:
    pieces = [piece(at, side=side) for at in range(4) if at != lost]
    *before, told = turns_of([*pieces, piece(0, 2, side=side)])
    assert before == [None] * 3
    assert told is not None
    assert_tells(told, {side * deg % 360 for deg in range(360) if deg // 90 != lost})
    assert [round(math.degrees(told.bearings_rad[0]))] == [0 if lost else side * 90]


def test_a_lidar_that_looks_at_half_of_the_bearings_is_told_and_one_of_less_than_a_third_is_not() -> None:
    half = turns_of(piece(at, turn) for turn in range(1, 4) for at in range(2))
    assert [one is not None for one in half] == [False, False, True, False, True, False]
    assert all([turn is None for turn in turns_of(piece(0, turn) for turn in range(1, 6))])


def test_two_half_turn_lidars_are_told_each_for_itself() -> None:
    told = turns_of(piece(at, turn, sensor=196 + at // 2) for turn in range(1, 4) for at in range(4))
    looked = [
        set() if turn is None else {deg for deg, range_m in by_degree(turn).items() if range_m == range_m}
        for turn in told
    ]
    ahead, behind = set(range(180)), set(range(180, 360))
    none: set[int] = set()
    assert looked == [none] * 4 + [ahead, none, behind, none] * 2


@given(st.permutations(range(4)), st.integers(0, 3), st.booleans())
def test_pieces_in_any_order_are_told_at_their_bearings(order: list[int], twice: int, is_left: bool) -> None:
    """What came late was taken for what stands beside the ray before it, and so for free."""
    side = -1 if is_left else 1
    told = [
        one
        for one in turns_of([piece(at, side=side) for at in [*order, *order[:twice]]] + [piece(0, 2, side=side)])
        if one
    ]
    assert len(told) == 1
    assert_tells(told[0], set(range(360)))
    assert round(math.degrees(told[0].bearings_rad[0])) % 360 == (
        0 if told[0].has_looked else side * order[0] * 90 % 360
    )


@given(st.sets(st.integers(0, 3), min_size=2), st.randoms(use_true_random=False), st.booleans())
def test_any_pieces_that_came_tell_what_they_looked_at_and_nothing_else(
    came: set[int], rng: object, is_left: bool
) -> None:
    side = -1 if is_left else 1
    order = sorted(came)
    rng.shuffle(order)  # type: ignore[attr-defined]
    told = [one for one in turns_of([piece(at, side=side) for at in order] + [piece(0, 2, side=side)]) if one]
    assert len(told) == 1
    assert_tells(told[0], {side * deg % 360 for deg in range(360) if deg // 90 in came})


def test_a_lidar_that_begins_anew_is_told_from_there_on() -> None:
    """Its turns may be numbered as the one that it did not end."""
    mapper = LidarMapper(ObstacleMap(), HoveringHulls())
    assert turns_of([piece(at, 7) for at in range(2)], 10.0, mapper) == [None, None]
    later_s = 10.0 + TURN_MAX_S + 1.0
    told = turns_of([piece(at, turn) for turn in (7, 8) for at in range(4)], later_s, mapper)
    assert [one is not None for one in told] == [False, False, False, True] * 2


def test_a_turn_of_long_ago_is_not_told() -> None:
    mapper = LidarMapper(ObstacleMap(), HoveringHulls())
    turns_of([piece(at) for at in range(3)], 10.0, mapper)
    assert turns_of([piece(0, 2)], 10.0 + TURN_MAX_S + 1.0, mapper) == [None]


def test_a_lidar_that_does_not_count_its_turns_is_told_again_after_a_piece_was_lost() -> None:
    rounds = [[at for at in range(4) if (turn, at) != (1, 2)] for turn in range(8)]
    told = turns_of([piece(at) for some in rounds for at in some])
    assert told[3] is not None
    assert sum(one is not None for one in told) >= 4


def test_a_stem_at_the_edge_of_what_was_looked_at_may_be_wider() -> None:
    whole, cut = LevelScan(math.radians(1.0)), LevelScan(math.radians(1.0))
    for deg in range(360):
        range_m = 2.0 if 100 <= deg < 106 else INF
        whole.add_ray(math.radians(deg), range_m, 0.0, 0.0)
        cut.add_ray(math.radians(deg), math.nan if deg >= 106 else range_m, 0.0, 0.0)
        cut.has_looked.append(deg < 106)
    ((seen,), (half,)) = find_stems(whole, FINE), find_stems(cut, FINE)
    assert (seen.is_hidden, half.is_hidden) == (False, True)


def test_trunks_at_bearings_at_which_no_ray_looked_are_not_missed() -> None:
    """Only who looks and does not see them has lost its pose."""
    stems, odometry = ring(12, 5.0), ScanOdometry(FINE)
    odometry.receive_position(HERE, 10.0)

    def take(now_s: float, looks_to_deg: int, seen: list[tuple[float, float, float]]) -> None:
        turn = LevelScan(math.radians(1.0))
        for deg in range(360):
            is_seen = deg < looks_to_deg
            range_m = range_to(seen, (0.0, 0.0), math.radians(deg), 12.0) if is_seen else math.nan
            turn.add_ray(math.radians(deg), range_m, 0.0, 0.0)
            if looks_to_deg < 360:
                turn.has_looked.append(is_seen)
        odometry.receive_position(HERE, now_s)
        odometry.integrate_scan(turn, 0.0, (), now_s)

    for k in range(1, 12):
        take(10.0 + 0.1 * k, 360, stems)
    assert odometry.is_corrected(11.1)
    for k in range(12, 20):
        take(10.0 + 0.1 * k, 119, stems[:2])  # two of the four that are looked at, of twelve
        assert odometry.is_corrected(10.0 + 0.1 * k)
    assert odometry.corrected_s == 10.0 + 0.1 * 19
