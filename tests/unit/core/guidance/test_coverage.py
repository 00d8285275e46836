"""Coverage, case by case. Whether it converges: tests/scenario/test_coverage_spreads.py."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pytest

from companion.core.guidance import coverage
from companion.core.guidance.coverage import SPREAD_LIMIT_MPS
from companion.core.model.vectors import ZERO, norm
from mission.common.frames import Vec3

R = 15.0
WAIT_M = 10.0
CLEAR_M = 6.0
SOUTH_OF_TREE = (R, 0.0, 0.0)  # the tree is north
HEARS_ACROSS, HEARS_BESIDE = 2.0 * R, R


def ring(
    dest_ned_m: Vec3,
    peers: Sequence[Vec3] = (),
    *,
    range_m: float = HEARS_ACROSS,
    size: int | None = None,
    is_free: Callable[[float, float], bool] | None = None,
    stranded: Sequence[Vec3] = (),
    told: Sequence[Vec3] = (),
) -> Vec3:
    """`size`: no more than are heard, unless a test says otherwise."""
    return coverage.ring(
        dest_ned_m,
        peers,
        size=len(peers) + 1 if size is None else size,
        radius_m=R,
        wait_m=WAIT_M,
        range_m=range_m,
        is_free=is_free,
        stranded_rel_ned_m=stranded,
        told_rel_ned_m=told,
        clear_m=CLEAR_M,
    )


def trunk(radius_m: float) -> Callable[[float, float], bool]:
    """Stands where the vehicle is, and leaves no place within `radius_m`."""
    return lambda north, east: math.hypot(north, east) > radius_m


def test_vehicle_alone_on_the_ring_rests() -> None:
    assert norm(ring(SOUTH_OF_TREE)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("distance_m", "north_mps"), [(17.0, 1.0), (13.0, -1.0), (500.0, 3.0), (5.0, -3.0)])
def test_ring_is_reached_radially_and_at_limited_speed(distance_m: float, north_mps: float) -> None:
    assert ring((distance_m, 0.0, 0.0)) == pytest.approx((north_mps, 0.0, 0.0))


@pytest.mark.parametrize("range_m", [HEARS_ACROSS, HEARS_BESIDE])
def test_vehicle_moves_into_the_wider_of_its_gaps(range_m: float) -> None:
    """South of the tree, with a peer east of it: the gap through the west is the wider one."""
    east_of_tree = (R, R, 0.0)
    velocity = ring(SOUTH_OF_TREE, [east_of_tree], range_m=range_m)
    assert velocity[1] == pytest.approx(-SPREAD_LIMIT_MPS)
    west_of_tree = (R, -R, 0.0)
    assert ring(SOUTH_OF_TREE, [west_of_tree], range_m=range_m)[1] == pytest.approx(SPREAD_LIMIT_MPS)


@pytest.mark.parametrize("n", range(2, 13))
@pytest.mark.parametrize("range_m", [HEARS_ACROSS, HEARS_BESIDE])
def test_evenly_spread_vehicles_rest(n: int, range_m: float) -> None:
    places = [(R * math.cos(math.tau * k / n), R * math.sin(math.tau * k / n), 0.0) for k in range(n)]
    here, *others = places
    peers = [(p[0] - here[0], p[1] - here[1], 0.0) for p in others]
    assert norm(ring((-here[0], -here[1], 0.0), peers, range_m=range_m)) == pytest.approx(0.0, abs=1e-9)


def test_vehicle_that_hears_only_beside_it_goes_midway_between_those() -> None:
    """On a ring too wide to hear across, the two it hears are not all there are."""
    ahead, behind = (2.0, -8.0, 0.0), (2.0, 8.0, 0.0)
    assert norm(ring(SOUTH_OF_TREE, [ahead, behind], range_m=HEARS_BESIDE)) == pytest.approx(0.0, abs=1e-9)


def test_where_a_trunk_stands_in_its_place_it_keeps_a_little_off_the_ring() -> None:
    outward_mps = coverage.RADIAL_GAIN_PER_S * 0.5
    assert ring(SOUTH_OF_TREE, is_free=trunk(0.4)) == pytest.approx((-outward_mps, 0.0, 0.0))
    assert ring(SOUTH_OF_TREE, is_free=lambda north, _: north > 0.0) == pytest.approx((outward_mps, 0.0, 0.0))


def test_where_a_thick_trunk_stands_in_its_place_it_goes_along_the_ring_to_the_next_that_is_free() -> None:
    velocity = ring(SOUTH_OF_TREE, is_free=trunk(2.2))
    assert abs(velocity[1]) == pytest.approx(coverage.RING_GAIN_PER_S * 1.5, abs=0.3)
    ahead = ring(SOUTH_OF_TREE, is_free=lambda north, east: trunk(2.2)(north, east) and east > 0.0)
    assert ahead[1] > 0.5


def test_where_no_place_is_free_it_keeps_its_own() -> None:
    assert norm(ring(SOUTH_OF_TREE, is_free=trunk(20.0))) == pytest.approx(0.0, abs=1e-12)


def test_ring_is_flown_at_the_height_of_the_destination() -> None:
    assert ring((R, 0.0, 3.0))[2] == pytest.approx(1.5)
    assert ring((R, 0.0, -3.0))[2] == pytest.approx(-1.5)


def test_height_of_others_does_not_change_the_way_round() -> None:
    assert ring(SOUTH_OF_TREE, [(R, R, 0.0)]) == ring(SOUTH_OF_TREE, [(R, R, -9.0)])


def test_straggler_does_not_enter_the_ring_where_it_is_crowded() -> None:
    """Twelve metres out, right behind one that is on the ring: no nearer."""
    outside, on_the_ring = (R + 12.0 - 4.0, 0.0, 0.0), (8.0, 0.1, 0.0)
    assert ring(outside)[0] > 1.0
    assert ring(outside, [on_the_ring])[0] == pytest.approx(0.0, abs=0.1)


def test_straggler_comes_up_to_the_place_where_it_waits() -> None:
    outside, on_the_ring = (R + WAIT_M + 2.0, 0.0, 0.0), (WAIT_M + 2.0, 0.1, 0.0)
    assert ring(outside, [on_the_ring])[0] == pytest.approx(1.0, abs=0.05)


def test_over_the_axis_no_direction_is_outward() -> None:
    assert ring((0.0, 0.0, 5.0), [(3.0, 0.0, 0.0)]) == ZERO
    assert coverage.sphere(ZERO, [(3, (3.0, 0.0, 0.0))], me=1, radius_m=R) == ZERO


def test_peer_on_the_axis_or_at_the_same_place_is_no_error() -> None:
    for peer in (SOUTH_OF_TREE, ZERO):
        assert all(map(math.isfinite, ring(SOUTH_OF_TREE, [peer])))
        assert all(map(math.isfinite, coverage.sphere(SOUTH_OF_TREE, [(3, peer)], me=1, radius_m=R)))


@pytest.mark.parametrize("range_m", [HEARS_ACROSS, HEARS_BESIDE])
@pytest.mark.parametrize("reaches", [(R, R + 6.0), (R - 5.0, R), (R + 3.0, R + 9.0)])
def test_two_at_the_same_bearing_part(range_m: float, reaches: tuple[float, float]) -> None:
    """One right behind the other as seen from the tree, and so with the same idea of where to go."""
    places = [(reach, 0.0) for reach in reaches]
    for _ in range(1200):
        velocities = []
        for here, other in (places, places[::-1]):
            rel = (other[0] - here[0], other[1] - here[1], 0.0)
            velocities.append(ring((-here[0], -here[1], 0.0), [rel], range_m=range_m))
        places = [(p[0] + 0.05 * v[0], p[1] + 0.05 * v[1]) for p, v in zip(places, velocities, strict=True)]
    bearings = [math.atan2(p[1], p[0]) for p in places]
    assert math.cos(bearings[0] - bearings[1]) == pytest.approx(-1.0, abs=1e-3)
    assert [math.hypot(*p) for p in places] == pytest.approx([R, R], abs=0.05)


def at(bearing_deg: float, reach_m: float = R) -> Vec3:
    """Relative to a vehicle south of the tree; bearings about the tree, clockwise from that vehicle."""
    bearing = math.radians(180.0 + bearing_deg)
    return R + reach_m * math.cos(bearing), reach_m * math.sin(bearing), 0.0


def test_one_that_is_stranded_has_no_rank() -> None:
    assert norm(ring(SOUTH_OF_TREE, [at(180.0)], stranded=[at(90.0)])) == pytest.approx(0.0, abs=1e-9)
    assert norm(ring(SOUTH_OF_TREE, [at(180.0), at(90.0)])) > 0.5


def test_beside_one_that_is_stranded_a_vehicle_keeps_its_clearance() -> None:
    away = ring(SOUTH_OF_TREE, [at(180.0)], stranded=[at(10.0)])
    assert away[1] > 0.5  # east: anticlockwise
    assert norm(ring(SOUTH_OF_TREE, [at(180.0)], stranded=[at(24.0)])) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("its_reach_m", [R - 1.2, R, R + 0.8])
@pytest.mark.parametrize("bearing_deg", [22.0, 21.0, 20.0])
def test_beside_one_that_is_stranded_a_vehicle_stays_on_the_ring(bearing_deg: float, its_reach_m: float) -> None:
    """Its position is up to 0.8 m too near: another was found up to 1.5 m off the ring."""
    north_mps, east_mps, _ = ring(SOUTH_OF_TREE, [at(180.0)], stranded=[at(bearing_deg, its_reach_m)])
    assert east_mps > 0.0
    assert north_mps == pytest.approx(0.0, abs=1e-9)


def test_beside_a_trunk_and_one_that_is_stranded_a_vehicle_leaves_the_ring_for_the_trunk_alone() -> None:
    """A trunk stands in the next position that is far enough from the one that is stranded."""
    along_m = 0.5
    north_m, east_m = R * (1.0 - math.cos(along_m / R)), R * math.sin(along_m / R)

    def is_free(north: float, east: float) -> bool:
        return math.hypot(north - north_m, east - east_m) > 0.4

    velocity = ring(SOUTH_OF_TREE, [at(180.0)], stranded=[at(22.0)], is_free=is_free)
    assert velocity[0] != pytest.approx(0.0, abs=0.1)
    assert velocity[1] > 0.0


@pytest.mark.parametrize(("told_deg", "along_m"), [(60.0, 3.27), (32.0, 2.27), (27.0, 0.77), (15, 0), (-20.0, 3.27)])
def test_it_comes_to_rest_no_nearer_to_where_others_have_one_that_is_stranded(told_deg: float, along_m: float) -> None:
    """And none of their words moves it back: its position is 3.3 m clockwise, by what it knows itself."""
    clockwise_mps = -ring(SOUTH_OF_TREE, [at(205.0)], stranded=[at(70.0)], told=[at(told_deg)])[1]
    assert clockwise_mps == pytest.approx(along_m * coverage.RING_GAIN_PER_S, abs=0.01)


def test_off_the_ring_it_comes_no_nearer_to_one_that_is_stranded() -> None:
    """The nearest position that the trunk leaves free is outward, and so is one that hovers 6.2 m off the ring."""
    assert ring(SOUTH_OF_TREE, is_free=trunk(0.4))[0] < -0.1
    assert ring(SOUTH_OF_TREE, stranded=[at(0.0, R + CLEAR_M + 0.2)], is_free=trunk(0.4))[0] > 0.1


@pytest.mark.parametrize("bearing_deg", [24.0, -18.0])
def test_one_that_is_stranded_is_passed_outside(bearing_deg: float) -> None:
    """Those heard are anticlockwise, so its position is far clockwise: behind the one stranded ahead, or past it."""
    heard = [at(-20.0), at(-40.0)]
    assert ring(SOUTH_OF_TREE, heard)[0] == pytest.approx(0.0, abs=0.01)
    assert ring(SOUTH_OF_TREE, heard, stranded=[at(bearing_deg)])[0] < -1.0
    inside = at(bearing_deg, R - CLEAR_M - 3.0)
    assert ring(SOUTH_OF_TREE, heard, stranded=[inside])[0] == pytest.approx(0.0, abs=0.01)


def test_vehicle_at_its_position_beside_one_that_is_stranded_does_not_wait_for_room() -> None:
    """Room is short on both sides: outside it would wait, were it not where it belongs."""
    outside = (R + 2.0, 0.0, 0.0)
    crowded = [(2.0 + rel[0], rel[1], 0.0) for rel in (at(50.0), at(-50.0), at(180.0))]
    assert ring(outside, crowded)[0] == pytest.approx(0.0, abs=0.1)
    assert ring(outside, crowded, stranded=[(2.0 + at(25.0)[0], at(25.0)[1], 0.0)])[0] > 0.5


def test_sphere_is_reached_radially() -> None:
    assert coverage.sphere((0.0, 0.0, R + 2.0), [], me=1, radius_m=R) == pytest.approx((0.0, 0.0, 1.0))
    assert norm(coverage.sphere((0.0, 0.0, R), [], me=1, radius_m=R)) == pytest.approx(0.0, abs=1e-12)


def test_on_the_sphere_others_push_along_it() -> None:
    velocity = coverage.sphere((R, 0.0, 0.0), [(3, (0.5, 4.0, 0.0))], me=1, radius_m=R)
    assert velocity[0] == pytest.approx(0.0, abs=1e-9)
    assert velocity[1] < -0.1


def test_opposite_point_of_the_sphere_is_at_rest() -> None:
    assert norm(coverage.sphere((R, 0.0, 0.0), [(3, (2 * R, 0.0, 0.0))], me=1, radius_m=R)) == pytest.approx(
        0.0, abs=1e-9
    )


def test_sphere_never_asks_for_more_than_its_limit() -> None:
    crowd = [(k, (0.01 * k, 0.2, 0.0)) for k in range(2, 21)]
    assert norm(coverage.sphere((90.0, 0.0, 0.0), crowd, me=1, radius_m=R)) <= SPREAD_LIMIT_MPS + 1e-9


def test_on_one_level_an_odd_id_goes_down_and_an_even_one_up() -> None:
    beside = (0.5, 4.0, 0.0)
    down, up = (coverage.sphere((R, 0.0, 0.0), [(3 - me, beside)], me=me, radius_m=R)[2] for me in (1, 2))
    assert up == pytest.approx(-down)
    assert up < -0.1
    assert coverage.sphere((R, 0.0, 0.0), [(3, beside)], me=1, radius_m=R)[2] == 0.0
    apart = (0.5, 4.0, coverage.LIFT_M)
    assert coverage.sphere((R, 0.0, 0.0), [(2, apart)], me=1, radius_m=R) == coverage.sphere(
        (R, 0.0, 0.0), [(3, apart)], me=1, radius_m=R
    )


def around_tree(*bearings_deg: float, radius_m: float = R, down_m: float = 0.0) -> list[Vec3]:
    angles = [math.radians(bearing) for bearing in bearings_deg]
    return [(radius_m * math.cos(a), radius_m * math.sin(a), down_m) for a in angles]


EIGHT = [45.0 * k for k in range(8)]


@pytest.mark.parametrize(
    ("bearings_deg", "hidden", "formed"),
    [
        (EIGHT, 0, True),
        ([10.0 + bearing for bearing in EIGHT], 0, True),
        (EIGHT[1:], 0, False),  # one has just been lost
        ([51.0 * k for k in range(7)], 0, True),  # ... and the others have closed up
        (EIGHT[1:], 1, True),  # the trunk hides one
        (EIGHT[4:], 1, False),  # of several next to each other one is hidden
        ([0.0, 90.0, 180.0, 270.0], 4, True),
        ([0.0, 45.0, 90.0, 135.0, 180.0], 0, False),
        ([77.0], 0, True),
        ([0.0, 180.0], 0, True),
        ([], 0, False),
    ],
)
def test_ring_without_a_wide_gap_is_formed(bearings_deg: list[float], hidden: int, formed: bool) -> None:
    from_tree = around_tree(*bearings_deg)
    assert coverage.is_formed(from_tree, hidden=hidden, radius_m=R, is_ring=True) is formed


@pytest.mark.parametrize(("off_m", "formed"), [(1.9, True), (-1.9, True), (2.1, False), (-2.1, False)])
def test_nobody_may_be_off_a_formed_ring(off_m: float, formed: bool) -> None:
    from_tree = around_tree(*EIGHT[1:]) + around_tree(0.0, radius_m=R + off_m, down_m=3.0)
    assert coverage.is_formed(from_tree, hidden=0, radius_m=R, is_ring=True) is formed


def test_sphere_is_formed_when_all_are_on_it() -> None:
    pole = (0.0, 0.0, -R)
    assert coverage.is_formed([pole, *around_tree(0.0, 10.0)], hidden=0, radius_m=R, is_ring=False)
    low = around_tree(0.0, down_m=-10.0)  # R off in the plane, 18 m in space
    assert not coverage.is_formed([pole, *low], hidden=0, radius_m=R, is_ring=False)
    assert not coverage.is_formed([pole], hidden=0, radius_m=R, is_ring=True)
