"""A world with a stand in it: where vehicles start, what their lidars send, and what becomes of those that touch."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.stand.stand import Stand, StandTree
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.contacts import Touched
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S, World

LINKS = {Link.ONBOARD: StreamProfile.MINIMAL}


def mission(**tables: dict[str, Any]) -> Mission:
    values: dict[str, Any] = {
        "route": {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (60.0, 0.0, 4.0), "vel_leader_mps": 2.0},
        "swarm": {"size": 3},
        "sim": {"placement": "grid"},
    }
    return Mission.model_validate({"schema": 1, **values, **tables}).with_origin(DEFAULT_ORIGIN)


def world(flown: Mission, stand: Stand | None = None) -> World:
    return World(
        flown, lambda _frame, place, _seed: PointMass(place, 0.0, ground_down_m=place[2]), links=LINKS, stand=stand
    )


def trunk(east_m: float, north_m: float) -> StandTree:
    return StandTree(east_m, north_m, 0.3, 20.0, 20.0, 0.3)


def test_each_vehicle_with_a_sensor_sends_its_scans_as_a_component_of_its_own() -> None:
    air = world(mission(sensing={}), Stand([trunk(3.0, 4.0)]))
    framing = Framing()
    sent: dict[int, list[Any]] = {k: [] for k in air.vehicles}
    for _ in range(40):
        for k in air.vehicles:
            sent[k] += framing.read_messages(b"".join(data for _, data in air.sense(k)))
        air.step(TICK_S)
    for k, messages in sent.items():
        assert 19 <= len(messages) <= 20  # 10 Hz
        assert {(m.system, m.component) for m in messages} == {(k, dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE)}
        scan = messages[-1].message
        assert scan.get_type() == "OBSTACLE_DISTANCE"
        assert min(scan.distances) < 800  # the trunk, or one that stands beside it
        assert scan.time_usec <= air.now_s * 1e6


def test_without_a_sensor_nothing_is_sent() -> None:
    air = world(mission(), Stand([trunk(3.0, 4.0)]))
    assert [air.sense(k) for k in air.vehicles] == [[], [], []]


def test_vehicles_start_on_the_slope() -> None:
    air = world(mission(), Stand(grade=(0.1, -0.05)))
    for vehicle in air.vehicles.values():
        north_m, east_m, down_m = vehicle.airframe.state.pos_ned_m
        assert down_m == pytest.approx(-(0.1 * east_m - 0.05 * north_m))
        assert vehicle.airframe.state.on_ground


def test_the_stand_is_the_missions_where_none_is_given() -> None:
    tree = {"base_enu_m": (20.0, 0.0), "trunk_radius_m": 0.3, "height_m": 12.0}
    assert len(world(mission(forest={"trees": (tree,)})).stand.trees) == 1


def test_a_vehicle_that_touches_a_trunk_is_named_and_falls_and_the_others_fly_on() -> None:
    air = world(mission(), Stand([trunk(30.0, 0.0)]))
    for vehicle in air.vehicles.values():
        vehicle.airframe.set_armed(True)
        vehicle.airframe.command((0.0, 0.0, -1.0), 0.0)
    for _ in range(60):
        for vehicle in air.vehicles.values():
            vehicle.believed.step(TICK_S)
    north_m, east_m, _ = air.positions()[1]
    air.vehicles[1].airframe.command((-north_m / 10.0, (30.0 - east_m) / 10.0, 0.0), 0.0)
    for k in (2, 3):
        air.vehicles[k].airframe.command((0.0, -2.0, 0.0), 0.0)
    for _ in range(240):
        for k, vehicle in air.vehicles.items():
            vehicle.believed.step(TICK_S)
            air.check_contact(k)
    assert air.touched == {1: Touched.TRUNK}
    one, *others = (vehicle.airframe.state for vehicle in air.vehicles.values())
    assert one.on_ground
    assert one.pos_ned_m[1] == pytest.approx(30.0 - 0.65, abs=0.3)
    assert all(not other.on_ground for other in others)


def test_a_world_of_point_masses_says_that_its_air_is_still() -> None:
    air = world(mission())
    quads = World(mission(), jsbsim_airframes(mission()), links=LINKS)
    assert (air.still_air, quads.still_air) == (True, False)


@pytest.mark.parametrize(("radius_m", "touched"), [(0.35, set()), (1.0, {1, 2, 3})])
def test_contacts_are_those_of_the_missions_own_hulls(radius_m: float, touched: set[int]) -> None:
    places: list[Vec3] = [(0.9, 30.0, -4.0), (10.0, 10.0, -4.0), (11.2, 10.0, -4.0)]  # the first 0.6 m from the bark
    left = iter(places)
    air = World(
        mission(sensing={"vehicle_radius_m": radius_m}),
        lambda _frame, _place, _seed: PointMass(next(left), 0.0),
        links=LINKS,
        stand=Stand([trunk(30.0, 0.0)]),
    )
    for k in air.vehicles:
        air.check_contact(k)
    air.check_collisions()
    assert set(air.touched) == touched


def test_two_vehicles_that_touch_one_another_both_fall_and_the_third_flies_on() -> None:
    air = world(mission(), Stand())
    for vehicle in air.vehicles.values():
        vehicle.airframe.set_armed(True)
        vehicle.airframe.command((0.0, 0.0, -1.0), 0.0)
    for _ in range(60):
        air.step(TICK_S)
    (north_m, east_m, _), (other_n, other_e, _) = air.positions()[1], air.positions()[2]
    way = (other_n - north_m, other_e - east_m)
    length_m = math.hypot(*way)
    met_s = length_m / 4.0  # each flies half the way at 2 m/s
    for _ in range(round((met_s + 4.0) / TICK_S)):
        for k, sign in ((1, 2.0), (2, -2.0)):
            body = air.vehicles[k].airframe
            body.command((sign * way[0] / length_m, sign * way[1] / length_m, 0.0), 0.0)
        for vehicle in air.vehicles.values():
            vehicle.believed.step(TICK_S)  # past their autopilots, which are not armed
        air.advance_clock(TICK_S)
    assert air.touched == {1: Touched.VEHICLE, 2: Touched.VEHICLE}
    first, second, third = (vehicle.airframe.state for vehicle in air.vehicles.values())
    assert first.on_ground
    assert second.on_ground
    assert not third.on_ground
