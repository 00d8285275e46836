"""What vehicles run into among trees, and what becomes of them then."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.common.frames import Vec3
from mission.document.model import VEHICLE_RADIUS_M
from mission.stand.stand import Stand, StandTree
from sim_bridge.judge.metrics import CONTACT_M
from sim_bridge.world.airframe.fragile import Fragile
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.contacts import Collisions, Contacts, Touched
from sim_bridge.world.world import TICK_S
from tests.unit.world.airframe_kit import FRAME

TRUNK = StandTree(5.0, 0.0, 0.2, 20.0, 20.0, 0.2)  # 5 m east
CROWNED = StandTree(5.0, 0.0, 0.2, 20.0, 8.0, 2.0)
STILL: Vec3 = (0.0, 0.0, 0.0)


def touched(stand: Stand, *way_ned_m: Vec3, vel_ned_mps: Vec3 = STILL, on_ground: bool = False) -> Touched | None:
    """What the last step of the way touches."""
    contacts = Contacts(stand)
    for place in way_ned_m[:-1]:
        contacts.find_contact(1, place, vel_ned_mps, on_ground=False)
    return contacts.find_contact(1, way_ned_m[-1], vel_ned_mps, on_ground=on_ground)


def test_a_trunk_is_touched_within_the_propellers_reach_of_its_surface() -> None:
    stand = Stand([TRUNK])
    edge_m = 5.0 - 0.2 - VEHICLE_RADIUS_M
    assert touched(stand, (0.0, edge_m + 0.01, -3.0)) is Touched.TRUNK
    assert touched(stand, (0.0, edge_m - 0.01, -3.0)) is None


def test_a_trunk_that_is_passed_through_between_two_looks_is_touched() -> None:
    assert touched(Stand([TRUNK]), (0.3, 2.0, -3.0), (0.3, 8.0, -3.0)) is Touched.TRUNK
    assert touched(Stand([TRUNK]), (0.6, 2.0, -3.0), (0.6, 8.0, -3.0)) is None


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.05, 0.6)), max_size=6),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
)
def test_every_trunk_on_the_way_is_touched_however_long_the_step(
    trunks: list[tuple[float, float, float]], begin: tuple[float, float], way: tuple[float, float]
) -> None:
    stand = Stand([StandTree(east_m, north_m, r_m, 20.0, 20.0, r_m) for north_m, east_m, r_m in trunks])
    n, e = (begin[axis] + way[axis] * np.linspace(0.0, 1.0, 501) for axis in (0, 1))
    clear_m = min((np.hypot(n - north_m, e - east_m).min() - r_m for north_m, east_m, r_m in trunks), default=9.0)
    found = touched(stand, (*begin, -3.0), (begin[0] + way[0], begin[1] + way[1], -3.0))
    if abs(clear_m - VEHICLE_RADIUS_M) > 0.01:
        assert found is (Touched.TRUNK if clear_m < VEHICLE_RADIUS_M else None)


def test_above_its_top_there_is_no_trunk_wherever_the_ground_lies() -> None:
    assert touched(Stand([TRUNK]), (0.0, 5.0, -20.1)) is None
    assert touched(Stand([TRUNK], grade=(0.1, 0.0)), (0.0, 5.0, -20.1)) is Touched.TRUNK
    assert touched(Stand([TRUNK], grade=(0.1, 0.0)), (0.0, 5.0, -20.6)) is None


def test_a_vehicle_inside_a_crown_touches_it_and_one_below_does_not() -> None:
    stand = Stand([CROWNED])
    assert touched(stand, (1.0, 4.0, -9.0)) is Touched.CROWN
    assert touched(stand, (1.0, 4.0, -7.9)) is None
    assert touched(stand, (1.5, 3.0, -9.0)) is None
    assert touched(stand, (0.0, 4.6, -9.0)) is Touched.TRUNK  # the trunk goes on inside it


def test_a_crown_is_touched_far_from_its_trunk() -> None:
    wide = Stand([StandTree(9.0, 0.0, 0.2, 20.0, 8.0, 5.0)])
    assert touched(wide, (0.0, 4.1, -9.0)) is Touched.CROWN
    assert touched(wide, (0.0, 3.9, -9.0)) is None


def test_how_hard_the_ground_was_touched_tells_the_speed_before() -> None:
    contacts = Contacts(Stand())
    contacts.find_contact(1, (0.0, 0.0, -0.1), (3.0, 0.0, 0.2), on_ground=False)
    assert contacts.find_contact(1, (0.15, 0.0, 0.0), STILL, on_ground=True) is Touched.GROUND


@pytest.mark.parametrize(
    ("vel_ned_mps", "expected"),
    [
        ((0.3, 0.0, 1.5), None),  # a landing
        ((0.0, 1.2, 0.2), Touched.GROUND),  # into the slope
        ((0.0, 0.0, 3.0), Touched.GROUND),  # a fall
    ],
)
def test_the_ground_is_touched_hard_or_landed_on(vel_ned_mps: Vec3, expected: Touched | None) -> None:
    way: tuple[Vec3, Vec3] = ((0.0, 0.0, -0.1), (0.0, 0.0, 0.0))
    assert touched(Stand(), *way, vel_ned_mps=vel_ned_mps, on_ground=True) is expected


def looks(quad: JsbsimQuad, ticks: int) -> tuple[list[Touched], bool]:
    """What is touched, and whether a bounce fell between two looks."""
    contacts, found, unseen = Contacts(Stand()), [], False
    for _ in range(ticks):
        quad.step(TICK_S)
        state = quad.state
        what = contacts.find_contact(
            1, state.pos_ned_m, state.vel_ned_mps, on_ground=state.on_ground, hit_ned_mps=state.hit_ned_mps
        )
        found += [] if what is None else [what]
        unseen = unseen or (what is not None and not state.on_ground)
    return found, unseen


def test_a_fall_is_seen_also_if_it_bounces_between_two_looks() -> None:
    falls = [looks(JsbsimQuad(FRAME, (0.0, 0.0, -0.6 - 0.35 * k), 0.0), 40) for k in range(16)]
    assert all(Touched.GROUND in found for found, _ in falls)
    assert any(unseen for _, unseen in falls)


def test_a_take_off_and_a_landing_touch_nothing() -> None:
    quad = JsbsimQuad(FRAME, STILL, 0.0)
    quad.set_armed(True)
    for down_mps, ticks in ((-1.2, 60), (1.5, 120)):
        quad.command((0.5, 0.0, down_mps), 0.0)
        assert looks(quad, ticks) == ([], False)
    assert quad.state.on_ground


def test_one_that_grazes_the_ground_as_it_rises_does_not_come_down_on_it() -> None:
    contacts = Contacts(Stand())
    contacts.find_contact(1, (0.0, 0.0, -0.01), (1.2, 0.0, -0.3), on_ground=False)
    rises = contacts.find_contact(1, (0.1, 0.0, -0.02), (1.2, 0.0, -0.3), on_ground=False, hit_ned_mps=(1.2, 0.0, -0.2))
    assert rises is None


def test_who_stands_beside_a_trunk_touches_nothing() -> None:
    assert touched(Stand([TRUNK]), (0.0, 4.9, 0.0), on_ground=True) is None


def flying(down_m: float = -5.0) -> PointMass:
    body = PointMass((1.0, 2.0, down_m), 0.5, ground_down_m=1.0)
    body.set_armed(True)
    body.command((2.0, 0.0, 0.0), 0.5)
    body.step(1.0)
    return body


def test_a_broken_airframe_falls_straight_down_and_stays_there() -> None:
    body = Fragile(flying(), lambda _east_m, _north_m: -1.0)
    before = body.state
    body.fall()
    body.step(0.5)
    assert body.state.pos_ned_m[:2] == before.pos_ned_m[:2]
    assert body.state.pos_ned_m[2] == pytest.approx(-5.0 + 0.5 * 9.80665 * 0.25)
    for _ in range(100):
        body.step(0.05)
    assert body.state.pos_ned_m == (*before.pos_ned_m[:2], 1.0)  # the ground there
    assert body.state.on_ground
    assert body.state.vel_ned_mps == STILL
    assert body.state.attitude_rad[0] == math.pi / 2.0


def test_a_broken_airframe_obeys_no_command() -> None:
    body = Fragile(flying(), lambda _east_m, _north_m: -1.0)
    body.fall()
    body.set_armed(True)
    body.command((0.0, 0.0, -3.0), 0.0)
    for _ in range(100):
        body.step(0.05)
    there = body.state
    body.step(1.0)
    assert body.state.on_ground
    assert body.state == there


def test_until_it_falls_a_fragile_airframe_is_the_other_one() -> None:
    plain, fragile = flying(), Fragile(flying(), lambda _east_m, _north_m: -1.0)
    for _ in range(20):
        plain.step(0.05)
        fragile.step(0.05)
    assert fragile.state == plain.state


def test_hulls_that_cross_between_two_looks_have_touched() -> None:
    looks = Collisions()
    assert looks.find_touching({1: (0.0, -1.0, -5.0), 2: (0.0, 1.0, -5.0), 7: (9.0, 0.0, -5.0)}) == set()
    assert looks.find_touching({1: (0.0, 1.0, -5.0), 2: (0.0, -1.0, -5.0), 7: (9.0, 0.0, -5.0)}) == {1, 2}


@pytest.mark.parametrize(("apart_m", "touch"), [(0.69, True), (0.71, False)])
def test_hulls_touch_at_twice_the_reach(apart_m: float, touch: bool) -> None:
    assert pytest.approx(2.0 * VEHICLE_RADIUS_M) == CONTACT_M
    found = Collisions().find_touching({3: (0.0, 0.0, -5.0), 5: (0.6 * apart_m, 0.0, -5.0 - 0.8 * apart_m)})
    assert found == ({3, 5} if touch else set())


def test_of_a_hundred_vehicles_every_touching_pair_is_found() -> None:
    rng = np.random.default_rng(3)
    was, now = rng.uniform(-12.0, 12.0, (2, 100, 3)) * (1.0, 1.0, 0.3)
    now = was + 0.05 * now
    looks = Collisions()
    looks.find_touching({k: tuple(was[k]) for k in range(100)})
    found = looks.find_touching({k: tuple(now[k]) for k in range(100)})
    shares = np.linspace(0.0, 1.0, 2001)
    expected = set()
    for a in range(100):
        for b in range(a + 1, 100):
            apart = (was[b] - was[a]) + shares[:, None] * ((now[b] - now[a]) - (was[b] - was[a]))
            if np.linalg.norm(apart, axis=1).min() < CONTACT_M:
                expected |= {a, b}
    assert expected
    assert found == expected
