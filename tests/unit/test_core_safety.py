"""The last stage, limit by limit. Laws over all inputs and flights: tests/property/test_core_safety_laws.py."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from core_kit import mission, neighbour

from companion.core.safety import MARGIN_M, Envelope, edges, is_inside, keep_within, to_edge
from companion.core.types import ZERO, Position
from companion.core.vec import dot, norm
from mission.frames import Vec3

# With its margin, 5 m are kept between vehicles.
OPEN = replace(Envelope.of(mission()), hard_separation_m=5.0 - MARGIN_M)
SQUARE = ((-30.0, -30.0), (-30.0, 30.0), (30.0, 30.0), (30.0, -30.0))
FENCED = replace(OPEN, polygon_m=SQUARE)


def admit(
    wanted: Vec3,
    *,
    envelope: Envelope = OPEN,
    last: Vec3 | None = None,
    pos: Vec3 = (0.0, 0.0, -10.0),
    vel: Vec3 = ZERO,
    neighbours: tuple = (),  # type: ignore[type-arg]
    fallen: tuple[Vec3, ...] = (),
    dest: Vec3 | None = None,
) -> Vec3:
    """Of a vehicle high up, whose last setpoint was what it wants now unless a test says otherwise."""
    before = wanted if last is None else last
    return envelope.admit(wanted, before, Position(pos, vel), neighbours, fallen, dest, dt_s=0.05)


def test_envelope_is_the_missions_with_the_fence_turned_north_east() -> None:
    fence = {"polygon_enu_m": ((-40.0, -50.0), (170.0, -50.0), (170.0, 50.0), (-40.0, 50.0))}
    envelope = Envelope.of(mission(fence=fence, limits={"speed_max_mps": 4.0}, separation={"hard_m": 3.0}))
    assert envelope.polygon_m == ((-50.0, -40.0), (-50.0, 170.0), (50.0, 170.0), (50.0, -40.0))
    assert (envelope.speed_max_mps, envelope.hard_separation_m, envelope.keep_out_m) == (4.0, 3.0, 2.0)
    assert envelope.trunk


def test_harmless_setpoint_passes_unchanged() -> None:
    assert admit((3.0, -1.0, 0.5)) == (3.0, -1.0, 0.5)


def test_speed_and_climb_are_limited() -> None:
    assert admit((30.0, 40.0, 0.0)) == pytest.approx((3.0, 4.0, 0.0))
    assert admit((0.0, 0.0, 9.0)) == (0.0, 0.0, 1.5)
    v = admit((5.0, 0.0, -1.5))
    assert norm(v) <= 5.0 + 1e-9
    assert abs(v[2]) <= 1.5


def test_setpoint_changes_no_faster_than_the_acceleration_limit() -> None:
    v = admit((5.0, 0.0, 0.0), last=(-5.0, 0.0, 0.0))
    assert v == pytest.approx((-5.0 + 3.0 * 0.05, 0.0, 0.0))


# --- the speed from which there is still room to stop ---


def test_no_room_means_back_off_in_proportion() -> None:
    assert OPEN.closing_mps(0.0) == 0.0
    assert OPEN.closing_mps(-2.0) == -2.0


def test_more_room_allows_more_speed() -> None:
    speeds = [OPEN.closing_mps(0.1 * k) for k in range(500)]
    assert speeds == sorted(speeds)
    assert len(set(speeds)) == 500


@pytest.mark.parametrize("room_m", [0.5, 2.0, 10.0, 40.0])
def test_allowed_speed_stops_within_the_room_after_the_reaction(room_m: float) -> None:
    speed = OPEN.closing_mps(room_m)
    assert speed * 0.8 + speed**2 / (2.0 * 0.6 * 3.0) == pytest.approx(room_m)


# --- the fence ---


@pytest.mark.parametrize(
    ("altitude_m", "wanted_down", "admitted_down"),
    [
        (2.0 + MARGIN_M, 1.5, 0.0),
        (30.0 - MARGIN_M, -1.5, 0.0),
        (2.0, 1.5, -MARGIN_M),  # at the limit: already gives way
        (30.0, -1.5, MARGIN_M),
        (1.0 + MARGIN_M, 1.5, -1.0),  # too low: climbs
        (0.2, 0.0, -1.5),
        (31.0 - MARGIN_M, -1.5, 1.0),  # too high: descends
        (10.0, 1.5, 1.5),
    ],
)
def test_altitude_limits_hold(altitude_m: float, wanted_down: float, admitted_down: float) -> None:
    v = admit((1.0, 0.0, wanted_down), pos=(0.0, 0.0, -altitude_m))
    assert v == pytest.approx((1.0, 0.0, admitted_down))


def test_below_the_least_altitude_it_may_climb_as_fast_as_it_likes() -> None:
    assert admit((0.0, 0.0, -1.5), pos=(0.0, 0.0, -1.9)) == (0.0, 0.0, -1.5)


def test_fence_ahead_slows_down_and_beside_does_not() -> None:
    near_the_north_side = (29.0, 0.0, -10.0)
    north, east, _ = admit((3.0, 3.0, 0.0), envelope=FENCED, pos=near_the_north_side)
    assert north == pytest.approx(FENCED.closing_mps(1.0 - MARGIN_M))
    assert east == 3.0


def test_sharp_corner_of_the_fence_holds_on_both_sides() -> None:
    """Where each side's cut pushes towards the other side."""
    rise = math.tan(math.radians(30.0))
    wedge = replace(OPEN, polygon_m=((0.0, 0.0), (60.0, 60.0 * rise), (60.0, -60.0 * rise)))
    pos = (4.0, 0.5, -10.0)
    v = admit((-5.0, 1.0, 0.0), envelope=wedge, pos=pos)
    for a, b in edges(wedge.polygon_m):
        way = to_edge(pos, a, b)
        assert dot(v, way) / norm(way) <= wedge.closing_mps(norm(way) - MARGIN_M) + 0.1


