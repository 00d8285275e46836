"""The safety filter, limit by limit. Over all inputs: tests/property/test_core_safety_laws.py."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.model.events import Position
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, add, dot, norm
from companion.core.perception.obstacle_cloud import Trunk
from companion.core.safety.bounds import TOLERANCE_MPS, Bound, is_inside, keep_within, to_edge, to_edges
from companion.core.safety.clearance import MARGIN_M, SILENT_STRAY_M
from companion.core.safety.response_model import BACK_OFF_MAX_MPS, BACK_OFF_PER_S
from companion.core.safety.safety_filter import AGE_WIDENS_MPS, ERROR_COUNTS_M, SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import applied, surroundings

# With its margin, 5 m are kept between vehicles.
OPEN = replace(SafetyFilter.of(mission()), hard_separation_m=5.0 - MARGIN_M)
SQUARE = ((-30.0, -30.0), (-30.0, 30.0), (30.0, 30.0), (30.0, -30.0))
FENCED = replace(OPEN, polygon_m=SQUARE)


def apply(
    wanted: Vec3,
    *,
    safety_filter: SafetyFilter = OPEN,
    trunks: tuple[Trunk, ...] = (),
    last: Vec3 | None = None,
    pos: Vec3 = (0.0, 0.0, -10.0),
    vel: Vec3 = ZERO,
    neighbours: tuple = (),  # type: ignore[type-arg]
    silent: tuple[Vec3, ...] = (),
    drift: Vec3 = ZERO,
) -> Vec3:
    """What a vehicle high up comes to that keeps wanting this; with `last`, after one tick."""
    before, ticks = (ZERO, 200) if last is None else (last, 1)
    for _ in range(ticks):
        own = Position(pos, vel)
        before = applied(safety_filter, wanted, before, own, neighbours, silent, dt_s=0.05, drift=drift, trunks=trunks)
    return before


def with_tree(rel_ned_m: Vec3, *, pos: Vec3 = (0.0, 0.0, -10.0), trunk: bool = True) -> tuple[Trunk, ...]:
    """The mission's tree at this place from the vehicle."""
    return (Trunk(add(pos, rel_ned_m), 2.0, upright=trunk),)


def test_limits_are_the_missions_with_the_fence_turned_north_east() -> None:
    fence = {"polygon_enu_m": ((-40.0, -50.0), (170.0, -50.0), (170.0, 50.0), (-40.0, 50.0))}
    safety_filter = SafetyFilter.of(mission(fence=fence, limits={"speed_max_mps": 4.0}, separation={"hard_m": 3.0}))
    assert safety_filter.polygon_m == ((-50.0, -40.0), (-50.0, 170.0), (50.0, 170.0), (50.0, -40.0))
    assert (safety_filter.speed_max_mps, safety_filter.hard_separation_m) == (4.0, 3.0)


def test_harmless_setpoint_passes_unchanged() -> None:
    assert apply((3.0, -1.0, 0.5)) == pytest.approx((3.0, -1.0, 0.5))


def test_speed_and_climb_are_limited() -> None:
    assert apply((30.0, 40.0, 0.0)) == pytest.approx((3.0, 4.0, 0.0))
    assert apply((0.0, 0.0, 9.0)) == pytest.approx((0.0, 0.0, 1.5))
    v = apply((5.0, 0.0, -1.5))
    assert norm(v) <= 5.0 + 1e-9
    assert abs(v[2]) <= 1.5


def test_setpoint_changes_no_faster_than_the_acceleration_limit() -> None:
    v = apply((5.0, 0.0, 0.0), last=(-5.0, 0.0, 0.0))
    assert v == pytest.approx((-5.0 + 3.0 * 0.05, 0.0, 0.0))


# --- the speed from which there is still room to stop ---


def test_no_room_means_back_off_in_proportion() -> None:
    assert OPEN.response.closing_mps(0.0) == 0.0
    assert OPEN.response.closing_mps(-0.5) == -0.5 * BACK_OFF_PER_S
    assert OPEN.response.closing_mps(-200.0) == -BACK_OFF_MAX_MPS


