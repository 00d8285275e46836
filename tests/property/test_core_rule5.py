"""Rule 5: a follower's velocity never depends on d2 nor on an absolute position. Equal to the bit, through a flight.

One vehicle hears and sees the same flight twice. Positions are on a grid of 2^-10 m and the fence's sides are powers of
two long, so that shifting the frame is exact in floating point and leaves no rounding to forgive.
"""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.agent import TICK_S, Agent
from companion.core.model.actions import Action, VelocitySetpoint
from companion.core.model.beacon import Lease
from companion.core.model.events import AutopilotHealth, AutopilotMode, Landed, Position
from companion.core.model.states import FlightMode, FlightState, LandedState, SwarmPhase
from companion.core.model.vectors import add, sub
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3
from mission.document.model import Mission
from tests.unit.core.core_kit import heard_beacon

TICKS = 150
GRID = 1024.0
SIDE_M = 256.0
LEADER, FOLLOWER, OTHER = 1, 2, 3
PHASES = [SwarmPhase.GATHER] * 50 + [SwarmPhase.TRANSIT] * 50 + [SwarmPhase.COVERAGE] * 50


def flown(d2_enu_m: Vec3 = (60.0, 20.0, 10.0), shift: Vec3 = (0.0, 0.0, 0.0)) -> Mission:
    """A mission whose fence is shifted (north, east) with the frame; its corners lie on the grid."""
    north, east, _ = shift
    low_n, low_e = north - SIDE_M / 2, east - SIDE_M / 2
    corners = [(low_e, low_n), (low_e + SIDE_M, low_n), (low_e + SIDE_M, low_n + SIDE_M), (low_e, low_n + SIDE_M)]
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": d2_enu_m, "vel_leader_mps": 2.0},
            "swarm": {"size": 3},
            "fence": {"polygon_enu_m": corners},
        }
    )


def on_grid(v: Vec3) -> Vec3:
    return (round(v[0] * GRID) / GRID, round(v[1] * GRID) / GRID, round(v[2] * GRID) / GRID)


def path(rng: random.Random, start: Vec3, drift: Vec3) -> list[Vec3]:
    """Where someone is at each tick: on the grid, wandering."""
    places = [start]
    for _ in range(TICKS):
        step = [drift[k] * TICK_S + rng.uniform(-0.05, 0.05) for k in range(3)]
        places.append(on_grid(add(places[-1], (step[0], step[1], 0.2 * step[2]))))
    return places


def fly(
    mission: Mission, me: int, seed: int, *, shift: Vec3 = (0.0, 0.0, 0.0)
) -> tuple[list[Action], set[FlightState]]:
    """All that `me` does in the flight of this seed; `shift` moves its own positions only."""
    rng = random.Random(seed)
    drift = (rng.uniform(-3, 3), rng.uniform(-3, 3), 0.0)
    start = (rng.choice([-124.0, 0.0, 126.0]), rng.choice([-127.0, 0.0, 125.0]), -9.0)  # often near the fence
    own = path(rng, start, drift)
    offsets = {k: (rng.uniform(-18, 18), rng.uniform(-18, 18), rng.uniform(-1, 1)) for k in (1, 2, 3) if k != me}
    others = {k: path(rng, on_grid(add(own[0], offset)), drift) for k, offset in offsets.items()}
    tree = on_grid(add(own[0], (rng.uniform(-30, 30), rng.uniform(-30, 30), 0.0)))
    agent = Agent(mission, me)
    actions: list[Action] = []
    states = set()
    for k in range(TICKS):
        now_s = 100.0 + k * TICK_S
        mode = FlightMode.OFFBOARD if k > 30 else FlightMode.HOLD
        agent.receive(AutopilotMode(mode, True, mode.name, failsafe=k <= 30 and me != LEADER, traits=PX4.traits), now_s)
        agent.receive(AutopilotHealth(True, 90), now_s)
        agent.receive(Landed(LandedState.IN_AIR), now_s)
        agent.receive(Position(add(own[k], shift), drift), now_s)
        for other, places in others.items():
            if k % 2 == 0 and rng.random() > 0.1:
                # When `me` is the leader, the others follow it and say so.
                leads = other == LEADER
                lease = Lease(LEADER, 1000 + k, 0, 9, established=True) if me != LEADER or k > 40 else None
                agent.receive(
                    heard_beacon(
                        other,
                        time_ms=1000 + 50 * k,
                        rel_ned_m=sub(places[k], own[k]),
                        vel_ned_mps=drift,
                        ref_ned_mps=(1.5, -0.25, 0.125),
                        dest_ned_m=sub(tree, places[k]),
                        route_cost=0.0 if leads else 1.0,
                        parent=0 if leads else LEADER,
                        lease=lease,
                        hop=0 if leads else 1,
                        agreed=True,
                        phase=PHASES[k],
                        state=FlightState.COVERAGE if PHASES[k] is SwarmPhase.COVERAGE else FlightState.TRANSIT,
                        airborne=True,
                    ),
                    now_s,
                )
        if me == LEADER:
            agent.swarm.phases.adopt_phase(PHASES[k], now_s)
            if k == 0:  # leads from the start, and so joins at once what it hears
                agent.flight.state = FlightState.HOLD
        actions += agent.tick(now_s)
        states.add(agent.flight.state)
    return actions, states