def test_fence_does_not_hold_back_from_leaving_it() -> None:
    assert admit((-4.0, 0.0, 0.0), envelope=FENCED, pos=(29.9, 0.0, -10.0)) == (-4.0, 0.0, 0.0)


def test_corner_of_the_fence_holds_on_both_sides() -> None:
    north, east, _ = admit((3.0, 3.0, 0.0), envelope=FENCED, pos=(29.0, 29.5, -10.0))
    assert north <= FENCED.closing_mps(1.0 - MARGIN_M) + 1e-9
    assert east <= FENCED.closing_mps(0.5 - MARGIN_M) + 1e-9


@pytest.mark.parametrize("pos", [(33.0, 5.0, -10.0), (500.0, 0.0, -10.0), (-33.0, -34.0, -10.0)])
def test_vehicle_outside_the_fence_comes_back_whatever_it_wants(pos: Vec3) -> None:
    v = admit((pos[0], pos[1], 0.0), envelope=FENCED, pos=pos)
    way_in = min((to_edge(pos, a, b) for a, b in edges(SQUARE)), key=norm)
    assert dot(v, way_in) == pytest.approx(norm((*v[:2], 0.0)) * norm(way_in))
    assert 0.0 < math.hypot(v[0], v[1]) <= 5.0 + 1e-9
    assert v[2] == 0.0


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
    v = admit((5.0, 0.0, 0.0), neighbours=(neighbour(2, (9.0, 0.0, 0.0)),))
    assert v == pytest.approx((OPEN.closing_mps(4.0) / 2.0, 0.0, 0.0))


def test_neighbour_at_the_hard_distance_is_not_closed_on_and_nearer_it_is_backed_off_from() -> None:
    assert admit((5.0, 0.0, 0.0), neighbours=(neighbour(2, (5.0, 0.0, 0.0)),)) == pytest.approx(ZERO)
    assert admit((5.0, 0.0, 0.0), neighbours=(neighbour(2, (3.0, 0.0, 0.0)),)) == pytest.approx((-1.0, 0.0, 0.0))


def test_sliding_past_a_neighbour_is_free() -> None:
    assert admit((0.0, 4.0, 0.0), neighbours=(neighbour(2, (5.0, 0.0, 0.0)),)) == pytest.approx((0.0, 4.0, 0.0))


def test_following_a_neighbour_at_its_speed_is_free() -> None:
    ahead = neighbour(2, (5.0, 0.0, 0.0), vel_ned_mps=(3.0, 0.0, 0.0))
    assert admit((3.0, 0.0, 0.0), vel=(3.0, 0.0, 0.0), neighbours=(ahead,)) == pytest.approx((3.0, 0.0, 0.0))


