"""The five conditions, one function after the other, degenerate neighbourhoods included."""

from __future__ import annotations

import math

import pytest

from companion.core.guidance import formation
from companion.core.guidance.formation import LEADER_ROUTE, NOWHERE, Route
from companion.core.model.beacon import NO_ROUTE
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, norm
from mission.common.frames import Vec3
from mission.lanes.spread import LineAbreast
from tests.unit.core.core_kit import neighbour

RANGE_M = 30.0


def up_to(*up: Neighbour) -> Route:
    return Route(9.0, up[0].id if up else 0, 0.0, up)


def at(distance_m: float) -> Vec3:
    return (distance_m, 0.0, 0.0)


# --- the way to the leader ---


def test_link_costs_one_hop_up_to_half_the_range() -> None:
    assert formation.link_cost(0.0, RANGE_M) == formation.link_cost(15.0, RANGE_M) == 1.0


def test_link_at_full_range_costs_twenty_hops_more() -> None:
    assert formation.link_cost(30.0, RANGE_M) == pytest.approx(21.0)


def test_follower_without_neighbours_has_no_route() -> None:
    assert formation.route([], range_m=RANGE_M) == NOWHERE


def test_neighbour_without_a_route_is_no_route() -> None:
    assert formation.route([neighbour(2, at(5.0), route_cost=NO_ROUTE)], range_m=RANGE_M) == NOWHERE


def test_route_goes_through_the_cheapest_neighbour() -> None:
    near_leader, relay = neighbour(2, at(29.0), route_cost=0.0), neighbour(3, at(10.0), route_cost=1.0)
    own = formation.route([near_leader, relay], range_m=RANGE_M)
    assert (own.cost, own.parent, own.parent_distance_m) == (2.0, 3, 10.0)


def test_two_short_hops_beat_a_long_one_and_a_short_one_beats_two() -> None:
    def parent(leader_m: float) -> int:
        swarm = [neighbour(1, at(leader_m), route_cost=0.0), neighbour(2, at(10.0), route_cost=1.0)]
        return formation.route(swarm, range_m=RANGE_M).parent

    assert parent(16.0) == 1
    assert parent(25.0) == 2


def test_of_equal_ways_the_first_heard_is_taken_so_the_choice_is_steady() -> None:
    swarm = [neighbour(4, at(10.0), route_cost=1.0), neighbour(6, at(-10.0), route_cost=1.0)]
    assert formation.route(swarm, range_m=RANGE_M).parent == 4


def test_up_are_all_that_are_a_hop_nearer_to_the_leader() -> None:
    swarm = [
        neighbour(1, at(10.0), route_cost=0.0),
        neighbour(2, at(10.0), route_cost=0.005),
        neighbour(3, at(10.0), route_cost=0.5),
        neighbour(4, at(10.0), route_cost=NO_ROUTE),
    ]
    assert [n.id for n in formation.route(swarm, range_m=RANGE_M).up] == [1, 2]


def test_coincident_neighbour_is_a_way_like_any_other() -> None:
    assert formation.route([neighbour(2, ZERO, route_cost=0.0)], range_m=RANGE_M).cost == 1.0


def test_children_are_those_that_name_me_parent_from_farther_out() -> None:
    own = Route(2.0, 1, 5.0, ())
    swarm = [
        neighbour(2, at(5.0), parent=9, route_cost=3.0),
        neighbour(3, at(5.0), parent=1, route_cost=3.0),
        neighbour(4, at(5.0), parent=9, route_cost=2.0),  # a stale loop
        neighbour(5, at(5.0), parent=9, route_cost=1.0),
    ]
    assert [n.id for n in formation.children(9, own, swarm)] == [2]


# --- 3: slow down rather than lose a link ---


def test_leader_without_followers_may_go_at_full_speed() -> None:
    assert formation.governor(LEADER_ROUTE, [], range_m=RANGE_M) == 1.0


