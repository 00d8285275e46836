"""Lanes over drawn polygons: each point is passed on two sides, by a lane that is as long as that takes."""

from __future__ import annotations

import math
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mission.common.plane import Point, clearance_m, polygon_fault, way_clearance_m
from mission.lanes.lay import Lane, Swath, axis_of, lay_lanes
from mission.lanes.spread import line_abreast, swath_of

ENDS = ((-20.0, 0.0), (-20.0, 20.0))
ROUNDED_M = 0.02  # ends are to 1 cm


@st.composite
def areas(draw: st.DrawFn) -> tuple[Point, ...]:
    """Polygons about a middle, most of them concave."""
    corners = draw(st.integers(3, 10))
    radii = draw(st.lists(st.floats(8.0, 70.0), min_size=corners, max_size=corners))
    turns = draw(st.lists(st.floats(0.05, 0.95), min_size=corners, max_size=corners))
    at = [math.tau * (k + turn) / corners for k, turn in enumerate(turns)]
    area = tuple((round(60.0 + r * math.cos(a), 2), round(r * math.sin(a), 2)) for r, a in zip(radii, at, strict=True))
    return ((40.0, -30.0), (90.0, -20.0), (70.0, 40.0)) if polygon_fault(area) else area


def swath_for(size: int, soft_m: float, reach_m: float) -> Swath:
    line = line_abreast(size=size, soft_m=soft_m, reach_m=reach_m, range_m=55.0)
    return swath_of(line=line, size=size, reach_m=reach_m, lane_m=None)


SIZES, SOFT_M = st.sampled_from([1, 2, 4, 8, 12]), st.sampled_from([8.0, 10.0, 14.0])
SWATHS = st.builds(swath_for, SIZES, SOFT_M, st.sampled_from([5.0, 7.0]))


def across_m(point: Point, lane: Lane) -> float | None:
    """How far from the lane's line, left of it as it lies west to east or south to north; None: it is not that long."""
    a, b = sorted((lane.start, lane.end))
    length_m = math.dist(a, b)
    u = ((b[0] - a[0]) / length_m, (b[1] - a[1]) / length_m)
    off = (point[0] - a[0], point[1] - a[1])
    along_m = off[0] * u[0] + off[1] * u[1]
    return off[1] * u[0] - off[0] * u[1] if -ROUNDED_M <= along_m <= length_m + ROUNDED_M else None


def points_in(area: tuple[Point, ...], step_m: float) -> list[Point]:
    east, north = zip(*area, strict=True)
    grid = [
        (min(east) + (i + 0.5) * step_m, min(north) + (j + 0.5) * step_m)
        for i in range(math.ceil((max(east) - min(east)) / step_m))
        for j in range(math.ceil((max(north) - min(north)) / step_m))
    ]
    return [point for point in grid if clearance_m(point, area) > 0.0]


@given(areas(), st.sampled_from([5.0, 7.0, 15.0]))
def test_one_vehicle_passes_each_point_on_both_sides(area: tuple[Point, ...], reach_m: float) -> None:
    one = swath_for(1, 10.0, reach_m)
    lanes = lay_lanes(area, one, ENDS)
    for point in points_in(area, 4.0):
        off_m = [m for m in (across_m(point, lane) for lane in lanes) if m is not None]
        assert any(-ROUNDED_M <= m <= one.lane_m + ROUNDED_M for m in off_m), point
        assert any(-one.lane_m - ROUNDED_M <= m <= ROUNDED_M for m in off_m), point


@given(areas(), SWATHS)
def test_each_point_is_within_the_swath_of_a_lane(area: tuple[Point, ...], swath: Swath) -> None:
    lanes = lay_lanes(area, swath, ENDS)
    half_m = swath.lane_m - swath.spread_m / 2.0  # the swarm on one side of the lane, and what its outermost sees
    for point in points_in(area, 4.0):
        off_m = [abs(m) for m in (across_m(point, lane) for lane in lanes) if m is not None]
        assert min(off_m) <= half_m + ROUNDED_M, point


@given(areas(), SWATHS)
def test_lanes_go_no_farther_beyond_the_area_than_they_say(area: tuple[Point, ...], swath: Swath) -> None:
    for lane in lay_lanes(area, swath, ENDS):
        a, b = lane.start, lane.end
        axis = axis_of(lane)
        for here, there in ((a, b), (b, a)):
            length_m = math.dist(here, there)
            is_first = (there[0] - here[0]) * axis[0] + (there[1] - here[1]) * axis[1] > 0.0
            share = (swath.before_m if is_first else swath.beyond_m) / length_m
            begins = (here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1]))
            reach_m = max(swath.lane_m, swath.inset_m) + ROUNDED_M  # of the strip that the lane is flown for
            assert clearance_m(begins, area) >= -reach_m