def test_more_room_allows_more_speed() -> None:
    speeds = [OPEN.response.closing_mps(0.1 * k) for k in range(500)]
    assert speeds == sorted(speeds)
    assert len(set(speeds)) == 500


@pytest.mark.parametrize("room_m", [0.5, 2.0, 10.0, 40.0])
def test_allowed_speed_stops_within_the_room_after_the_reaction(room_m: float) -> None:
    speed = OPEN.response.closing_mps(room_m)
    assert speed * 0.8 + speed**2 / (2.0 * 0.6 * 3.0) == pytest.approx(room_m)


# --- the fence ---


@pytest.mark.parametrize(
    ("altitude_m", "wanted_down", "admitted_down"),
    [
        (2.0 + MARGIN_M, 1.5, 0.0),
        (30.0 - MARGIN_M, -1.5, 0.0),
        (2.0, 1.5, -MARGIN_M * BACK_OFF_PER_S),  # at the limit: already gives way
        (30.0, -1.5, MARGIN_M * BACK_OFF_PER_S),
        (1.0 + MARGIN_M, 1.5, -BACK_OFF_MAX_MPS),  # too low: climbs
        (0.2, 0.0, -BACK_OFF_MAX_MPS),
        (31.0 - MARGIN_M, -1.5, BACK_OFF_MAX_MPS),  # too high: descends
        (10.0, 1.5, 1.5),
    ],
)
def test_altitude_limits_hold(altitude_m: float, wanted_down: float, admitted_down: float) -> None:
    v = apply((1.0, 0.0, wanted_down), pos=(0.0, 0.0, -altitude_m))
    assert v == pytest.approx((1.0, 0.0, admitted_down), abs=1e-6)


def test_below_the_least_altitude_it_may_climb_as_fast_as_it_likes() -> None:
    assert apply((0.0, 0.0, -1.5), pos=(0.0, 0.0, -1.9)) == pytest.approx((0.0, 0.0, -1.5))


def test_fence_ahead_slows_down_and_beside_does_not() -> None:
    near_the_north_side = (29.0, 0.0, -10.0)
    north, east, _ = apply((3.0, 3.0, 0.0), safety_filter=FENCED, pos=near_the_north_side)
    assert north == pytest.approx(FENCED.response.closing_mps(1.0 - MARGIN_M))
    assert east == pytest.approx(3.0)


def test_sharp_corner_of_the_fence_holds_on_both_sides() -> None:
    """Where each side's cut pushes towards the other side."""
    rise = math.tan(math.radians(30.0))
    wedge = replace(OPEN, polygon_m=((0.0, 0.0), (60.0, 60.0 * rise), (60.0, -60.0 * rise)))
    pos = (4.0, 0.5, -10.0)
    v = apply((-5.0, 1.0, 0.0), safety_filter=wedge, pos=pos)
    for way in to_edges(pos, wedge.polygon_m):
        assert dot(v, way) / norm(way) <= wedge.response.closing_mps(norm(way) - MARGIN_M) + TOLERANCE_MPS


def test_fence_does_not_hold_back_from_leaving_it() -> None:
    assert apply((-4.0, 0.0, 0.0), safety_filter=FENCED, pos=(29.9, 0.0, -10.0)) == pytest.approx((-4.0, 0.0, 0.0))


def test_corner_of_the_fence_holds_on_both_sides() -> None:
    north, east, _ = apply((3.0, 3.0, 0.0), safety_filter=FENCED, pos=(29.0, 29.5, -10.0))
    assert north <= FENCED.response.closing_mps(1.0 - MARGIN_M) + 1e-9
    assert east <= FENCED.response.closing_mps(0.5 - MARGIN_M) + 1e-9


@pytest.mark.parametrize("pos", [(33.0, 5.0, -10.0), (500.0, 0.0, -10.0), (-33.0, -34.0, -10.0)])
def test_vehicle_outside_the_fence_comes_back_whatever_it_wants(pos: Vec3) -> None:
    v = apply((pos[0], pos[1], 0.0), safety_filter=FENCED, pos=pos)
    way_in = min(to_edges(pos, SQUARE), key=norm)
    assert dot(v, way_in) == pytest.approx(norm((*v[:2], 0.0)) * norm(way_in))
    assert 0.0 < math.hypot(v[0], v[1]) <= 5.0 + 1e-9
    assert v[2] == 0.0


