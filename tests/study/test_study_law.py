"""Our law in studies is the agents': what each agent sets at a beacon, the study's functions set from the same news."""

from __future__ import annotations

from copy import deepcopy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.agent import TICK_S, Agent
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.model.actions import VelocitySetpoint
from companion.core.model.states import Order, SwarmPhase
from companion.core.swarm.orders import Orders
from companion.core.swarm.picture import Picture
from mission.document.model import Mission
from sim_bridge.lab.study.ours import Flight
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

ON_THE_WAY = {"GATHERING": SwarmPhase.GATHER, "TRANSIT": SwarmPhase.TRANSIT}


@st.composite
def missions(draw: st.DrawFn) -> Mission:
    """Of two to five vehicles that start beside d1; every number that the law has."""
    number = st.floats
    hard_m = draw(number(2.0, 5.0))
    range_m = draw(number(25.0, 60.0))
    cruise_mps = draw(st.sampled_from([0.5, 0.7, 1.0, 2.0, 3.0]))
    d1 = (draw(number(-10.0, 20.0)), draw(number(-10.0, 20.0)), 18.0)
    return mission(
        route={"d1_enu_m": d1, "d2_enu_m": (60.0, 20.0, 19.0), "vel_leader_mps": cruise_mps},
        fence={"altitude_max_m": 60.0},
        swarm={"size": draw(st.integers(2, 5))},
        separation={"hard_m": hard_m, "soft_m": hard_m + draw(number(1.0, 6.0))},
        radio={"transit_range_m": range_m, "full_range_m": 60.0, "beacon_rate_hz": draw(st.sampled_from([5.0, 10.0]))},
        coverage={"shape": draw(st.sampled_from(["ring", "sphere"])), "radius_m": 15.0},
        limits={
            "speed_max_mps": draw(number(4.0, 8.0)),
            "climb_max_mps": draw(number(1.0, 3.0)),
            "acceleration_max_mps2": draw(number(1.0, 6.0)),
        },
    )


def watch(agent: Agent, compared: list[str]) -> None:
    """From now on the agent's setpoints at its beacons are compared with the study's."""
    steer = agent._compute_setpoint

    def both(picture: Picture, orders: Orders) -> VelocitySetpoint:
        flight, own = Flight(agent.mission), agent.flight.vehicle.position
        vehicle = flight.vehicles[agent.id - 1]
        phase, state = agent.swarm.phases.phase, agent.flight.state.name
        assert isinstance(agent.localiser, GnssLocaliser)
        vehicle.own_drift = agent.localiser._bias
        vehicle.movement, vehicle.setpoint = deepcopy(agent.movement), agent.setpoint
        vehicle.destination = deepcopy(agent.localiser.destination)
        found = steer(picture, orders)
        beacon_due = (agent._ticks - 1) % agent._ticks_per_beacon == 0
        if own is not None and beacon_due and ON_THE_WAY.get(state) is phase and agent.swarm.election.lease is not None:
            goal = agent.swarm.phases.goal() if agent.swarm.election.acts else None
            flight.guide_vehicle(agent.id, own, agent.localiser.neighbours, goal, phase, TICK_S)
            assert vehicle.route == agent.swarm.route
            assert vehicle.governor == agent.swarm.governor
            assert vehicle.movement.ref_ned_mps == agent.movement.ref_ned_mps
            assert vehicle.setpoint.vel_ned_mps == found.vel_ned_mps
            compared.append(state)
        return found

    agent._compute_setpoint = both  # type: ignore[method-assign]


@pytest.mark.sources
@settings(max_examples=12, deadline=None)
@given(missions())
def test_studies_fly_the_agents_law_whatever_the_mission(flown: Mission) -> None:
    fleet = Fleet(flown, spacing_m=6.5)
    fleet.run(2.0)
    fleet.order(1, Order.START)
    fleet.until("GATHERING", limit_s=40.0)
    compared: list[str] = []
    for one in fleet.aircraft.values():
        watch(one.agent, compared)
    fleet.until("TRANSIT", limit_s=120.0)
    fleet.run(4.0)
    assert {"GATHERING", "TRANSIT"} <= set(compared)
