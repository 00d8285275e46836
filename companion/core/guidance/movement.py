"""Guidance: the five conditions put together or coverage, led clear by the local planner.

The agents fly by this, and so do the studies on point masses: there is one law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from companion.core.guidance import avoidance, coverage, formation
from companion.core.guidance.guidance_input import Desired, GuidanceInput
from companion.core.guidance.local_planner import LocalPlanner
from companion.core.guidance.open_sky_planner import OpenSkyPlanner
from companion.core.guidance.sensing_planner import SensingPlanner
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor, keep_clear_of
from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour, find_hover_places
from companion.core.model.states import IN_FORMATION, FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, norm, scale, sub
from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.safety.clearance import Use, clearance_m
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from mission.document.model import CoverageShape, Mission
from mission.lanes.lay import axis_of

GATHER_MPS: Final = 1.0  # the leader on its way to d1, through those that have just taken off beside it
# Elsewhere each has its position.
CORRIDORS_COUNT = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.SEEKING, FlightState.HOLD)
# After so long without a beacon a vehicle keeps no rank on the ring. Only a part with the majority covers the tree, and
# the others hold: what it does not hear hovers, without a companion or in a part that holds.
STRANDED_S: Final = 10.0
LAYER_GAIN_PER_S: Final = 1.0
LAYER_MPS: Final = 1.0  # to another layer: of slow change for those that are about it
YAW_SPEED_MPS: Final = 0.3  # below this the heading stays


class Guidance:
    """One vehicle's. `ref_ned_mps` is what it hands down."""

    def __init__(self, mission: Mission, me: int) -> None:
        self.ref_ned_mps = ZERO
        self.yaw_rad = 0.0
        self._mission, self._me = mission, me
        self._planner = build_planner(mission)
        self._line = mission.line_abreast
        lanes = mission.lanes
        self._axis_ne = axis_of(lanes[0])[::-1] if lanes else None

    def reset(self) -> None:
        """Not steered: a vehicle that gets control back starts from rest, not from what it last desired."""
        self.ref_ned_mps = ZERO
        self._planner.reset()

    def predict_corridors(
        self, peers: PeerTable, pos_ned_m: Vec3, now_s: float, *, range_m: float
    ) -> Sequence[PredictedCorridor]:
        """As `LocalPlanner.predict_corridors`."""
        return self._planner.predict_corridors(peers, pos_ned_m, now_s, range_m)

    def guide(self, now: GuidanceInput, *, dt_s: float) -> Desired:
        """Works out velocity and heading for now: the safety filter cuts the velocity."""
        desired = self._planner.plan(now, self.find_desired(now), dt_s)
        if now.layer_m is not None:
            desired = _keep_layer(desired, now.layer_m, now.around.own.pos_ned_m)
        heading = self._planner.heading()
        if heading is not None:
            self._face_along(heading)
        return Desired(desired, self.ref_ned_mps, self.yaw_rad)

    def find_desired(self, now: GuidanceInput) -> Vec3:
        """NED m/s, before the local planner leads it clear. Sets the reference and the heading too."""
        self.ref_ned_mps = ZERO
        around, apart = now.around, self._mission.separation
        match now.state:
            case FlightState.COVERAGE if now.dest_ned_m is not None and not self._planner.must_pause(now):
                desired = self._cover(now, now.dest_ned_m)
            case _ if now.state in IN_FORMATION and now.role is Role.LEADER:
                # The swarm arranges itself around its leader: that one gives way in the safety filter alone.
                desired = self._guide_leader(now)
            case _ if now.state in IN_FORMATION:
                desired = self._guide_follower(now)
            case _ if now.phase is SwarmPhase.LAND:
                level = [(rel[0], rel[1], 0.0) for rel in around.silent_ned_m]
                desired = formation.separation([_level(n) for n in around.neighbours], level, soft_m=apart.soft_m)
            case _:
                desired = formation.separation(around.neighbours, around.silent_ned_m, soft_m=apart.hard_m)
        if now.role is not Role.LEADER:
            self._planner.stop_leading()
            if now.excitation_ned_mps != ZERO:
                desired = add(desired, now.excitation_ned_mps)
        self._update_heading(now)
        # In layers who stands is where the others take it to be; who flies on does so at the mission's height
        is_apart = now.layer_m != self._mission.route.d1_enu_m[2]
        stands = now.layer_m is not None and (is_apart or now.state is FlightState.HOLD)
        if now.corridors and now.state in CORRIDORS_COUNT and not stands:
            desired = add(
                desired, keep_clear_of(now.corridors, clear_m=clearance_m(ObstacleKind.HIDDEN, Use.PASS, apart.hard_m))
            )
        return desired

    # --- the leader ---

    def to_goal_m(self, pos_ned_m: Vec3, goal: tuple[Vec3, float], standing: Mapping[int, PeerReport]) -> float:
        """Distance that a leader has to go: to the goal, or to the position beside it where none stands."""
        return norm(self._find_goal(pos_ned_m, goal[0], standing))

    def _find_goal(self, pos_ned_m: Vec3, goal_ned_m: Vec3, standing: Mapping[int, PeerReport]) -> Vec3:
        clear_m = clearance_m(ObstacleKind.SILENT, Use.STAY, self._mission.separation.hard_m)
        positions = find_hover_places(standing.values())
        return avoidance.find_clear_position(sub(goal_ned_m, pos_ned_m), positions, clear_m=clear_m)

    def _guide_leader(self, now: GuidanceInput) -> Vec3:
        if now.goal is None or self._planner.must_pause(now):
            return ZERO
        goal, stop_m = now.goal
        to_goal = self._find_goal(now.around.own.pos_ned_m, goal, now.around.hovering)
        if now.layer_m is not None:
            to_goal = (to_goal[0], to_goal[1], 0.0)
        cruise_mps = self._mission.route.vel_leader_mps
        if now.phase is SwarmPhase.GATHER:
            cruise_mps = min(cruise_mps, GATHER_MPS)
        along = scale(formation.approach(to_goal, cruise_mps=cruise_mps, stop_m=stop_m), now.governor)
        self.ref_ned_mps, desired = self._planner.plan_leader(now, along, to_goal, stop_m)
        return desired

    # --- a follower ---

    def _guide_follower(self, now: GuidanceInput) -> Vec3:
        apart = self._mission.separation
        self.ref_ned_mps = scale(formation.alignment(now.route), now.lease_freshness)
        pull = formation.cohesion(now.route, range_m=now.range_m)
        if self._axis_ne is not None and _is_on_lanes(now):
            pull = add(pull, formation.line_abreast(now.around.neighbours, self._line, self._axis_ne))
        push = self._planner.separate(now, add(self.ref_ned_mps, pull))
        desired = add(add(self.ref_ned_mps, push), add(pull, formation.level(now.route)))  # Algorithm 1, line 35
        if now.state in (FlightState.TRANSIT, FlightState.RETURNING) and now.dest_ned_m is not None:
            right = self._me % 2 == 0
            keep_out_m = max(self._mission.coverage.keep_out_m, apart.hard_m)
            clear_m = clearance_m(ObstacleKind.TRUNK, Use.PASS, keep_out_m)
            sideways = avoidance.pass_tree(self.ref_ned_mps, now.dest_ned_m, clear_m=clear_m, to_the_right=right)
            desired = add(desired, sideways)
        if norm(self.ref_ned_mps) < avoidance.PASS_SPEED_MPS:  # on the spot it is pushed, and keeps no course
            return desired
        return self._planner.plan_follower(now, desired)

    # --- coverage ---

    def _cover(self, now: GuidanceInput, dest: Vec3) -> Vec3:
        spec, apart = self._mission.coverage, self._mission.separation
        ring = spec.shape is CoverageShape.RING
        stranded = find_stranded(now.around.hovering) if ring else {}
        around = {n.id: n.rel_ned_m for n in now.around.neighbours if n.beacon.state is FlightState.COVERAGE}
        # One that holds there keeps its position; so does one that fell silent, until it counts as stranded.
        others = {n.id: n.rel_ned_m for n in now.around.neighbours if n.beacon.airborne}
        others |= {k: sighting.rel_ned_m for k, sighting in now.around.hovering.items() if k not in stranded}

        def is_in_the_way(rel: Vec3) -> bool:
            return abs(_from_tree_m(rel, dest, ring=ring) - spec.radius_m) <= apart.soft_m

        for vehicle, rel in others.items():
            if is_in_the_way(rel):
                around.setdefault(vehicle, rel)
        stranded = {k: rel for k, rel in stranded.items() if is_in_the_way(rel)}
        clear_m = clearance_m(ObstacleKind.SILENT, Use.STAY, apart.hard_m)
        if ring:
            spread = coverage.ring(
                dest,
                list(around.values()),
                size=max(now.size, len(around) + 1),
                radius_m=spec.radius_m,
                wait_m=apart.soft_m,
                range_m=now.range_m,
                is_free=self._planner.find_free(now),
                stranded_rel_ned_m=list(stranded.values()),
                told_rel_ned_m=[rel for k in stranded for rel in now.around.hovering[k].elsewhere],
                clear_m=clear_m,
            )
            if stranded:  # it comes to rest beside one, and is led round none
                self._planner.limit_reach(coverage.position_off_m(spread))
            spacing_m = 2.0 * spec.radius_m * math.sin(math.pi / (len(around) + 1))
        else:
            spread = coverage.sphere(dest, sorted(around.items()), me=self._me, radius_m=spec.radius_m)
            spacing_m = spec.radius_m * math.sqrt(4.0 * math.pi / (len(around) + 1))
        soft_m = max(apart.hard_m, min(apart.soft_m, 0.8 * spacing_m))
        if not stranded:
            return add(spread, formation.separation(now.around.neighbours, now.around.silent_ned_m, soft_m=soft_m))
        # Of those by which it is pushed, none is known by others' words alone.
        own = {k: s.rel_ned_m for k, s in now.around.hovering.items() if s.silent and not s.received}
        push = formation.separation(
            now.around.neighbours, [rel for k, rel in own.items() if k not in stranded], soft_m=soft_m
        )
        # No further than to the position that is free beside one: pushed on, a vehicle would not come to rest in it.
        away = formation.separation((), [rel for k, rel in own.items() if k in stranded], soft_m=min(soft_m, clear_m))
        return add(spread, add(push, away))

    def _update_heading(self, now: GuidanceInput) -> None:
        """Face the tree in coverage, else the way the swarm goes."""
        if now.state is FlightState.COVERAGE and now.dest_ned_m is not None:
            self.yaw_rad = math.atan2(now.dest_ned_m[1], now.dest_ned_m[0])
        else:
            self._face_along(self.ref_ned_mps)

    def _face_along(self, vel_ned_mps: Vec3) -> None:
        """Turn to where that leads."""
        if math.hypot(vel_ned_mps[0], vel_ned_mps[1]) > YAW_SPEED_MPS:
            self.yaw_rad = math.atan2(vel_ned_mps[1], vel_ned_mps[0])