def test_neighbour_that_pushes_does_not_carry_one_that_is_outside_further_out() -> None:
    pos = (30.01, 0.0, -10.0)
    pushes = neighbour(2, (-3.0, 0.0, 0.0), vel_ned_mps=(5.0, 0.0, 0.0))
    v = apply((5.0, 0.0, 0.0), safety_filter=FENCED, pos=pos, neighbours=(pushes,))
    assert v[0] == pytest.approx(FENCED.response.closing_mps(-0.01 - MARGIN_M), abs=TOLERANCE_MPS)


def test_hole_of_a_concave_fence_is_outside() -> None:
    letter_l = ((0.0, 0.0), (40.0, 0.0), (40.0, 10.0), (10.0, 10.0), (10.0, 40.0), (0.0, 40.0))
    assert is_inside(5.0, 35.0, letter_l)
    assert is_inside(35.0, 5.0, letter_l)
    assert not is_inside(20.0, 20.0, letter_l)
    assert not is_inside(-1.0, 5.0, letter_l)


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1]], ids=["one way round", "the other"])
def test_fence_may_be_drawn_either_way_round(polygon: tuple[tuple[float, float], ...]) -> None:
    assert is_inside(29.0, -29.0, polygon)
    assert not is_inside(31.0, 0.0, polygon)


def test_nearest_point_of_a_side_may_be_its_corner() -> None:
    assert to_edge((10.0, 10.0, -3.0), (0.0, 0.0), (5.0, 0.0)) == (-5.0, -10.0, 0.0)
    assert to_edge((3.0, 10.0, -3.0), (0.0, 0.0), (5.0, 0.0)) == (0.0, -10.0, 0.0)


# --- neighbours ---


def test_half_of_the_closing_speed_is_each_ones() -> None:
    v = apply((5.0, 0.0, 0.0), neighbours=(neighbour(2, (9.0, 0.0, 0.0)),))
    assert v == pytest.approx((OPEN.response.closing_mps(4.0) / 2.0, 0.0, 0.0))


def test_neighbour_at_the_hard_distance_is_not_closed_on_and_nearer_it_is_backed_off_from() -> None:
    assert apply((5.0, 0.0, 0.0), neighbours=(neighbour(2, (5.0, 0.0, 0.0)),)) == pytest.approx(ZERO, abs=1e-9)
    backs_off = apply((5.0, 0.0, 0.0), neighbours=(neighbour(2, (4.5, 0.0, 0.0)),))
    assert backs_off == pytest.approx((-0.5 * BACK_OFF_PER_S / 2.0, 0.0, 0.0))


def test_sliding_past_a_neighbour_is_free() -> None:
    assert apply((0.0, 4.0, 0.0), neighbours=(neighbour(2, (5.0, 0.0, 0.0)),)) == pytest.approx((0.0, 4.0, 0.0))


def test_following_a_neighbour_at_its_speed_is_free() -> None:
    ahead = neighbour(2, (5.0, 0.0, 0.0), vel_ned_mps=(3.0, 0.0, 0.0))
    assert apply((3.0, 0.0, 0.0), vel=(3.0, 0.0, 0.0), neighbours=(ahead,)) == pytest.approx((3.0, 0.0, 0.0))


def test_closing_is_about_the_mean_velocity_of_the_pair() -> None:
    ahead = neighbour(2, (5.0, 0.0, 0.0), vel_ned_mps=(1.0, 0.0, 0.0))
    assert apply((5.0, 0.0, 0.0), vel=(2.0, 0.0, 0.0), neighbours=(ahead,)) == pytest.approx((1.5, 0.0, 0.0))


@pytest.mark.parametrize("state", [FlightState.RELEASED, FlightState.LANDING, FlightState.WAITING])
def test_one_that_is_not_steered_does_not_give_way_and_is_given_it_all(state: FlightState) -> None:
    hovers = neighbour(2, (9.0, 0.0, 0.0), state=state)
    assert apply((5.0, 0.0, 0.0), neighbours=(hovers,)) == pytest.approx((OPEN.response.closing_mps(4.0), 0.0, 0.0))
    assert apply((5.0, 0.0, 0.0), vel=(3.0, 0.0, 0.0), neighbours=(hovers,))[0] <= OPEN.response.closing_mps(4.0) + 1e-9
    comes = neighbour(2, (9.0, 0.0, 0.0), state=state, vel_ned_mps=(-1.0, 0.0, 0.0))
    assert apply((5.0, 0.0, 0.0), neighbours=(comes,))[0] == pytest.approx(OPEN.response.closing_mps(4.0) - 1.0)


