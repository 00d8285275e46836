"""The five conditions and coverage: laws over all inputs."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.guidance import coverage, formation
from companion.core.guidance.formation import Route
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import norm, scale, sub
from mission.common.frames import Vec3
from tests.unit.core.core_kit import is_finite, neighbour

DT_S = 0.1
R = 15.0
coordinate = st.floats(-50_000.0, 50_000.0) | st.floats(-40.0, 40.0) | st.sampled_from([0.0, 1e-9, -1e-7])
vectors = st.tuples(coordinate, coordinate, coordinate)
velocities = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
neighbours = st.builds(
    lambda k, rel, ref, cost, q, parent: neighbour(k, rel, ref_ned_mps=ref, route_cost=cost, governor=q, parent=parent),
    st.integers(1, 250),
    vectors,
    velocities,
    st.floats(0.0, 2e6) | st.integers(0, 5).map(float),
    st.floats(0.0, 1.0),
    st.integers(0, 5),
)
swarms = st.lists(neighbours, max_size=6)
ranges = st.floats(0.5, 10_000.0)


@given(st.floats(0.0, 1e5), st.floats(0.0, 1e5), ranges)
@settings(max_examples=50)
def test_link_cost_never_falls_with_distance(a_m: float, b_m: float, range_m: float) -> None:
    near, far = sorted((a_m, b_m))
    assert 1.0 <= formation.link_cost(near, range_m) <= formation.link_cost(far, range_m)


@given(swarms, ranges)
@settings(max_examples=40)
def test_route_is_the_cheapest_and_costs_a_hop_more_than_its_parent(swarm: list[Neighbour], range_m: float) -> None:
    own = formation.route(swarm, range_m=range_m)
    if not own.parent:
        assert own == formation.NOWHERE
        return
    best = min(n.beacon.route_cost + formation.link_cost(norm(n.rel_ned_m), range_m) for n in swarm)
    assert own.cost == best
    parents = [n for n in swarm if n.id == own.parent]
    assert any(own.cost >= n.beacon.route_cost + 1.0 for n in parents)
    assert all(n.beacon.route_cost < own.cost for n in own.up)
    assert own.up


@given(swarms, st.integers(0, 5), st.floats(0.0, 1e5), ranges)
@settings(max_examples=40)
def test_governor_is_a_share_and_no_faster_than_any_child(
    swarm: list[Neighbour], parent: int, distance_m: float, range_m: float
) -> None:
    own = Route(1.5, parent, distance_m, ())
    branch = formation.children(3, own, swarm)
    share = formation.governor(own, branch, range_m=range_m)
    assert 0.0 <= share <= 1.0
    assert all(share <= child.beacon.governor and child.beacon.route_cost > own.cost for child in branch)


@given(swarms, st.lists(vectors, max_size=3), ranges)
@settings(max_examples=40)
def test_no_rule_exceeds_its_limit_nor_gives_nan(swarm: list[Neighbour], silent: list[Vec3], range_m: float) -> None:
    own = Route(9.0, 1, 1.0, tuple(swarm))
    push = formation.separation(swarm, silent, soft_m=10.0)
    pull = formation.cohesion(own, range_m=range_m)
    assert norm(push) <= formation.SEPARATION_LIMIT_MPS * (1 + 1e-9)
    assert norm(pull) <= formation.COHESION_LIMIT_MPS * (1 + 1e-9)
    assert is_finite(formation.alignment(own))
    assert is_finite(formation.level(own))


@given(swarms)
@settings(max_examples=50)
def test_alignment_is_within_the_references_it_averages(swarm: list[Neighbour]) -> None:
    v = formation.alignment(Route(9.0, 1, 1.0, tuple(swarm)))
    for axis in range(3):
        refs = [n.beacon.ref_ned_mps[axis] for n in swarm] or [0.0]
        assert min(refs) - 1e-9 <= v[axis] <= max(refs) + 1e-9


@given(
    st.tuples(*[st.floats(-60.0, 60.0)] * 3), st.floats(0.05, 5.0), st.floats(0.0, 20.0), st.sampled_from([0.05, 0.1])
)
@settings(max_examples=30)
def test_approach_never_passes_its_stop_distance(start: Vec3, cruise_mps: float, stop_m: float, dt_s: float) -> None:
    """But for one step's worth of its deceleration, 1/2 a dt^2; and it does arrive."""
    to_goal = start
    slack_m = 0.5 * formation.APPROACH_MPS2 * dt_s**2 + 1e-9
    for _ in range(math.ceil((norm(start) / cruise_mps + cruise_mps + 5.0) / dt_s)):
        v = formation.approach(to_goal, cruise_mps=cruise_mps, stop_m=stop_m)
        assert norm(v) <= cruise_mps * (1 + 1e-9)
        to_goal = sub(to_goal, scale(v, dt_s))
        assert norm(to_goal) >= min(norm(start), stop_m) - slack_m
    assert norm(to_goal) <= max(stop_m, 0.0) + 0.02


@given(vectors, st.lists(vectors, max_size=8), st.floats(0.1, 10_000.0), st.floats(0.5, 10_000.0))
@settings(max_examples=50)
def test_coverage_is_finite_and_limited_for_any_neighbourhood(
    dest: Vec3, peers: list[Vec3], radius_m: float, range_m: float
) -> None:
    size = len(peers) + 1
    around = coverage.ring(dest, peers, size=size, radius_m=radius_m, wait_m=10.0, range_m=range_m)
    over = coverage.sphere(dest, list(enumerate(peers)), me=1, radius_m=radius_m)
    assert is_finite(around)
    assert is_finite(over)
    assert math.hypot(around[0], around[1]) <= coverage.CLOSE_UP_LIMIT_MPS * (1 + 1e-9)
    assert norm(over) <= coverage.SPREAD_LIMIT_MPS * (1 + 1e-9)
