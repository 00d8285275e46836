"""Where a vehicle wants to go, the five conditions put together or coverage; and the last stage's word on it.

The agents fly by this, and so do the studies on point masses: there is one law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.guidance import avoidance, coverage, formation
from companion.core.guidance.local_planner import SensingPlanner
from companion.core.localisation.predicted_corridors import PredictedCorridor, aside
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import ZERO, add, dot, limit, norm, scale, sub
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.safety import obstacles
from companion.core.safety.obstacles import Obstacle
from companion.core.safety.safety_filter import MARGIN_M, SILENT_STRAY_M, SafetyFilter
from companion.core.safety.stopping import LocalObstacleCloud
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import CoverageShape, Mission

GATHER_MPS: Final = 1.0  # the leader on its way to d1, through those that have just taken off beside it
PASS_CLEAR_M: Final = 1.0  # more than the separation from a leader that stands at d2
ROUND_CLEAR_M: Final = 0.4  # more than the last stage keeps from one that hangs still
PLACE_CLEAR_M: Final = 1.0  # the same, for a place to stay
STAY_CLEAR_M: Final = 0.5  # more than is kept from a trunk in passing: for gusts
LINE_GAIN_PER_S: Final = 0.8  # back to the line: a velocity 0.4 m/s wrong is held within half a metre
LINE_LIMIT_MPS: Final = 1.0  # of that
LINE_ENDS_M: Final = 3.0  # a goal that is elsewhere by so much is another line's
HASTE: Final = 1.3  # of the leader's speed, among trees: one that a tree has held up catches up
GUSTS_LEAST: Final = 0.6  # of it in gusts: the more they change, the slower
LEADER_GIVES: Final = 0.3  # of its push away from the others, among trees
ALL_ROUND_DEG: Final = 355.0  # with a sensor that sees less, a vehicle faces where it flies
# Elsewhere each has its place.
LANES_COUNT = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.SEEKING, FlightState.HOLD)
WEAVES = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.COVERAGE)
LANE_CLEAR_M: Final = 1.2  # more than the separation
YAW_SPEED_MPS: Final = 0.3  # below this the heading stays


@dataclass(slots=True, init=False, unsafe_hash=True)
class GuidanceInput:
    """What a vehicle goes by in one tick."""

    own: Final[Position]  # with its true velocity
    neighbours: Final[Sequence[Neighbour]]
    standing: Final[Mapping[int, PeerReport]]  # by id: in the air, and not steered
    state: Final[FlightState]
    phase: Final[SwarmPhase]
    route: Final[formation.Route]
    range_m: Final[float]
    leads: Final[bool]  # and acts
    governor: Final[float]
    faith: Final[float]  # 1 while the leader is heard of, falling to 0 as its lease runs out
    goal: Final[tuple[Vec3, float] | None]  # a leader's: see `phases.Phases.goal`
    size: Final[int]  # of the swarm in the air
    obstacles: Final[ObstacleMap | None]  # what the own sensor saw; None: no sensor
    now_s: Final[float]  # of the clock that `obstacles` goes by
    lanes: Final[Sequence[PredictedCorridor]]  # of those that trees hide; none without a sensor
    off_ned_m: Final[Vec3]  # the mission's place less the own told one: what odometry is off by
    weave_ned_mps: Final[Vec3]  # see `weave`

    def __init__(
        self,
        own: Position,
        neighbours: Sequence[Neighbour],
        standing: Mapping[int, PeerReport],
        state: FlightState,
        phase: SwarmPhase,
        route: formation.Route,
        range_m: float,
        leads: bool,
        governor: float,
        faith: float,
        goal: tuple[Vec3, float] | None,
        size: int,
        obstacles: ObstacleMap | None = None,
        now_s: float = 0.0,
        lanes: Sequence[PredictedCorridor] = (),
        off_ned_m: Vec3 = ZERO,
        weave_ned_mps: Vec3 = ZERO,
    ) -> None:
        self.own = own
        self.neighbours = neighbours
        self.standing = standing
        self.state = state
        self.phase = phase
        self.route = route
        self.range_m = range_m
        self.leads = leads
        self.governor = governor
        self.faith = faith
        self.goal = goal
        self.size = size
        self.obstacles = obstacles
        self.now_s = now_s
        self.lanes = lanes
        self.off_ned_m = off_ned_m
        self.weave_ned_mps = weave_ned_mps

    @property
    def placed(self) -> Position:
        """`own`, in the mission's frame: for fence and trunk."""
        own = self.own
        return own if self.off_ned_m == ZERO else Position(add(own.pos_ned_m, self.off_ned_m), own.vel_ned_mps)

    @property
    def silent_ned_m(self) -> list[Vec3]:
        """Where those that fell silent hang: the others that stand are among the neighbours."""
        return [sighting.rel_ned_m for sighting in self.standing.values() if sighting.silent]


