"""A leader rises above the crowns, to deliver records that the base station has not acknowledged, and comes down.

Where the mission allows it (`survey.rise_to_m`), the acting leader with a majority does, in coverage, when it rests: no
other vehicle may. It flies to a column near its place that its own rays have seen free, up to the top, rises in it, and
comes down in the same column: when all is delivered, or for any row of `reasons.DESCENDS`. The safety filter holds it,
as all, below `fence.altitude_max_m`, but for as long as this stage tells it of a column that is free (`free_up_m`).
"""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import Final, final

from companion.core.guidance.guidance_input import Desired
from companion.core.model.actions import Say, brief
from companion.core.model.neighbour import find_hover_places
from companion.core.model.states import FlightState, Role, Severity, SwarmPhase
from companion.core.model.vectors import ZERO, limit, scale
from companion.core.perception.columns.column import Column
from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.perception.obstacle_perception import ObstaclePerception, SensingPerception
from companion.core.rise.beside import Others, bring_beside
from companion.core.rise.reasons import DESCENDS, SAID, STAYS, Reason, RiseReadings, find_reason
from companion.core.safety.clearance import MARGIN_M, Use, clearance_m
from companion.core.swarm.orders import Orders
from companion.core.swarm.picture import Picture
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.rules.rise_rules import APPROACH_S, DOWN_MPS

NO_COLUMN: Final = -math.inf
REACH_M: Final = 8.0  # level, from the place in coverage to a column
THERE_M: Final = 0.3  # of the axis
CLIMBS_M: Final = 0.5  # of the axis: farther off it goes neither up nor down
LEAVES_M: Final = 0.8  # of the axis: farther off the column is not its own any more
BACK_S: Final = 10.0  # farther off than CLIMBS_M on the way down: so long it stays at its height to come back to it
LEVEL_GAIN_PER_S: Final = 0.8
LEVEL_MPS: Final = 1.0
UP_GAIN_PER_S: Final = 1.0
UP_MPS: Final = 1.0
BELOW_M: Final = 0.2  # less than the filter allows at the top
DOWN_M: Final = 0.5  # of the height of coverage: it is down
ABOVE_M: Final = 1.0  # the height that holds all others: what heights are off
AGAIN_S: Final = 60.0  # after it came down
LOOKS_S: Final = 1.0  # from one look at the columns to the next
FLOOR_M: Final = 0.6  # above the height of coverage: where others fly about is no part of a column
OUTWARD = (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE)


class Stage(Enum):
    """Stages of a rise."""

    RESTS = auto()
    APPROACHES = auto()  # on its way to the column
    RISES = auto()  # or up
    DESCENDS = auto()


class Rise:
    """One vehicle's. Base, and the make of missions in which nobody rises."""

    @property
    def is_away(self) -> bool:
        """It is not at its place in coverage: it does not take the swarm on."""
        return False

    @property
    def is_allowed(self) -> bool:
        """The mission has its leader rise."""
        return False

    @property
    def free_up_m(self) -> float:
        """Height up to which this vehicle may fly above the fence's ceiling, in a column that it has seen free."""
        return NO_COLUMN

    def note_waiting(self, waiting: int, now_s: float) -> None:
        """Takes in how many records that this node knows of are not acknowledged by the base station."""

    def update(self, picture: Picture, orders: Orders) -> list[Say]:  # noqa: ARG002
        """Once a tick; words for the operator."""
        return []

    def bring_beside(self, picture: Picture) -> Others:
        """The others, as they count for separation."""
        return picture.neighbours, picture.hovering

    def steer_rise(self, desired: Desired) -> Desired:
        """Leads to the column, up or down; else as desired."""
        return desired