def test_age_of_a_neighbour_widens_the_distance_kept() -> None:
    fresh, old = neighbour(2, (9.0, 0.0, 0.0)), neighbour(2, (9.0, 0.0, 0.0), age_s=0.5)
    assert apply((5.0, 0.0, 0.0), neighbours=(old,))[0] == pytest.approx(OPEN.response.closing_mps(3.5) / 2.0)
    assert apply((5.0, 0.0, 0.0), neighbours=(old,))[0] < apply((5.0, 0.0, 0.0), neighbours=(fresh,))[0]


@pytest.mark.parametrize("late_s", [0.3, 1.0])
def test_a_late_neighbour_may_have_braked_or_turned_meanwhile(late_s: float) -> None:
    late = neighbour(2, (9.0, 0.0, 0.0), late_s=late_s)
    room_m = 4.0 - 0.5 * OPEN.acceleration_max_mps2 * late_s * late_s
    assert apply((5.0, 0.0, 0.0), neighbours=(late,))[0] == pytest.approx(OPEN.response.closing_mps(room_m) / 2.0)


def test_neighbour_whose_beacon_is_overdue_may_hover_silent_whatever_it_said_of_its_speed() -> None:
    """It flew off at 5 m/s when it was heard; by a good radio it would have counted as silent by now."""
    rel, away = (9.0 + SILENT_STRAY_M, 0.0, 0.0), (5.0, 0.0, 0.0)
    told = {"age_s": 1.2, "vel_ned_mps": away, "airborne": True}
    v = apply(away, vel=away, neighbours=(neighbour(2, rel, is_overdue=True, **told),))
    assert v[0] <= apply(away, vel=away, silent=(rel,))[0] + TOLERANCE_MPS
    assert apply(away, vel=away, neighbours=(neighbour(2, rel, **told),))[0] > v[0] + 1.0


@pytest.mark.parametrize("state", [FlightState.TAKING_OFF, FlightState.LANDING])
def test_one_that_is_overdue_on_its_way_up_or_down_may_be_at_every_height(state: FlightState) -> None:
    rel = (6.0, 0.0, 9.0)
    told = {"age_s": 1.2, "airborne": True, "state": state}
    v = apply((5.0, 0.0, 0.0), neighbours=(neighbour(2, rel, is_overdue=True, **told),))
    assert v[0] <= apply((5.0, 0.0, 0.0), silent=((6.0, 0.0, 0.0),))[0] + TOLERANCE_MPS
    rel, sinks = (1.0, 0.0, 6.2), (0.0, 0.0, 1.0)  # and its word frees nobody to come down on it
    told |= {"vel_ned_mps": sinks}
    assert apply(sinks, vel=sinks, neighbours=(neighbour(2, rel, is_overdue=True, **told),))[2] < 0.8


@pytest.mark.parametrize("age_s", [0.0, 0.5])
def test_where_others_hear_one_that_this_vehicle_does_not_counts_as_where_it_hovers(age_s: float) -> None:
    own, wanted = Position((0.0, 0.0, -10.0), ZERO), (5.0, 0.0, 0.0)
    around = surroundings(own, silent=((9.0, 0.0, 0.0),))
    told = Surroundings(own, (), {}, around.cloud, relayed=(((9.0 + age_s * AGE_WIDENS_MPS, 0.0, 0.0), age_s),))
    bounds, as_silent = OPEN.separations(told), OPEN.separations(around)
    assert [bound.most_mps for bound in bounds] == pytest.approx([bound.most_mps for bound in as_silent])
    assert OPEN.apply(wanted, told, dt_s=10.0).vel_ned_mps[0] < 3.0