class Guidance:
    """One vehicle's. `ref_ned_mps` is what it hands down; `dest_ned_m` the vector to d2, where it is known."""

    def __init__(self, mission: Mission, me: int) -> None:
        self.ref_ned_mps = self.setpoint_ned_mps = ZERO
        self.dest_ned_m: Vec3 | None = None
        self.yaw_rad = 0.0
        self._mission, self._me = mission, me
        self._places_ned_m = [enu_to_ned(visit.pos_enu_m) for visit in mission.visits]
        self._trunks = obstacles.trunks(mission)
        self._filter = SafetyFilter.of(mission)
        self._dest_at: Vec3 | None = None  # odometry reading that goes with dest_ned_m
        self._dest_stop = 0  # which of the visits it leads to
        self._fixed = not mission.flies_by_ranges
        self.lag_m = 0.0  # how far a leader's vector to d2 is from what satellites say
        # Since when, and from where, this vehicle leads, and where to
        self._line: tuple[SwarmPhase, Vec3, Vec3] | None = None
        self._side = 0  # on which it passes what hangs still, see avoidance.way_round
        sensing = mission.sensing
        self._planner = None if sensing is None else SensingPlanner(sensing, self._filter)
        self._looks_ahead = sensing is not None and sensing.field_of_view_deg < ALL_ROUND_DEG
        self._reach_m = math.inf  # how far ahead anything is in the way: a leader stops at its goal

    def rest(self) -> None:
        """Not steered: a vehicle that gets control back starts from rest, not from what it last wanted."""
        self.ref_ned_mps = self.setpoint_ned_mps = ZERO
        self._line, self._side = None, 0
        if self._planner is not None:
            self._planner.rest()

    @property
    def to_d2_mps(self) -> float:
        """How fast the reference comes nearer to d2; 0 where it is not known."""
        dest = self.dest_ned_m
        if dest is None:
            return 0.0
        away_m = math.hypot(dest[0], dest[1])
        return (self.ref_ned_mps[0] * dest[0] + self.ref_ned_mps[1] * dest[1]) / away_m if away_m > 0.0 else 0.0

    def locate(
        self,
        own: Position,
        route: formation.Route,
        *,
        leads: bool,
        stop: int = 0,
        fix_ned_m: Vec3 | None = None,
        most_m: float = math.inf,
    ) -> None:
        """Vector to d2: the leader's own, a follower's as those nearer to the leader tell it, else by odometry.

        `stop`: which of the mission's visits the swarm is bound for, or at; d2 is the last. `fix_ned_m`: in a swarm
        that flies by ranges, where satellites have this vehicle; a leader goes over to that by `most_m` at once.
        """
        place, dest, at = self._places_ned_m[stop], self.dest_ned_m, self._dest_at
        if leads and (self._fixed or dest is None or at is None):
            self.dest_ned_m = sub(place, fix_ned_m or own.pos_ned_m)
        elif leads and dest is not None and at is not None:
            # An heir goes on from where its predecessor knew the swarm to be, by odometry; with satellites by these.
            on = sub(place, self._places_ned_m[self._dest_stop])
            self.dest_ned_m = add(on, sub(dest, sub(own.pos_ned_m, at)))
            if fix_ned_m is not None:
                self.dest_ned_m, self.lag_m = _nearer(self.dest_ned_m, sub(place, fix_ned_m), most_m)
        else:
            told = [n.dest_ned_m for n in route.up if n.dest_ned_m is not None]
            if told:
                total = ZERO
                for vector in told:
                    total = add(total, vector)
                self.dest_ned_m = scale(total, 1.0 / len(told))
            elif self.dest_ned_m is not None and self._dest_at is not None:
                self.dest_ned_m = sub(self.dest_ned_m, sub(own.pos_ned_m, self._dest_at))
        self._dest_at = own.pos_ned_m
        self._dest_stop = stop

    def off_ned_m(self, own: Position) -> Vec3:
        """The mission's place less the own told one, level; none where all have satellites, nor while d2 is not known.

        Of other swarms a vehicle is where its vector to d2 says, which comes from the leader, hop by hop.
        """
        if self._fixed or self.dest_ned_m is None:
            return ZERO
        there = sub(self._places_ned_m[self._dest_stop], self.dest_ned_m)
        return (there[0] - own.pos_ned_m[0], there[1] - own.pos_ned_m[1], 0.0)

    def steer(self, now: GuidanceInput, *, dt_s: float, drift_ned_mps: Vec3 = ZERO) -> Vec3:
        """The next setpoint, NED m/s. `drift_ned_mps`: the true velocity less the told one."""
        wish, seen = self.wish(now), None
        if self._planner is not None and now.obstacles is not None:
            gust = self._planner.estimate_disturbance(now.own, add(self.setpoint_ned_mps, drift_ned_mps), dt_s)
            drift_ned_mps = add(drift_ned_mps, gust)
            seen = self._planner.look(now.obstacles, now.own, now.now_s)
            wish = self._through(wish, now, self._planner, seen, drift_ned_mps, dt_s)
        self.setpoint_ned_mps = self._filter.apply(
            wish,
            self.setpoint_ned_mps,
            now.placed,
            now.neighbours,
            now.silent_ned_m,
            dt_s=dt_s,
            drift_ned_mps=drift_ned_mps,
            points=seen,
        )
        if self._looks_ahead and self._planner is not None:
            north, east = self._planner.wants  # not what it flies: a trunk is passed sideways, and stays in view
            self._face((north, east, 0.0))
        return self.setpoint_ned_mps

    def _through(
        self,
        wish: Vec3,
        now: GuidanceInput,
        planner: SensingPlanner,
        seen: LocalObstacleCloud,
        drift: Vec3,
        dt_s: float,
    ) -> Vec3:
        """A wish, led through what the sensor saw, past what hangs still and the mission's own trunk."""
        around = seen.copy()
        standing = [sighting.rel_ned_m for sighting in now.standing.values()]
        clear_m = self._mission.separation.hard_m + MARGIN_M + SILENT_STRAY_M + ROUND_CLEAR_M
        around.add([rel[0] for rel in standing], [rel[1] for rel in standing], clear_m)
        for trunk in self._trunks:
            to_it = trunk.seen_from(now.placed.pos_ned_m)
            around.add([to_it[0]], [to_it[1]], trunk.keep_out_m + MARGIN_M + ROUND_CLEAR_M)
        level = math.hypot(wish[0], wish[1])
        haste = max(GUSTS_LEAST, HASTE - planner.gusts.change_mps)
        most_mps = haste * self._mission.route.vel_leader_mps
        if level > most_mps:
            wish = (wish[0] * most_mps / level, wish[1] * most_mps / level, wish[2])
        bounds = self._filter.separations(now.own.vel_ned_mps, now.neighbours, now.silent_ned_m, among_trees=True)
        last = add(self.setpoint_ned_mps, drift)
        return planner.course(wish, now.own, last, around, bounds, reach_m=self._reach_m, dt_s=dt_s)

    def wish(self, now: GuidanceInput) -> Vec3:
        """NED m/s. Sets the reference and the heading too."""
        self.ref_ned_mps = ZERO
        self._reach_m = math.inf
        apart = self._mission.separation
        silent = now.silent_ned_m
        match now.state:
            case FlightState.COVERAGE if self.dest_ned_m is not None and not _pauses(now):
                wanted = self._cover(now, self.dest_ned_m)
            case FlightState.GATHERING | FlightState.TRANSIT | FlightState.RETURNING | FlightState.SEEKING if now.leads:
                # The swarm arranges itself around its leader: that one gives way in the safety stage alone.
                wanted = self._lead(now)
            case FlightState.GATHERING | FlightState.TRANSIT | FlightState.RETURNING | FlightState.SEEKING:
                wanted = self._follow(now, silent)
            case _ if now.phase is SwarmPhase.LAND:
                level = [(rel[0], rel[1], 0.0) for rel in silent]
                wanted = formation.separation([_level(n) for n in now.neighbours], level, soft_m=apart.soft_m)
            case _:
                wanted = formation.separation(now.neighbours, silent, soft_m=apart.hard_m)
        if not now.leads:
            self._line = None
            if now.weave_ned_mps != ZERO:
                wanted = add(wanted, now.weave_ned_mps)
        self._turn(now.state)
        if now.lanes and now.state in LANES_COUNT:
            wanted = add(wanted, aside(now.lanes, clear_m=apart.hard_m + LANE_CLEAR_M))
        return wanted

    # --- the leader ---

    def to_goal_m(self, pos_ned_m: Vec3, goal: tuple[Vec3, float], standing: Mapping[int, PeerReport]) -> float:
        """How far a leader has to go: to the goal, or to the place beside it where none stands."""
        return norm(self._to_place(pos_ned_m, goal[0], standing))

    def _to_place(self, pos_ned_m: Vec3, goal_ned_m: Vec3, standing: Mapping[int, PeerReport]) -> Vec3:
        clear_m = self._mission.separation.hard_m + MARGIN_M + PLACE_CLEAR_M
        places = [sighting.rel_ned_m for sighting in standing.values()]
        return avoidance.give_way(sub(goal_ned_m, pos_ned_m), places, clear_m=clear_m)

    def _lead(self, now: GuidanceInput) -> Vec3:
        if now.goal is None or _pauses(now):
            return ZERO
        goal, stop_m = now.goal
        to_goal = self._to_place(now.own.pos_ned_m, goal, now.standing)
        cruise_mps = self._mission.route.vel_leader_mps
        if now.phase is SwarmPhase.GATHER:
            cruise_mps = min(cruise_mps, GATHER_MPS)
        along = scale(formation.approach(to_goal, cruise_mps=cruise_mps, stop_m=stop_m), now.governor)
        if self._planner is not None and now.obstacles is not None:
            # Followers take the course, not the dodges: each makes its own.
            self.ref_ned_mps = along
            self._reach_m = norm(to_goal) - stop_m
            push = formation.separation(now.neighbours, now.silent_ned_m, soft_m=self._mission.separation.soft_m)
            return add(along, _not_against(scale(push, LEADER_GIVES), along))
        here = now.placed.pos_ned_m
        trunks = [Obstacle(t.seen_from(here), t.keep_out_m + MARGIN_M + ROUND_CLEAR_M, t.upright) for t in self._trunks]
        course = self._round(along, now, trunks, to_goal_m=norm(to_goal) - stop_m)
        # Followers take the course, not what leads this one vehicle back to its line; on a detour nothing does.
        self.ref_ned_mps = course
        return add(course, self._to_line(now, to_goal)) if course == along else course

    def _to_line(self, now: GuidanceInput, to_goal_ned_m: Vec3) -> Vec3:
        """Back to the straight line on which this leader has set out: a velocity that lies would carry it away."""
        here = now.own.pos_ned_m
        goal = add(here, to_goal_ned_m)
        if self._line is None or self._line[0] is not now.phase or self._is_elsewhere(goal, self._line[2]):
            self._line = (now.phase, here, goal)
        start = self._line[1]
        way = sub(add(here, to_goal_ned_m), start)
        if now.phase is SwarmPhase.GATHER or now.state is FlightState.SEEKING or norm(way) < 1.0:
            return ZERO
        unit = scale(way, 1.0 / norm(way))
        off = sub(here, start)
        aside = sub(off, scale(unit, dot(off, unit)))
        return limit(scale(aside, -LINE_GAIN_PER_S), LINE_LIMIT_MPS)

    def _is_elsewhere(self, goal: Vec3, before: Vec3) -> bool:
        """A leader that goes back along its own way has one goal after the other."""
        return not self._fixed and norm(sub(goal, before)) > LINE_ENDS_M

    # --- a follower ---

    def _follow(self, now: GuidanceInput, silent: list[Vec3]) -> Vec3:
        apart = self._mission.separation
        sees = self._planner is not None and now.obstacles is not None
        push = formation.separation(now.neighbours, () if sees else silent, soft_m=apart.soft_m)
        self.ref_ned_mps = scale(formation.alignment(now.route), now.faith)
        pull = formation.cohesion(now.route, range_m=now.range_m)
        if sees:
            # Those that hang silent are trunks to the planner: pushed back against its course, a follower stands before
            # one with nothing left to wish, and nobody looks for the way round.
            away = formation.separation((), silent, soft_m=apart.soft_m)
            push = add(push, _not_against(away, add(self.ref_ned_mps, pull)))
        wanted = add(add(self.ref_ned_mps, push), add(pull, formation.level(now.route)))  # Algorithm 1, line 35
        if now.state in (FlightState.TRANSIT, FlightState.RETURNING) and self.dest_ned_m is not None:
            right = self._me % 2 == 0
            clear_m = max(self._mission.coverage.keep_out_m, apart.hard_m) + PASS_CLEAR_M
            aside = avoidance.pass_by(self.ref_ned_mps, self.dest_ned_m, clear_m=clear_m, to_the_right=right)
            wanted = add(wanted, aside)
        if norm(self.ref_ned_mps) < avoidance.PASS_SPEED_MPS:  # on the spot it is pushed, and keeps no course
            return wanted
        if sees:
            return wanted
        return self._round(wanted, now, [], to_goal_m=math.inf)

    def _round(self, wanted: Vec3, now: GuidanceInput, others: Sequence[Obstacle], *, to_goal_m: float) -> Vec3:
        altitude_m, fence = -now.own.pos_ned_m[2], self._mission.fence
        clear_m = self._mission.separation.hard_m + MARGIN_M + SILENT_STRAY_M + ROUND_CLEAR_M
        standing = [Obstacle(sighting.rel_ned_m, clear_m) for sighting in now.standing.values()]
        course, self._side = avoidance.way_round(
            wanted,
            [*standing, *others],
            to_goal_m=to_goal_m,
            room_up_m=fence.altitude_max_m - altitude_m - MARGIN_M,
            room_down_m=altitude_m - fence.altitude_min_m - MARGIN_M,
            side=self._side,
        )
        return course

    # --- coverage ---

    def _cover(self, now: GuidanceInput, dest: Vec3) -> Vec3:
        spec, apart = self._mission.coverage, self._mission.separation
        ring = spec.shape is CoverageShape.RING
        around = {n.id: n.rel_ned_m for n in now.neighbours if n.beacon.state is FlightState.COVERAGE}
        # One that holds there keeps its place; so does one that fell silent, or flies on in a part that is not heard.
        others = {n.id: n.rel_ned_m for n in now.neighbours if n.beacon.airborne}
        others |= {k: sighting.rel_ned_m for k, sighting in now.standing.items()}
        for vehicle, rel in others.items():
            if abs(_from_tree_m(rel, dest, ring=ring) - spec.radius_m) <= apart.soft_m:
                around.setdefault(vehicle, rel)
        if ring:
            spread = coverage.ring(
                dest,
                list(around.values()),
                size=max(now.size, len(around) + 1),
                radius_m=spec.radius_m,
                wait_m=apart.soft_m,
                range_m=now.range_m,
                is_free=self._free_places(now),
            )
            spacing_m = 2.0 * spec.radius_m * math.sin(math.pi / (len(around) + 1))
        else:
            spread = coverage.sphere(dest, sorted(around.items()), me=self._me, radius_m=spec.radius_m)
            spacing_m = spec.radius_m * math.sqrt(4.0 * math.pi / (len(around) + 1))
        soft_m = max(apart.hard_m, min(apart.soft_m, 0.8 * spacing_m))
        return add(spread, formation.separation(now.neighbours, now.silent_ned_m, soft_m=soft_m))

    def _free_places(self, now: GuidanceInput) -> Callable[[float, float], bool] | None:
        """Whether a vehicle may stay in a place, north and east of this one; None: it sees none."""
        if self._planner is None or now.obstacles is None:
            return None
        norths, easts = now.obstacles.near(now.own.pos_ned_m, now.obstacles.max_m)
        clear_m = self._planner.clear_m + STAY_CLEAR_M
        return lambda north_m, east_m: all(
            [math.hypot(n - north_m, e - east_m) >= clear_m for n, e in zip(norths, easts, strict=True)]
        )

    def _turn(self, state: FlightState) -> None:
        """Face the tree in coverage, else the way the swarm goes."""
        if state is FlightState.COVERAGE and self.dest_ned_m is not None:
            self.yaw_rad = math.atan2(self.dest_ned_m[1], self.dest_ned_m[0])
        else:
            self._face(self.ref_ned_mps)

    def _face(self, vel_ned_mps: Vec3) -> None:
        """Turn to where that leads."""
        if math.hypot(vel_ned_mps[0], vel_ned_mps[1]) > YAW_SPEED_MPS:
            self.yaw_rad = math.atan2(vel_ned_mps[1], vel_ned_mps[0])


