"""Any stand that a mission may ask for keeps its promises, and its index answers as a search of all trees does."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from mission.document.model import Mission
from mission.stand.stand import Stand, StandTree, stand_of

SETTINGS = settings(deadline=None, max_examples=40)
metres = st.floats(-60.0, 60.0)
trees = st.builds(
    StandTree,
    east_m=metres,
    north_m=metres,
    radius_m=st.floats(0.01, 3.0),
    height_m=st.floats(0.5, 40.0),
    crown_base_m=st.just(5.0),
    crown_radius_m=st.just(3.0),
)
points = st.tuples(metres, metres, st.floats(-5.0, 50.0))
stands = st.builds(Stand, st.lists(trees, max_size=40), grade=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)))


@SETTINGS
@given(stands, metres, metres, st.floats(0.0, 80.0))
def test_near_finds_what_a_search_of_all_trees_finds(stand: Stand, east: float, north: float, within: float) -> None:
    def gap_m(tree: StandTree) -> float:
        return math.hypot(tree.east_m - east, tree.north_m - north) - tree.radius_m

    found = stand.near(east, north, within)
    assert len(found) == len({id(tree) for tree in found})
    for tree in stand.trees:
        if abs(gap_m(tree) - within) > 1e-9:
            assert (tree in found) == (gap_m(tree) < within)


@SETTINGS
@given(stands, points, points)
def test_crossed_finds_what_steps_along_the_way_find(stand: Stand, a: Any, b: Any) -> None:
    """Every trunk that one of 400 steps is inside of, and none that stands off the way."""
    crossed = stand.crossed(a, b)
    steps = [tuple(p + k / 400.0 * (q - p) for p, q in zip(a, b, strict=True)) for k in range(401)]
    for tree in stand.trees:
        ground_m = stand.ground_up_m(tree.east_m, tree.north_m)
        gaps_m = [math.hypot(s[0] - tree.east_m, s[1] - tree.north_m) - tree.radius_m for s in steps]
        heights_m = [s[2] - ground_m for s in steps]
        inside = [g < -1e-6 and 1e-6 < h < tree.height_m - 1e-6 for g, h in zip(gaps_m, heights_m, strict=True)]
        if any(inside):
            assert tree in crossed
        if tree in crossed:
            assert min(gaps_m) < 0.5 * math.dist(steps[0], steps[1])


@st.composite
def wooded(draw: Any) -> Mission:
    """A mission through a stand of any kind that is allowed."""
    density = draw(st.floats(1.0, 1_200.0))
    spacing_max_m = min(50.0, 2.0 * math.sqrt(0.34 * 1e4 / (math.pi * density)))
    dbh_max_m = draw(st.floats(0.3, 0.6))
    stand = {
        "density_per_ha": density,
        "margin_m": draw(st.floats(0.0, 40.0)),
        "spacing_min_m": draw(st.floats(0.61, spacing_max_m)),
        "dbh_min_m": draw(st.floats(0.1, 0.15)),
        "dbh_mean_m": draw(st.floats(0.16, 0.29)),
        "dbh_max_m": dbh_max_m,
        "dbh_shape": draw(st.floats(0.5, 20.0)),
        "species": draw(st.lists(st.sampled_from(["spruce", "pine", "broadleaf"]), min_size=1, max_size=3)),
        "undergrowth_per_ha": draw(st.floats(0.0, 500.0)),
        "clearing_m": draw(st.floats(1.0, 5.0)),
    }
    d2 = (draw(st.floats(40.0, 130.0)), draw(st.floats(-60.0, 60.0)), 3.0)
    route = {"d1_enu_m": (0.0, 0.0, 3.0), "d2_enu_m": d2, "vel_leader_mps": 2.0}
    swarm, sim = {"size": draw(st.integers(1, 12))}, {"seed": draw(st.integers(0, 2**32 - 1))}
    return Mission.model_validate(
        {"schema": 1, "route": route, "swarm": swarm, "sim": sim, "sensing": {}, "forest": {"stand": stand}}
    )


@settings(deadline=None, max_examples=25)
@given(wooded())
def test_a_grown_stand_keeps_what_the_mission_says(mission: Mission) -> None:
    spec, stand, d2 = mission.forest.stand, stand_of(mission), mission.route.d2_enu_m
    assert spec is not None
    near_m = spec.spacing_min_m + spec.dbh_max_m
    for tree in stand.trees:
        around = stand.near(tree.east_m, tree.north_m, near_m)
        off_m = [math.hypot(o.east_m - tree.east_m, o.north_m - tree.north_m) for o in around if o is not tree]
        assert min(off_m, default=math.inf) >= spec.spacing_min_m - 0.0051  # d2 itself is not rounded to 1 cm
        assert spec.dbh_min_m - 5e-4 <= 2.0 * tree.radius_m <= spec.dbh_max_m + 5e-4
        assert 0.0 < tree.crown_base_m <= tree.height_m
        start_m = math.hypot(tree.east_m, tree.north_m) - tree.radius_m
        assert start_m >= mission.placement_radius_m + spec.clearing_m
    assert any((tree.east_m, tree.north_m) == d2[:2] for tree in stand.trees)
    assert all(bush.height_m <= spec.undergrowth_height_m for bush in stand.bushes)
