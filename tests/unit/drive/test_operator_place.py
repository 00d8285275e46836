"""Where the simulated operator of a swarm with keys stands."""

from __future__ import annotations

import math

from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.core.core_kit import mission


def test_it_stands_where_it_reaches_all_of_a_swarm_whose_first_vehicle_does_not() -> None:
    """Vehicle 7 stood 31.7 m from vehicle 1, where the operator was: START did not name it (search, seed 9689)."""
    flies = mission(swarm={"size": 12}, sim={"placement": "random", "seed": 9689}).with_origin(DEFAULT_ORIGIN)
    world = World(flies, point_mass_airframes(flies), links={})
    starts = world.positions()
    range_m = flies.radio.transit_range_m
    assert max(math.dist(starts[1], at) for at in starts.values()) > range_m
    place = FleetKeys(flies).operator(world).pos_ned_m
    assert max(math.dist(place, at) for at in starts.values()) < 0.6 * range_m