@pytest.mark.parametrize(
    ("distance_m", "share"),
    [(0.0, 1.0), (21.0, 1.0), (24.3, 0.5), (27.6, 0.0), (30.0, 0.0), (500.0, 0.0)],
)
def test_governor_falls_from_full_at_seventy_to_nothing_at_ninety_two_percent_of_the_range(
    distance_m: float, share: float
) -> None:
    assert formation.governor(Route(1.0, 1, distance_m, ()), [], range_m=RANGE_M) == pytest.approx(share, abs=1e-9)


def test_governor_is_that_of_the_slowest_of_the_branch() -> None:
    followers = [neighbour(2, at(5.0), governor=0.8), neighbour(3, at(5.0), governor=0.3)]
    assert formation.governor(LEADER_ROUTE, followers, range_m=RANGE_M) == 0.3
    assert formation.governor(Route(1.0, 1, 27.6, ()), followers, range_m=RANGE_M) == pytest.approx(0.0, abs=1e-9)


# --- 1 and 5: the leader's way ---


def test_leader_cruises_towards_a_far_goal() -> None:
    assert formation.approach((300.0, 400.0, 0.0), cruise_mps=3.0, stop_m=4.0) == pytest.approx((1.8, 2.4, 0.0))


def test_leader_comes_to_rest_at_the_stop_distance() -> None:
    assert formation.approach((4.0, 0.0, 0.0), cruise_mps=3.0, stop_m=4.0) == ZERO
    assert formation.approach(ZERO, cruise_mps=3.0, stop_m=0.0) == ZERO


def test_leader_slows_down_with_one_metre_per_second_squared() -> None:
    speed = norm(formation.approach((8.0, 0.0, 0.0), cruise_mps=3.0, stop_m=4.0))
    assert speed == pytest.approx(math.sqrt(8.0))  # v^2 = 2 a d


@pytest.mark.parametrize("left_m", [0.1, 1.0, 3.0])
def test_leader_flies_the_last_metres_in_proportion_to_what_is_left(left_m: float) -> None:
    speed = norm(formation.approach((4.0 + left_m, 0.0, 0.0), cruise_mps=3.0, stop_m=4.0))
    assert speed == pytest.approx(0.8 * left_m)


# --- 2: alignment and level flight ---


def test_alignment_is_the_mean_of_the_references_up_the_route() -> None:
    own = up_to(
        neighbour(1, at(5.0), ref_ned_mps=(3.0, 0.0, 0.0)),
        neighbour(2, at(6.0), ref_ned_mps=(1.0, 2.0, -0.5)),
    )
    assert formation.alignment(own) == pytest.approx((2.0, 1.0, -0.25))


def test_level_goes_to_the_mean_height_of_those_followed() -> None:
    own = up_to(neighbour(1, (5.0, 0.0, -4.0)), neighbour(2, (5.0, 0.0, 1.0)))
    assert formation.level(own) == pytest.approx((0.0, 0.0, -1.5 * formation.LEVEL_GAIN_PER_S))


@pytest.mark.parametrize("rule", [formation.alignment, formation.level, lambda r: formation.cohesion(r, range_m=30.0)])
def test_vehicle_that_follows_no_one_gets_nothing_from_the_followers_rules(rule: object) -> None:
    assert rule(NOWHERE) == ZERO  # type: ignore[operator]


# --- 4: separation ---


def test_separation_pushes_straight_away_and_harder_the_nearer() -> None:
    near = formation.separation([neighbour(2, at(6.0))], [], soft_m=10.0)
    far = formation.separation([neighbour(2, at(9.0))], [], soft_m=10.0)
    assert near == pytest.approx((-2.4, 0.0, 0.0))
    assert far == pytest.approx((-0.6, 0.0, 0.0))


@pytest.mark.parametrize("distance_m", [10.0, 10.5, 1e6])
def test_separation_leaves_those_beyond_the_soft_distance_alone(distance_m: float) -> None:
    assert formation.separation([neighbour(2, at(distance_m))], [], soft_m=10.0) == ZERO


