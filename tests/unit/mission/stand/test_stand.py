"""Stands: what grows where, the same every time, and the questions that the simulator asks of them."""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import pytest

from mission.common.plane import clearance_m
from mission.document.model import Mission
from mission.schema.forest import MAX_STAND_TREES
from mission.schema.trees import Species, crown_radius_of_m, height_of_m, tree_of
from mission.stand.stand import Stand, StandTree, stand_of

AREA = ((-30.0, -40.0), (160.0, -40.0), (160.0, 40.0), (-30.0, 40.0))  # 1.52 ha


def wooded(sim_seed: int = 1, size: int = 8, trees: tuple[Any, ...] = (), **stand: Any) -> Mission:
    """A mission of 130 m at 4 m above the ground, through 400 trees/ha unless told otherwise."""
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (130.0, 0.0, 4.0), "vel_leader_mps": 3.0},
            "swarm": {"size": size},
            "sensing": {},
            "forest": {"trees": trees, "stand": {"density_per_ha": 400.0, "area_enu_m": AREA, **stand}},
            "sim": {"seed": sim_seed},
        }
    )


def gap_m(tree: StandTree, east_m: float, north_m: float) -> float:
    return math.hypot(tree.east_m - east_m, tree.north_m - north_m) - tree.radius_m


def trunk(east_m: float, north_m: float, radius_m: float = 0.2, height_m: float = 20.0) -> StandTree:
    return StandTree(east_m, north_m, radius_m, height_m, 0.6 * height_m, 2.0)


# What grows


def test_the_same_seed_grows_the_same_trees_and_another_does_not() -> None:
    assert stand_of(wooded(7)).trees == stand_of(wooded(7)).trees
    assert stand_of(wooded(7)).trees != stand_of(wooded(8)).trees


def test_the_first_trees_of_a_seed_are_these_on_every_machine() -> None:
    first = stand_of(wooded(1)).trees[:3]

    assert [(t.east_m, t.north_m, round(2 * t.radius_m, 3), t.height_m) for t in first] == [
        (130.0, 0.0, 0.198, 14.8),
        (-4.47, 27.79, 0.241, 16.8),
        (115.12, -19.59, 0.327, 20.2),
    ]


def test_a_stand_with_a_seed_of_its_own_heeds_no_other() -> None:
    assert stand_of(wooded(1, seed=5)).trees == stand_of(wooded(2, seed=5)).trees


@pytest.mark.parametrize("density", [100.0, 400.0, 600.0])
def test_as_many_trees_stand_there_as_the_density_says_but_for_the_clearing(density: float) -> None:
    mission = wooded(density_per_ha=density)
    stand = stand_of(mission)

    cleared_m2 = math.pi * (mission.placement_radius_m + 2.0) ** 2
    assert len(stand.trees) == pytest.approx(density * (15_200.0 - cleared_m2) / 1e4, rel=0.06)
    assert all(clearance_m((tree.east_m, tree.north_m), AREA) >= 0.0 for tree in stand.trees)


def test_nothing_grows_about_the_starting_points() -> None:
    mission = wooded(density_per_ha=600.0, undergrowth_per_ha=2_000.0, clearing_m=3.0)
    stand = stand_of(mission)

    grown = (*stand.trees, *stand.bushes)
    assert min(gap_m(tree, 0.0, 0.0) for tree in grown) >= mission.placement_radius_m + 3.0


def test_one_of_the_trees_stands_at_d2_and_others_may_stand_in_the_ring() -> None:
    stand = stand_of(wooded(density_per_ha=600.0))

    near = sorted(stand.near(130.0, 0.0, 15.0), key=lambda tree: gap_m(tree, 130.0, 0.0))
    assert (near[0].east_m, near[0].north_m) == (130.0, 0.0)
    assert len(near) > 10


def test_a_trunk_of_the_missions_own_at_d2_is_the_only_one_there() -> None:
    own = {"base_enu_m": (130.2, 0.1), "trunk_radius_m": 0.4, "height_m": 22.0}
    stand = stand_of(wooded(trees=(own,)))

    assert [(t.east_m, t.radius_m, t.crown_base_m) for t in stand.near(130.0, 0.0, 1.0)] == [(130.2, 0.4, 22.0)]


def test_a_sphere_in_open_sky_plants_no_tree_at_d2() -> None:
    above = wooded(density_per_ha=10.0).model_dump(by_alias=True)
    above["route"] |= {"d1_enu_m": (0.0, 0.0, 40.0), "d2_enu_m": (130.0, 0.0, 50.0)}
    above["coverage"]["shape"] = "sphere"
    above["fence"]["altitude_max_m"] = 90.0

    assert stand_of(Mission.model_validate(above)).near(130.0, 0.0, 0.5) == []


