"""Our law: the flight software's own functions, vehicle by vehicle. Slower than sums over arrays, but it cannot drift.

What an agent does around them is not here, as nothing of it acts on these flights: the election, coverage, silent
neighbours and the fading of faith. Where d2 is, everyone knows exactly: agents hand it on from one to the next.
"""

from __future__ import annotations

import numpy as np

from companion.core import formation, movement
from companion.core.formation import Route
from companion.core.peers import Neighbour
from companion.core.safety import Envelope
from companion.core.types import ZERO, Beacon, FlightState, Position, SwarmPhase
from companion.core.vec import add, sub
from mission.frames import Vec3, enu_to_ned, ned_to_enu
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
        self._fly(mission)
        self._said = [(formation.NOWHERE, 1.0, ZERO)] * mission.swarm.size
        self.setpoints = [ZERO] * mission.swarm.size

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
                Neighbour(beacons[j], rel, None, 0.0)
                for j, rel in zip(at.tolist(), _ned(view.rel_enu_m[b, i, at]), strict=True)
            ]
            said.append(self.steer(i + 1, own, neighbours, goal if i == leader else None, phase, view.dt_s))
        self._said = said
        return [ned_to_enu(v) for v in self.setpoints]

    def _fly(self, mission: Mission) -> None:
        self._mission = mission
        self._envelope = Envelope.of(mission)
        self._d2_ned_m = enu_to_ned(mission.route.d2_enu_m)

    def steer(
        self,
        me: int,
        own: Position,
        neighbours: list[Neighbour],
        goal: tuple[Vec3, float] | None,
        phase: SwarmPhase,
        dt_s: float,
    ) -> tuple[Route, float, Vec3]:
        """A tick of vehicle `me`, as `agent.Agent` has it: its route, governor and reference. The leader has a goal."""
        mission, range_m = self._mission, self._mission.radio.transit_range_m
        route = formation.LEADER_ROUTE if goal else formation.route(neighbours, range_m=range_m)
        behind = formation.children(me, route, neighbours)
        governor = formation.governor(route, behind, range_m=range_m)
        dest = sub(self._d2_ned_m, own.pos_ned_m)
        if goal:
            ref = wanted = movement.lead(mission, phase, goal, own.pos_ned_m, governor=governor)
        else:
            passing = dest if phase is SwarmPhase.TRANSIT else None
            ref, wanted = movement.follow(mission, me, route, neighbours, [], passing, range_m=range_m, faith=1.0)
        last = self.setpoints[me - 1]
        self.setpoints[me - 1] = self._envelope.admit(wanted, last, own, neighbours, [], dest, dt_s=dt_s)
        return route, governor, ref

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