def test_one_that_hovers_silent_is_an_obstacle_that_does_not_give_way() -> None:
    v = apply((5.0, 0.0, 0.0), silent=((9.0 + SILENT_STRAY_M, 0.0, 0.0),))
    assert v == pytest.approx((OPEN.response.closing_mps(4.0), 0.0, 0.0))
    backs_off = apply((5.0, 0.0, 0.0), silent=((4.5 + SILENT_STRAY_M, 0.0, 0.0),))
    assert backs_off == pytest.approx((-0.5 * BACK_OFF_PER_S, 0.0, 0.0))


def test_coincident_vehicles_and_tree_have_no_direction_and_hold_nothing_back() -> None:
    v = apply((1.0, 2.0, 0.0), trunks=with_tree(ZERO), neighbours=(neighbour(2, ZERO),), silent=(ZERO,))
    assert v == pytest.approx((1.0, 2.0, 0.0))


def test_between_two_that_are_too_near_it_rests() -> None:
    """One of them may say so only to have it pushed at the other."""
    near, nearer = neighbour(2, (0.0, 4.8, 0.0)), neighbour(3, (0.0, -4.2, 0.0))
    _, east, _ = apply((0.0, -2.0, 0.0), neighbours=(near, nearer))
    assert abs(east) <= TOLERANCE_MPS


def test_bounds_that_meet_at_an_angle_are_all_kept() -> None:
    sixty = (0.5, math.sqrt(0.75), 0.0)
    v = keep_within((4.0, 4.0, 0.0), [Bound((1.0, 0.0, 0.0), 1.0), Bound(sixty, 1.0)])
    assert v[0] <= 1.0 + TOLERANCE_MPS
    assert dot(v, sixty) <= 1.0 + TOLERANCE_MPS


# --- the mission's own tree ---


def test_trunk_is_kept_clear_of_at_every_height() -> None:
    v = apply((4.0, 0.0, 1.0), trunks=with_tree((4.0, 0.0, -90.0)))
    assert v == pytest.approx((OPEN.response.closing_mps(2.0 - MARGIN_M), 0.0, 1.0))


def test_point_in_open_sky_is_kept_clear_of_in_space() -> None:
    below = apply((0.0, 0.0, 1.5), trunks=with_tree((0.0, 0.0, 2.5), trunk=False))
    assert below[2] == pytest.approx(OPEN.response.closing_mps(0.5 - MARGIN_M))
    past = apply((5.0, 0.0, 0.0), trunks=with_tree((4.0, 0.0, -90.0), trunk=False))
    assert past == pytest.approx((5.0, 0.0, 0.0))


# --- precedence ---


def test_fence_wins_over_a_neighbour() -> None:
    pressing = neighbour(2, (-3.0, 0.0, 0.0), vel_ned_mps=(5.0, 0.0, 0.0))
    v = apply(ZERO, safety_filter=FENCED, pos=(30.0 - MARGIN_M, 0.0, -10.0), neighbours=(pressing,))
    assert v[0] <= TOLERANCE_MPS


def test_floor_wins_over_a_neighbour() -> None:
    above = neighbour(2, (0.0, 0.0, -3.0), vel_ned_mps=(0.0, 0.0, 5.0))
    assert apply(ZERO, pos=(0.0, 0.0, -2.0 - MARGIN_M), neighbours=(above,))[2] <= TOLERANCE_MPS


def test_trunk_wins_over_a_neighbour() -> None:
    pressing = neighbour(2, (-1.0, 0.0, 0.0))
    v = apply(ZERO, trunks=with_tree((2.0, 0.0, 0.0)), neighbours=(pressing,))
    assert v[0] == pytest.approx(-MARGIN_M * BACK_OFF_PER_S, abs=TOLERANCE_MPS)


def test_neighbour_wins_over_the_wish() -> None:
    assert apply((5.0, 0.0, 0.0), neighbours=(neighbour(2, (4.0, 0.0, 0.0)),))[0] < 0.0


def test_bounds_brake_at_once_and_turning_away_takes_its_time() -> None:
    too_near = neighbour(2, (4.0, 0.0, 0.0))
    v = apply((5.0, 0.0, 0.0), last=(5.0, 0.0, 0.0), neighbours=(too_near,))
    assert v == pytest.approx((-3.0 * 0.05, 0.0, 0.0))


