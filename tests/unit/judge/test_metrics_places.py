"""The ideal gap of a ring in which trunks stand."""

from __future__ import annotations

import math

import pytest

from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.judge.metrics import ideal_among_trees_deg

D2 = (100.0, 0.0, 10.0)
RING_M = 15.0


def ideal(n: int, *trunks: tuple[float, float, float], shape: str = "ring") -> float:
    """`trunks`: bearing (deg from north), distance from d2 and radius, metres."""
    trees = [
        {
            "base_enu_m": (D2[0] + away_m * math.sin(math.radians(deg)), away_m * math.cos(math.radians(deg))),
            "trunk_radius_m": radius_m,
            "height_m": 20.0,
        }
        for deg, away_m, radius_m in trunks
    ]
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": D2, "vel_leader_mps": 2.0}
    coverage = {"radius_m": RING_M if shape == "ring" else 7.0, "shape": shape}
    tables = {"route": route, "swarm": {"size": 2}, "coverage": coverage, "forest": {"trees": trees}}
    mission = Mission.model_validate({"schema": 1, **tables})
    return ideal_among_trees_deg(mission, stand_of(mission), n)


@pytest.mark.parametrize("n", [1, 4, 7])
def test_open_ring_can_be_divided_evenly(n: int) -> None:
    assert ideal(n) == 360.0 / n


def test_thin_trunk_in_the_ring_costs_nothing_as_one_passes_beside_it() -> None:
    assert ideal(4, (10.0, RING_M, 0.2)) == 90.0


def test_trunk_that_fills_the_rings_width_costs_nothing_while_the_others_can_turn() -> None:
    assert ideal(4, (10.0, RING_M, 3.0)) == pytest.approx(90.0, abs=0.6)


def test_trunks_that_leave_an_arc_widen_the_gap_by_what_they_take() -> None:
    """Two vehicles, and free is only what the first and the last trunk of a wall leave between them."""
    wall = [(float(deg), RING_M, 3.0) for deg in range(160, 381, 10)]
    # A vehicle 2 m outside the ring has its centre 3.3 m from the axis of a trunk 15 m from d2.
    outside_m = RING_M + 2.0
    taken = math.degrees(math.acos((outside_m**2 + RING_M**2 - 3.3**2) / (2.0 * outside_m * RING_M)))
    assert ideal(2, *wall) == pytest.approx(360.0 - (140.0 - 2.0 * taken), abs=1.0)


def test_place_that_is_free_inside_the_ring_is_a_place() -> None:
    outside = [
        (float(deg), RING_M + 1.5, 2.2) for deg in range(160, 381, 5)
    ]  # 2 m inside the ring is 3.5 m from an axis
    assert ideal(2, *outside) == pytest.approx(180.0, abs=0.6)


def test_ring_without_any_free_place_has_the_ideal_of_an_open_one() -> None:
    assert ideal(3, *((float(deg), RING_M, 3.0) for deg in range(0, 360, 10))) == 120.0


def test_on_a_sphere_trunks_do_not_count() -> None:
    assert ideal(4, (10.0, 7.0, 1.0), shape="sphere") == pytest.approx(70.5288)
