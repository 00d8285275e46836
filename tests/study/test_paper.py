"""Algorithm 1: what the print does, what the reading does, and how the tables are put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.lab.paper import elections, khopca, table1
from sim_bridge.lab.paper.algorithm1 import LITERAL, Params, Swarm, fly, starts
from sim_bridge.lab.study.results.summary import Group, spread

GRAPHS = 40
SEEDS = list(range(1, 13))


def paper(n: int) -> Mission:
    return load_mission("mission/examples/paper.toml").with_size(n)


def graphs(n: int) -> tuple[np.ndarray, np.ndarray]:
    weights = [khopca.initial_weights(n, np.random.default_rng([seed, n])) for seed in range(GRAPHS)]
    return np.array([elections.graph(n, seed) for seed in range(GRAPHS)]), np.array(weights)


def drawn_as_the_program_does(n: int) -> tuple[np.ndarray, np.ndarray]:
    weights = [khopca.initial_weights(n, np.random.default_rng([seed, n])) for seed in range(GRAPHS)]
    return np.array([elections.graph(n, seed) for seed in range(1, GRAPHS + 1)]), np.array(weights)


# --- elections ---


@pytest.mark.parametrize("n", [4, 8, 12])
def test_printed_election_seldom_ends_with_one_leader_and_never_replaces_a_lost_one(n: int) -> None:
    near, weights = graphs(n)
    after = elections.run_rounds(khopca.printed, weights, near)
    assert elections.one_leader(after).mean() < 0.5
    replaced = elections.replaced(after, near)
    assert replaced.size == (after == khopca.LEADER_ID).any(axis=1).sum() > 0
    assert not replaced.any()
    assert elections.adjacent(after, near).any()


def test_two_adjacent_leaders_stay_for_ever_as_printed_and_not_with_khopca() -> None:
    near = np.ones((1, 3, 3), dtype=np.bool_) & ~np.eye(3, dtype=np.bool_)
    two = np.array([[khopca.LEADER_ID, khopca.LEADER_ID, 1]])
    printed, clean = (elections.run_rounds(rule, two, near) for rule in (khopca.printed, khopca.clean))
    assert list(printed[0][:2]) == [khopca.LEADER_ID] * 2
    assert list(clean[0]) == [khopca.LEADER_ID, 1, 1]


def test_rules_three_and_four_are_dead_code_as_printed() -> None:
    """After rule 2 the weight is leaderID, which rule 3 excludes: only what rules 1 and 2 give ever comes out."""
    rng = np.random.default_rng(1)
    weight = rng.integers(khopca.LEADER_ID, khopca.WEIGHT_LIMIT + 1, (2000, 5))
    near = rng.random((2000, 5)) < 0.6
    near[:, 0] = False
    after = khopca.printed(weight, near, 0)
    least = np.where(near, weight, 99).min(axis=1)
    most = np.where(near, weight, -1).max(axis=1)
    first_two = np.where(least < weight[:, 0], np.where(most == khopca.WEIGHT_LIMIT, 0, least + 1), weight[:, 0])
    assert (after == first_two).all()


@pytest.mark.parametrize(("n", "share"), [(4, 0.60), (8, 0.20), (12, 0.025)])
def test_rules_one_after_the_other_give_one_leader_seldom_and_replace_most_that_are_lost(n: int, share: float) -> None:
    near, weights = drawn_as_the_program_does(n)
    after = elections.run_rounds(khopca.unnested, weights, near)
    assert elections.one_leader(after).mean() == share
    assert (after == khopca.LEADER_ID).any(axis=1).all()
    assert elections.replaced(after, near, khopca.unnested).mean() >= 0.75


@pytest.mark.parametrize("n", [4, 12])
def test_clean_khopca_settles_with_no_two_adjacent_leaders(n: int) -> None:
    near, weights = graphs(n)
    after = elections.run_rounds(khopca.clean, weights, near)
    assert (elections.run_round(khopca.clean, after, near) == after).all()
    assert not elections.adjacent(after, near).any()
    assert (after == khopca.LEADER_ID).any(axis=1).all()


def test_where_nobody_leads_there_is_no_share_of_replaced_leaders() -> None:
    near = np.ones((1, 3, 3), dtype=np.bool_) & ~np.eye(3, dtype=np.bool_)
    assert elections.share(elections.replaced(np.array([[1, 2, 3]]), near)) == "-"
    # Of 4 and none: 1 - 0.025^(1/4) = 0.60
    assert elections.share(np.zeros(4, dtype=np.bool_)) == "0 % (0-60), of 4"


def test_greatest_weight_decides_whether_the_printed_rules_make_a_leader() -> None:
    near = np.ones((1, 2, 2), dtype=np.bool_) & ~np.eye(2, dtype=np.bool_)
    weight = np.array([[4, 6]])
    assert list(khopca.printed(weight, near[:, 1], 1, limit=4)) == [khopca.LEADER_ID]
    assert list(khopca.printed(weight, near[:, 1], 1, limit=8)) == [5]


# --- movement ---


@pytest.mark.parametrize("n", [4, 8, 12])
def test_reading_comes_within_eight_percent_of_the_paper(n: int) -> None:
    flown = fly(paper(n), SEEDS, Params())
    times = [f.arrival_leader_s for f in flown if f.arrival_leader_s is not None]
    assert len(times) == len(SEEDS)
    assert sum(times) / len(times) == pytest.approx(table1.paper_mean(n), rel=table1.WITHIN)
    assert all(f.connected_fraction_transit == 1.0 for f in flown)


@pytest.mark.parametrize("n", [4, 8])
def test_mean_position_and_the_last_arrive_after_the_leader(n: int) -> None:
    leader, centroid, last = (
        [f.arrival_leader_s for f in fly(paper(n), SEEDS, Params.model_validate({"arrival_of": what}))]
        for what in ("leader", "centroid", "all")
    )
    for first, second, third in zip(leader, centroid, last, strict=True):
        assert first is not None
        assert second is not None
        assert third is not None
        assert max(first, second) <= third
    assert np.mean([t for t in leader if t]) < np.mean([t for t in centroid if t])


def test_print_flies_apart_and_nobody_arrives() -> None:
    flown = fly(paper(8), SEEDS, Params.model_validate(LITERAL))
    assert not any(f.arrived for f in flown)
    assert all(f.arrival_leader_s is None for f in flown)
    assert all((f.connected_fraction_transit or 0.0) < 1.0 for f in flown)


def test_separation_as_printed_is_enough_to_scatter_the_swarm() -> None:
    for flown in fly(paper(8), SEEDS, Params(separation_m=100.0)):
        assert not flown.arrived
        assert (flown.connected_fraction_transit or 0.0) < 0.5


def test_speed_without_limit_breaks_up_most_swarms_and_the_rest_come_far_too_soon() -> None:
    flown = fly(paper(8), SEEDS, Params(speed_is_limited=False))
    assert sum(f.arrived for f in flown) < len(flown) / 2
    assert all(f.arrival_leader_s is None or f.arrival_leader_s < 100.0 for f in flown)


def test_with_a_sum_for_the_centre_the_number_of_uavs_costs_nothing() -> None:
    """It pulls away from the origin of the coordinates, on whose diagonal d2 happens to lie: nobody need be led."""
    for n in (4, 12):
        times = [f.arrival_leader_s for f in fly(paper(n), SEEDS, Params(centre_is_mean=False))]
        assert np.mean([t for t in times if t is not None]) == pytest.approx(179.5, abs=2.5)


def test_one_neighbour_divides_by_zero_as_printed() -> None:
    swarm = Swarm(paper(2), [1, 2], Params.model_validate({"alignment_is_mean": False}))
    with np.errstate(all="ignore"):
        swarm.run_pass()
        swarm.run_pass()
    assert np.isnan(swarm.pos_enu_m).any()
    assert swarm.over.all()


def test_moving_all_at_once_costs_more_and_more_with_n() -> None:
    late = []
    for n in (8, 12):
        both = [fly(paper(n), SEEDS, Params.model_validate({"update": how})) for how in ("parallel", "in-place")]
        late.append(np.mean([f.overhead_last for f in both[0]]) - np.mean([f.overhead_last for f in both[1]]))
    assert 0.1 < late[0] < late[1]


def test_uavs_start_in_a_ball_about_d1() -> None:
    places = starts(paper(12), SEEDS, 2.0) - 25.0
    reach = np.linalg.norm(places, axis=2)
    assert reach.max() <= 2.0
    # Half of a ball's volume is beyond 0.794 of its radius
    assert (reach > 2.0 * 0.5 ** (1 / 3)).mean() == pytest.approx(0.5, abs=0.1)


def test_a_flight_does_not_depend_on_its_batch() -> None:
    together = fly(paper(4), [1, 2, 3, 4, 5], Params())
    assert together == [*fly(paper(4), [1, 2], Params()), *fly(paper(4), [3, 4, 5], Params())]


# --- table I ---


def group(n: int, times: list[float], run: str = "paper mode") -> Group:
    found = spread(times)
    assert found is not None
    figures = {"arrival_leader_s": found, "overhead_leader": found, "overhead_last": found}
    return Group(run, "algorithm1", "point-mass", n, {}, len(times), 0, len(times), figures)


def test_paper_mode_has_to_reach_the_paper_with_its_interval() -> None:
    near = [group(n, [table1.paper_mean(n) + d for d in (-1, 1, 0)]) for n in table1.SIZES]
    assert table1.reached(near)
    assert not table1.reached(near[:2])
    assert not table1.reached([*near[:2], group(12, [210.0, 212.0])])
    # The mean is within, its interval not
    assert not table1.reached([*near[:2], group(12, [200.0, 290.0])])
    # Nobody arrived, or too few
    assert not table1.reached([*near[:2], replace(near[2], figures={})])
    assert not table1.reached([*near[:2], replace(near[2], flights=4)])


def test_table_has_the_papers_rows_and_ours() -> None:
    lines = list(table1.table([group(4, [190.0, 192.0])]))
    assert any(line.startswith("| the paper | 12 | 5/5 | 244.6 |") for line in lines)
    assert lines[-1].startswith("| paper mode | 4 | 2/2 | 191.0 ± ")
    assert len({line.count("|") for line in lines if line.startswith("|")}) == 1