def test_managed_and_natural_diameters_differ_as_their_shapes_say() -> None:
    managed = stand_of(wooded(dbh_min_m=0.14, dbh_mean_m=0.3, dbh_max_m=0.5, dbh_shape=3.6)).trees
    natural = stand_of(wooded(dbh_min_m=0.1, dbh_mean_m=0.22, dbh_max_m=0.8, dbh_shape=1.0)).trees

    of_managed, of_natural = ([2.0 * tree.radius_m for tree in trees] for trees in (managed, natural))
    assert statistics.mean(of_managed) == pytest.approx(0.3, abs=0.01)
    assert statistics.mean(of_managed) == pytest.approx(statistics.median(of_managed), abs=0.01)
    assert statistics.mean(of_natural) == pytest.approx(0.22, abs=0.02)
    assert statistics.median(of_natural) < statistics.mean(of_natural) - 0.02
    assert min(of_natural) >= 0.1
    assert max(of_natural) <= 0.8


def test_a_species_that_is_listed_twice_is_twice_as_frequent() -> None:
    trees = stand_of(wooded(species=("spruce", "broadleaf", "spruce"))).trees

    share = sum(tree.species == "spruce" for tree in trees) / len(trees)
    assert {tree.species for tree in trees} == {"spruce", "broadleaf"}
    assert share == pytest.approx(2 / 3, abs=0.06)


def test_a_stand_is_as_tall_as_it_is_told_for_every_species() -> None:
    tall = stand_of(wooded(height_mean_m=34.0, species=("spruce", "pine"))).trees
    usual = stand_of(wooded(species=("spruce", "pine"))).trees

    for species, usual_m in (("spruce", 17.2), ("pine", 14.1)):  # at 0.25 m
        shares = [t.height_m / u.height_m for t, u in zip(tall, usual, strict=True) if t.species == species]
        assert shares == pytest.approx([34.0 / usual_m] * len(shares), rel=0.012)  # heights are to 0.1 m
    assert all(tree.crown_base_m == pytest.approx(0.6 * tree.height_m, abs=0.051) for tree in tall)


def test_undergrowth_is_low_and_answers_by_itself() -> None:
    stand = stand_of(wooded(undergrowth_per_ha=1_000.0, undergrowth_height_m=2.0))

    assert len(stand.bushes) == pytest.approx(1_440, abs=40)
    assert all(0.3 <= bush.height_m <= 2.0 and bush.crown_base_m == bush.height_m for bush in stand.bushes)
    assert all(bush.species == "undergrowth" for bush in stand.bushes_near(65.0, 0.0, 8.0))
    assert all(tree.species == "spruce" for tree in stand.near(65.0, 0.0, 8.0))


def test_left_to_itself_a_stand_grows_on_the_rectangle_about_the_route() -> None:
    trees = stand_of(wooded(area_enu_m=None, margin_m=20.0)).trees

    assert min(tree.east_m for tree in trees) == pytest.approx(-20.0, abs=2.0)
    assert max(tree.east_m for tree in trees) == pytest.approx(150.0, abs=2.0)
    assert max(tree.north_m for tree in trees) == pytest.approx(20.0, abs=2.0)


def test_missions_without_a_forest_have_an_empty_stand() -> None:
    open_field = wooded().model_copy(update={"forest": Mission.model_fields["forest"].default})

    assert stand_of(open_field).trees == ()
    assert stand_of(open_field).near(0.0, 0.0, 1e3) == []
    assert stand_of(open_field).crossed((0.0, 0.0, 4.0), (130.0, 0.0, 4.0)) == []


# How tall and wide


@pytest.mark.parametrize(
    ("species", "dbh_m", "height_m", "crown_radius_m"),
    [
        (Species.SPRUCE, 0.3, 19.3, 3.2),
        (Species.PINE, 0.3, 15.5, 3.5),
        (Species.BROADLEAF, 0.3, 15.6, 5.1),
        (Species.SPRUCE, 0.1, 8.7, 1.6),
    ],
)
def test_curves_give_the_figures_of_their_sources(
    species: Species, dbh_m: float, height_m: float, crown_radius_m: float
) -> None:
    """By hand from the coefficients: 1017.27 exp(-12.697 / 300^0.3562) dm, exp(-0.3232 + 0.6441 ln 30) / 2 m."""
    assert height_of_m(dbh_m, species) == height_m
    assert crown_radius_of_m(dbh_m, species) == crown_radius_m


