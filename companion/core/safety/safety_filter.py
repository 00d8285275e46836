"""The safety filter: cuts every desired velocity to a setpoint that keeps the vehicle's limits.

It knows the vehicle, its neighbours, the local obstacle cloud and the fence: never which vehicle leads, and of what
others report only where they are and how fast. Precedence, highest first; what stands lower never buys anything at the
cost of what stands higher:

1. a finite desired velocity and a finite position, else rest;
2. what an obstacle sensor saw: the way to a stop keeps clear of it (`response_model`);
3. floor, ceiling, polygon, the mission's own trunks (`limits`);
4. separation, from neighbours and from those that fell silent in the air (`separations`);
5. the desired velocity.

Last, a setpoint moves away from the one before by no more than a tick of the acceleration limit, except towards rest,
as far as 2, 3 or 4 demand it. `apply` says what is promised, and `Setpoint.cuts` which of these has cut.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.model.states import CLIMBING, DESCENDING, FlightState
from companion.core.model.vectors import ZERO, dot, is_finite, limit, norm, scale, sub
from companion.core.perception.obstacle_cloud import GIVES_M, LocalObstacleCloud, Obstacle, ObstacleKind
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from companion.core.safety.bounds import (
    TOLERANCE_MPS,
    Bound,
    find_nearest,
    is_inside,
    step_towards,
    to_commanded,
    to_edges,
)
from companion.core.safety.clearance import MARGIN_M, Use, clearance_m
from companion.core.safety.response_model import BRAKING_SHARE, SPEED_MARGIN_S, ResponseModel
from companion.core.safety.setpoint import Setpoint
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission

AGE_WIDENS_MPS: Final = 1.0  # what a silent neighbour may have strayed from its last course
# of the error that a neighbour says its own position may have: its word moves nobody further than that; and of the own
ERROR_COUNTS_M: Final = 8.0
UNSHARED_M: Final = 0.7  # of the separation, that one takes which a trunk keeps from giving way
WAY_IN_MPS: Final = 1.0  # at least, for a vehicle outside the fence
SHARES = (1.0, 0.5)  # of a setpoint that are tried before rest, where it does not lead clear of trunks
ESCAPE_MAX_MPS: Final = 1.0
ESCAPE_GAIN_M: Final = 0.02  # less is not worth to leave rest for
BETWEEN_HEIGHTS: Final = CLIMBING | DESCENDING
AGAINST: Final = 0.5  # of the speed, to brake harder than rest does
# Out of a clearance, from what a verified way may give of it on: faster than corrected velocities are wrong, or one
# that rests beside a trunk drifts into it. Half of the margin below the clearance it is flown at the most.
OUT_PER_S: Final = 4.0
OUT_MAX_MPS: Final = 0.5


@dataclass(frozen=True, slots=True)
class SafetyFilter:
    """Holds a vehicle to its limits. Polygon: (north, east) metres in order round the fence, or empty."""

    speed_max_mps: float
    climb_max_mps: float
    acceleration_max_mps2: float
    hard_separation_m: float
    altitude_min_m: float
    altitude_max_m: float
    polygon_m: tuple[tuple[float, float], ...]
    senses: bool  # with an obstacle sensor: every setpoint is verified to a stop among what was seen

    @property
    def response(self) -> ResponseModel:
        """Response model with the vehicle's limits."""
        return ResponseModel(self.acceleration_max_mps2, BRAKING_SHARE * self.acceleration_max_mps2)

    @classmethod
    def of(cls, mission: Mission) -> SafetyFilter:
        """The limits, fence and separation of a mission."""
        return cls(
            mission.limits.speed_max_mps,
            mission.limits.climb_max_mps,
            mission.limits.acceleration_max_mps2,
            mission.separation.hard_m,
            mission.fence.altitude_min_m,
            mission.fence.altitude_max_m,
            tuple((y, x) for x, y in mission.fence.polygon_enu_m or ()),
            mission.sensing is not None,
        )

    def apply(self, desired_ned_mps: Vec3, around: Surroundings, *, dt_s: float) -> Setpoint:
        """The setpoint nearest to the desired velocity (NED m/s) that keeps all limits.

        With `last` the one before, `drift` what is flown less what is commanded, L the `limits` and S the
        `separations`, promised of the setpoint v of any input:

        - v is finite, within the speed limits, and no further than `acceleration_max_mps2 * dt_s` from k `last` for
          some k in 0..1, where `last` kept them;
        - along each bound of L it is at most max(0, its most) + TOLERANCE_MPS; where a bound of L is negative and not
          contradicted by another, it points away;
        - along each bound of S it is at most max(0, its most) + TOLERANCE_MPS, unless a bound of L is negative: where
          those of S contradict one another, who asks it to get away gives first. So no word pushes it at a third one.

        With an obstacle sensor it is as much of that v (0..1) as leads to rest clear of all that was seen
        (`ResponseModel.is_clear`), by SPEED_MARGIN_S of the own speed more than its clearance, or level rest: where v
        points away from a limit or a neighbour, trunks come first. A
        vehicle that is nearer than it should be by more than GIVES_M desires to get away besides, by OUT_PER_S, as far
        as that v leads clear.
        Braking so leaves the acceleration limit: the setpoint is v, half of v, or in true level motion (with `drift`)
        at most ESCAPE_MAX_MPS and AGAINST of the own speed, in one tick; how the vehicle follows is in `ResponseModel`.
        """
        drift, pos_ned_m = around.drift_ned_mps, around.placed.pos_ned_m
        if not (is_finite(desired_ned_mps) and is_finite(pos_ned_m)):
            return Setpoint(ZERO, (math.nan, math.nan, math.nan))
        desired, way_in = sub(desired_ned_mps, drift), self._way_in(pos_ned_m)
        turned = desired if way_in is None else sub(way_in, drift)
        north, east, down = limit(turned, self.speed_max_mps)
        limited = (north, east, max(-self.climb_max_mps, min(self.climb_max_mps, down)))
        bounds = self.limits(
            pos_ned_m, around.cloud.trunks, free_up_m=around.free_up_m, unsure_m=min(around.error_m, ERROR_COUNTS_M)
        )
        limits = to_commanded(bounds, drift)
        separations = self.separations(around, drift)
        bounded = self._shorten(find_nearest(limited, limits, separations))
        last = self._shorten(around.commanded_ned_mps) if is_finite(around.commanded_ned_mps) else ZERO
        reached = v = step_towards(bounded, last, [*limits, *separations], self.acceleration_max_mps2 * dt_s)
        if self.senses:
            tried = [scale(reached, share) if share < 1.0 else reached for share in SHARES]
            led_out = self._lead_out(limited, around.cloud, drift)
            if led_out != limited:
                bounded_out = self._shorten(find_nearest(led_out, limits, separations))
                step_mps = self.acceleration_max_mps2 * dt_s
                tried.insert(0, step_towards(bounded_out, last, [*limits, *separations], step_mps))
            v = self._keep_stop_clear(tried, last, around, limits, dt_s)
        return Setpoint(v, desired, turned, limited, bounded, reached, limits, separations)

    def _lead_out(self, desired: Vec3, cloud: LocalObstacleCloud, drift: Vec3) -> Vec3:
        """`desired`, and away from the point that is too near, in true motion; the same where none is."""
        north, east, lacking_m = cloud.find_way_out()
        if lacking_m <= GIVES_M:
            return desired
        out_mps = min(OUT_MAX_MPS, OUT_PER_S * (lacking_m - GIVES_M))
        more_mps = out_mps - ((desired[0] + drift[0]) * north + (desired[1] + drift[1]) * east)
        if more_mps <= 0.0:
            return desired
        return (desired[0] + more_mps * north, desired[1] + more_mps * east, desired[2])

    def _keep_stop_clear(
        self, tried: Sequence[Vec3], last: Vec3, around: Surroundings, limits: Sequence[Bound], dt_s: float
    ) -> Vec3:
        """The first of `tried` that leads to rest clear of what was seen; else an escape."""
        if not is_finite(around.own.vel_ned_mps):
            return ZERO
        response, drift = self.response, around.drift_ned_mps
        vel = (around.own.vel_ned_mps[0], around.own.vel_ned_mps[1])
        before = (last[0] + drift[0], last[1] + drift[1])
        passed = around.cloud.widened(SPEED_MARGIN_S * math.hypot(*vel))
        for v in tried:
            flown = (v[0] + drift[0], v[1] + drift[1])
            if response.is_clear(passed, vel, before, flown, dt_s, slews=False, disturbance=around.disturbance):
                return v
        return self._escape(vel, before, around, limits, tried[0][2])

    def _escape(
        self,
        vel: tuple[float, float],
        last: tuple[float, float],
        around: Surroundings,
        limits: Sequence[Bound],
        down_mps: float,
    ) -> Vec3:
        """Escapes where nothing is verified: true rest, or what keeps further from what is near and within `limits`.

        Level: `down_mps` is flown as it was desired, or a vehicle that finds no clear way for seconds leaves its height
        by what its velocity is wrong, up into a crown or down.

        Where a vehicle is nearest now, all ways keep as near: then the one that ends further off, and comes no nearer.
        """
        cloud, drift, response = around.cloud, around.drift_ned_mps, self.response
        push_n, push_e = cloud.push_away(0.0, ESCAPE_MAX_MPS)
        best, most_m, ends_m = ZERO, -1.0, -1.0
        ways = ((0.0, 0.0), (push_n, push_e), (push_n - AGAINST * vel[0], push_e - AGAINST * vel[1]))
        for k in range(len(ways)):  # the first is rest: it may leave the limits, as it leans against the wind
            v = self._shorten((ways[k][0] - drift[0], ways[k][1] - drift[1], down_mps))
            if k > 0 and not all([dot(v, bound.along) <= max(0.0, bound.most_mps) + TOLERANCE_MPS for bound in limits]):
                continue
            flown = (v[0] + drift[0], v[1] + drift[1])
            nearest_m, end_m = response.find_nearest_m(cloud, vel, last, flown, around.disturbance)
            is_end_further = nearest_m >= most_m and end_m > ends_m + ESCAPE_GAIN_M
            if nearest_m > most_m + ESCAPE_GAIN_M or is_end_further:
                best, most_m, ends_m = v, nearest_m, end_m
        return best

    def limits(
        self, pos_ned_m: Vec3, trunks: Sequence[Obstacle], *, free_up_m: float = -math.inf, unsure_m: float = 0.0
    ) -> list[Bound]:
        """Floor, ceiling, the sides of the polygon (outside: the way further out), the mission's own trunks.

        `free_up_m`: the ceiling where that is higher, in a column that own rays have seen free. `unsure_m`: level error
        of the position, by which it comes no nearer to the sides.
        """
        response = self.response
        altitude_m = -pos_ned_m[2]
        ceiling_m = max(self.altitude_max_m, free_up_m)
        bounds = [
            Bound((0.0, 0.0, 1.0), response.closing_mps(altitude_m - self.altitude_min_m - MARGIN_M)),
            Bound((0.0, 0.0, -1.0), response.closing_mps(ceiling_m - altitude_m - MARGIN_M)),
        ]
        sides = to_edges(pos_ned_m, self.polygon_m)
        if sides and is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            for side in sides:
                bounds += self._bound(response, side, MARGIN_M, unsure_m)
        elif sides:
            way_in = min(sides, key=norm)
            out_m = norm(way_in)
            if out_m > 1e-6:
                bounds.append(Bound(scale(way_in, -1.0 / out_m), response.closing_mps(-out_m - MARGIN_M)))
        for trunk in trunks:
            north, east, down = trunk.rel_ned_m
            keep_m = clearance_m(ObstacleKind.TRUNK, Use.FILTER, trunk.keep_out_m)
            bounds += self._bound(response, (north, east, 0.0) if trunk.upright else (north, east, down), keep_m)
        return bounds

    def separations(self, around: Surroundings, drift_ned_mps: Vec3 = ZERO) -> list[Bound]:
        """Bounds on closing on each of the others: of the commanded velocity, which the drift amends.

        Among trees those that give way may stop at once, before a trunk; in the open those that the fence stops. One
        whose beacon is overdue may hover silent, too; where others hear one that this vehicle does not counts as where
        that one hovers. One that its autopilot takes up from below, or down from above, is kept from at every height.
        """
        response, unsure_m = self.response, min(around.error_m, ERROR_COUNTS_M)
        bounds = to_commanded(self._separations_from_still(around, unsure_m), drift_ned_mps)
        own_x, own_y, own_z = around.own.vel_ned_mps
        fence_m = math.inf if self.senses else self._fence_m(around.placed.pos_ned_m)
        drift_x, drift_y, drift_z = drift_ned_mps
        for neighbour in around.neighbours:  # written out: this runs for every neighbour in every tick
            distance_m = neighbour.distance_m
            if not 1e-6 < distance_m < math.inf:
                continue
            share, (x, y, z), (vx, vy, vz) = 1.0 / distance_m, neighbour.rel_ned_m, neighbour.vel_ned_mps
            n = x, y, z = x * share, y * share, z * share
            late_s = neighbour.late_s  # it may have braked or turned since it told of itself
            strayed_m = AGE_WIDENS_MPS * neighbour.age_s + 0.5 * self.acceleration_max_mps2 * late_s * late_s
            error_m = neighbour.beacon.position_error_m  # it does not know where it is: its word frees nothing
            strayed_m += min(error_m, ERROR_COUNTS_M)
            room_m = distance_m - self.hard_separation_m - MARGIN_M - strayed_m
            its_mps, own_mps = vx * x + vy * y + vz * z, own_x * x + own_y * y + own_z * z
            most_mps = response.closing_mps(room_m) + self._believed(its_mps if error_m <= 0.0 else min(0.0, its_mps))
            if neighbour.gives_way:  # half of the allowed closing speed each, about the pair's common velocity
                shared_mps = response.closing_mps(room_m) / 2.0 + self._believed((own_mps + its_mps) / 2.0)
                if self.senses:
                    shared_mps = min(shared_mps, response.behind_mps(room_m + UNSHARED_M, self._believed(its_mps)))
                elif its_mps > 0.0 and distance_m + response.stopping_m(self._believed(its_mps)) > fence_m:
                    shared_mps = min(shared_mps, response.behind_mps(room_m, self._believed(its_mps)))
                most_mps = shared_mps if error_m <= 0.0 else min(most_mps, shared_mps)
            if unsure_m > 0.0:  # it slows: who does not know where it is pushes away from nobody by that
                unsure_mps = response.closing_mps(room_m - unsure_m) + self._believed(its_mps)
                most_mps = min(most_mps, max(0.0, unsure_mps))
            bounds.append(Bound(n, most_mps - (x * drift_x + y * drift_y + z * drift_z)))
        bounds += self._separations_from_seen(around.seen, around.own.vel_ned_mps, drift_ned_mps)
        return bounds

    def _fence_m(self, pos_ned_m: Vec3) -> float:
        """Level distance to the nearest side of the fence; infinite outside, and without one."""
        if not self.polygon_m or not is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            return math.inf
        return min([norm(side) for side in to_edges(pos_ned_m, self.polygon_m)])

    def _separations_from_still(self, around: Surroundings, unsure_m: float) -> list[Bound]:
        """Bounds of the true velocity on closing on places, and on columns in which a vehicle climbs or lands."""
        response = self.response
        bounds: list[Bound] = []
        keep_m = clearance_m(ObstacleKind.SILENT, Use.FILTER, self.hard_separation_m)
        for rel in around.silent_ned_m:
            bounds += self._bound(response, rel, keep_m, unsure_m)
        for rel in around.told_ned_m:
            bounds += [Bound(b.along, max(0.0, b.most_mps)) for b in self._bound(response, rel, keep_m, unsure_m)]
        column_m = clearance_m(ObstacleKind.NEIGHBOUR, Use.FILTER, self.hard_separation_m)
        for neighbour in around.neighbours:
            rel, beacon = neighbour.rel_ned_m, neighbour.beacon
            comes = (
                FlightState.LANDING if rel[2] < 0.0 else FlightState.TAKING_OFF
            )  # to this height, giving way to nobody
            if neighbour.is_overdue and beacon.airborne:
                bounds += self._bound(response, rel, keep_m, unsure_m)
                if beacon.state in BETWEEN_HEIGHTS:  # and at every height, as one that is silent
                    bounds += self._bound(response, (rel[0], rel[1], 0.0), keep_m, unsure_m)
            elif beacon.state is comes and beacon.airborne:
                bounds += self._bound(response, (rel[0], rel[1], 0.0), column_m, unsure_m)
        for rel, age_s in around.relayed:
            told = self._bound(response, rel, keep_m + AGE_WIDENS_MPS * age_s, unsure_m)
            bounds += [Bound(b.along, max(0.0, b.most_mps)) for b in told]
        return bounds

    def _separations_from_seen(
        self, seen: Sequence[SeenVehicle], own_ned_mps: Vec3, drift_ned_mps: Vec3
    ) -> list[Bound]:
        """Bounds on closing on vehicles seen, level: of those that are not heard nobody knows whether they give way.

        One that is heard has another bound, by its word: so its word alone brings nobody nearer to where it is.
        """
        bounds: list[Bound] = []
        for vehicle in seen:
            distance_m = norm(vehicle.rel_ned_m)
            if not 1e-6 < distance_m < math.inf:
                continue
            along = scale(vehicle.rel_ned_m, 1.0 / distance_m)
            strayed_m = AGE_WIDENS_MPS * vehicle.age_s + vehicle.sd_m
            room_m = distance_m - self.hard_separation_m - MARGIN_M - strayed_m
            seen_mps = dot(vehicle.vel_ned_mps, along)
            most_mps = self.response.closing_mps(room_m) + self._believed(seen_mps)
            if vehicle.gives_way:  # both brake
                shared_mps = self._believed((dot(own_ned_mps, along) + seen_mps) / 2.0)
                most_mps = self.response.closing_mps(room_m) / 2.0 + shared_mps
            bounds.append(Bound(along, most_mps - dot(along, drift_ned_mps)))
        return bounds

    def _believed(self, speed_mps: float) -> float:
        """No vehicle is faster than the limit; 0 for what is no number."""
        if speed_mps - speed_mps != 0.0:  # not finite
            return 0.0
        return max(-self.speed_max_mps, min(self.speed_max_mps, speed_mps))

    def _bound(self, response: ResponseModel, to_obstacle: Vec3, keep_m: float, unsure_m: float = 0.0) -> list[Bound]:
        """Bound on closing on a still obstacle, so as to stop `keep_m` before it.

        `unsure_m`: so much farther off it comes no nearer; it is not pushed away by that.
        """
        distance_m = norm(to_obstacle)
        if not 1e-6 < distance_m < math.inf:
            return []
        most_mps = response.closing_mps(distance_m - keep_m)
        if unsure_m > 0.0:
            most_mps = min(most_mps, max(0.0, response.closing_mps(distance_m - keep_m - unsure_m)))
        return [Bound(scale(to_obstacle, 1.0 / distance_m), most_mps)]

    def _way_in(self, pos_ned_m: Vec3) -> Vec3 | None:
        """Level velocity back to the polygon; None for a vehicle inside, where the desired velocity counts."""
        if not self.polygon_m or is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            return None
        way_in = min(to_edges(pos_ned_m, self.polygon_m), key=norm)
        out_m = max(norm(way_in), 1e-6)
        return scale(way_in, max(WAY_IN_MPS, min(self.speed_max_mps, out_m)) / out_m)

    def _shorten(self, v: Vec3) -> Vec3:
        """Within the speed limits, in the same direction: to cut the climb alone might close on a neighbour."""
        v = limit(v, self.speed_max_mps)
        if abs(v[2]) <= self.climb_max_mps:
            return v
        return scale(v, self.climb_max_mps / abs(v[2]))