def test_closing_is_about_the_mean_velocity_of_the_pair() -> None:
    ahead = neighbour(2, (5.0, 0.0, 0.0), vel_ned_mps=(1.0, 0.0, 0.0))
    assert admit((5.0, 0.0, 0.0), vel=(2.0, 0.0, 0.0), neighbours=(ahead,)) == pytest.approx((1.5, 0.0, 0.0))


def test_age_of_a_neighbour_widens_the_distance_kept() -> None:
    fresh, old = neighbour(2, (9.0, 0.0, 0.0)), neighbour(2, (9.0, 0.0, 0.0), age_s=0.5)
    assert admit((5.0, 0.0, 0.0), neighbours=(old,))[0] == pytest.approx(OPEN.closing_mps(3.5) / 2.0)
    assert admit((5.0, 0.0, 0.0), neighbours=(old,))[0] < admit((5.0, 0.0, 0.0), neighbours=(fresh,))[0]


def test_fallen_neighbour_is_an_obstacle_that_does_not_give_way() -> None:
    assert admit((5.0, 0.0, 0.0), fallen=((9.0, 0.0, 0.0),)) == pytest.approx((OPEN.closing_mps(4.0), 0.0, 0.0))
    assert admit((5.0, 0.0, 0.0), fallen=((4.0, 0.0, 0.0),)) == pytest.approx((-1.0, 0.0, 0.0))


def test_coincident_vehicles_and_tree_have_no_direction_and_hold_nothing_back() -> None:
    v = admit((1.0, 2.0, 0.0), neighbours=(neighbour(2, ZERO),), fallen=(ZERO,), dest=(0.0, 0.0, 3.0))
    assert v == (1.0, 2.0, 0.0)


def test_bounds_that_meet_at_an_angle_are_all_kept() -> None:
    sixty = (0.5, math.sqrt(0.75), 0.0)
    v = keep_within((4.0, 4.0, 0.0), [((1.0, 0.0, 0.0), 1.0), (sixty, 1.0)])
    assert v[0] <= 1.0 + 1e-9
    assert dot(v, sixty) <= 1.0 + 1e-9


# --- the tree ---


def test_trunk_is_kept_clear_of_at_every_height() -> None:
    v = admit((4.0, 0.0, 1.0), dest=(4.0, 0.0, -90.0))
    assert v == pytest.approx((OPEN.closing_mps(2.0 - MARGIN_M), 0.0, 1.0))


def test_point_in_open_sky_is_kept_clear_of_in_space() -> None:
    sky = replace(OPEN, trunk=False)
    below = admit((0.0, 0.0, 1.5), envelope=sky, dest=(0.0, 0.0, 2.5))
    assert below[2] == pytest.approx(sky.closing_mps(0.5 - MARGIN_M))
    assert admit((5.0, 0.0, 0.0), envelope=sky, dest=(4.0, 0.0, -90.0)) == (5.0, 0.0, 0.0)


def test_unknown_tree_holds_nothing_back() -> None:
    assert admit((5.0, 0.0, 0.0), dest=None) == (5.0, 0.0, 0.0)


# --- precedence: what comes later wins ---


def test_neighbour_wins_over_the_fence() -> None:
    inside_the_hard_distance = neighbour(2, (-3.0, 0.0, 0.0))
    v = admit(ZERO, envelope=FENCED, pos=(30.0 - 1e-3, 0.0, -10.0), neighbours=(inside_the_hard_distance,))
    assert v[0] == pytest.approx(1.0)


def test_trunk_wins_over_a_neighbour() -> None:
    pressing = neighbour(2, (-1.0, 0.0, 0.0))
    assert admit(ZERO, neighbours=(pressing,), dest=(2.0, 0.0, 0.0)) == pytest.approx((-MARGIN_M, 0.0, 0.0))


def test_separation_may_brake_harder_than_the_acceleration_limit() -> None:
    v = admit((5.0, 0.0, 0.0), last=(5.0, 0.0, 0.0), neighbours=(neighbour(2, (4.0, 0.0, 0.0)),))
    assert v[0] < 0.0


def test_bound_leaves_slower_approaches_alone() -> None:
    assert keep_within((1.0, 2.0, 0.0), [((1.0, 0.0, 0.0), 1.5)]) == (1.0, 2.0, 0.0)