def _is_on_lanes(now: GuidanceInput) -> bool:
    """In a mission that has some: on the way to them or on them, where no tree is ahead."""
    return now.state is FlightState.TRANSIT and now.phase is SwarmPhase.TRANSIT and now.dest_ned_m is None


def _keep_layer(desired: Vec3, layer_m: float, pos_ned_m: Vec3) -> Vec3:
    """`desired`, at the height of the layer: whatever else was wished for up or down."""
    below_m = -pos_ned_m[2] - layer_m
    return (desired[0], desired[1], max(-LAYER_MPS, min(LAYER_MPS, LAYER_GAIN_PER_S * below_m)))


def find_stranded(hovering: Mapping[int, PeerReport]) -> dict[int, Vec3]:
    """Relative positions (NED m), by id, of vehicles silent for so long that none waits for them on the ring."""
    return {
        k: sighting.rel_ned_m for k, sighting in hovering.items() if sighting.silent and sighting.age_s >= STRANDED_S
    }


def _from_tree_m(rel_ned_m: Vec3, dest_ned_m: Vec3, *, ring: bool) -> float:
    from_tree = sub(rel_ned_m, dest_ned_m)
    return math.hypot(from_tree[0], from_tree[1]) if ring else norm(from_tree)


def _level(neighbour: Neighbour) -> Neighbour:
    """The same neighbour as if at this vehicle's own height."""
    rel = neighbour.rel_ned_m
    return neighbour.at((rel[0], rel[1], 0.0), neighbour.dest_ned_m)


def build_planner(mission: Mission) -> LocalPlanner:
    """The make of the local planner that a mission's vehicles have."""
    if mission.sensing is None:
        return OpenSkyPlanner(mission)
    return SensingPlanner(mission, mission.sensing, SafetyFilter.of(mission))
