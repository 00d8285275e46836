"""Where coverage leads vehicles on a ring in which trunks stand."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Sequence

import pytest

from companion.core.guidance import coverage
from companion.core.model.vectors import add, norm, scale, sub
from mission.common.frames import Vec3

DT_S = 0.1
R = 15.0
CLEAR_M = 1.0
SIGHT_M = 8.0
LAG_S = 0.3
Trunk = tuple[float, float, float]  # north, east of the tree, radius


def spread(places: list[Vec3], trunks: Sequence[Trunk], *, seconds: float = 60.0, sees: bool = True) -> list[Vec3]:
    """Where vehicles end about a tree at the origin; each knows the trunks within its sight."""
    moving = [(0.0, 0.0, 0.0)] * len(places)
    for _ in range(round(seconds / DT_S)):
        wanted = []
        for here in places:
            others = [sub(other, here) for other in places if other is not here]
            wanted.append(
                coverage.ring(
                    scale(here, -1.0),
                    others,
                    size=len(places),
                    radius_m=R,
                    wait_m=8.0,
                    range_m=2 * R,
                    is_free=knows(here, trunks) if sees else None,
                )
            )
        moving = [add(m, scale(sub(w, m), DT_S / LAG_S)) for m, w in zip(moving, wanted, strict=True)]
        places = [add(p, scale(m, DT_S)) for p, m in zip(places, moving, strict=True)]
    return places


def knows(here: Vec3, trunks: Sequence[Trunk]) -> Callable[[float, float], bool]:
    seen = [t for t in trunks if math.hypot(t[0] - here[0], t[1] - here[1]) - t[2] <= SIGHT_M]
    return lambda n, e: all(math.hypot(t[0] - here[0] - n, t[1] - here[1] - e) >= t[2] + CLEAR_M for t in seen)


def on_the_ring(n: int, turn_rad: float = 0.3) -> list[Vec3]:
    bearings = [turn_rad + math.tau * k / n for k in range(n)]
    return [(R * math.cos(b), R * math.sin(b), 0.0) for b in bearings]


def clear_m(places: Sequence[Vec3], trunks: Sequence[Trunk]) -> float:
    return min(math.hypot(p[0] - t[0], p[1] - t[1]) - t[2] for p in places for t in trunks)


def widest_gap_rad(places: list[Vec3]) -> float:
    bearings = sorted(math.atan2(p[1], p[0]) for p in places)
    return max(b - a for a, b in itertools.pairwise([*bearings, bearings[0] + math.tau]))


def test_place_in_which_a_trunk_stands_is_left_out_and_the_gaps_stay_even() -> None:
    """A thin one: a place a little off the ring, at the same bearing, is free."""
    places = on_the_ring(6)
    trunks = [(places[0][0], places[0][1], 0.2)]
    assert clear_m(spread(places, trunks, sees=False), trunks) < 0.0
    end = spread(places, trunks)
    assert clear_m(end, trunks) >= CLEAR_M - 0.05
    assert widest_gap_rad(end) <= 1.02 * math.tau / 6
    assert all(abs(norm(p) - R) <= 2.0 for p in end)


def test_where_no_place_off_the_ring_is_free_either_one_beside_is_taken_and_the_others_close_the_gap() -> None:
    """A thicket through the ring. One vehicle is pushed aside: the others turn the whole ring after it."""
    places = on_the_ring(6)
    outward = scale(places[0], 1.0 / R)
    trunks = [((R + k) * outward[0], (R + k) * outward[1], 0.5) for k in (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)]
    end = spread(places, trunks)
    assert clear_m(end, trunks) >= CLEAR_M - 0.05
    assert widest_gap_rad(end) <= 1.05 * math.tau / 6


@pytest.mark.parametrize("n", [4, 8, 12])
def test_among_random_trunks_the_gap_stays_within_a_seventh_of_the_ideal(n: int) -> None:
    """400 trees/ha, seeds 1 to 8."""
    for seed in range(1, 9):
        rng = random.Random(seed)
        trunks: list[Trunk] = []
        while len(trunks) < 0.04 * 50.0 * 50.0:
            trunk = (rng.uniform(-25.0, 25.0), rng.uniform(-25.0, 25.0), rng.uniform(0.1, 0.4))
            if all(math.hypot(trunk[0] - t[0], trunk[1] - t[1]) >= 1.5 for t in [*trunks, (0.0, 0.0, 0.0)]):
                trunks.append(trunk)
        end = spread(on_the_ring(n, rng.uniform(0.0, math.tau)), trunks)
        assert clear_m(end, trunks) >= CLEAR_M - 0.1, seed
        assert widest_gap_rad(end) <= 1.15 * math.tau / n, seed
        assert all(abs(norm(p) - R) <= 2.0 for p in end), seed


def test_when_one_is_lost_the_others_close_its_gap_among_trunks() -> None:
    places = on_the_ring(6)
    trunks = [(places[3][0] + 0.5, places[3][1], 0.3)]
    end = spread(spread(places, trunks)[1:], trunks)
    assert widest_gap_rad(end) <= 1.1 * math.tau / 5
    assert clear_m(end, trunks) >= CLEAR_M - 0.05
