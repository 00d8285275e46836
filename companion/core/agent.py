"""The companion agent: `receive` what comes in, `tick` at 20 Hz, do what it returns. It does no I/O by itself."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.core import formation
from companion.core.drift import Drift
from companion.core.election import ECHO_PERIODS, LEASE_PERIODS, Election, priority_of
from companion.core.flight import Flight
from companion.core.movement import Movement, Situation
from companion.core.peers import RANGE_SLACK, TELL_AFTER_S, Neighbour, PeerTable
from companion.core.phases import Phases
from companion.core.roster import Roster, ids
from companion.core.types import (
    STEERED,
    ZERO,
    Action,
    Beacon,
    Event,
    FlightState,
    HeardBeacon,
    Lease,
    OperatorOrder,
    Order,
    Position,
    Say,
    SendBeacon,
    Severity,
    Sighting,
    SwarmPhase,
    VelocitySetpoint,
)
from companion.core.vec import add, limit, norm
from mission.frames import Vec3
from mission.model import Mission

TICK_HZ = 20
TICK_S = 1.0 / TICK_HZ
HUNG_S = 0.4  # just before the autopilot's offboard-loss timeout under a canopy, 0.5 s
ABSENT_SAID_S = 10.0  # the leader names those who are not ready this often
ALONE_HOLD_S = 1.0  # without any neighbour a vehicle of a swarm holds ...
ALONE_HOLD_PERIODS = 5  # where beacons are rarer
ALONE_LAND_S = 90.0  # ... and at last lands where it is; it never climbs
LISTEN_S = 5.0  # in the air without a leader, among others that listen too: then somebody claims the lead
WHOLE_S = 3.0  # a new leader counts as having the majority for a second: only then it has
NO_QUORUM_LAND_S = 120.0  # a part without the majority of those that took off holds so long for the others, then lands
REF_FADES_FROM = 5  # periods without news of the leader; the reference is gone when the lease is
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
        self._period_s = 1.0 / mission.radio.beacon_rate_hz
        self.peers = PeerTable(beacon_period_s=self._period_s, speed_max_mps=mission.limits.speed_max_mps)
        self.roster = Roster(vehicle_id, mission.swarm.size)
        self.movement = Movement(mission, vehicle_id)
        self.election = self._new_election()
        self.flight = Flight(mission.route.d1_enu_m[2])
        self.phases = Phases(mission)
        self._ticks_per_beacon = round(TICK_HZ / mission.radio.beacon_rate_hz)
        self._ticks = 0
        self._said_early = False  # a beacon before its time, in this period
        self._last_tick_s: float | None = None
        self._started = False  # an operator has allowed the flight
        self._abort = False  # an operator has ordered all to land; latched
        self._drift = Drift()  # of the own velocity
        self._silent: dict[int, Sighting] = {}  # those that fell silent in the air, by id
        self._standing: dict[int, Sighting] = {}  # and those that are heard there, but not steered
        self._silent_said: set[int] = set()
        self._route = formation.NOWHERE
        self._governor = 1.0
        self._parted_s: float | None = None  # since when this part has not held the majority
        self._whole_s: float | None = None  # and since when it does
        self._launched = False  # the swarm takes off, or has
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
            case HeardBeacon():
                self._hear(event, now_s)
            case OperatorOrder(order):
                self._obey(order)
            case Position():
                # By the autopilot's own time, where it tells it: what comes in a burst was not measured in one.
                measured_s = now_s if event.boot_s is None else event.boot_s
                self._drift.see(event.pos_ned_m, event.vel_ned_mps, measured_s)
                self.flight.receive(event, now_s)
            case _:
                self.flight.receive(event, now_s)

    def tick(self, now_s: float) -> list[Action]:
        """Decide: what to send to the neighbours, to the autopilot and to the operator."""
        if self._last_tick_s is not None and now_s - self._last_tick_s > HUNG_S:
            self._wake()
        self._last_tick_s = now_s
        actions: list[Action] = []
        neighbours = self._look_around(now_s)
        self._keep_company(neighbours, now_s)
        if self._ticks % self._ticks_per_beacon == 0:
            self._elect(neighbours, now_s)
            actions += self._beacon(self.election.lease, neighbours, now_s)
            self._said_early = False
        elif self.election.changed and not self._said_early:
            # At most one more beacon a period: so news of a leader does not wait at every hop.
            self._route_and_govern(neighbours)
            self._collect(neighbours)
            actions += self._beacon(self.election.early, neighbours, now_s)
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
            self.movement.rest()
        actions += self._says
        self._says = []
        return actions

    # --- what is heard ---

    def _hear(self, heard: HeardBeacon, now_s: float) -> None:
        own, beacon = self.flight.position, heard.said
        if own is None or beacon.sender == self.id or not self._is_ours(beacon.sender):
            return
        candidate = beacon.candidate
        if candidate is not None and candidate.priority != self._priority(candidate.vehicle):
            beacon = replace(beacon, candidate=None)
        fastest_mps = self.mission.limits.speed_max_mps
        if norm(beacon.ref_ned_mps) > fastest_mps:
            beacon = replace(beacon, ref_ned_mps=limit(beacon.ref_ned_mps, fastest_mps))
        if not self.peers.hear(HeardBeacon(beacon, heard.rel_ned_m), own.pos_ned_m, now_s):
            return
        seen = beacon.sighting
        if seen is not None and self._is_ours(seen.vehicle) and seen.vehicle not in (self.id, beacon.sender):
            rel = add(heard.rel_ned_m, seen.rel_ned_m)
            if norm(rel) <= self._reach_m:
                self.peers.told(replace(seen, rel_ned_m=rel), own.pos_ned_m, now_s)
        self.roster.hear(beacon)
        self._started |= beacon.start
        self._abort |= beacon.abort
        lease = beacon.lease
        if lease is None or not self._is_ours(lease.leader):
            return
        if lease.priority == self._priority(lease.leader) and self.election.hear(lease, beacon.hop):
            self.phases.follow(beacon.phase, now_s)
        elif self.election.acts and lease.leader == self.id:
            self.phases.follow(beacon.phase, now_s)  # of a part that it has joined, and that is further on

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

    def _look_around(self, now_s: float) -> list[Neighbour]:
        """Who is heard, where it claims to be within reach; and who hangs silent in the air."""
        own = self.flight.position
        if own is None:
            return []
        if self.flight.airborne or self.flight.state is FlightState.TAKING_OFF:
            self.roster.took_off()
        self._silent = self.peers.silent_airborne(
            own.pos_ned_m, now_s, range_m=self.radio_range_m, launched=self._launched
        )
        self._tell_silent()
        heard = [n for n in self.peers.neighbours(own.pos_ned_m, now_s) if norm(n.rel_ned_m) <= self._reach_m]
        standing = {n.id: Sighting(n.id, n.rel_ned_m, n.age_s, silent=False) for n in heard if n.stands}
        self._standing = self._silent | standing
        return heard

    @property
    def _reach_m(self) -> float:
        """Who claims to be farther off takes no part in movement."""
        return RANGE_SLACK * self.mission.radio.full_range_m

    def _tell_silent(self) -> None:
        """Once for each, when it is no burst of losses any more."""
        lasting = {vehicle for vehicle, sighting in self._silent.items() if sighting.age_s >= TELL_AFTER_S}
        for vehicle in sorted(lasting - self._silent_said):
            self._say(Severity.WARNING, f"vehicle {vehicle} silent in the air: kept clear of")
        for vehicle in sorted(self._silent_said - self._silent.keys()):
            self._say(Severity.NOTICE, f"vehicle {vehicle} heard again")
        self._silent_said = lasting | (self._silent_said & self._silent.keys())

    # --- each beacon period: who leads, which phase ---

    def _elect(self, neighbours: list[Neighbour], now_s: float) -> None:
        battery = self.flight.battery_percent
        charged = battery is None or battery >= LOW_BATTERY_PERCENT
        # Who stands on the ground does not lead those that fly.
        there = self.flight.state in STEERED or (self.flight.can_lead and self.phases.phase <= SwarmPhase.GATHER)
        # A swarm of which all were stalled at once: somebody has to begin.
        there |= bool(neighbours) and self.flight.listens_s(now_s) > LISTEN_S
        eligible = there and self.flight.position_known(now_s) and charged
        score = 0 if battery is None else battery // SCORE_STEP_PERCENT
        heard = self.peers.beacons(now_s, within_s=ECHO_PERIODS * self._period_s)
        self.election.step(now_s, period_s=self._period_s, eligible=eligible, score=score, heard=heard)
        self._tell_leader()
        self._route_and_govern(neighbours)
        self._collect(neighbours)
        self._count_votes(now_s)
        if self.phases.phase >= SwarmPhase.GATHER and not self._launched:
            self._launched = True
            self.roster.launch(self.peers.ready(now_s))
        if self.election.acts and eligible and not self._why_hold(now_s):
            self._lead(now_s)

    def _count_votes(self, now_s: float) -> None:
        """Whether this part of the swarm may go on: its leader counts, and says so with the lease."""
        if self.election.acts:
            grounded = self.peers.grounded()
            self.election.set_quorum(self.roster.quorum(now_s, grounded=grounded))
        else:
            self.roster.lead()
        lease = self.election.lease
        if self.flight.state not in STEERED:
            self._parted_s = self._whole_s = None
        elif lease is None or not lease.quorum:
            self._whole_s = None
            if lease is not None and self._parted_s is None:
                self._parted_s = now_s
        elif self._whole_s is None:
            self._whole_s = now_s
        elif now_s - self._whole_s > WHOLE_S:
            self._parted_s = None

    def _tell_leader(self) -> None:
        lease = self.election.lease
        leader = lease.leader if lease is not None and lease.established else None
        if leader != self._leader_said and leader is not None:
            self._say(Severity.NOTICE, f"leader: vehicle {leader}" + (" (this one)" if leader == self.id else ""))
        elif leader is None and self._leader_said is not None and self.flight.state in STEERED:
            self._say(Severity.WARNING, f"holding: leader {self._leader_said} lost")
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
        """Who is there, and who has done what the phase asks: this vehicle and the branches behind it."""
        followers = formation.children(self.id, self._route, neighbours)
        branches = [follower.beacon for follower in followers]
        self.roster.collect(branches, done=self._has_done(), phase=self.phases.phase)

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
        to_goal_m = self.movement.to_goal_m(own.pos_ned_m, goal, self._standing) if goal is not None else 0.0
        there = to_goal_m <= self.mission.route.arrival_distance_m
        done = self.roster.done
        missing = [str(k) for k in range(1, self.mission.swarm.size + 1) if not done >> (k - 1) & 1]
        phase = self.phases.phase
        if self.phases.lead(done, to_goal_m=to_goal_m, started=self._started, now_s=now_s):
            if self.phases.phase is SwarmPhase.GATHER:
                self.roster.launch(done)
            leaving = self.phases.phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT)
            if self.phases.phase is SwarmPhase.LAND and phase in (SwarmPhase.TRANSIT, SwarmPhase.RETURN) and not there:
                self._say(Severity.WARNING, "no way on found: swarm lands here")
            without = f", without {', '.join(missing)}" if missing and leaving else ""
            self._say(Severity.NOTICE, f"{NEWS[self.phases.phase]}{without}")
        elif missing and ((self.phases.phase is SwarmPhase.ASSEMBLE and self._started) or self.phases.overdue(now_s)):
            self._tell_absent(missing, now_s)

    def _tell_absent(self, missing: list[str], now_s: float) -> None:
        """From time to time, for whom the swarm waits: out of radio range, not ready, or not there at all."""
        if self._absent_said_s is None or now_s - self._absent_said_s >= ABSENT_SAID_S:
            if self._absent_said_s is not None:
                self._say(Severity.WARNING, f"waiting for {', '.join(missing)}")
            self._absent_said_s = now_s

    @property
    def range_m(self) -> float:
        """The range that the formation keeps: the paper keeps the swarm compact on the way and extends it at d2."""
        radio = self.mission.radio
        return radio.full_range_m if self.phases.phase >= SwarmPhase.COVERAGE else radio.transit_range_m

    @property
    def radio_range_m(self) -> float:
        """The range that the radio is set to: all of it while somebody is missing, to find one another again."""
        lease = self.election.lease
        parted = self.flight.airborne and (bool(self._silent) or lease is None or not lease.quorum)
        return self.mission.radio.full_range_m if parted else self.range_m

    def _beacon(self, lease: Lease | None, neighbours: list[Neighbour], now_s: float) -> list[Action]:
        own = self.flight.position
        if own is None:
            return []
        beacon = Beacon(
            sender=self.id,
            time_ms=int(now_s * 1000.0),
            vel_ned_mps=add(own.vel_ned_mps, self._drift.ned_mps),
            ref_ned_mps=self.movement.ref_ned_mps,
            dest_ned_m=self._destination(own),
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
            done=self.roster.done,
            range_m=self.radio_range_m,
            present=self.roster.present,
            flown=self.roster.flown,
            sighting=self.peers.to_tell(self._silent, neighbours, own.pos_ned_m, now_s),
        )
        return [SendBeacon(beacon)]

    # --- each tick: where to ---

    def _steer(self, neighbours: list[Neighbour], now_s: float) -> VelocitySetpoint:
        own = self.flight.position
        assert own is not None
        self._destination(own)
        if self.flight.state is FlightState.TAKING_OFF:  # on the ground: nothing may move it
            return VelocitySetpoint(ZERO, self.movement.yaw_rad)
        if not self.flight.position_known(now_s):
            self.movement.rest()  # from an old place nothing can be kept clear of: brake
            return VelocitySetpoint(ZERO, self.movement.yaw_rad)
        drift = self._drift.ned_mps
        leads = self.election.acts
        situation = Situation(
            own=Position(own.pos_ned_m, add(own.vel_ned_mps, drift)),
            neighbours=neighbours,
            standing=self._standing,
            state=self.flight.state,
            phase=SwarmPhase.LAND if self._lands(now_s) else self.phases.phase,
            route=self._route,
            range_m=self.range_m,
            leads=leads,
            governor=self._governor,
            faith=self._faith(),
            goal=self.phases.goal() if leads else None,
            size=self.roster.flown.bit_count(),
        )
        velocity = self.movement.steer(situation, dt_s=TICK_S, drift_ned_mps=drift)
        return VelocitySetpoint(velocity, self.movement.yaw_rad)

    def _destination(self, own: Position) -> Vec3 | None:
        """Vector to d2, as far as it is known here."""
        self.movement.locate(own, self._route, leads=self.election.acts)
        return self.movement.dest_ned_m

    def _faith(self) -> float:
        """1 while the leader is heard of, falling to 0 as its lease runs out."""
        left = (LEASE_PERIODS - self.election.age) / (LEASE_PERIODS - REF_FADES_FROM)
        return max(0.0, min(1.0, left))

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
        lands = self._lands(now_s) and self._is_clear_below(neighbours)
        return self._abort or critical or lands or self._alone_s(now_s) > ALONE_LAND_S

    def _lands(self, now_s: float) -> bool:
        """By its leader's word, or because the others have not been heard again."""
        parted = self._parted_s is not None and now_s - self._parted_s > NO_QUORUM_LAND_S
        return self.phases.phase is SwarmPhase.LAND or parted

    def _why_hold(self, now_s: float) -> str:
        if self._alone_s(now_s) > max(ALONE_HOLD_S, ALONE_HOLD_PERIODS * self._period_s):
            return self._hold("no neighbour heard")
        lease = self.election.lease
        if lease is None:
            return self._hold("no leader")
        if not lease.quorum:
            missing = ids(self.roster.missing(self.peers.grounded())) if self.election.leads else []
            without = f", without {', '.join(map(str, missing))}" if missing else ""
            return self._hold(f"no majority{without}")
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

    def _is_clear_below(self, neighbours: list[Neighbour]) -> bool:
        """No one flies or hangs above or below."""
        apart = self.mission.separation
        clear_m = SPREAD_DONE_SHARE * apart.soft_m
        others = [(n.rel_ned_m, clear_m) for n in neighbours]
        others += [(sighting.rel_ned_m, apart.hard_m) for sighting in self._silent.values()]
        return all(math.hypot(rel[0], rel[1]) >= least_m for rel, least_m in others)

    def _wake(self) -> None:
        """After standing still: what is known is old, and the autopilot has acted by itself."""
        self._say(Severity.WARNING, "companion stalled: listening first")
        self.flight.interrupt()
        self.election = self._new_election()
        self.movement.rest()

    def _say(self, severity: Severity, text: str) -> None:
        self._says.append(Say(severity, text))
