"""Our law: the flight software's own functions, vehicle by vehicle. Slower than sums over arrays, but it cannot drift.

What an agent does around them is not here, as nothing of it acts on these flights: the election, coverage, vehicles
that fall silent and the fading of faith. A neighbour whose beacon is lost is not there until its next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.core.guidance import formation
from companion.core.guidance.formation import Route
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.localisation.destination import Destination
from companion.core.model.beacon import Beacon
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, norm
from companion.core.model.velocity_bias import VelocityBias
from companion.core.perception.obstacle_perception import OpenSkyPerception
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.setpoint import AT_REST, Setpoint
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3, ned_to_enu
from mission.document.model import Mission
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Floats, Law, View

STATES = {SwarmPhase.GATHER: FlightState.GATHERING, SwarmPhase.TRANSIT: FlightState.TRANSIT}
Goal = tuple[Vec3, float]  # as phases.Phases.goal


class Params(law.Params):
    """None: its parameters are the flight software's."""


def make(mission: Mission, flights: int, params: Params) -> Law:  # noqa: ARG001
    """Our law."""
    return Ours(mission, flights)


class Ours:
    """A batch of flights that know nothing of one another."""

    def __init__(self, mission: Mission, flights: int) -> None:
        self._flights = [Flight(mission) for _ in range(flights)]

    def velocity(self, view: View) -> Floats:
        """(B, n, 3) setpoints."""
        return np.array([flight.setpoints_enu_mps(view, b) for b, flight in enumerate(self._flights)])


@dataclass(slots=True)
class Vehicle:
    """State that an agent keeps from tick to tick; route, governor and position as its last beacon said."""

    movement: Guidance
    safety_filter: SafetyFilter
    own_drift: VelocityBias
    claim_drift: VelocityBias  # of what it claims, as its neighbours find it
    position: Position
    destination: Destination
    route: Route = formation.NOWHERE
    governor: float = 1.0
    setpoint: Setpoint = AT_REST


