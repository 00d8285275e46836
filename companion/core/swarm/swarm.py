"""One vehicle's view of its swarm: the leader, the phase, and which are there and have done what the phase asks.

Every beacon period `run_period` elects, finds the route to the leader, collects what comes up the routes and counts
votes; an acting leader then decides with `decide_phase`. The route and its costs are the paper's way to the leader; the
election is its Algorithm 1, lines 4-18 (see `election`).
"""

from __future__ import annotations

from typing import Final

from companion.core.guidance import coverage, formation
from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon, BeaconEcho, Lease, PeerReport
from companion.core.model.states import STEERED, FlightState, Reception, Role, SwarmPhase
from companion.core.model.vectors import ZERO, sub
from companion.core.swarm.backtracking import Backtracking
from companion.core.swarm.election import ECHO_PERIODS, LEASE_PERIODS, Election
from companion.core.swarm.orders import Goal
from companion.core.swarm.partition import UNDER_WAY, build_partition
from companion.core.swarm.phases import Phases
from companion.core.swarm.picture import Picture
from companion.core.swarm.priorities import Priorities, Resignation, score_of
from companion.core.swarm.reports import SwarmReports
from companion.core.swarm.roster import Roster
from companion.core.swarm.trust.trust import Trust
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Finding, Readings, Source
from companion.core.vehicle.operator_orders import OperatorOrders
from mission.common.frames import Vec3
from mission.document.model import CoverageShape, Mission, PositionUncertain

LISTEN_S: Final = 5.0  # in the air without a leader, among others that listen too: then one of them claims the lead
RENEWED_PERIODS: Final = 2  # since news of the leader: longer, the way to it may be cut
REF_FADES_FROM: Final = 5  # periods without news of the leader; the reference is gone when the lease is
OUTWARD = (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE)
NOT_AT_IT = (FlightState.HOLD, FlightState.SEEKING)  # steered, but not as the phase asks


