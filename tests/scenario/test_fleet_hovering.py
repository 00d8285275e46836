"""Agents in small fleets: who hovers is remembered, whatever one member says, and by those who were not there."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import find_hover_places
from companion.core.model.states import FlightMode, Order
from mission.common.frames import Vec3
from tests.unit.core.core_fleet import Fleet, fleet
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources


def hears(vehicle: int, rel_ned_m: Vec3) -> PeerReport:
    return PeerReport(vehicle, rel_ned_m, 0.1, silent=False)


@pytest.mark.parametrize("size", [4, 5, 8])
def test_one_that_lies_that_it_hears_a_hovering_vehicle_leads_nobody_into_it(size: int) -> None:
    """The leader falls silent at departure and hovers at d1, where the swarm comes back to."""
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (40.0, 0.0, 8.0), "at_end": "return"},
            swarm={"size": size, "leader_priority": [1, 2]},
            coverage={"duration_s": 1.0},
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.hung.add(1)
    swarm.lies[3] = lambda sent: replace(sent, sighting=hears(1, (0.0, 60.0, 0.0)))
    others = [k for k in swarm.aircraft if k != 1]
    swarm.until("LANDED", limit_s=300.0, among=others)
    assert swarm.aircraft[1].mode is FlightMode.HOLD
    assert swarm.least_m >= 5.0


def test_part_that_is_met_tells_where_a_vehicle_hovers_that_fell_silent_among_them() -> None:
    """The others heard it last elsewhere: both places are kept clear of."""
    swarm = fleet(5)
    swarm.apart |= {1, 2}
    swarm.run(3.0)
    lost = swarm.aircraft[1]
    lost.put((lost.pos_ned_m[0], lost.pos_ned_m[1] - 15.0, lost.pos_ned_m[2]))
    swarm.run(1.0)
    swarm.hung.add(1)
    swarm.run(4.0)
    swarm.apart.clear()
    swarm.run(0.5)
    for k in (3, 4, 5):
        one = swarm.aircraft[k]
        there = tuple(a - b for a, b in zip(lost.pos_ned_m, one.pos_ned_m, strict=True))
        places = find_hover_places([one.agent.localiser.silent[1]])
        assert len(places) == 2
        assert min(math.dist(there, place) for place in places) <= 1.5


def test_others_fly_round_the_place_that_only_the_part_they_meet_can_tell_of() -> None:
    swarm = fleet(5)
    swarm.apart |= {1, 2}
    swarm.run(1.0)
    lost = swarm.aircraft[1]
    lost.put((3.0, 40.0, lost.pos_ned_m[2]))  # on their way
    swarm.run(1.0)
    swarm.hung.add(1)
    swarm.run(2.0)
    swarm.apart.clear()
    swarm.until("COVERAGE", limit_s=90.0, among=[3, 4, 5])
    assert swarm.least_m >= 5.0


def test_one_that_is_hidden_from_most_is_given_free_by_the_one_that_called_it_silent() -> None:
    """Two hear 4 between them, one loses it for a while: when it hears it again nobody flies round the place."""
    swarm = fleet(5)
    swarm.links = {frozenset(pair) for pair in ((1, 2), (2, 3), (1, 3), (3, 5), (2, 5), (1, 4))}
    swarm.run(1.0)
    swarm.aircraft[2].forget(4)
    for k in (3, 5):
        swarm.aircraft[k].forget(4)
    swarm.links.remove(frozenset((1, 4)))
    swarm.run(4.0)
    assert all(4 in swarm.aircraft[k].agent.localiser.silent for k in (1, 2, 3, 5))
    swarm.links.add(frozenset((1, 4)))
    swarm.run(3.0)
    assert not any(4 in swarm.aircraft[k].agent.localiser.silent for k in (1, 2, 3, 5))
