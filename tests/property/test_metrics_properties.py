"""Figures of any flight against a slower and plainer way to get them."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from sim_bridge.judge import metrics
from sim_bridge.judge.metrics import Floats, measure
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.tick import TOUCHED

SETTINGS = settings(derandomize=True, deadline=None, max_examples=60)
MISSION = Mission.model_validate(
    {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": (100.0, 0.0, 10.0), "vel_leader_mps": 3.0},
        "forest": {"trees": ({"base_enu_m": (100.0, 0.0), "trunk_radius_m": 0.5, "height_m": 12.0},)},
    }
)


@st.composite
def flights(draw: st.DrawFn) -> Recording:
    """Vehicles that jump about near d2: links, contacts and phases of every kind."""
    ticks, n = draw(st.integers(1, 8)), draw(st.integers(1, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread_m = draw(st.sampled_from([0.8, 6.0, 40.0]))
    often = draw(st.sampled_from([0.1, 0.5, 0.9]))
    pos = np.array([0.0, 100.0, -10.0]) + rng.normal(size=(ticks, n, 3)) * spread_m
    shape = (ticks, n)
    return Recording(
        time_s=np.cumsum(rng.uniform(0.01, 1.0, ticks)),
        pos_ned_m=pos,
        vel_ned_mps=np.zeros_like(pos),
        on_ground=rng.random(shape) > often,
        armed=np.ones(shape, dtype=np.bool_),
        agent_alive=rng.random(shape) < often,
        touched=np.maximum.accumulate(rng.integers(0, 5, shape) * (rng.random(shape) < 0.1), axis=0).astype(np.int8),
        range_m=rng.choice([30.0, 55.0], shape),
        phase=rng.integers(-1, 6, shape).astype(np.int8),
        acting=rng.random(shape) < 0.3,
        leader=np.zeros(shape, dtype=np.int16),
    )


def plain_links(flight: Recording, tick: int) -> set[tuple[int, int]]:
    able = flight.agent_alive[tick] & ~flight.on_ground[tick]
    n = len(able)
    return {
        (a, b)
        for a in range(n)
        for b in range(a + 1, n)
        if able[a]
        and able[b]
        and math.dist(flight.pos_ned_m[tick, a], flight.pos_ned_m[tick, b])
        <= min(flight.range_m[tick, a], flight.range_m[tick, b])
    }


def plain_connected(vertices: set[int], links: set[tuple[int, int]]) -> bool:
    if not vertices:
        return False
    reached = {min(vertices)}
    while more := {b for pair in links for a, b in (pair, pair[::-1]) if a in reached} - reached:
        reached |= more
    return reached == vertices


@SETTINGS
@given(flights())
def test_connectivity_is_what_a_walk_along_the_links_finds(flight: Recording) -> None:
    phase = metrics.swarm_phase(flight)
    transit = [tick for tick in range(len(phase)) if phase[tick] == SwarmPhase.TRANSIT]
    connected, lambda2 = [], []
    for tick in transit:
        vertices = sorted(int(v) for v in np.flatnonzero(flight.agent_alive[tick]))
        links = plain_links(flight, tick)
        assert {tuple(pair) for pair in metrics.links(flight, tick).tolist()} == links
        connected.append(plain_connected(set(vertices), links))
        if len(vertices) > 1:
            laplacian = np.zeros((len(vertices), len(vertices)))
            for a, b in links:
                i, j = vertices.index(a), vertices.index(b)
                laplacian[i, i] += 1
                laplacian[j, j] += 1
                laplacian[i, j] = laplacian[j, i] = -1
            lambda2.append(float(np.sort(np.linalg.eigvalsh(laplacian))[1]))
    result = measure(flight, MISSION)
    if transit:
        assert result.connected_fraction_transit == np.mean(connected)
    else:
        assert result.connected_fraction_transit is None
    if lambda2:
        assert result.lambda2_mean_transit is not None
        assert math.isclose(result.lambda2_mean_transit, np.mean(lambda2), abs_tol=1e-9)
    else:
        assert result.lambda2_mean_transit is None


@SETTINGS
@given(flights())
def test_contacts_and_separation_are_what_looking_at_each_pair_finds(flight: Recording) -> None:
    ticks, n = flight.on_ground.shape
    contacts, least_m = 0, math.inf
    up_once = [[False] * n for _ in range(ticks)]
    for v in range(n):
        up = False
        for t in range(ticks):
            up = not flight.on_ground[t, v] and (up or -flight.pos_ned_m[t, v, 2] > 5.0)
            up_once[t][v] = up
    for a in range(n):
        for b in range(a + 1, n):
            before = False
            for t in range(ticks):
                distance_m = math.dist(flight.pos_ned_m[t, a], flight.pos_ned_m[t, b])
                touch = distance_m < 0.7 and not (flight.on_ground[t, a] and flight.on_ground[t, b])
                contacts += touch and not before
                before = touch
                if up_once[t][a] and up_once[t][b]:
                    least_m = min(least_m, distance_m)
    result = measure(flight, MISSION)
    contacts = max(contacts, math.ceil(np.count_nonzero(flight.touched[-1] == TOUCHED.index("vehicle")) / 2))
    assert result.contacts_vehicles == contacts
    others = np.isin(flight.touched[-1], [TOUCHED.index(what) for what in ("trunk", "crown", "ground")])
    assert result.contacts == contacts + np.count_nonzero(others)
    if math.isinf(least_m):
        assert result.min_separation_m is None
    else:
        assert result.min_separation_m is not None
        assert math.isclose(result.min_separation_m, least_m)


@SETTINGS
@given(flights())
def test_leaders_counted_one_tick_after_another(flight: Recording) -> None:
    changes, overlap_s, longest_s, run_s = 0, 0.0, 0.0, 0.0
    last = None
    phase = metrics.swarm_phase(flight)
    for t in range(len(flight.time_s)):
        length_s = flight.time_s[t + 1] - flight.time_s[t] if t + 1 < len(flight.time_s) else 0.0
        leaders = np.flatnonzero(flight.acting[t] & flight.agent_alive[t])
        if len(leaders):
            changes += last is not None and last != leaders[0]
            last = leaders[0]
        overlap_s += length_s * (len(leaders) > 1)
        run_s = run_s + length_s if not len(leaders) and phase[t] in (2, 3) else 0.0
        longest_s = max(longest_s, run_s)
    result = measure(flight, MISSION)
    assert result.leader_changes == changes
    assert math.isclose(result.acting_leaders_overlap_s, overlap_s, abs_tol=1e-9)
    assert math.isclose(result.leaderless_max_s, longest_s, abs_tol=1e-9)


@SETTINGS
@given(flights())
def test_figures_make_sense_together(flight: Recording) -> None:
    result = measure(flight, MISSION)
    assert result.arrived == (result.arrival_last_s is not None)
    if result.arrival_last_s is not None:
        assert result.arrival_leader_s is not None
        assert 0.0 <= result.arrival_leader_s <= result.arrival_last_s
    if result.coverage_gap_deg is not None:
        assert result.coverage_gap_ideal_deg is not None
        assert result.coverage_gap_deg <= 360.0 + 1e-9
    if result.coverage_settled_s is not None:
        assert result.coverage_radius_error_m is not None
        assert set(result.absent) | set(result.aloft) | set(result.armed) <= set(range(1, result.n + 1))


def directions(count: int) -> Floats:
    """(count, 3) spread evenly over the sphere: a spiral of equal areas."""
    k = np.arange(count)
    up = 1.0 - 2.0 * (k + 0.5) / count
    turn = k * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - up * up)
    return np.stack((flat * np.cos(turn), flat * np.sin(turn), up), axis=1)


DIRECTIONS = np.ascontiguousarray(directions(40_000).T)
COARSE_DEG = 0.8  # no direction is farther from all of these


def cloud(kind: str, n: int, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    match kind:
        case "cap":
            points += np.array([2.5, 0.0, 0.0])
        case "arc":  # in a plane through d2
            points[:, 2] = 0.0
            points[:, 0] = np.abs(points[:, 0])
        case "nearly flat":
            points[:, 2] = 1e-9 * points[:, 2]
        case "parallel":  # in a plane beside d2
            points /= np.linalg.norm(points[:, :2], axis=1)[:, None]
            points[:, 2] = 0.4
        case "lattice":  # equal points, opposite points, many on one plane
            points = rng.integers(-1, 2, size=(n, 3)).astype(np.float64)
    return points


@settings(SETTINGS, max_examples=150)
@given(
    st.sampled_from(["anywhere", "cap", "arc", "nearly flat", "parallel", "lattice"]),
    st.integers(1, 16),
    st.integers(0, 2**32 - 1),
)
def test_sphere_gap_is_what_trying_many_directions_finds(kind: str, n: int, seed: int) -> None:
    points = cloud(kind, n, seed)
    length = np.linalg.norm(points, axis=1)
    units = points[length > 0.0] / length[length > 0.0, None]
    gap_deg = metrics.sphere_gap_deg(points)
    if not len(units):
        assert gap_deg == 180.0
        return
    sampled_deg = math.degrees(math.acos(np.clip((units @ DIRECTIONS).max(axis=0).min(), -1.0, 1.0)))
    assert sampled_deg - 1e-4 <= gap_deg <= sampled_deg + COARSE_DEG
    bounds = len(units) > 2 and metrics.sphere_covering_bound_deg(len(units))
    assert gap_deg >= bounds - 1e-6


@SETTINGS
@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0.1, 50.0))
def test_gaps_do_not_depend_on_order_distance_or_heading(n: int, seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    turn = rng.uniform(0.0, 2.0 * math.pi)
    rotation = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    moved = scale * rng.permutation(points) @ rotation.T
    for gap_deg in (metrics.ring_gap_deg, metrics.sphere_gap_deg):
        assert math.isclose(gap_deg(points), gap_deg(moved), abs_tol=1e-5)


@SETTINGS
@given(st.lists(st.floats(0.0, 360.0), min_size=1, max_size=12))
def test_ring_gap_is_what_walking_round_finds(azimuths_deg: list[float]) -> None:
    rad = np.radians(azimuths_deg)
    gap_deg = metrics.ring_gap_deg(np.stack((np.cos(rad), np.sin(rad), 0 * rad), axis=1))
    ahead = [min(((b - a) % 360.0 or 360.0) for b in azimuths_deg) for a in azimuths_deg]
    assert math.isclose(gap_deg, max(ahead), abs_tol=1e-6)
