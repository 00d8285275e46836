"""Trunks: what the safety filter promises with a map of them, for any input.

In flight: tests/scenario/test_flights_beside_trunks.py.
"""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO, norm, scale, sub
from companion.core.perception.obstacle_cloud import GIVES_M, LocalObstacleCloud
from companion.core.safety.safety_filter import AGAINST, ESCAPE_MAX_MPS, OUT_MAX_MPS, OUT_PER_S, SafetyFilter
from tests.unit.core.core_kit import is_finite, mission, neighbour
from tests.unit.core.core_promises import any_inputs, broken_promises
from tests.unit.core.core_surroundings import applied

FILTER = SafetyFilter.of(mission())
CLEAR_M, MARGIN_M = 0.65, 0.3
DT_S = 0.05
SEEN = [False] * 72

places = st.floats(-9.0, 9.0)
found_points = st.lists(st.tuples(places, places), max_size=40)
speeds = st.floats(-3.5, 3.5)
level = st.tuples(speeds, speeds)


def points_at(
    found: list[tuple[float, float]], *, blind: list[bool] | None = None, reach_m: float = 7.35
) -> LocalObstacleCloud:
    points = LocalObstacleCloud(reach_m, SEEN if blind is None else blind)
    points.add_points([n for n, _ in found], [e for _, e in found], CLEAR_M)
    return points


@given(
    found_points,
    level,
    level,
    level,
    st.lists(st.tuples(places, places, level), max_size=4),
    st.lists(st.booleans(), min_size=72, max_size=72),
)
@settings(max_examples=100)
def test_setpoint_leads_to_rest_clear_of_every_point_or_no_nearer_than_rest(
    found: list[tuple[float, float]],
    vel: tuple[float, float],
    last: tuple[float, float],
    wish: tuple[float, float],
    others: list[tuple[float, float, tuple[float, float]]],
    blind: list[bool],
) -> None:
    points = points_at(found, blind=blind)
    own = Position((40.0, 0.0, -8.0), (*vel, 0.0))
    around = [neighbour(k + 2, (n, e, 0.0), vel_ned_mps=(*v, 0.0)) for k, (n, e, v) in enumerate(others)]
    v = applied(FILTER, (*wish, 0.0), (*last, 0.0), own, around, [], dt_s=DT_S, points=points)
    clear = FILTER.response.is_clear(points, vel, last, (v[0], v[1]), DT_S, slews=False)
    if not clear:  # then at least as far from the nearest as rest leads
        nearest_m = [FILTER.response.find_nearest_m(points, vel, last, told)[0] for told in ((v[0], v[1]), (0.0, 0.0))]
        assert nearest_m[0] >= nearest_m[1]


@given(found_points, level, level, level)
@settings(max_examples=200)
def test_setpoint_among_trunks_is_as_without_them_or_half_of_it_or_led_away_or_a_slow_way_out(
    found: list[tuple[float, float]], vel: tuple[float, float], last: tuple[float, float], wish: tuple[float, float]
) -> None:
    """What holds of its change in one tick: braking for trunks leaves the acceleration limit.

    One that is too near to a trunk wishes to get away besides.
    """
    own, points = Position((40.0, 0.0, -8.0), (*vel, 0.0)), points_at(found)
    north, east, lacking_m = points.find_way_out()
    out_mps = min(OUT_MAX_MPS, OUT_PER_S * (lacking_m - GIVES_M)) if lacking_m > GIVES_M else -math.inf
    more_mps = max(0.0, out_mps - wish[0] * north - wish[1] * east)
    led_out = (wish[0] + more_mps * north, wish[1] + more_mps * east, 0.0)
    without, led = (applied(FILTER, w, (*last, 0.0), own, dt_s=DT_S) for w in ((*wish, 0.0), led_out))
    v = applied(FILTER, (*wish, 0.0), (*last, 0.0), own, dt_s=DT_S, points=points)
    if all(norm(sub(v, told)) > 1e-9 for told in (led, without, scale(without, 0.5))):
        assert norm(v) <= ESCAPE_MAX_MPS + AGAINST * math.hypot(*vel) + 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_safety_filter_keeps_limits_of_speed_and_fence_among_trunks(seed: int) -> None:
    rng = random.Random(seed)
    for (safety_filter, trunks, wish, last, own, around, silent, drift), _ in any_inputs(rng, 200):
        found = [(rng.uniform(-8, 8), rng.uniform(-8, 8)) for _ in range(rng.randrange(12))]
        points = points_at(found)
        v = applied(
            safety_filter, wish, last, own, around, silent, dt_s=DT_S, drift=drift, trunks=trunks, points=points
        )
        broken = broken_promises(safety_filter, trunks, wish, last, own, around, silent, drift, v)
        assert [line for line in broken if not line.startswith(("steps", "separation", "limit"))] == []
        if math.hypot(v[0] + drift[0], v[1] + drift[1]) > 1e-9 and is_finite(own.pos_ned_m):  # but for true rest
            assert [line for line in broken if line.startswith("limit")] == []


def test_vehicle_that_a_gust_drives_at_a_trunk_leans_and_brakes_against_it() -> None:
    gust = (0.0, 1.5, 0.0)  # what the wind adds to what is told
    own = Position((0.0, 0.0, -8.0), (0.0, 1.5, 0.0))
    points = points_at([(0.0, 0.9)])
    v = applied(FILTER, ZERO, ZERO, own, [], [], dt_s=DT_S, drift=gust, points=points)
    assert v[1] <= -1.5  # at least to rest over ground
    pusher = neighbour(2, (0.0, -4.0, 0.0), vel_ned_mps=(0.0, 1.0, 0.0))
    v = applied(FILTER, ZERO, ZERO, own, [pusher], [], dt_s=DT_S, drift=gust, points=points)
    assert v[1] <= -1.5  # trunks before separation