def setpoints(actions: list[Action]) -> list[VelocitySetpoint]:
    return [action for action in actions if isinstance(action, VelocitySetpoint)]


seeds = st.integers(0, 2**32)
shifts = st.tuples(*[st.integers(-25 * 1024, 25 * 1024).map(lambda k: k / GRID)] * 2, st.just(0.0))
destinations = st.tuples(st.floats(-80.0, 80.0), st.floats(30.0, 80.0), st.floats(8.0, 10.0))


@given(seeds, destinations)
@settings(max_examples=10)
def test_followers_velocity_does_not_depend_on_d2(seed: int, d2_enu_m: Vec3) -> None:
    here, states = fly(flown(), FOLLOWER, seed)
    there, _ = fly(flown(d2_enu_m), FOLLOWER, seed)
    assert {FlightState.GATHERING, FlightState.TRANSIT, FlightState.COVERAGE} <= states
    assert here == there  # beacons and all
    assert len({s.vel_ned_mps for s in setpoints(here)}) > 50


@given(seeds, shifts)
@settings(max_examples=10)
def test_followers_velocity_does_not_depend_on_the_frame(seed: int, shift: Vec3) -> None:
    here, states = fly(flown(), FOLLOWER, seed)
    there, _ = fly(flown(shift=shift), FOLLOWER, seed, shift=shift)
    assert {FlightState.GATHERING, FlightState.TRANSIT, FlightState.COVERAGE} <= states
    assert here == there


def test_leaders_velocity_does_depend_on_d2_and_on_the_frame() -> None:
    """So the two tests above would notice."""
    here, states = fly(flown(), LEADER, 5)
    assert {FlightState.GATHERING, FlightState.TRANSIT, FlightState.COVERAGE} <= states
    there, _ = fly(flown((-60.0, 40.0, 10.0)), LEADER, 5)
    shift = (32.0, -16.0, 0.0)
    shifted, _ = fly(flown(shift=shift), LEADER, 5, shift=shift)
    assert setpoints(here) != setpoints(there)
    assert setpoints(here) != setpoints(shifted)


def test_the_flights_come_near_enough_to_others_and_to_the_fence_to_be_held_back() -> None:
    """Or the safety stage would be equal for want of anything to do."""
    fenced, free = flown(), flown()
    free = free.model_copy(update={"fence": free.fence.model_copy(update={"polygon_enu_m": None})})
    differs = [seed for seed in range(3) if fly(fenced, FOLLOWER, seed) != fly(free, FOLLOWER, seed)]
    assert len(differs) >= 1
