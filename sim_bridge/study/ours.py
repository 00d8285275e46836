"""Our law: the flight software's own functions, vehicle by vehicle. Slower than sums over arrays, but it cannot drift.

What an agent does around them is not here, as nothing of it acts on these flights: the election, coverage, silent
neighbours and the fading of faith. Where d2 is, everyone knows exactly: agents hand it on from one to the next.
"""

from __future__ import annotations

import numpy as np

from companion.core import formation
from companion.core.formation import Route
from companion.core.movement import Movement, Situation
from companion.core.peers import Neighbour
from companion.core.types import ZERO, Beacon, FlightState, Position, SwarmPhase
from companion.core.vec import add
from mission.frames import Vec3, ned_to_enu
from mission.model import Mission
from sim_bridge.study import law
from sim_bridge.study.law import Floats, Law, View


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


class Flight:
    """State, by vehicle: what its last beacon said of its route, governor and reference, and its last setpoint."""

    def __init__(self, mission: Mission) -> None:
        self.movements: list[Movement] = []
        self._fly(mission)
        self._said = [(formation.NOWHERE, 1.0, ZERO)] * mission.swarm.size

    def setpoints_enu_mps(self, view: View, b: int) -> list[Vec3]:
        """Of every vehicle of flight `b`, one beacon period on."""
        if view.routes[b] is not self._mission:
            self._fly(view.routes[b])
        positions = [Position(*both) for both in zip(_ned(view.pos_enu_m[b]), _ned(view.vel_enu_mps[b]), strict=True)]
        leader = int(view.leads[b].argmax())
        goal = add(positions[leader].pos_ned_m, _ned(view.to_goal_enu_m[b : b + 1])[0]), float(view.stop_m[b])
        phase = SwarmPhase.TRANSIT if view.departed[b] else SwarmPhase.GATHER
        beacons = [self._beacon(k, vel, phase) for k, vel in enumerate(_ned(view.vel_heard_enu_mps[b]), start=1)]
        said = []
        for i, own in enumerate(positions):
            at = np.flatnonzero(view.heard[b, i])
            neighbours = [
                Neighbour(beacons[j], rel, None, 0.0, beacons[j].vel_ned_mps)
                for j, rel in zip(at.tolist(), _ned(view.rel_enu_m[b, i, at]), strict=True)
            ]
            said.append(self.steer(i + 1, own, neighbours, goal if i == leader else None, phase, view.dt_s))
        self._said = said
        return [ned_to_enu(movement.setpoint_ned_mps) for movement in self.movements]

    def _fly(self, mission: Mission) -> None:
        self._mission = mission
        before = [movement.setpoint_ned_mps for movement in self.movements]
        self.movements = [Movement(mission, k) for k in range(1, mission.swarm.size + 1)]
        for movement, setpoint_ned_mps in zip(self.movements, before, strict=False):
            movement.setpoint_ned_mps = setpoint_ned_mps  # on another route it flies on

    def steer(
        self,
        me: int,
        own: Position,
        neighbours: list[Neighbour],
        goal: tuple[Vec3, float] | None,
        phase: SwarmPhase,
        dt_s: float,
        *,
        drift_ned_mps: Vec3 = ZERO,
    ) -> tuple[Route, float, Vec3]:
        """A tick of vehicle `me`, as `agent.Agent` has it: its route, governor and reference. The leader has a goal."""
        range_m = self._mission.radio.transit_range_m
        route = formation.LEADER_ROUTE if goal else formation.route(neighbours, range_m=range_m)
        behind = formation.children(me, route, neighbours)
        governor = formation.governor(route, behind, range_m=range_m)
        movement = self.movements[me - 1]
        movement.locate(own, formation.LEADER_ROUTE, leads=True)  # everyone knows where d2 is
        situation = Situation(
            own=own,
            neighbours=neighbours,
            silent={},
            state=FlightState.TRANSIT if phase is SwarmPhase.TRANSIT else FlightState.GATHERING,
            phase=phase,
            route=route,
            range_m=range_m,
            leads=goal is not None,
            governor=governor,
            faith=1.0,
            goal=goal,
            size=self._mission.swarm.size,
        )
        movement.steer(situation, dt_s=dt_s, drift_ned_mps=drift_ned_mps)
        return route, governor, movement.ref_ned_mps

    def _beacon(self, sender: int, vel_ned_mps: Vec3, phase: SwarmPhase) -> Beacon:
        route, governor, ref = self._said[sender - 1]
        state = FlightState.TRANSIT if phase is SwarmPhase.TRANSIT else FlightState.GATHERING
        return Beacon(
            sender=sender,
            time_ms=0,
            rel_ned_m=ZERO,
            vel_ned_mps=vel_ned_mps,
            ref_ned_mps=ref,
            dest_ned_m=None,
            route_cost=route.cost,
            governor=governor,
            lease=None,
            hop=0,
            agreed=True,
            candidate=None,
            parent=route.parent,
            phase=phase,
            state=state,
            airborne=True,
            start=True,
            abort=False,
            done=0,
            range_m=self._mission.radio.transit_range_m,
        )


def _ned(enu: Floats) -> list[Vec3]:
    """Rows of (k, 3) as plain tuples in NED."""
    return [(y, x, -z) for x, y, z in enu.tolist()]
