"""Agents without a wire: each on a simple autopilot that moves at once, beacons as values. Small, exact, fast."""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass, field

from companion.core.agent import TICK_S, Agent
from companion.core.localisation.integrity.own_position import OwnPosition
from companion.core.model.actions import Action, Ask, Say, SendBeacon, VelocitySetpoint
from companion.core.model.beacon import Beacon
from companion.core.model.events import (
    Answer,
    AutopilotHealth,
    AutopilotMode,
    HeardBeacon,
    Landed,
    ObstacleScan,
    OperatorOrder,
    Position,
    Satellites,
)
from companion.core.model.states import FlightMode, FlightState, LandedState, Order, Request, Result
from companion.core.model.vectors import ZERO, add, scale, sub
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3
from mission.document.model import Mission
from tests.unit.core.core_kit import mission

LAG_S = 0.3
SECTORS, SIGHT_M, BODY_M = 72, 8.0, 0.35
OFFBOARD_LOSS_S = 0.5


@dataclass
class Aircraft:
    """An agent, its autopilot and its airframe."""

    agent: Agent
    pos_ned_m: Vec3
    vel_ned_mps: Vec3 = ZERO
    mode: FlightMode = FlightMode.HOLD
    armed: bool = False
    failsafe: bool = False
    battery_percent: int | None = 90
    can_arm: bool = True
    estimates_position: bool = True
    has_fix: bool | None = None  # as its receiver tells; None: it does not
    can_climb: bool = True
    is_linked: bool = True  # its autopilot and its agent hear each other
    tells_mode: bool = True  # by HEARTBEATs
    tells_health: bool = True  # its charge, and whether it is ready to arm
    tells_landed: bool = True  # whether it is in the air
    boot_s: float | None = None  # when its autopilot was started; None: it does not tell
    late_s: float = 0.0  # positions are under way for so long
    off_ned_m: Vec3 = (0.0, 0.0, 0.0)  # what it tells of its position, less the true one
    frozen_ned_m: Vec3 | None = None  # it tells this one
    sees: bool = True  # its obstacle sensor works, where the mission has one
    ranges_m: tuple[float, ...] = (math.inf,) * SECTORS  # what that sees, from north clockwise
    refuses: Result | None = None  # its answer to whatever is asked
    setpoint: VelocitySetpoint | None = None
    setpoint_s: float = -1e9
    takeoff_m: float = 0.0
    said: list[str] = field(default_factory=list)
    asked: list[Request] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)  # of the last tick

    @property
    def id(self) -> int:
        return self.agent.id

    @property
    def altitude_m(self) -> float:
        return -self.pos_ned_m[2]

    @property
    def state(self) -> FlightState:
        return self.agent.flight.state

    def put(self, pos_ned_m: Vec3) -> None:
        """There at once, as if it had flown there: or its agent would take the jump off what it is told."""
        self.pos_ned_m = pos_ned_m
        self.agent.own_position = OwnPosition(self.agent.mission, self.agent.localiser, self.agent.perception)

    def forget(self, vehicle_id: int) -> None:
        """As if it had never been heard."""
        del self.agent.localiser.peers._heard[vehicle_id]

    def tick(self, now_s: float) -> Beacon | None:
        """What the autopilot says, a tick of the agent, and what it asks for; its beacon, when one is due."""
        if self.is_linked:
            self._tell(now_s)
        if self.agent.mission.sensing is not None and self.sees:
            self.agent.receive(ObstacleScan(196, self.ranges_m, 0.0, math.tau / SECTORS, 0.2, SIGHT_M), now_s)
        self.actions = self.agent.tick(now_s)
        sent = None
        for action in self.actions:
            match action:
                case VelocitySetpoint() if self.is_linked:
                    self.setpoint, self.setpoint_s = action, now_s
                case SendBeacon(beacon):
                    sent = beacon
                case Ask(request, altitude_m):
                    self.asked.append(request)
                    if self.refuses is not None:
                        self.agent.receive(Answer(request, self.refuses), now_s)
                    elif self.is_linked:
                        self._obey(request, altitude_m, now_s)
                case Say(_, text):
                    self.said.append(text)
        return sent

    def _tell(self, now_s: float) -> None:
        landed = LandedState.IN_AIR if self.altitude_m > 0.1 else LandedState.ON_GROUND
        if self.tells_mode:
            self.agent.receive(
                AutopilotMode(self.mode, self.armed, self.mode.value.upper(), self.failsafe, PX4.traits), now_s
            )
        if self.tells_health:
            self.agent.receive(AutopilotHealth(True, self.battery_percent), now_s)
        if self.tells_landed:
            self.agent.receive(Landed(landed), now_s)
        if self.has_fix is not None:
            self.agent.receive(Satellites(used=True, sd_m=1.0, has_fix=self.has_fix), now_s)
        if self.estimates_position:
            boot_s = None if self.boot_s is None else now_s - self.boot_s - self.late_s
            self.agent.receive(Position(self.told_ned_m, self.vel_ned_mps, boot_s), now_s)

    @property
    def told_ned_m(self) -> Vec3:
        """The position that its autopilot tells."""
        return add(self.pos_ned_m, self.off_ned_m) if self.frozen_ned_m is None else self.frozen_ned_m

    def _obey(self, request: Request, altitude_m: float, now_s: float) -> None:
        match request:
            case Request.ARM:
                self.armed = self.can_arm
            case Request.TAKEOFF if self.armed and self.can_climb:
                self.mode, self.takeoff_m = FlightMode.TAKEOFF, altitude_m
            case Request.OFFBOARD if now_s - self.setpoint_s < OFFBOARD_LOSS_S:
                self.mode, self.failsafe = FlightMode.OFFBOARD, False
            case Request.LAND:
                self.mode = FlightMode.LAND

    def fly(self, now_s: float) -> None:
        """A tick of the airframe."""
        wanted = ZERO
        match self.mode:
            case FlightMode.TAKEOFF:
                wanted = (0.0, 0.0, -1.5)
                if self.altitude_m >= 0.98 * self.takeoff_m:
                    self.mode = FlightMode.HOLD
            case FlightMode.OFFBOARD if now_s - self.setpoint_s > OFFBOARD_LOSS_S:
                self.mode, self.failsafe = FlightMode.HOLD, True
            case FlightMode.HOLD if self.failsafe and now_s - self.setpoint_s < OFFBOARD_LOSS_S:
                self.mode, self.failsafe = FlightMode.OFFBOARD, False  # PX4 goes back by itself
            case FlightMode.OFFBOARD if self.setpoint is not None:
                wanted = self.setpoint.vel_ned_mps
            case FlightMode.LAND:
                wanted = (0.0, 0.0, 1.5)
                if self.altitude_m <= 0.0:
                    self.armed = False
        if not self.can_climb:
            wanted = (wanted[0], wanted[1], max(0.0, wanted[2]))
        if not self.armed:  # it falls
            self.vel_ned_mps, self.pos_ned_m = ZERO, (self.pos_ned_m[0], self.pos_ned_m[1], 0.0)
            return
        self.vel_ned_mps = add(self.vel_ned_mps, scale(sub(wanted, self.vel_ned_mps), TICK_S / LAG_S))
        north, east, down = add(self.pos_ned_m, scale(self.vel_ned_mps, TICK_S))
        self.pos_ned_m = (north, east, min(0.0, down))


