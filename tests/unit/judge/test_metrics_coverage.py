"""Figures of a flight: how well a ring or sphere is covered."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.core.model.states import SwarmPhase
from mission.document.model import CoverageShape
from sim_bridge.judge import metrics
from sim_bridge.judge.metrics import measure
from tests.unit.judge.metrics_kit import COVERAGE, D2, TRANSIT, a_mission, a_recording, column


def ring(*azimuth_deg: float, radius_m: float = 15.0) -> list[list[float]]:
    """One tick of vehicles on a ring about d2."""
    rad = np.radians(azimuth_deg)
    return [[D2[0] + radius_m * math.sin(a), D2[1] + radius_m * math.cos(a), D2[2]] for a in rad]


def test_ring_gap_is_the_mean_of_the_last_five_seconds_of_coverage() -> None:
    even, uneven = ring(10.0, 130.0, 250.0), ring(0.0, 90.0, 180.0)
    ticks = [uneven] * 3 + [even] * 4 + [uneven, even, uneven]
    phase = column(TRANSIT, *[COVERAGE] * 8, SwarmPhase.LAND)
    result = measure(a_recording(ticks, phase=phase), a_mission(n=3))
    assert result.coverage_gap_ideal_deg == 120.0
    assert result.coverage_gap_deg == pytest.approx((5 * 120.0 + 180.0) / 6)
    assert result.coverage_settled_s == 7.0  # the lapse at 7 s starts it anew


def test_a_ring_never_settled() -> None:
    result = measure(a_recording([ring(0.0, 120.0, 240.0), ring(0.0, 90.0, 180.0)], phase=COVERAGE), a_mission(n=3))
    assert result.coverage_settled_s is None


def test_a_gap_is_between_those_on_the_ring() -> None:
    wide, narrow = ring(0.0, 120.0, 240.0), [*ring(0.0, 120.0), *ring(240.0, radius_m=12.9)]
    result = measure(a_recording([narrow] * 2 + [wide] * 2, phase=COVERAGE), a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx((2 * 240.0 + 2 * 120.0) / 4)
    assert result.coverage_settled_s == 2.0
    assert result.coverage_radius_error_m == pytest.approx(2.1)
    assert result.uncovering == (3,)


def test_a_ring_that_stays_too_narrow_never_settles_however_even() -> None:
    mission = a_mission(n=3, coverage={"radius_m": 100.0}, radio={"full_range_m": 400.0})
    result = measure(a_recording([ring(0.0, 120.0, 240.0, radius_m=60.0)] * 9, phase=COVERAGE), mission)
    assert result.coverage_settled_s is None
    assert result.coverage_gap_deg == 360.0
    assert result.coverage_radius_error_m == pytest.approx(40.0)
    near = measure(a_recording([ring(0.0, 120.0, 240.0, radius_m=90.5)] * 9, phase=COVERAGE), mission)
    assert near.coverage_settled_s == 0.0  # within a tenth


def test_one_alone_settles_when_it_is_on_the_ring() -> None:
    result = measure(a_recording([ring(90.0, radius_m=9.0), ring(90.0), ring(90.0)], phase=COVERAGE), a_mission(n=1))
    assert result.coverage_settled_s == 1.0


def test_a_silent_vehicle_that_hangs_on_the_ring_covers_nothing() -> None:
    recording = a_recording([ring(0.0, 90.0, 180.0, 270.0)] * 2, phase=COVERAGE, agent_alive=[1, 1, 1, 0])
    result = measure(recording, a_mission(n=4))
    assert result.coverage_gap_deg == pytest.approx(180.0)
    assert result.coverage_gap_ideal_deg == 120.0
    assert result.coverage_settled_s is None


def test_height_counts_on_a_sphere_and_not_on_a_ring() -> None:
    high = [[D2[0] + 7.0, D2[1], D2[2] + 3.0]]
    for shape, error_m in (("ring", 0.0), ("sphere", math.hypot(7.0, 3.0) - 7.0)):
        mission = a_mission(n=1, coverage={"shape": shape, "radius_m": 7.0})
        result = measure(a_recording([high], phase=COVERAGE), mission)
        assert result.coverage_radius_error_m == pytest.approx(error_m)


def test_coverage_is_by_those_alive() -> None:
    recording = a_recording(
        [ring(0.0, 180.0, 90.0)] * 2, phase=COVERAGE, agent_alive=[[1, 1, 1], [1, 1, 0]], acting=[1, 0, 0]
    )
    result = measure(recording, a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx(180.0)
    assert result.coverage_gap_ideal_deg == 180.0
    assert result.coverage_settled_s == 1.0


def test_a_vehicle_on_the_ground_covers_nothing_but_is_still_expected_to() -> None:
    recording = a_recording([ring(0.0, 120.0, 240.0)], phase=COVERAGE, on_ground=[0, 0, 1])
    result = measure(recording, a_mission(n=3))
    assert result.coverage_gap_deg == pytest.approx(240.0)
    assert result.coverage_gap_ideal_deg == 120.0


def test_an_octahedron_leaves_the_middles_of_its_faces() -> None:
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * 7.0 + np.array(D2)
    mission = a_mission(n=6, coverage={"shape": "sphere", "radius_m": 7.0})
    result = measure(a_recording([corners], phase=COVERAGE), mission)
    assert result.coverage_gap_deg == pytest.approx(54.7356, abs=1e-4)
    assert result.coverage_settled_s == 0.0


@pytest.mark.parametrize(
    ("points", "gap_deg"),
    [
        ([], 180.0),
        ([[0.0, 0.0, 0.0]], 180.0),  # at d2 it covers no direction
        ([[3.0, 0.0, 0.0]], 180.0),
        ([[1.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 180.0),  # behind one another
        ([[1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]], 90.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 135.0),
        ([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 90.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 180.0 - math.degrees(math.acos(3**-0.5))),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], 90.0),  # flat, through d2
        ([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]], 135.0),  # flat, beside it
        ([[math.cos(a), math.sin(a), 0.0] for a in (0.0, 0.3, 0.7, 1.0)], 180.0 - math.degrees(0.5)),  # an arc
    ],
)
def test_sphere_gap_where_the_points_are_few_flat_or_on_one_side(points: list[list[float]], gap_deg: float) -> None:
    assert metrics.sphere_gap_deg(np.array(points).reshape(-1, 3)) == pytest.approx(gap_deg, abs=1e-6)


@pytest.mark.parametrize("n", range(3, 21))
def test_no_covering_in_the_table_beats_the_bound(n: int) -> None:
    best = metrics.ideal_gap_deg(CoverageShape.SPHERE, n)
    assert metrics.sphere_covering_bound_deg(n) <= best + 5e-5
    if n in (3, 4, 6, 12):  # the bound is met by the regular solids of triangles
        assert metrics.sphere_covering_bound_deg(n) == pytest.approx(best, abs=5e-5)


def test_ideal_gaps_fall_with_the_number_of_vehicles() -> None:
    sphere = [metrics.ideal_gap_deg(CoverageShape.SPHERE, n) for n in range(2, 60)]
    assert sphere == sorted(sphere, reverse=True)
    assert [metrics.ideal_gap_deg(CoverageShape.RING, n) for n in (1, 8)] == [360.0, 45.0]
