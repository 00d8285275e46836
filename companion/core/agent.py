"""The companion agent: `receive` what comes in, `tick` at 20 Hz, do what it returns. It does no I/O by itself."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.core import coverage, formation, movement
from companion.core.election import ECHO_PERIODS, LEASE_PERIODS, Election, priority_of
from companion.core.flight import STEERED, Flight
from companion.core.peers import Neighbour, PeerTable
from companion.core.phases import Phases
from companion.core.safety import Envelope
from companion.core.types import (
    ZERO,
    Action,
    Beacon,
    Event,
    FlightState,
    Lease,
    OperatorOrder,
    Order,
    Position,
    Say,
    SendBeacon,
    Severity,
    SwarmPhase,
    VelocitySetpoint,
)
from companion.core.vec import add, norm, scale, sub
from mission.frames import Vec3, enu_to_ned
from mission.model import CoverageShape, Mission

TICK_HZ = 20
TICK_S = 1.0 / TICK_HZ
HUNG_S = 0.4  # just before the autopilot's offboard-loss timeout under a canopy, 0.5 s
ABSENT_SAID_S = 10.0  # the leader names those who are not ready this often
ALONE_HOLD_S = 1.0  # without any neighbour a vehicle of a swarm holds ...
ALONE_LAND_S = 90.0  # ... and at last lands where it is; it never climbs
REF_FADES_FROM = 5  # periods without news of the leader; the reference is gone when the lease is
YAW_SPEED_MPS = 0.3  # below this the heading stays
LOW_BATTERY_PERCENT = 20  # no leadership below
CRITICAL_BATTERY_PERCENT = 10  # down here it lands where it is
SPREAD_DONE_SHARE = 0.8  # of the soft separation, level, before a descent
SCORE_STEP_PERCENT = 10
NEWS = {
    SwarmPhase.GATHER: "ready: swarm takes off",
    SwarmPhase.TRANSIT: "gathered at d1: leaving for d2",
    SwarmPhase.COVERAGE: "arrived at d2: spreading around it",
    SwarmPhase.RETURN: "coverage done: returning to d1",
    SwarmPhase.LAND: "swarm lands",
}


class Agent:
    """One vehicle's companion. `now_s` is any monotonic clock, in seconds."""

    def __init__(self, mission: Mission, vehicle_id: int) -> None:
        """ValueError when `vehicle_id` is not one of the mission's 1..size."""
        if not 1 <= vehicle_id <= mission.swarm.size:
            raise ValueError(f"vehicle id {vehicle_id}: the mission has 1..{mission.swarm.size}")
        self.id = vehicle_id
        self.mission = mission
        self.peers = PeerTable()
        self._period_s = 1.0 / mission.radio.beacon_rate_hz
        self.election = self._new_election()
        self.flight = Flight(mission.route.d1_enu_m[2])
        self.phases = Phases(mission)
        self._envelope = Envelope.of(mission)
        self._ticks_per_beacon = round(TICK_HZ / mission.radio.beacon_rate_hz)
        self._everyone = (1 << mission.swarm.size) - 1
        self._ticks = 0
        self._said_early = False  # a beacon before its time, in this period
        self._last_tick_s: float | None = None
        self._started = False  # an operator has allowed the flight
        self._abort = False  # an operator has ordered all to land; latched
        self._setpoint = ZERO
        self._ref = ZERO
        self._yaw_rad: float | None = None
        self._route = formation.NOWHERE
        self._governor = 1.0
        self._dest: Vec3 | None = None
        self._dest_at: Vec3 | None = None  # odometry reading that goes with _dest
        self._done = 0
        self._company_s: float | None = None  # when this vehicle was last in company, see _keep_company
        self._leader_said: int | None = None
        self._hold_said = ""
        self._absent_said_s: float | None = None
        self._says: list[Say] = []
        self._waived = ""  # checks of the preflight that somebody took as accepted

    def waive(self, checks: str, unknown: str = "") -> None:
        """These checks of the preflight were taken as accepted: the operator hears of it, now and at the start.

        `unknown`: what could not be, in words; heard now.
        """
        self._waived = checks
        if unknown:
            self._say(Severity.WARNING, unknown)
        self._tell_waived()

    def receive(self, event: Event, now_s: float) -> None:
        """Store one event; `now_s` is its local time of arrival."""
        match event:
            case Beacon():
                self._hear(event, now_s)
            case OperatorOrder(order):
                self._obey(order)
            case _:
                self.flight.receive(event, now_s)

    def tick(self, now_s: float) -> list[Action]:
        """Decide: what to send to the neighbours, to the autopilot and to the operator."""
        if self._last_tick_s is not None and now_s - self._last_tick_s > HUNG_S:
            self._wake()
        self._last_tick_s = now_s
        actions: list[Action] = []
        neighbours = self._neighbours(now_s)
        self._keep_company(neighbours, now_s)
        if self._ticks % self._ticks_per_beacon == 0:
            self._elect(neighbours, now_s)
            actions += self._beacon(self.election.lease, now_s)
            self._said_early = False
        elif self.election.changed and not self._said_early:
            # At most one more beacon a period: so news of a leader does not wait at every hop.
            self._route_and_govern(neighbours)
            self._collect(neighbours)
            actions += self._beacon(self.election.early, now_s)
            self._said_early = True
        self._ticks += 1
        actions += self.flight.step(
            self.phases.phase,
            now_s,
            land_now=self._must_land(neighbours, now_s),
            hold=bool(self._why_hold(now_s)),
            may_join=self._may_join(),
        )
        if self.flight.steers:
            actions.append(self._steer(neighbours, now_s))
        else:
            # Whoever gets control back starts from rest, not from what it last wanted.
            self._ref = self._setpoint = ZERO
        actions += self._says
        self._says = []
        return actions

    # --- what is heard ---

    def _hear(self, beacon: Beacon, now_s: float) -> None:
        own = self.flight.position
        if own is None or beacon.sender == self.id or not self._is_ours(beacon.sender):
            return
        candidate = beacon.candidate
        if candidate is not None and candidate.priority != self._priority(candidate.vehicle):
            beacon = replace(beacon, candidate=None)
        if not self.peers.hear(beacon, own.pos_ned_m, now_s):
            return
        self._started |= beacon.start
        self._abort |= beacon.abort
        lease = beacon.lease
        if lease is None or not self._is_ours(lease.leader):
            return
        if lease.priority == self._priority(lease.leader) and self.election.hear(lease, beacon.hop):
            self.phases.follow(beacon.phase, now_s)

    def _is_ours(self, vehicle_id: int) -> bool:
        """One of the mission's swarm: nobody else leads, votes or is followed."""
        return 1 <= vehicle_id <= self.mission.swarm.size

    def _new_election(self) -> Election:
        swarm = self.mission.swarm
        periods = round(swarm.reelection_period_s / self._period_s)
        return Election(self.id, self._priority(self.id), size=swarm.size, reelection_periods=periods)

    def _priority(self, vehicle_id: int) -> int:
        return priority_of(vehicle_id, self.mission.swarm.leader_priority)

    def _obey(self, order: Order) -> None:
        match order:
            case Order.START:
                self._started = True
                if self.flight.grounded:
                    self._say(Severity.ERROR, f"grounded, {self.flight.grounded}")
                self._tell_waived()
                self.flight.hand_back()
            case Order.LAND_ALL:
                if not self._abort:
                    self._say(Severity.WARNING, "land all: ordered from the ground")
                self._abort = True

    def _tell_waived(self) -> None:
        if self._waived:
            self._say(Severity.WARNING, f"preflight waived: {self._waived}")

    def _neighbours(self, now_s: float) -> list[Neighbour]:
        own = self.flight.position
        if own is None:
            return []
        self.peers.forget(now_s)
        return self.peers.neighbours(own.pos_ned_m, now_s)

    # --- each beacon period: who leads, which phase ---

    def _elect(self, neighbours: list[Neighbour], now_s: float) -> None:
        battery = self.flight.battery_percent
        charged = battery is None or battery >= LOW_BATTERY_PERCENT
        # Who stands on the ground does not lead those that fly.
        there = self.flight.state in STEERED or (self.flight.can_lead and self.phases.phase <= SwarmPhase.GATHER)
        eligible = there and self.flight.position_known(now_s) and charged
        score = 0 if battery is None else battery // SCORE_STEP_PERCENT
        heard = self.peers.beacons(now_s, within_s=ECHO_PERIODS * self._period_s)
        self.election.step(now_s, period_s=self._period_s, eligible=eligible, score=score, heard=heard)
        self._tell_leader()
        self._route_and_govern(neighbours)
        self._collect(neighbours)
        if self.election.acts and eligible and not self._why_hold(now_s):
            self._lead(now_s)

    def _tell_leader(self) -> None:
        lease = self.election.lease
        leader = lease.leader if lease is not None and lease.established else None
        if leader != self._leader_said and leader is not None:
            self._say(Severity.NOTICE, f"leader: vehicle {leader}" + (" (this one)" if leader == self.id else ""))
        elif leader is None and self._leader_said is not None and self.flight.state in STEERED:
            self._say(Severity.WARNING, f"holding: vehicle {self._leader_said} leads no more")
        self._leader_said = leader

    def _route_and_govern(self, neighbours: list[Neighbour]) -> None:
        if self.flight.state in STEERED:  # one that cannot follow must not hold up those that can
            neighbours = [n for n in neighbours if n.beacon.state in STEERED]
        if self.election.leads:
            self._route = formation.LEADER_ROUTE
        elif self.election.lease is None:
            self._route = formation.NOWHERE
        else:
            self._route = formation.route(neighbours, range_m=self.range_m)
        followers = formation.children(self.id, self._route, neighbours)
        self._governor = formation.governor(self._route, followers, range_m=self.range_m)

    def _collect(self, neighbours: list[Neighbour]) -> None:
        """Who has done what the phase asks: this vehicle and the branches behind it."""
        done = 1 << (self.id - 1) if self._has_done() else 0
        for follower in formation.children(self.id, self._route, neighbours):
            if follower.beacon.phase is self.phases.phase:
                done |= follower.beacon.done
        self._done = done & self._everyone

    def _has_done(self) -> bool:
        match self.phases.phase:
            case SwarmPhase.ASSEMBLE:
                return self.flight.state is FlightState.READY
            case SwarmPhase.LAND:
                return self.flight.state is FlightState.LANDED
            case _:
                return self.flight.settled and self.flight.state is not FlightState.HOLD

    def _lead(self, now_s: float) -> None:
        own = self.flight.position
        assert own is not None
        goal = self.phases.goal()
        to_goal_m = norm(sub(goal[0], own.pos_ned_m)) if goal is not None else 0.0
        missing = [str(k) for k in range(1, self.mission.swarm.size + 1) if not self._done >> (k - 1) & 1]
        if self.phases.lead(self._done, to_goal_m=to_goal_m, started=self._started, now_s=now_s):
            leaving = self.phases.phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT)
            without = f", without {', '.join(missing)}" if missing and leaving else ""
            self._say(Severity.NOTICE, f"{NEWS[self.phases.phase]}{without}")
        elif self.phases.phase is SwarmPhase.ASSEMBLE and self._started and missing:
            self._tell_absent(missing, now_s)

    def _tell_absent(self, missing: list[str], now_s: float) -> None:
        """From time to time, for whom the swarm waits: out of radio range, not ready, or not there at all."""
        if self._absent_said_s is None or now_s - self._absent_said_s >= ABSENT_SAID_S:
            if self._absent_said_s is not None:
                self._say(Severity.WARNING, f"waiting for {', '.join(missing)}")
            self._absent_said_s = now_s

    @property
    def range_m(self) -> float:
        """The radio range in use: the paper keeps the swarm compact on the way and extends it at d2."""
        radio = self.mission.radio
        return radio.full_range_m if self.phases.phase >= SwarmPhase.COVERAGE else radio.transit_range_m

    def _beacon(self, lease: Lease | None, now_s: float) -> list[Action]:
        own = self.flight.position
        if own is None:
            return []
        beacon = Beacon(
            sender=self.id,
            time_ms=int(now_s * 1000.0),
            rel_ned_m=ZERO,
            vel_ned_mps=own.vel_ned_mps,
            ref_ned_mps=self._ref,
            dest_ned_m=self._destination(),
            route_cost=self._route.cost,
            governor=self._governor,
            lease=lease,
            hop=self.election.hop,
            agreed=self.election.agreed,
            candidate=self.election.candidate,
            parent=self._route.parent,
            phase=self.phases.phase,
            state=self.flight.state,
            airborne=self.flight.airborne,
            start=self._started,
            abort=self._abort,
            done=self._done,
            range_m=self.range_m,
        )
        return [SendBeacon(beacon)]

    # --- each tick: where to ---

    def _steer(self, neighbours: list[Neighbour], now_s: float) -> VelocitySetpoint:
        own = self.flight.position
        assert own is not None
        dest = self._destination()
        if self.flight.state is FlightState.TAKING_OFF:  # on the ground: nothing may move it
            return VelocitySetpoint(ZERO, self._heading(dest))
        if not self.flight.position_known(now_s):  # from an old place nothing can be kept clear of: brake
            self._ref = self._setpoint = ZERO
            return VelocitySetpoint(ZERO, self._heading(dest))
        fallen = self.peers.fallen(own.pos_ned_m, now_s, range_m=self.range_m)
        wanted = self._desired(own, neighbours, fallen, dest)
        self._setpoint = self._envelope.admit(wanted, self._setpoint, own, neighbours, fallen, dest, dt_s=TICK_S)
        return VelocitySetpoint(self._setpoint, self._heading(dest))

    def _desired(self, own: Position, neighbours: list[Neighbour], fallen: list[Vec3], dest: Vec3 | None) -> Vec3:
        """The five conditions, or coverage; NED m/s."""
        self._ref = ZERO
        match self.flight.state:
            case FlightState.COVERAGE if dest is not None:
                return self._cover(neighbours, fallen, dest)
            case FlightState.GATHERING | FlightState.TRANSIT | FlightState.RETURNING:
                if self.election.acts:
                    self._ref = self._leader_reference(own)
                    return self._ref
                self._ref, wanted = movement.follow(
                    self.mission,
                    self.id,
                    self._route,
                    neighbours,
                    fallen,
                    dest if self.flight.state is FlightState.TRANSIT else None,
                    range_m=self.range_m,
                    faith=self._faith(),
                )
                return wanted
            case _ if self.phases.phase is SwarmPhase.LAND:
                return formation.separation(
                    [_level(n) for n in neighbours], fallen, soft_m=self.mission.separation.soft_m
                )
            case _:
                return formation.separation(neighbours, fallen, soft_m=self.mission.separation.hard_m)

    def _leader_reference(self, own: Position) -> Vec3:
        goal = self.phases.goal()
        if goal is None:
            return ZERO
        return movement.lead(self.mission, self.phases.phase, goal, own.pos_ned_m, governor=self._governor)

    def _faith(self) -> float:
        """1 while the leader is heard of, falling to 0 as its lease runs out."""
        left = (LEASE_PERIODS - self.election.age) / (LEASE_PERIODS - REF_FADES_FROM)
        return max(0.0, min(1.0, left))

    def _cover(self, neighbours: list[Neighbour], fallen: list[Vec3], dest: Vec3) -> Vec3:
        spec, apart = self.mission.coverage, self.mission.separation
        around = [(n.id, n.rel_ned_m) for n in neighbours if n.beacon.state is FlightState.COVERAGE]
        if spec.shape is CoverageShape.RING:
            places = [rel for _, rel in around]
            spread = coverage.ring(dest, places, radius_m=spec.radius_m, wait_m=apart.soft_m, range_m=self.range_m)
            spacing_m = 2.0 * spec.radius_m * math.sin(math.pi / (len(around) + 1))
        else:
            spread = coverage.sphere(dest, around, me=self.id, radius_m=spec.radius_m)
            spacing_m = spec.radius_m * math.sqrt(4.0 * math.pi / (len(around) + 1))
        soft_m = max(apart.hard_m, min(apart.soft_m, 0.8 * spacing_m))
        return add(spread, formation.separation(neighbours, fallen, soft_m=soft_m))

    def _destination(self) -> Vec3 | None:
        """Vector to d2: the leader's own, a follower's as those nearer to the leader tell it, else by odometry."""
        own = self.flight.position
        if own is None:
            return None
        if self.election.acts:
            dest: Vec3 | None = sub(enu_to_ned(self.mission.route.d2_enu_m), own.pos_ned_m)
        else:
            told = [n.dest_ned_m for n in self._route.up if n.dest_ned_m is not None]
            if told:
                total = ZERO
                for vector in told:
                    total = add(total, vector)
                dest = scale(total, 1.0 / len(told))
            elif self._dest is not None and self._dest_at is not None:
                dest = sub(self._dest, sub(own.pos_ned_m, self._dest_at))
            else:
                dest = None
        self._dest, self._dest_at = dest, own.pos_ned_m
        return dest

    def _heading(self, dest: Vec3 | None) -> float:
        """Face the tree in coverage, else the way the swarm goes."""
        if self.flight.state is FlightState.COVERAGE and dest is not None:
            self._yaw_rad = math.atan2(dest[1], dest[0])
        elif math.hypot(self._ref[0], self._ref[1]) > YAW_SPEED_MPS:
            self._yaw_rad = math.atan2(self._ref[1], self._ref[0])
        return self._yaw_rad or 0.0

    # --- when not to go on ---

    def _keep_company(self, neighbours: list[Neighbour], now_s: float) -> None:
        """In company: on the ground, hearing the swarm fly, or a swarm of one."""
        flies_alone = self.mission.swarm.size == 1 and self.flight.state in STEERED
        guided = self.flight.state in STEERED or self.election.lease is not None
        if self._company_s is None or not self.flight.airborne or flies_alone or (neighbours and guided):
            self._company_s = now_s

    def _alone_s(self, now_s: float) -> float:
        """How long this vehicle has been in the air without company."""
        return 0.0 if self._company_s is None else now_s - self._company_s

    def _must_land(self, neighbours: list[Neighbour], now_s: float) -> bool:
        battery = self.flight.battery_percent
        critical = battery is not None and battery <= CRITICAL_BATTERY_PERCENT
        return self._abort or critical or self._may_land(neighbours) or self._alone_s(now_s) > ALONE_LAND_S

    def _why_hold(self, now_s: float) -> str:
        if self._alone_s(now_s) > ALONE_HOLD_S:
            return self._hold("no neighbour heard")
        if self.election.lease is None:
            return self._hold("no leader")
        self._hold_said = ""
        return ""

    def _hold(self, why: str) -> str:
        if self._hold_said != why and self.flight.state in STEERED:
            self._say(Severity.WARNING, f"holding: {why}")
            self._hold_said = why
        return why

    def _may_join(self) -> bool:
        lease = self.election.lease
        flying = SwarmPhase.GATHER <= self.phases.phase < SwarmPhase.LAND
        return lease is not None and lease.established and flying

    def _may_land(self, neighbours: list[Neighbour]) -> bool:
        """In the phase LAND: when no one flies above or below."""
        if self.phases.phase is not SwarmPhase.LAND:
            return False
        clear_m = SPREAD_DONE_SHARE * self.mission.separation.soft_m
        return all(math.hypot(n.rel_ned_m[0], n.rel_ned_m[1]) >= clear_m for n in neighbours)

    def _wake(self) -> None:
        """After standing still: what is known is old, and the autopilot has acted by itself."""
        self._say(Severity.WARNING, "companion stood still: listening first")
        self.flight.interrupt()
        self.election = self._new_election()
        self._setpoint = ZERO

    def _say(self, severity: Severity, text: str) -> None:
        self._says.append(Say(severity, text))


def _level(neighbour: Neighbour) -> Neighbour:
    """The same neighbour as if at this vehicle's own height."""
    rel = neighbour.rel_ned_m
    return Neighbour(neighbour.beacon, (rel[0], rel[1], 0.0), neighbour.dest_ned_m, neighbour.age_s)