def _nearer(from_m: Vec3, to_m: Vec3, most_m: float) -> tuple[Vec3, float]:
    """From one vector towards another, by no more than so much; and how far that is from it."""
    off = sub(to_m, from_m)
    off_m = norm(off)
    return (to_m, 0.0) if off_m <= most_m else (add(from_m, scale(off, most_m / off_m)), off_m - most_m)


def _not_against(push: Vec3, course: Vec3) -> Vec3:
    """`push` without what of it is against the course: a swarm that flies ahead of its leader must not slow it."""
    square = dot(course, course)
    back = min(0.0, dot(push, course)) / square if square > 0.0 else 0.0
    return sub(push, scale(course, back))


def _pauses(now: GuidanceInput) -> bool:
    """See `obstacles.pauses`. Among trees vehicles are hidden for moments all the time, and what is near is seen."""
    return now.obstacles is None and obstacles.pauses(now.standing)


def _from_tree_m(rel_ned_m: Vec3, dest_ned_m: Vec3, *, ring: bool) -> float:
    from_tree = sub(rel_ned_m, dest_ned_m)
    return math.hypot(from_tree[0], from_tree[1]) if ring else norm(from_tree)


def _level(neighbour: Neighbour) -> Neighbour:
    """The same neighbour as if at this vehicle's own height."""
    rel = neighbour.rel_ned_m
    level = (rel[0], rel[1], 0.0)
    return Neighbour(neighbour.beacon, level, neighbour.dest_ned_m, neighbour.age_s, neighbour.vel_ned_mps, norm(level))
