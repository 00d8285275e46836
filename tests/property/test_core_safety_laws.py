"""The safety filter: what it admits for any input. In flight: tests/scenario/test_safety_filter_flights.py."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import limit
from companion.core.perception.obstacle_cloud import Trunk
from companion.core.safety.response_model import BACK_OFF_MAX_MPS, BACK_OFF_PER_S
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_promises import POLYGONS, any_inputs, broken_promises, restless_inputs
from tests.unit.core.core_surroundings import applied

OPEN = SafetyFilter.of(mission())
KEEP_M = mission().coverage.keep_out_m
EPS = 1e-6

far = st.floats(-50_000.0, 50_000.0) | st.floats(-12.0, 12.0) | st.sampled_from([0.0, 1e-9, 5.0, -2.0])
speeds = st.floats(-100.0, 100.0) | st.floats(-5.0, 5.0)
places = st.tuples(far, far, far)
velocities = st.tuples(speeds, speeds, speeds)
wishes = velocities | st.tuples(*[st.floats(-1e300, 1e300)] * 3)
filters = st.builds(
    lambda polygon: replace(OPEN, polygon_m=polygon),
    st.sampled_from(list(POLYGONS.values())),
)
trees = st.builds(lambda upright, tree: Trunk(tree, KEEP_M, upright=upright), st.booleans(), places)
neighbours = st.builds(
    lambda k, rel, vel, age_s: neighbour(k, rel, vel_ned_mps=vel, age_s=age_s),
    st.integers(1, 250),
    places,
    velocities,
    st.floats(0.0, 0.5),
)


@given(
    filters,
    trees,
    wishes | st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3),
    velocities,
    st.builds(Position, places, velocities),
    st.lists(neighbours, max_size=5),
    st.lists(places, max_size=3),
    velocities.map(lambda v: limit(v, 1.0)),
)
@settings(max_examples=100)  # the next test tries thousands, drawn plainly
def test_safety_filter_keeps_its_promises_for_any_input(
    safety_filter: SafetyFilter,
    tree: Trunk,
    wanted: Vec3,
    last: Vec3,
    own: Position,
    around: list[Neighbour],
    silent: list[Vec3],
    drift: Vec3,
) -> None:
    v = applied(safety_filter, wanted, last, own, around, silent, dt_s=0.05, drift=drift, trunks=[tree])
    assert broken_promises(safety_filter, [tree], wanted, last, own, around, silent, drift, v) == []


@pytest.mark.parametrize("seed", range(3))
def test_safety_filter_keeps_its_promises_along_restless_flights_and_anywhere(seed: int) -> None:
    for given_to, v in restless_inputs(random.Random(seed), 2000):
        assert broken_promises(*given_to, v) == []
    for given_to, v in any_inputs(random.Random(seed), 1000):
        assert broken_promises(*given_to, v) == []


@given(st.floats(-1e4, 1e4))
@settings(max_examples=50)
def test_allowed_closing_speed_always_stops_in_time(room_m: float) -> None:
    speed = OPEN.response.closing_mps(room_m)
    if room_m > 0.0:
        assert speed > 0.0 or room_m < EPS
        assert speed * 0.8 + speed**2 / (2 * 0.6 * OPEN.acceleration_max_mps2) <= room_m + EPS
    else:
        assert speed == pytest.approx(max(-BACK_OFF_MAX_MPS, BACK_OFF_PER_S * room_m))