class Swarm:
    """Feed it the beacons with `receive_beacon`; `run_period` once per beacon period."""

    def __init__(self, mission: Mission, me: int, operator: OperatorOrders) -> None:
        """`operator`: the orders that this vehicle holds."""
        self.me, self.operator = me, operator
        self._reception = Reception.GOOD if mission.has_satellites(me) else Reception.NONE
        self._priorities, self._resignation = Priorities(mission), Resignation()
        self.trust = Trust(mission, me, self._priorities)
        self.election = self._new_election(mission)
        self.phases = Phases(mission)
        self.roster = Roster(me, mission.swarm.size)
        self.partition = build_partition(mission)
        self.route = formation.NOWHERE
        self.governor = 1.0  # share of cruise speed for this vehicle's branch
        self._is_link_bad = False  # the one up the route
        self.backtracking = Backtracking()  # of its own, where its position may get uncertain
        self._home: Vec3 | None = None  # the next position on the way back
        self.launched = False  # the swarm takes off, or has
        self._reports = SwarmReports(mission, me)
        self._mission = mission
        self._size = mission.swarm.size
        self._period_s = 1.0 / mission.radio.beacon_rate_hz

    # --- what is heard ---

    def has(self, vehicle_id: int) -> bool:
        """One of the mission's swarm: no other vehicle leads, votes or is followed."""
        return 1 <= vehicle_id <= self._size

    def sanitise_beacon(self, beacon: Beacon, now_s: float) -> Beacon:
        """The same without what no member truly says, or what a blocked one says."""
        return self.trust.sanitise_beacon(beacon, now_s)

    def block(self, vehicle: int, why: str) -> None:
        """A member is proven to have lied: from now on its words count for separation alone. `why`: in words."""
        if self.has(vehicle) and vehicle != self.me:
            self.trust.blocklist.block(vehicle, why)

    def receive_beacon(self, beacon: Beacon, now_s: float) -> None:
        """A new beacon of another member."""
        self.roster.update_flown(beacon)
        self.operator.receive_flags(beacon)
        if beacon.lease is not None and not self.has(beacon.lease.leader):
            return
        is_news = self.trust.receive_lease(beacon, self.election, now_s)
        if self.trust.believes_phase(beacon, self.election, self.phases, now_s, is_news=is_news):
            self.phases.adopt_phase(beacon.phase, now_s, beacon.stop)

    def forget_leader(self) -> None:
        """After a stall: what is known of the leader is old."""
        self.election = self._new_election(self._mission)

    # --- each tick ---

    def update_picture(self, picture: Picture) -> None:
        """Each tick, before anything is decided: contact with peers, who has taken off, the way back."""
        self.phases.obey(picture.now_s, holds=self.operator.holds, lands=self.operator.lands)
        own, takes_off = picture.own, picture.state is FlightState.TAKING_OFF
        if own is not None and (picture.airborne or takes_off):
            self.roster.mark_airborne(takes_off=takes_off)
        if own is not None and picture.may_lose_position and picture.is_steered:
            self._update_trail(own.pos_ned_m, is_lost=picture.is_position_lost)
        self.partition.update_peer_contact(picture, led=self.election.lease is not None)

    def update_layer(self, picture: Picture, lease: Lease | None) -> float | None:
        """Each tick, as `NetworkPartition.update_layer`; another height is reported."""
        layer_m = self.partition.update_layer(picture, lease)
        self._reports.report_layer(layer_m, picture.now_s, is_steered=picture.is_steered)
        return layer_m

    def lands(self, now_s: float) -> bool:
        """By its leader's word, or because the others have not been heard again."""
        return self.phases.phase is SwarmPhase.LAND or self.partition.partitioned_long(now_s)

    def findings(self, picture: Picture, *, clear_below: bool) -> list[Finding]:
        """The reasons for which this vehicle must not follow the phase, by the table of failsafes.

        `clear_below`: no vehicle flies or hangs above or below this one, so that it may land.
        """
        phase = self.phases.phase
        holds_lost = picture.is_position_lost and self._mission.swarm.position_uncertain is PositionUncertain.HOLD
        readings = Readings(
            land_all=self.operator.aborts,
            clear_below=clear_below,
            swarm_lands=phase is SwarmPhase.LAND and not self.operator.holds,
            operator_holds=self.operator.holds,
            global_lost=holds_lost and phase in OUTWARD,
            alone_s=self.partition.no_contact_s(picture.now_s),
            parted_s=self.partition.partitioned_s(picture.now_s),
        )
        return self._holds(picture) + failsafe_engine.detect(Source.SWARM, readings)

    def may_join(self) -> bool:
        """A leader is known, and its swarm flies: also where it lands, as who is steered can make room to."""
        lease = self.election.lease
        return lease is not None and lease.established and self.phases.phase >= SwarmPhase.GATHER

    def lease_freshness(self) -> float:
        """1 while the leader is heard of, falling to 0 as its lease runs out."""
        left = (LEASE_PERIODS - self.election.age) / (LEASE_PERIODS - REF_FADES_FROM)
        return max(0.0, min(1.0, left))

    @property
    def range_m(self) -> float:
        """The range that the formation keeps: the paper keeps it compact on the way and back, extended at d2."""
        radio, is_spread = self._mission.radio, self.phases.phase in (SwarmPhase.COVERAGE, SwarmPhase.LAND)
        return radio.full_range_m if is_spread else radio.transit_range_m

    @property
    def formation_range_m(self) -> float:
        """The same, less where the link up the route is bad: on the way the swarm closes up before it is lost."""
        closes_up = self._is_link_bad and self.phases.phase in UNDER_WAY
        return formation.BAD_LINK_RANGE * self.range_m if closes_up else self.range_m

    def radio_range_m(self, *, airborne: bool, misses: bool) -> float:
        """The range that the radio is set to: all of it while a vehicle is missing, to find one another again.

        And on the way from a tree: they leave it as widely as they have spread about it.
        """
        lease, phases = self.election.lease, self.phases
        parted = airborne and (misses or lease is None or not lease.quorum)
        came = phases.stop > 0 or phases.phase >= SwarmPhase.COVERAGE
        return self._mission.radio.full_range_m if parted or came else self.range_m

    # --- each beacon period: the leader, the phase ---

    def run_period(self, picture: Picture, *, resigns: bool) -> bool:
        """Elect and count; True when this vehicle leads, and may decide for the swarm (see `decide_phase`).

        `resigns`: a failsafe costs it the lead.
        """
        now_s, contacts = picture.now_s, picture.contacts
        self._reception = picture.reception
        # A vehicle on the ground does not lead those that fly.
        there = picture.is_steered or (picture.can_lead and self.phases.phase <= SwarmPhase.GATHER)
        # A swarm of which all were stalled at once: one of them has to begin.
        there |= bool(picture.neighbours) and picture.listens_s > LISTEN_S
        is_out = self._resignation.update(picture, leads=self.election.acts, resigns=resigns)
        eligible = there and not resigns and not is_out and not self.trust.bars_lead(now_s)
        score = score_of(picture.battery_percent, self._reception)
        self.election.set_priority(self._priorities.of(self.me, self._reception))
        news = self.trust.run_period(picture, self.election, self.phases, is_held=self.operator.holds)
        for vehicle, why in news:
            self._reports.report_blocked(vehicle, why)
        self.roster.exclude(self.trust.blocklist.bits())
        heard = self.trust.find_views(contacts.beacons(now_s, within_s=ECHO_PERIODS * self._period_s))
        self.election.run_period(now_s, period_s=self._period_s, eligible=eligible, score=score, heard=heard)
        self._reports.report_leader(self.election.lease, is_steered=picture.is_steered)
        self.find_route(picture)
        self._count_votes(picture)
        self._search_lost_peers(picture)
        if self.phases.phase >= SwarmPhase.GATHER and not self.launched:
            self.launched = True
            self.roster.mark_launched(contacts.ready(now_s))
        decides = self.election.role is Role.LEADER and self.roster.may_decide(now_s)
        return decides and eligible and not self.operator.holds and not self._holds(picture)

    def find_route(self, picture: Picture) -> None:
        """The way to the leader, how fast it may go, and what comes up it: which are there, and which have done it."""
        neighbours = linked = picture.neighbours
        if picture.is_steered:  # one that cannot follow must not hold up those that can
            linked = [n for n in neighbours if n.beacon.state in STEERED]
        if self.election.leads:
            self.route = formation.LEADER_ROUTE
        elif self.election.lease is None:
            self.route = formation.NOWHERE
        else:
            self.route = formation.route(linked, range_m=self.range_m)
            self.trust.check_route(self.route, neighbours, self.election.lease, picture.now_s)
        self._is_link_bad = formation.is_link_bad(self.route, was_bad=self._is_link_bad)
        range_m, followers = self.formation_range_m, formation.children(self.me, self.route, linked)
        self.governor = formation.governor(
            self.route,
            self.trust.filter_followers(followers, picture.now_s, range_m=range_m),
            range_m=range_m,
            link_is_bad=self._is_link_bad,
        )
        branches = [follower.beacon for follower in formation.children(self.me, self.route, neighbours)]
        heard, silent, phases = [n.beacon for n in neighbours], picture.find_silent_here(), self.phases
        self.roster.collect_branches(
            branches, done=self._has_done(picture), phase=phases.phase, stop=phases.stop, silent=silent, heard=heard
        )

    def decide_phase(self, picture: Picture, to_goal_m: float) -> None:
        """One period as leader, `to_goal_m` from the phase's goal: whether the swarm goes on.

        With its position more uncertain than the mission allows it turns back, or does not set out.
        """
        now_s, is_lost = picture.now_s, picture.is_position_lost
        there, started = to_goal_m <= self._mission.route.arrival_distance_m, self.operator.started
        if (
            is_lost
            and self._mission.swarm.position_uncertain is PositionUncertain.RETURN
            and self.phases.turn_back(now_s)
        ):
            self._reports.report_backtracking()
            return
        if self.phases.is_near_end(now_s) and not self._is_formed(picture):
            self.phases.note_unformed(now_s)
        phase, stop, waits = self.phases.phase, self.phases.stop, self.partition.makes_wait(now_s)
        done = self._may_leave(self.roster.with_excluded(self.roster.done), is_lost=is_lost)
        if self.phases.decide_phase(done, to_goal_m=to_goal_m, started=started, now_s=now_s, waits=waits):
            entered = self.phases.phase
            if entered is SwarmPhase.GATHER:
                self.roster.mark_launched(done)
            if entered is SwarmPhase.LAND and phase in (SwarmPhase.TRANSIT, SwarmPhase.RETURN) and not there:
                self._reports.report_stuck()
            if entered is phase:
                self._reports.report_lane(stop, self.phases.stop, is_reached=there)
            else:
                self._reports.report_phase(entered, phase, self.phases.stop, done)
        elif (phase is SwarmPhase.ASSEMBLE and started) or self.phases.overdue(now_s):
            self._reports.report_absent(done, now_s)

    def _is_formed(self, picture: Picture) -> bool:
        """A leader's: the ring or sphere, by the positions of those that it hears."""
        dest = picture.dest_ned_m
        if dest is None:
            return True
        own = [sub(ZERO, dest)] if picture.is_steered else []
        from_tree = own + [sub(n.rel_ned_m, dest) for n in picture.neighbours if n.gives_way]
        hidden = max(0, self.roster.present.bit_count() - len(from_tree))
        spec = self._mission.coverage
        return coverage.is_formed(
            from_tree, hidden=hidden, radius_m=spec.radius_m, is_ring=spec.shape is CoverageShape.RING
        )

    def _may_leave(self, done: int, *, is_lost: bool) -> int:
        """`done`, as it counts: with its position lost a swarm at d1 does not set out, to turn back at once."""
        waits = is_lost and self.phases.phase is SwarmPhase.GATHER
        self._reports.report_wait_for_position(waits=waits)
        return 0 if waits else done

    def make_beacon(
        self,
        lease: Lease | None,
        *,
        time_s: float,
        vel_ned_mps: Vec3,
        ref_ned_mps: Vec3,
        dest_ned_m: Vec3 | None,
        state: FlightState,
        airborne: bool,
        range_m: float,
        sighting: PeerReport | None,
        echo: BeaconEcho | None,
        position_error_m: float = 0.0,
    ) -> Beacon:
        """The beacon that this vehicle sends now. `lease`: the election's own, or its early one."""
        election, roster = self.election, self.roster
        return Beacon(
            sender=self.me,
            time_ms=int(time_s * 1000.0),
            vel_ned_mps=vel_ned_mps,
            ref_ned_mps=ref_ned_mps,
            dest_ned_m=dest_ned_m,
            route_cost=self.route.cost,
            governor=self.governor,
            lease=lease,
            hop=election.hop,
            agreed=election.agreed,
            candidate=election.candidate,
            parent=self.route.parent,
            phase=self.phases.phase,
            state=state,
            airborne=airborne,
            start=self.operator.started,
            abort=self.operator.aborts,
            done=roster.done,
            range_m=range_m,
            present=roster.present,
            flown=roster.flown,
            sighting=sighting,
            echo=echo,
            stop=self.phases.stop,
            position_error_m=position_error_m,
            accused=self.trust.accused,
        )

    # --- inside ---

    def _new_election(self, mission: Mission) -> Election:
        periods = round(mission.swarm.reelection_period_s / (1.0 / mission.radio.beacon_rate_hz))
        priority = self._priorities.of(self.me, self._reception)
        return Election(self.me, priority, size=mission.swarm.size, reelection_periods=periods)

    def _count_votes(self, picture: Picture) -> None:
        """Finds out if this part of the swarm may go on: its leader counts, and says so with the lease."""
        if self.election.role is Role.LEADER:
            self.election.set_quorum(self.roster.has_quorum(picture.now_s, grounded=picture.contacts.grounded()))
        else:
            lease, inherits = self.election.lease, self.election.inherits_quorum(RENEWED_PERIODS)
            is_led = lease is not None and lease.established and lease.quorum
            self.roster.note_following(picture.now_s if inherits else None, majority=is_led)
        self.partition.update_quorum(picture, self.election.lease)

    def _search_lost_peers(self, picture: Picture) -> None:
        """An acting leader looks for those that are lost; with the majority it goes on after a while."""
        election, phases, parts, roster = self.election, self.phases, self.partition, self.roster
        lease, leads = election.lease, election.role is Role.LEADER
        whole = lease is not None and lease.established and lease.quorum and election.age <= RENEWED_PERIODS
        parts.search_lost_peers(
            picture,
            roster,
            lease,
            # A leader counts; one that hears news of one with the majority is linked to all that count.
            linked=roster.find_linked() if leads else roster.flown if whole else 0,
            role=election.role,
            to_goal_mps=-picture.to_d2_mps if phases.phase is SwarmPhase.RETURN else picture.to_d2_mps,
            ahead=[sub(position, picture.offset_ned_m) for position in phases.stops_ahead()],
            phase=phases.phase,
        )
        if (parts.waits_for and parts.recovery.goal is None) or parts.leaves_layer(picture.now_s):
            self.governor = 0.0
        goes_on = whole and leads and picture.is_steered and phases.phase in UNDER_WAY
        self._reports.report_waits(parts.waits_for, picture.now_s, parts.waits_until_s, roster.present, goes_on=goes_on)

    def goal(self) -> Goal | None:
        """A leader's: where it goes; when others are lost, where it looks for them."""
        search = self.partition.recovery.goal
        return self.own_goal() if search is None else Goal(search[0], search[1], is_own=True)

    def own_goal(self) -> Goal | None:
        """As `Phases.goal`; or back along the own way."""
        if self._home is not None and self.phases.phase is SwarmPhase.RETURN:
            return Goal(self._home, 0.0, is_own=True)
        goal = self.phases.goal()
        return None if goal is None else Goal(goal[0], goal[1], is_own=False)

    def _update_trail(self, pos_ned_m: Vec3, *, is_lost: bool) -> None:
        """The own way, out, and back where its position is lost."""
        phase, backtracking = self.phases.phase, self.backtracking
        if phase in OUTWARD:
            backtracking.record_position(pos_ned_m)
        elif is_lost and phase is SwarmPhase.RETURN and not backtracking.has_turned:
            backtracking.turn_back(pos_ned_m)
        if backtracking.has_turned:
            self._home = backtracking.next_waypoint(pos_ned_m)

    def trail_left_m(self, pos_ned_m: Vec3) -> float | None:
        """A leader's that goes back along its own way: how far it has to go; None: it does not."""
        return None if self._home is None else self.backtracking.left_m(pos_ned_m)

    def _has_done(self, picture: Picture) -> bool:
        match self.phases.phase:
            case SwarmPhase.ASSEMBLE:
                return picture.state is FlightState.READY
            case SwarmPhase.LAND:
                return picture.state is FlightState.LANDED
            case _:
                return picture.settled and picture.state not in NOT_AT_IT

    def _holds(self, picture: Picture) -> list[Finding]:
        """The reasons for which it must neither follow the phase nor, as leader, decide for the swarm."""
        lease, role = self.election.lease, self.election.role
        return self.partition.hold_findings(self.roster, picture.contacts, lease, picture.now_s, role=role)

    def take_reports(self) -> list[Say]:
        """The news for an operator, since they were taken last."""
        return self._reports.take_all()