def test_separation_keeps_clear_of_the_silent_too() -> None:
    assert formation.separation([], [(0.0, 6.0, 0.0)], soft_m=10.0) == pytest.approx((0.0, -2.4, 0.0))


def test_separation_between_two_of_a_pair_cancels() -> None:
    assert formation.separation([neighbour(2, at(5.0)), neighbour(3, at(-5.0))], [], soft_m=10.0) == ZERO


def test_separation_is_at_most_three_metres_per_second() -> None:
    crowd = [neighbour(k, (1.0, 0.01 * k, 0.0)) for k in range(2, 30)]
    assert norm(formation.separation(crowd, [], soft_m=10.0)) == pytest.approx(formation.SEPARATION_LIMIT_MPS)


def test_separation_from_a_coincident_vehicle_has_no_direction() -> None:
    assert formation.separation([neighbour(2, ZERO)], [ZERO], soft_m=10.0) == ZERO


# --- 3: cohesion ---


def test_cohesion_leaves_near_neighbours_alone() -> None:
    near_m = formation.COHESION_START * RANGE_M
    assert formation.cohesion(up_to(neighbour(1, at(near_m))), range_m=RANGE_M) == ZERO
    assert formation.cohesion(up_to(neighbour(1, ZERO)), range_m=RANGE_M) == ZERO


def test_cohesion_pulls_towards_those_farther_off_the_more_the_farther() -> None:
    start_m = formation.COHESION_START * RANGE_M
    by_one = formation.cohesion(up_to(neighbour(1, at(-start_m - 1.0))), range_m=RANGE_M)
    by_two = formation.cohesion(up_to(neighbour(1, at(-start_m - 2.0))), range_m=RANGE_M)
    assert by_one == pytest.approx((-formation.COHESION_GAIN_PER_S, 0.0, 0.0))
    assert by_two == pytest.approx((-2.0 * formation.COHESION_GAIN_PER_S, 0.0, 0.0))


def test_cohesion_pulls_a_strained_link_together_with_all_it_may() -> None:
    pull = formation.cohesion(up_to(neighbour(1, (0.0, 29.0, 0.0))), range_m=RANGE_M)
    assert pull == pytest.approx((0.0, formation.COHESION_LIMIT_MPS, 0.0))


def test_strained_link_counts_for_more_than_its_length() -> None:
    """Of three followed one is strained: beyond eight tenths of the range the pull grows faster than before."""
    near = [neighbour(1, at(5.0)), neighbour(2, at(-5.0))]
    start_m, strain_m = formation.COHESION_START * RANGE_M, formation.STRAIN_START * RANGE_M
    pulls = [norm(formation.cohesion(up_to(*near, neighbour(3, at(strain_m + d))), range_m=RANGE_M)) for d in (0, 2)]
    gain = formation.COHESION_GAIN_PER_S / 3.0
    assert pulls[0] == pytest.approx(gain * (strain_m - start_m))
    assert pulls[1] == pytest.approx(gain * (strain_m + 2.0 - start_m) + 2.0 / 4.0 / 3.0)


@pytest.mark.parametrize("distance_m", [30.0, 30.3, 29.7, 1e5])
def test_cohesion_stays_bounded_at_and_beyond_the_range(distance_m: float) -> None:
    pull = formation.cohesion(up_to(neighbour(1, at(distance_m))), range_m=RANGE_M)
    assert norm(pull) == pytest.approx(formation.COHESION_LIMIT_MPS)


def test_cohesion_looks_at_the_three_nearest_only() -> None:
    three = [neighbour(k, at(20.0)) for k in (1, 2, 3)]
    far = neighbour(4, at(-29.0))
    assert formation.cohesion(up_to(far, *three), range_m=RANGE_M) == formation.cohesion(up_to(*three), range_m=RANGE_M)


def test_cohesion_is_the_mean_pull() -> None:
    far = neighbour(1, at(formation.COHESION_START * RANGE_M + 3.0))
    one = formation.cohesion(up_to(far), range_m=RANGE_M)
    with_a_near_one = formation.cohesion(up_to(far, neighbour(2, at(5.0))), range_m=RANGE_M)
    assert norm(with_a_near_one) == pytest.approx(norm(one) / 2.0)