@final
class ColumnRise(Rise):
    """In a mission that allows it."""

    def __init__(self, mission: Mission, perception: SensingPerception, rise_to_m: float, sees_m: float) -> None:
        """`sees_m`: range of the sensor."""
        self._perception: Final = perception
        self._top_m: Final = rise_to_m
        self._ceiling_m: Final = mission.fence.altitude_max_m
        self._heights_m: Final = [visit.pos_enu_m[2] for visit in mission.visits]
        self._lane_ends: Final = 2 * len(mission.lanes)  # visits, before all others: no tree is ahead
        self._radius_m: Final = mission.coverage.radius_m
        self._sees_m: Final = sees_m + mission.coverage.radius_m
        self._clear_m: Final = clearance_m(ObstacleKind.SILENT, Use.STAY, mission.separation.hard_m)
        self._climb_mps: Final = min(UP_MPS, mission.limits.climb_max_mps)
        self.stage = Stage.RESTS
        self._placed_ned_m = ZERO  # now, as trunks have it
        self._column: Column | None = None
        self._axis_ne_m = (0.0, 0.0)
        self._home_up_m = self._heights_m[0]
        self._laid_stop = -1
        self._began_s = self._again_s = self._looked_s = -math.inf
        self._astray_s: float | None = None  # on the way down: since it is farther off than CLIMBS_M
        self._back_up_m = NO_COLUMN  # then: its height, for BACK_S
        self._covers_since_s: float | None = None
        self._waiting = 0
        self._grew_s: float | None = None  # when the base station acknowledged one more
        self._stayed_by: tuple[Reason, int] | None = None  # that was said last, and at which stop

    # --- what it takes in ---

    @property
    def is_allowed(self) -> bool:
        """It does."""
        return True

    def note_waiting(self, waiting: int, now_s: float) -> None:
        """As the base says."""
        if self._grew_s is None or waiting < self._waiting:
            self._grew_s = now_s
        self._waiting = waiting

    def update(self, picture: Picture, orders: Orders) -> list[Say]:
        """As the base says."""
        own = picture.own
        if own is None:
            return []
        self._placed_ned_m = self._perception.correct_place(own.pos_ned_m)
        self._lay_columns(picture, orders)
        if not orders.steers or not picture.is_steered:  # its autopilot or its pilot has it
            self.stage, self._covers_since_s = Stage.RESTS, None
            return []
        self._note_astray(picture.now_s)
        match self.stage:
            case Stage.RESTS if self._up_m > self._ceiling_m + ABOVE_M:
                # A companion that has started anew up there: what is below is the way that it came
                self._axis_ne_m, self.stage = (self._placed_ned_m[0], self._placed_ned_m[1]), Stage.DESCENDS
                return [Say(Severity.WARNING, "rise ends: steered anew")]
            case Stage.RESTS:
                return self._consider_rise(picture, orders)
            case Stage.APPROACHES:
                return self._approach_column(picture, orders)
            case Stage.RISES:
                reason = find_reason(DESCENDS, self._take_readings(picture, orders))
                return [] if reason is None else self._begin_descent(reason)
            case Stage.DESCENDS:
                if self._up_m <= self._home_up_m + DOWN_M:
                    self._end_rise(picture.now_s)
                return []

    def _note_astray(self, now_s: float) -> None:
        """Record since when it is off its column on the way down, and the height that it comes back at."""
        if self.stage is not Stage.DESCENDS or self._off_m <= CLIMBS_M:
            self._astray_s, self._back_up_m = None, NO_COLUMN
        elif self._astray_s is None:
            self._astray_s, self._back_up_m = now_s, self._up_m
        elif now_s - self._astray_s >= BACK_S:
            self._back_up_m = NO_COLUMN

    # --- the stages ---

    def _lay_columns(self, picture: Picture, orders: Orders) -> None:
        """About the tree that comes next, once its ring is in sight."""
        columns, dest, stop = self._perception.columns, picture.dest_ned_m, orders.stop
        if orders.phase not in OUTWARD:
            columns.clear()
            return
        is_new = self._lane_ends <= stop != self._laid_stop
        if is_new and dest is not None and math.hypot(dest[0], dest[1]) <= self._sees_m:
            self._laid_stop, self._home_up_m = stop, self._heights_m[stop]
            tree_ne_m = (self._placed_ned_m[0] + dest[0], self._placed_ned_m[1] + dest[1])
            columns.lay_ring(tree_ne_m, radius_m=self._radius_m, floor_up_m=self._home_up_m + FLOOR_M)

    def _consider_rise(self, picture: Picture, orders: Orders) -> list[Say]:
        now_s = picture.now_s
        # As leader: whose time at the tree is up goes on before, so that no two rises prolong one coverage
        if not (_leads(orders) and _covers(orders)):
            self._covers_since_s = None
        elif self._covers_since_s is None:
            self._covers_since_s = now_s
        if now_s < self._again_s or now_s - self._looked_s < LOOKS_S:
            return []
        self._looked_s, self._column = now_s, None
        reason = find_reason(STAYS, self._take_readings(picture, orders))
        if reason is None:
            self._column = self._choose_column(picture)
            reason = Reason.BLOCKED
        if self._column is None:
            return self._report_stay(reason, orders.stop)
        self._axis_ne_m = (self._column.north_m, self._column.east_m)
        self.stage, self._began_s, self._stayed_by = Stage.APPROACHES, now_s, None
        return [Say(Severity.NOTICE, brief(f"records: {self._waiting} waiting; rising to {self._top_m:.0f} m"))]

    def _approach_column(self, picture: Picture, orders: Orders) -> list[Say]:
        reason = find_reason(DESCENDS, self._take_readings(picture, orders))
        if reason is None and picture.now_s - self._began_s > APPROACH_S:
            reason = Reason.UNREACHED
        if reason is not None:
            self._end_rise(picture.now_s)
            return [Say(Severity.NOTICE, f"not rising: {reason.value}")]
        if self._off_m <= THERE_M and picture.settled:
            self.stage, self._began_s = Stage.RISES, picture.now_s
        return []

    def _begin_descent(self, reason: Reason) -> list[Say]:
        self.stage = Stage.DESCENDS
        severity = Severity.INFO if reason is Reason.DELIVERED else Severity.NOTICE
        return [Say(severity, f"rise ends: {reason.value}")]

    def _end_rise(self, now_s: float) -> None:
        self.stage, self._again_s, self._covers_since_s = Stage.RESTS, now_s + AGAIN_S, None

    def _report_stay(self, reason: Reason, stop: int) -> list[Say]:
        """Says why it does not rise, once at each tree."""
        if reason not in SAID or self._stayed_by == (reason, stop):
            return []
        self._stayed_by = (reason, stop)
        return [Say(Severity.NOTICE, f"not rising: {reason.value}")]

    def _choose_column(self, picture: Picture) -> Column | None:
        """The nearest that is free up to its top, and in which nobody else hovers or flies."""
        here_n, here_e, _ = self._placed_ned_m
        others = _places_of(picture)
        for column in self._perception.columns.find_free(self._placed_ned_m, picture.now_s, within_m=REACH_M):
            n, e = column.north_m - here_n, column.east_m - here_e
            if all([math.hypot(rel[0] - n, rel[1] - e) >= self._clear_m for rel in others]):
                return column
        return None

    def _take_readings(self, picture: Picture, orders: Orders) -> RiseReadings:
        now_s, column = picture.now_s, self._column
        return RiseReadings(
            leads=_leads(orders),
            covers=_covers(orders),
            covers_s=0.0 if self._covers_since_s is None else now_s - self._covers_since_s,
            rests=picture.settled,
            waiting=self._waiting,
            quiet_s=0.0 if self._grew_s is None else now_s - self._grew_s,
            battery_percent=picture.battery_percent,
            is_free=column is not None and column.is_free(now_s, from_up_m=self._up_m),
            is_alone=all([self._up_m - rel[2] <= self._ceiling_m + ABOVE_M for rel in _places_of(picture)]),
            since_s=now_s - self._began_s,
        )

    # --- the way ---

    @property
    def is_away(self) -> bool:
        """As the base says."""
        return self.stage is not Stage.RESTS

    @property
    def free_up_m(self) -> float:
        """As the base says."""
        if self.stage is Stage.RISES and self._off_m <= LEAVES_M:
            return self._top_m
        return self._back_up_m + MARGIN_M

    def bring_beside(self, picture: Picture) -> Others:
        """As the base says: for a vehicle that is up itself, others are where they are."""
        above_m = self._ceiling_m + ABOVE_M - self._up_m
        others = super().bring_beside(picture)
        return others if above_m < 0.0 else bring_beside(others, above_m=above_m)

    def steer_rise(self, desired: Desired) -> Desired:
        """As the base says."""
        if self.stage is Stage.RESTS:
            return desired
        off = (self._axis_ne_m[0] - self._placed_ned_m[0], self._axis_ne_m[1] - self._placed_ned_m[1], 0.0)
        north_mps, east_mps, _ = limit(scale(off, LEVEL_GAIN_PER_S), LEVEL_MPS)
        return Desired((north_mps, east_mps, -self._climb()), ZERO, desired.yaw_rad)

    def _climb(self) -> float:
        """Up, m/s."""
        home_mps = UP_GAIN_PER_S * (self._home_up_m - self._up_m)
        if self.stage is Stage.APPROACHES:
            return max(-self._climb_mps, min(self._climb_mps, home_mps))
        if self._off_m > CLIMBS_M:
            return 0.0
        if self.stage is Stage.RISES:
            top_m = self._top_m - MARGIN_M - BELOW_M
            return max(-self._climb_mps, min(self._climb_mps, UP_GAIN_PER_S * (top_m - self._up_m)))
        return min(0.0, max(-DOWN_MPS, home_mps))

    @property
    def _up_m(self) -> float:
        return -self._placed_ned_m[2]

    @property
    def _off_m(self) -> float:
        return math.hypot(self._axis_ne_m[0] - self._placed_ned_m[0], self._axis_ne_m[1] - self._placed_ned_m[1])


def _leads(orders: Orders) -> bool:
    """The acting leader, of a majority."""
    lease = orders.lease
    return orders.role is Role.LEADER and orders.leader != 0 and lease is not None and lease.quorum


def _covers(orders: Orders) -> bool:
    return orders.phase is SwarmPhase.COVERAGE and orders.state is FlightState.COVERAGE


def _places_of(picture: Picture) -> list[Vec3]:
    """Relative places of others in the air."""
    heard = [n.rel_ned_m for n in picture.neighbours if n.beacon.airborne]
    return heard + find_hover_places(picture.hovering.values())


def build_rise(mission: Mission, perception: ObstaclePerception) -> Rise:
    """The make that a mission's vehicle has."""
    sensing, rise_to_m = mission.sensing, mission.rise_to_m
    if rise_to_m is None or sensing is None or not isinstance(perception, SensingPerception):
        return Rise()
    return ColumnRise(mission, perception, rise_to_m, sensing.range_m)
