"""Where coverage leads vehicles whose velocity lags."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest

from companion.core.guidance import coverage
from companion.core.model.vectors import add, norm, scale, sub
from mission.common.frames import Vec3
from mission.document.model import CoverageShape
from sim_bridge.judge.metrics import ideal_gap_deg, sphere_gap_deg
from tests.unit.core.core_kit import is_finite

DT_S = 0.1
R = 15.0


def spread(
    places: list[Vec3],
    law: str,
    *,
    seconds: float,
    range_m: float = 2 * R,
    radius_m: float = R,
    hears_all: bool = True,
    lag_s: float = 0.3,
) -> list[Vec3]:
    """Where vehicles end about a tree at the origin; velocity follows the law with a lag, as an autopilot's does."""
    moving = [(0.0, 0.0, 0.0)] * len(places)
    for _ in range(round(seconds / DT_S)):
        wanted = []
        for me, here in enumerate(places):
            peers = [sub(other, here) for other in places if other is not here]
            dest = scale(here, -1.0)
            if law == "ring":
                heard = [rel for rel in peers if hears_all or norm(rel) <= range_m]
                size = len(places)
                v = coverage.ring(dest, heard, size=size, radius_m=radius_m, wait_m=8.0, range_m=range_m)
            else:
                others = [other for other in range(len(places)) if other != me]
                v = coverage.sphere(dest, list(zip(others, peers, strict=True)), me=me, radius_m=R)
            assert is_finite(v)
            wanted.append(v)
        moving = [add(m, scale(sub(w, m), DT_S / lag_s)) for m, w in zip(moving, wanted, strict=True)]
        places = [add(p, scale(m, DT_S)) for p, m in zip(places, moving, strict=True)]
    return places


def gaps_of(places: list[Vec3]) -> list[float]:
    bearings = sorted(math.atan2(p[1], p[0]) for p in places)
    return [b - a for a, b in itertools.pairwise([*bearings, bearings[0] + math.tau])]


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 12])
@pytest.mark.parametrize("start", ["random", "clustered"])
def test_ring_ends_with_equal_gaps_at_its_radius(n: int, start: str) -> None:
    rng = random.Random(n)
    if start == "random":
        places = [(rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(-3, 3)) for _ in range(n)]
    else:  # as a swarm arrives: all on one side
        places = [(-20.0 - 4.0 * (k // 4) + rng.random(), 5.0 * (k % 4) - 7.0 + rng.random(), 0.0) for k in range(n)]
    places = spread(places, "ring", seconds=60.0)
    for place in places:
        assert math.hypot(place[0], place[1]) == pytest.approx(R, abs=0.1)
        assert place[2] == pytest.approx(0.0, abs=0.05)
    assert gaps_of(places) == pytest.approx([math.tau / n] * n, abs=0.02)


@pytest.mark.parametrize("n", [2, 5, 12])
def test_ring_too_wide_to_hear_across_evens_out_too(n: int) -> None:
    rng = random.Random(n)
    bearings = [math.tau * (k + 0.4 * rng.random()) / n for k in range(n)]
    places = [(R * math.cos(b), R * math.sin(b), 0.0) for b in bearings]
    assert gaps_of(spread(places, "ring", seconds=60.0, range_m=R)) == pytest.approx([math.tau / n] * n, abs=0.05)


@pytest.mark.parametrize("n", [11, 12])
def test_ring_of_a_hundred_metres_forms_though_only_the_next_are_heard(n: int) -> None:
    """As a swarm arrives: all on one side of the tree, within range. The ends open the ring until it closes."""
    rng = random.Random(n)
    places = [(-4.0 - 8.0 * (k // 4) + rng.random(), 8.0 * (k % 4) - 12.0 + rng.random(), 0.0) for k in range(n)]
    places = spread(places, "ring", seconds=400.0, range_m=60.0, radius_m=100.0, hears_all=False)
    assert [math.hypot(p[0], p[1]) for p in places] == pytest.approx([100.0] * n, abs=1.0)
    assert max(gaps_of(places)) <= 1.15 * math.tau / n


@pytest.mark.parametrize(("n", "least_share"), [(2, 1.9), (3, 1.65), (4, 1.5), (6, 1.3), (8, 1.1), (12, 0.9)])
def test_sphere_spreads_vehicles_over_all_of_it(n: int, least_share: float) -> None:
    """The nearest two are as far apart as on the best arrangement known (2, 1.73, 1.63, 1.41, 1.22, 1.05 R), nearly."""
    rng = random.Random(n)
    places = [(-20.0 + 4 * rng.random(), 8 * rng.random() - 4, 8 * rng.random() - 4) for _ in range(n)]
    places = spread(places, "sphere", seconds=60.0)
    assert [norm(p) for p in places] == pytest.approx([R] * n, abs=0.05)
    assert min(math.dist(a, b) for a, b in itertools.combinations(places, 2)) >= least_share * R


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n", [4, 6, 8, 12])
def test_sphere_is_covered_nearly_as_well_as_can_be_in_forty_seconds_from_a_level_start(n: int, seed: int) -> None:
    """As a swarm arrives: at one height, from which the ways out of the plane are slow at first."""
    rng = random.Random(seed)
    places = [
        (-3.0 - 8.0 * (k // 3) + rng.random(), 8.0 * (k % 3) - 8.0 + rng.random(), rng.random()) for k in range(n)
    ]
    places = spread(places, "sphere", seconds=40.0)
    assert sphere_gap_deg(np.array(places)) <= 1.2 * ideal_gap_deg(CoverageShape.SPHERE, n)


@pytest.mark.parametrize("n", [4, 8, 12])
def test_swarm_that_comes_on_one_level_spreads_over_the_whole_sphere(n: int) -> None:
    places = [(-3.0 - 8.0 * (k // 3), 8.0 * (k % 3) - 8.0 + 0.1 * k, 0.0) for k in range(n)]
    places = spread(places, "sphere", seconds=40.0)
    assert sphere_gap_deg(np.array(places)) <= 1.2 * ideal_gap_deg(CoverageShape.SPHERE, n)