def test_wish_alone_does_not_brake_harder_than_the_limit() -> None:
    assert apply(ZERO, last=(3.0, 0.0, 0.0)) == pytest.approx((3.0 - 3.0 * 0.05, 0.0, 0.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_means_rest(bad: float) -> None:
    assert apply((bad, 0.0, 0.0), last=(3.0, 0.0, 0.0)) == ZERO
    assert apply((1.0, 0.0, 0.0), last=(3.0, 0.0, 0.0), pos=(0.0, bad, 0.0)) == ZERO
    assert apply((1.0, 0.0, 0.0), last=(bad, 0.0, 0.0)) == pytest.approx((0.15, 0.0, 0.0))


def test_ghost_that_is_nowhere_holds_nothing_back() -> None:
    ghosts = (neighbour(2, (math.inf, 0.0, 0.0)), neighbour(3, (math.nan, 0.0, 0.0)))
    assert apply((3.0, 0.0, 0.0), neighbours=ghosts, silent=((math.nan, 0.0, 0.0),)) == pytest.approx((3.0, 0.0, 0.0))


# --- a velocity that lies ---


def test_setpoint_makes_up_for_a_velocity_that_lies() -> None:
    """Told 0.4 m/s too little: what is asked for is that much less."""
    assert apply((3.0, 0.0, 0.0), drift=(0.4, 0.0, 0.0)) == pytest.approx((2.6, 0.0, 0.0))
    assert apply(ZERO, drift=(0.0, -0.4, 0.1)) == pytest.approx((0.0, 0.4, -0.1))


def test_limits_hold_for_the_true_velocity() -> None:
    at_the_margin = (30.0 - MARGIN_M, 0.0, -10.0)
    v = apply((3.0, 0.0, 0.0), safety_filter=FENCED, pos=at_the_margin, drift=(0.4, 0.0, 0.0))
    assert v[0] == pytest.approx(-0.4, abs=TOLERANCE_MPS)


def test_bound_leaves_slower_approaches_alone() -> None:
    assert keep_within((1.0, 2.0, 0.0), [Bound((1.0, 0.0, 0.0), 1.5)]) == (1.0, 2.0, 0.0)


# --- a neighbour that does not know where it is ---


def closing(distance_m: float, error_m: float, its_mps: float = 0.0, own_mps: float = 0.0) -> float:
    """The velocity towards one ahead, as the filter leaves it."""
    lost = neighbour(2, (distance_m, 0.0, 0.0), position_error_m=error_m, vel_ned_mps=(its_mps, 0.0, 0.0))
    own = Position((0.0, 0.0, -8.0), (own_mps, 0.0, 0.0))
    around = surroundings(own, last=(own_mps, 0.0, 0.0), neighbours=(lost,))
    return OPEN.apply((5.0, 0.0, 0.0), around, dt_s=10.0).vel_ned_mps[0]


@pytest.mark.parametrize("its_mps", [-2.0, 0.0, 3.0])
@pytest.mark.parametrize("distance_m", [5.5, 7.0, 9.0])
def test_no_error_that_a_neighbour_says_it_may_have_lets_another_come_nearer(distance_m: float, its_mps: float) -> None:
    """One that flies away by its word, too: of a velocity that it does not know either, nothing frees."""
    without = closing(distance_m, 0.0, its_mps, own_mps=3.0)
    assert closing(distance_m, 0.1, its_mps, own_mps=3.0) <= without + TOLERANCE_MPS


def test_the_error_that_a_neighbour_says_it_may_have_is_kept_besides() -> None:
    assert closing(10.0, 3.0) == pytest.approx(OPEN.response.closing_mps(2.0) / 2.0)
    assert closing(7.0, 3.0) == pytest.approx(-BACK_OFF_MAX_MPS)
    assert closing(7.0, 0.0) == pytest.approx(OPEN.response.closing_mps(2.0) / 2.0)


def test_no_neighbours_word_of_its_error_moves_anybody_further_than_a_bound() -> None:
    assert closing(5.0 + ERROR_COUNTS_M + 2.0, 25.5) == pytest.approx(OPEN.response.closing_mps(2.0) / 2.0)