@pytest.mark.parametrize(
    ("share", "was_bad", "bad"), [(1.0, False, False), (0.35, False, False), (0.35, True, True), (0.25, False, True)]
)
def test_link_that_loses_much_is_bad_until_it_is_clearly_better(share: float, was_bad: bool, bad: bool) -> None:
    own = formation.route([neighbour(2, (10.0, 0.0, 0.0), share=share, route_cost=1.0)], range_m=30.0)
    assert formation.is_link_bad(own, was_bad=was_bad) is bad


@pytest.mark.parametrize(("share", "governed"), [(0.4, 0.89), (0.3, 0.67), (0.1, formation.BAD_LINK_LEAST)])
def test_bad_link_slows_the_swarm_but_never_stops_it(share: float, governed: float) -> None:
    own = formation.route([neighbour(2, (10.0, 0.0, 0.0), share=share, route_cost=1.0)], range_m=30.0)
    assert formation.governor(own, [], range_m=30.0, link_is_bad=True) == pytest.approx(governed, abs=0.01)
    assert formation.governor(own, [], range_m=30.0) == 1.0


def test_bad_link_near_the_end_of_the_range_stops_the_swarm_as_any() -> None:
    own = formation.route([neighbour(2, (29.0, 0.0, 0.0), share=0.2, route_cost=1.0)], range_m=30.0)
    assert formation.governor(own, [], range_m=30.0, link_is_bad=True) == 0.0


# --- line abreast on lanes ---

LINE = LineAbreast(6.0, 8.0)
NORTH = (1.0, 0.0)


def flown_abreast(starts: list[tuple[float, float]], axis: tuple[float, float]) -> list[tuple[float, float]]:
    """Where followers come to, about a leader that rests at (0, 0)."""
    places = list(starts)
    for _ in range(600):
        moved = []
        for k, (n, e) in enumerate(places):
            others = [neighbour(1, (-n, -e, 0.0), route_cost=0.0)]
            others += [
                neighbour(j + 2, (p[0] - n, p[1] - e, 0.0), route_cost=1.0) for j, p in enumerate(places) if j != k
            ]
            to_n, to_e, to_d = formation.line_abreast(others, LINE, axis)
            assert to_d == 0.0
            assert norm((to_n, to_e, to_d)) <= formation.ABREAST_LIMIT_MPS + 1e-9
            moved.append((n + 0.1 * to_n, e + 0.1 * to_e))
        places = moved
    return places


def test_followers_come_to_places_on_both_sides_of_the_leader_every_second_one_behind() -> None:
    found = flown_abreast([(3.0, 1.0), (-9.0, 2.0), (-5.0, -1.0), (-8.0, 7.0)], NORTH)
    wanted = [(0.0, -12.0), (-8.0, -6.0), (-8.0, 6.0), (0.0, 12.0)]
    assert sorted(found, key=lambda p: p[1]) == [pytest.approx(place, abs=1e-3) for place in wanted]


def test_nobody_changes_places_when_the_course_turns_as_the_axis_does_not() -> None:
    settled = flown_abreast([(3.0, 1.0), (-9.0, 2.0), (-5.0, -1.0)], (0.0, 1.0))
    assert flown_abreast(settled, (0.0, 1.0)) == [pytest.approx(place, abs=1e-3) for place in settled]


def test_one_that_does_not_hear_the_leader_and_one_that_hovers_count_for_nothing() -> None:
    beside, hovers = at(5.0), neighbour(3, (0.0, -4.0, 0.0), route_cost=1.0, state=FlightState.HOLD)
    assert formation.line_abreast([neighbour(2, beside, route_cost=1.0)], LINE, NORTH) == ZERO
    leader = neighbour(1, ZERO, route_cost=0.0)
    assert formation.line_abreast([leader, hovers], LINE, NORTH) == formation.line_abreast([leader], LINE, NORTH)