class Flight:
    """One flight's vehicles."""

    def __init__(self, mission: Mission) -> None:
        self._now_s = 0.0
        at_rest = Position(ZERO, ZERO)
        self.vehicles = [
            Vehicle(
                Guidance(mission, k),
                SafetyFilter.of(mission),
                VelocityBias(),
                VelocityBias(),
                at_rest,
                Destination(mission),
            )
            for k in range(1, mission.swarm.size + 1)
        ]
        self._fly(mission)

    def _fly(self, mission: Mission) -> None:
        """On this mission's route from now on."""
        self._mission, self._perception = mission, OpenSkyPerception(mission)
        for k, vehicle in enumerate(self.vehicles, start=1):
            before, vehicle.movement = vehicle.movement, Guidance(mission, k)
            vehicle.movement.ref_ned_mps = before.ref_ned_mps
            vehicle.safety_filter = SafetyFilter.of(mission)
            vehicle.destination = Destination(mission)

    def setpoints_enu_mps(self, view: View, b: int) -> list[Vec3]:
        """Of every vehicle of flight `b`, one beacon period on."""
        if view.routes[b] is not self._mission:
            self._fly(view.routes[b])
        positions = [Position(*both) for both in zip(_ned(view.pos_enu_m[b]), _ned(view.vel_enu_mps[b]), strict=True)]
        leader = int(view.leads[b].argmax())
        goal = add(positions[leader].pos_ned_m, _ned(view.to_goal_enu_m[b : b + 1])[0]), float(view.stop_m[b])
        phase = SwarmPhase.TRANSIT if view.departed[b] else SwarmPhase.GATHER
        beacons = [self._beacon(k, phase) for k in range(1, len(positions) + 1)]
        found = [self._found(vehicle, beacon) for vehicle, beacon in zip(self.vehicles, beacons, strict=True)]
        self._now_s += view.dt_s
        heard: list[list[bool]] = view.heard[b].tolist()
        all_rels = [_ned(rels) for rels in view.rel_enu_m[b]]
        for i, own in enumerate(positions):
            rels = all_rels[i]
            neighbours = []
            for j, hears in enumerate(heard[i]):
                if hears:
                    rel, dest = rels[j], beacons[j].dest_ned_m
                    goal_rel = None if dest is None else add(rel, dest)
                    neighbours.append(Neighbour(beacons[j], rel, goal_rel, 0.0, found[j], norm(rel)))
            self.vehicles[i].own_drift.update(own.pos_ned_m, own.vel_ned_mps, self._now_s)
            self.guide_vehicle(i + 1, own, neighbours, goal if i == leader else None, phase, view.dt_s)
        for vehicle, own in zip(self.vehicles, positions, strict=True):
            vehicle.position = Position(own.pos_ned_m, add(own.vel_ned_mps, vehicle.own_drift.ned_mps))
        return [ned_to_enu(vehicle.setpoint.vel_ned_mps) for vehicle in self.vehicles]

    def _found(self, vehicle: Vehicle, beacon: Beacon) -> Vec3:
        """A neighbour's velocity as peers.PeerTable corrects what it claims."""
        vehicle.claim_drift.update(vehicle.position.pos_ned_m, beacon.vel_ned_mps, self._now_s)
        return add(beacon.vel_ned_mps, vehicle.claim_drift.ned_mps)

    def guide_vehicle(
        self, me: int, own: Position, neighbours: list[Neighbour], goal: Goal | None, phase: SwarmPhase, dt_s: float
    ) -> None:
        """A tick of vehicle `me`, as `agent.Agent` has it; the leader has a goal."""
        vehicle, range_m = self.vehicles[me - 1], self._mission.radio.transit_range_m
        vehicle.route = formation.LEADER_ROUTE if goal else formation.route(neighbours, range_m=range_m)
        behind = formation.children(me, vehicle.route, neighbours)
        vehicle.governor = formation.governor(vehicle.route, behind, range_m=range_m)
        if goal is None:
            up = vehicle.route.up
            leader = next((n.id for n in up if n.beacon.route_cost == formation.LEADER_ROUTE.cost), 0)
            vehicle.destination.update_follower(own.pos_ned_m, 0, up, self._now_s, leader=leader)
        else:
            vehicle.destination.update_leader(own.pos_ned_m, 0)
        drift = vehicle.own_drift.ned_mps
        around = Surroundings(
            Position(own.pos_ned_m, add(own.vel_ned_mps, drift)),
            neighbours,
            {},
            self._perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, self._now_s),
            bias_ned_mps=drift,
            commanded_ned_mps=vehicle.setpoint.vel_ned_mps,
        )
        desired = vehicle.movement.guide(
            GuidanceInput(
                around,
                state=STATES[phase],
                phase=phase,
                route=vehicle.route,
                range_m=range_m,
                role=Role.FOLLOWER if goal is None else Role.LEADER,
                governor=vehicle.governor,
                lease_freshness=1.0,
                goal=goal,
                size=len(self.vehicles),
                dest_ned_m=vehicle.destination.ned_m,
            ),
            dt_s=dt_s,
        )
        vehicle.setpoint = vehicle.safety_filter.apply(desired.vel_ned_mps, around, dt_s=dt_s)

    def _beacon(self, sender: int, phase: SwarmPhase) -> Beacon:
        vehicle = self.vehicles[sender - 1]
        return Beacon(
            sender=sender,
            time_ms=0,
            vel_ned_mps=vehicle.position.vel_ned_mps,
            ref_ned_mps=vehicle.movement.ref_ned_mps,
            dest_ned_m=vehicle.destination.ned_m,
            route_cost=vehicle.route.cost,
            governor=vehicle.governor,
            lease=None,
            hop=0,
            agreed=True,
            candidate=None,
            parent=vehicle.route.parent,
            phase=phase,
            state=STATES[phase],
            airborne=True,
            start=True,
            abort=False,
            done=0,
            range_m=self._mission.radio.transit_range_m,
        )


def _ned(enu: Floats) -> list[Vec3]:
    """Rows of (k, 3) as plain tuples in NED."""
    return [(y, x, -z) for x, y, z in enu.tolist()]