class Fleet:
    """Aircraft 1..n on the ground at d1, six metres apart; all hear one another within `range_m`."""

    def __init__(self, mission: Mission, *, range_m: float = 1e9, spacing_m: float = 6.0) -> None:
        self.mission, self.range_m, self.now_s = mission, range_m, 500.0
        side = math.ceil(math.sqrt(mission.swarm.size))
        self.aircraft = {
            k + 1: Aircraft(Agent(mission, k + 1), (spacing_m * (k % side), spacing_m * (k // side), 0.0))
            for k in range(mission.swarm.size)
        }
        self.hung: set[int] = set()  # agents that do not tick
        self.mute: set[int] = set()  # radios that are off
        self.apart: set[int] = set()  # these and the others do not hear one another
        self.links: set[frozenset[int]] | None = None  # only these pairs hear each other; None: all within range
        self.trunks: list[tuple[float, float, float]] = []  # north, east, radius: each cuts the radio behind it
        self.lies: dict[int, Callable[[Beacon], Beacon]] = {}  # members that send other beacons than their agents'
        self.loss, self.rng = 0.0, random.Random(0)  # the share of beacons that each receiver misses
        self.least_m = math.inf  # between any two in the air
        self._under_way: list[tuple[Vec3, Beacon]] = []

    def tick(self) -> None:
        self.now_s += TICK_S
        heard, self._under_way = self._under_way, []
        for sent_from, beacon in heard:
            for other in self.aircraft.values():
                if self._hears(other.id, beacon.sender):
                    rel = sub(sent_from, other.pos_ned_m)
                    if math.hypot(*rel) <= self.range_m and not self._cut(sent_from, other.pos_ned_m):
                        other.agent.receive(HeardBeacon(beacon, rel), self.now_s)
        for one in self.aircraft.values():
            if one.id not in self.hung:
                if self.mission.sensing is not None:
                    one.ranges_m = self._scan(one)
                sent = one.tick(self.now_s)
                if sent is not None:
                    sent = self.lies[one.id](sent) if one.id in self.lies else sent
                    self._under_way.append((one.pos_ned_m, sent))
        flying = []
        for one in self.aircraft.values():
            one.fly(self.now_s)
            if one.altitude_m > 1.0:
                self.least_m = min([self.least_m, *(math.dist(one.pos_ned_m, other) for other in flying)])
                flying.append(one.pos_ned_m)

    def _hears(self, me: int, sender: int) -> bool:
        """Whether the radio carries `sender`'s beacons to `me`, which listens."""
        if me == sender or me in self.hung or {me, sender} & self.mute:
            return False
        cut = (sender in self.apart) != (me in self.apart) or (self.loss > 0.0 and self.rng.random() < self.loss)
        return not cut and (self.links is None or frozenset((me, sender)) in self.links)

    def _cut(self, a: Vec3, b: Vec3) -> bool:
        """A trunk stands between two places."""
        north, east = b[0] - a[0], b[1] - a[1]
        length2 = max(north * north + east * east, 1e-9)
        for trunk_n, trunk_e, radius_m in self.trunks:
            share = max(0.0, min(1.0, ((trunk_n - a[0]) * north + (trunk_e - a[1]) * east) / length2))
            if math.hypot(a[0] + share * north - trunk_n, a[1] + share * east - trunk_e) <= radius_m:
                return True
        return False

    def _scan(self, one: Aircraft) -> tuple[float, ...]:
        """Level; of trunks and the other aircraft, but for what hides what."""
        north, east, down = one.pos_ned_m
        ranges = [math.inf] * SECTORS
        bodies = [
            (*other.pos_ned_m[:2], BODY_M)
            for other in self.aircraft.values()
            if other is not one and abs(other.pos_ned_m[2] - down) <= BODY_M
        ]
        for its_north, its_east, radius_m in [*bodies, *self.trunks]:
            away_m = math.hypot(its_north - north, its_east - east)
            if radius_m < away_m <= SIGHT_M + radius_m:
                bearing, half = math.atan2(its_east - east, its_north - north), math.asin(radius_m / away_m)
                first, last = ((bearing + turn) / math.tau * SECTORS for turn in (-half, half))
                for sector in range(round(first), round(last) + 1):
                    ranges[sector % SECTORS] = min(ranges[sector % SECTORS], away_m - radius_m)
        return tuple([range_m if range_m <= SIGHT_M else math.inf for range_m in ranges])

    def parts(self) -> list[set[int]]:
        """Those that hear one another, over others or not, as the radio stands now: the widest first."""
        left, found = set(self.aircraft) - self.hung, []
        while left:
            part, news = set[int](), {min(left)}
            while news:
                part |= news
                news = {b for a in news for b in left - part if self._linked(a, b)}
            left -= part
            found.append(part)
        return sorted(found, key=len, reverse=True)

    def _linked(self, a: int, b: int) -> bool:
        here, there = self.aircraft[a].pos_ned_m, self.aircraft[b].pos_ned_m
        in_range = math.dist(here, there) <= self.range_m and not self._cut(here, there)
        return in_range and self._hears(a, b) and self._hears(b, a)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.tick()

    def until(self, what: str, *, limit_s: float, among: Iterable[int] | None = None) -> float:
        """Ticks until all (`among`: these) are in the state of this name; how long it took."""
        start_s = self.now_s
        ids = list(self.aircraft if among is None else among)
        while any(self.aircraft[i].state.name != what for i in ids):
            assert self.now_s - start_s < limit_s, {i: self.aircraft[i].state.name for i in ids}
            self.tick()
        return self.now_s - start_s

    def order(self, vehicle_id: int, order: Order) -> None:
        self.aircraft[vehicle_id].agent.receive(OperatorOrder(order), self.now_s)

    def acting(self) -> list[int]:
        return [a.id for a in self.aircraft.values() if a.agent.swarm.election.acts and a.id not in self.hung]


@functools.cache
def _fleet(size: int, state: str, priority: tuple[int, ...]) -> Fleet:
    fleet = Fleet(
        mission(
            route={"d2_enu_m": (60.0, 0.0, 8.0), "at_end": "land"},
            swarm={"size": size, "leader_priority": priority},
            coverage={"duration_s": 20.0},
        )
    )
    fleet.run(2.0)
    if state != "READY":
        fleet.order(1, Order.START)
        fleet.until(state, limit_s=60.0)
        fleet.run(2.0)
    return fleet


def fleet(size: int = 3, state: str = "TRANSIT", *, priority: tuple[int, ...] = ()) -> Fleet:
    """On its way, for two seconds, by default: at full speed, vehicle 1 leading. Flown there once for all tests."""
    return deepcopy(_fleet(size, state, priority))


def asked(one: Aircraft) -> list[Request]:
    return [action.request for action in one.actions if isinstance(action, Ask)]


def setpoints(one: Aircraft) -> list[VelocitySetpoint]:
    return [action for action in one.actions if isinstance(action, VelocitySetpoint)]