def test_a_tree_is_never_lower_than_breast_height_nor_its_crown_thinner_than_its_trunk() -> None:
    thin = tree_of(0.0, 0.0, 0.001, Species.PINE, crown_base_share=0.5)

    assert thin.height_m == 1.3
    assert thin.crown_radius_m >= thin.radius_m


# Where they are


def test_near_counts_from_the_trunks_surface() -> None:
    stand = Stand([trunk(10.0, 0.0, radius_m=0.5), trunk(0.0, 30.0, radius_m=3.0)])

    assert stand.near(7.0, 0.0, 2.49) == []
    assert stand.near(7.0, 0.0, 2.51) == [stand.trees[0]]
    assert stand.near(0.0, 25.0, 2.01) == [stand.trees[1]]  # from beyond its axis' cell and the next


def test_a_way_crosses_the_trunks_that_it_goes_through_and_no_other() -> None:
    stand = Stand([trunk(10.0, 0.1), trunk(20.0, -0.19), trunk(30.0, 0.21), trunk(-5.0, 0.0), trunk(60.0, 0.0)])

    assert stand.crossed((0.0, 0.0, 4.0), (50.0, 0.0, 4.0)) == [stand.trees[0], stand.trees[1]]
    assert stand.crossed((50.0, 0.0, 4.0), (0.0, 0.0, 4.0)) == [stand.trees[0], stand.trees[1]]
    assert stand.crossed((10.0, -50.0, 4.0), (10.0, 50.0, 4.0)) == [stand.trees[0]]
    assert stand.crossed((10.0, 0.0, 4.0), (10.0, 0.0, 4.0)) == [stand.trees[0]]
    assert stand.crossed((11.0, 0.0, 4.0), (11.0, 0.0, 4.0)) == []


def test_a_way_above_the_top_or_below_the_ground_of_a_slope_crosses_nothing() -> None:
    stand = Stand([trunk(10.0, 0.0, height_m=20.0)], grade=(0.5, 0.0))

    assert stand.ground_up_m(10.0, 3.0) == 5.0
    assert stand.crossed((0.0, 0.0, 24.0), (20.0, 0.0, 24.0)) == [stand.trees[0]]
    assert stand.crossed((0.0, 0.0, 25.5), (20.0, 0.0, 25.5)) == []
    assert stand.crossed((0.0, 0.0, 4.0), (20.0, 0.0, 4.0)) == []
    assert stand.crossed((0.0, 0.0, 51.5), (20.0, 0.0, 0.0)) == []  # 25.2 m where it leaves the trunk's circle
    assert stand.crossed((0.0, 0.0, 50.0), (20.0, 0.0, 0.0)) == [stand.trees[0]]


def test_the_largest_stand_that_a_mission_may_ask_for_is_grown() -> None:
    side_m = math.sqrt(MAX_STAND_TREES / 600.0) * 100.0
    area = ((0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m))

    assert len(stand_of(wooded(density_per_ha=600.0, area_enu_m=area)).trees) >= 0.98 * MAX_STAND_TREES


def test_600_trees_per_ha_over_4_ha_are_cheap_to_grow_and_to_ask() -> None:
    """Measured in plain Python: 0.06 s to grow, 9 us for what a scan of 8 m may see."""
    area = ((-40.0, -100.0), (160.0, -100.0), (160.0, 100.0), (-40.0, 100.0))
    mission = wooded(density_per_ha=600.0, area_enu_m=area)
    start_s = time.process_time()
    stand = stand_of(mission)
    grown_s = time.process_time()
    for k in range(1_000):
        stand.near(0.13 * k, 0.05 * k - 25.0, 8.0)
    asked_s = time.process_time()

    assert len(stand.trees) > 2_300
    assert grown_s - start_s < 0.5  # the slack is for busy machines
    assert asked_s - grown_s < 0.1


def test_the_densest_packing_that_a_mission_may_ask_for_is_grown() -> None:
    """35 % of a thin triangle, which takes a twentieth of its bounding box: the most tries a tree."""
    area = ((0.0, 0.0), (100.0, 100.0), (95.0, 84.0))
    spacing_m = 2.0 * math.sqrt(0.349 * 1e4 / (math.pi * 400.0))
    mission = wooded(area_enu_m=area, spacing_min_m=spacing_m, clearing_m=1.0, size=1)

    area_m2 = abs(100.0 * 84.0 - 95.0 * 100.0) / 2.0
    cleared = 2
    assert len(stand_of(mission).trees) >= round(400.0 * area_m2 / 1e4) - cleared