@given(areas(), SWATHS)
def test_a_fence_with_room_all_round_is_kept_from(area: tuple[Point, ...], swath: Swath) -> None:
    slack_m = 5.0 + swath.spread_m / 2.0
    room_m = slack_m + swath.beyond_m + swath.lane_m
    (low_e, high_e), (low_n, high_n) = ((min(axis) - room_m, max(axis) + room_m) for axis in zip(*area, strict=True))
    fence = ((low_e, low_n), (high_e, low_n), (high_e, high_n), (low_e, high_n))
    lanes = lay_lanes(area, swath, ENDS, fence, slack_m)
    ends = [end for lane in lanes for end in (lane.start, lane.end)]
    assert all(way_clearance_m(a, b, fence) >= slack_m - ROUNDED_M for a, b in pairwise(ends))


def test_a_notch_that_is_outside_the_fence_is_not_crossed() -> None:
    """Three sides about a lake: lanes east and west would cross it, and be fewer."""
    area = (
        (0.0, 0.0),
        (150.0, 0.0),
        (150.0, 60.0),
        (110.0, 60.0),
        (110.0, 20.0),
        (40.0, 20.0),
        (40.0, 60.0),
        (0.0, 60.0),
    )
    fence = (
        (-15.0, -15.0),
        (165.0, -15.0),
        (165.0, 75.0),
        (98.0, 75.0),
        (98.0, 32.0),
        (52.0, 32.0),
        (52.0, 75.0),
        (-15.0, 75.0),
    )
    one = swath_for(1, 10.0, 7.0)
    crossing, kept = lay_lanes(area, one, ENDS), lay_lanes(area, one, ENDS, fence, 5.0)
    for lanes, leaves in ((crossing, True), (kept, False)):
        ends = [end for lane in lanes for end in (lane.start, lane.end)]
        assert any(way_clearance_m(a, b, fence) < 5.0 for a, b in pairwise(ends)) is leaves
    for point in points_in(area, 3.0):
        off_m = [abs(m) for m in (across_m(point, lane) for lane in kept) if m is not None]
        assert min(off_m) <= one.lane_m, point


@given(areas(), SWATHS)
def test_it_does_not_matter_where_the_boundary_begins_or_which_way_round_it_goes(
    area: tuple[Point, ...], swath: Swath
) -> None:
    again = (*area[2:], *area[:2])
    assert len(lay_lanes(again, swath, ENDS)) == len(lay_lanes(area, swath, ENDS))
    assert len(lay_lanes(tuple(reversed(area)), swath, ENDS)) == len(lay_lanes(area, swath, ENDS))


@given(areas(), SWATHS)
def test_all_lanes_have_one_axis_which_leads_east(area: tuple[Point, ...], swath: Swath) -> None:
    axes = [axis_of(lane) for lane in lay_lanes(area, swath, ENDS)]
    assert all(math.dist(axis, axes[0]) <= 0.01 for axis in axes)  # ends are rounded
    assert axes[0][0] >= -0.01


@given(SIZES, SOFT_M, st.sampled_from([5.0, 7.0, 15.0]))
def test_in_line_abreast_no_two_are_nearer_than_they_keep(size: int, soft_m: float, reach_m: float) -> None:
    line = line_abreast(size=size, soft_m=soft_m, reach_m=reach_m, range_m=55.0)
    places = [(k * line.pitch_m, -(k % 2) * line.depth_m) for k in range(size)]
    apart_m = [math.dist(a, b) for k, a in enumerate(places) for b in places[:k]]
    assert min(apart_m, default=soft_m) >= soft_m - 1e-9


def test_stems_between_two_abreast_are_within_the_useful_reach_of_both() -> None:
    line = line_abreast(size=8, soft_m=10.0, reach_m=7.0, range_m=55.0)
    assert line.pitch_m == 0.85 * 7.0
    assert line.width_m(8) == 7 * line.pitch_m


def test_so_wide_a_swarm_that_its_ends_would_not_hear_each_other_closes_up() -> None:
    line = line_abreast(size=8, soft_m=10.0, reach_m=15.0, range_m=55.0)
    assert line.width_m(8) <= 0.85 * 55.0 + 1e-9
