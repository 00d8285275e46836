"""One vehicle, as a function from a value to a value: its shipped `Swarm`, and the least of a flight around it.

A beacon period is a few of these functions, each remembered: of a million states of a swarm there are some thousands of
one vehicle. What stands in for the rest of the agent moves at once: one that may take off is in the air a period later,
one that lands has landed. All vehicles stand where all links are equally good; who hears whom is the explorer's.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from companion.core.model.beacon import Beacon, Lease
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.peer_contacts import PeerContact, PeerContacts
from companion.core.model.states import STEERED, FlightState, Order, Reception, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.swarm.election import ECHO_PERIODS
from companion.core.swarm.phases import progress_of
from companion.core.swarm.picture import Picture
from companion.core.swarm.swarm import LISTEN_S, Swarm
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Response
from companion.core.vehicle.flight import NOT_OURS
from companion.core.vehicle.flight_table import EVENT_OF_PHASE, IN_FLIGHT
from companion.core.vehicle.operator_orders import FloodedOrders
from mission.document.model import Mission
from tests.exploration.kept import EPOCH, PERIOD_S, Shelf, Value, give_lease, take_lease, to_s

STALE_PERIODS = 5  # a neighbour counts as heard for so long; `peer_table.STALE_S`
READY_PERIODS = 51  # one that was ready counts as about to take off; only before the swarm has left
LISTEN_PERIODS = round(LISTEN_S / PERIOD_S) + 1
AWAY_M = (10.0, 0.0, 0.0)  # each of the other
TOLD = Lease(1, 1, 0, 0, established=False)  # of a kept beacon only the leader counts
FAR_M = 1e4


class Member(NamedTuple):
    """A vehicle's whole state."""

    swarm: Value
    state: FlightState
    airborne: bool
    decides: bool  # it has decided for the swarm in this period, or might have: it acts exclusively
    counted: bool  # ... and then its lease said that it has the majority
    weak: bool  # a failsafe costs it the lead
    clock: int  # periods by which its own clock is off
    listens: int  # periods in the air, waiting for a swarm
    heard: tuple[tuple[int, int] | None, ...]  # of each vehicle: how many periods ago, and which beacon


class Seen(NamedTuple):
    """What the rules look at."""

    leader: int
    acts: bool
    decides: bool
    counted: bool
    quorum: bool
    phase: SwarmPhase
    progress: tuple[bool, int, SwarmPhase]
    started: bool
    abort: bool
    airborne: bool
    landed: bool
    flown: int
    able: bool  # it may lead
    blocks: int  # whose words do not count; bit k-1 for vehicle k
    role: Role


class Said(NamedTuple):
    """A beacon on the air: without its lease, and that from the clock."""

    beacon: Beacon
    lease: Value | None


class Fleet:
    """The functions of each vehicle of a mission, remembered. Members and beacons are numbers here."""

    def __init__(self, mission: Mission, *, arrives: bool) -> None:
        """`arrives`: a leader is at its goal as soon as it has one; else it never comes to d2."""
        self.mission, self.arrives = mission, arrives
        self.size = mission.swarm.size
        self._members: list[tuple[int, Member]] = []  # of which vehicle
        self._seen: list[Seen] = []
        self._member_numbers: dict[tuple[int, Member], int] = {}
        self.said: list[Said] = []
        self._said_numbers: dict[Said, int] = {}
        self._swarms = [Swarm(mission, k, FloodedOrders()) for k in range(1, self.size + 1)]
        self._shelves = [Shelf(swarm) for swarm in self._swarms]
        self._new = [shelf.take(EPOCH, 0) for shelf in self._shelves]
        self._runs: dict[int, tuple[int, int]] = {}
        self._hears: dict[tuple[int, int], int] = {}
        self._news: dict[int, tuple[int, int] | None] = {}

    # --- numbers ---

    def member(self, number: int) -> tuple[int, Member]:
        """Which vehicle, and its state."""
        return self._members[number]

    @property
    def count(self) -> int:
        """States of one vehicle, so far."""
        return len(self._members)

    def seen(self, number: int) -> Seen:
        """What the rules look at."""
        return self._seen[number]

    def number(self, vehicle: int, member: Member) -> int:
        """The number of a vehicle's state."""
        key = (vehicle, member)
        number = self._member_numbers.get(key)
        if number is None:
            number = self._member_numbers[key] = len(self._members)
            self._members.append(key)
            self._seen.append(self._look(vehicle, member))
        return number

    def said_number(self, said: Said) -> int:
        """The number of a beacon."""
        number = self._said_numbers.get(said)
        if number is None:
            number = self._said_numbers[said] = len(self.said)
            self.said.append(said)
        return number

    # --- the functions ---

    def begin(self, vehicle: int, *, airborne: bool = False, clock: int = 0) -> int:
        """A companion has started, on the ground or in the air; it knows nothing."""
        shelf, swarm = self._shelves[vehicle - 1], self._swarms[vehicle - 1]
        shelf.give(self._new[vehicle - 1], EPOCH, clock)
        swarm.phases.since_s = to_s(EPOCH + clock)
        state = FlightState.WAITING if airborne else FlightState.READY
        value = shelf.take(EPOCH, clock)
        return self.number(vehicle, Member(value, state, airborne, False, False, False, clock, 0, (None,) * self.size))

    def order(self, number: int, *, start: bool = False, land: bool = False) -> int:
        """An operator's order, at this vehicle."""
        vehicle, member = self._members[number]
        swarm = self._give(vehicle, member)
        if start:
            swarm.operator.obey(Order.START)
        if land:
            swarm.operator.obey(Order.ABORT)
        return self.number(vehicle, member._replace(swarm=self._shelves[vehicle - 1].take(EPOCH, member.clock)))

    def weaken(self, number: int) -> int:
        """Its battery is low: it must not lead."""
        vehicle, member = self._members[number]
        return self.number(vehicle, member._replace(weak=True))

    def run(self, number: int) -> tuple[int, int]:
        """One beacon period: the next state, and the beacon that it sends."""
        found = self._runs.get(number)
        if found is None:
            found = self._runs[number] = self._run(number)
        return found

    def hear(self, number: int, said: int) -> int:
        """It hears a beacon, in the period in which that is sent."""
        key = (number, said)
        found = self._hears.get(key)
        if found is None:
            found = self._hears[key] = self._hear(number, said)
        return found

    def spread_news(self, number: int) -> tuple[int, int] | None:
        """Half a period later: the beacon of one that follows another leader since; None: it does not."""
        if number not in self._news:
            self._news[number] = self._spread_news(number)
        return self._news[number]

    def _run(self, number: int) -> tuple[int, int]:
        vehicle, member = self._members[number]
        swarm, period = self._give(vehicle, member), EPOCH + 1
        launched = swarm.launched and swarm.phases.phase > SwarmPhase.GATHER
        oldest = ECHO_PERIODS + 1 if launched else READY_PERIODS
        heard = tuple(None if one is None else (min(oldest, one[0] + 1), one[1]) for one in member.heard)
        member = member._replace(heard=heard)
        picture = self._picture(member, period)
        swarm.update_picture(picture)
        decides = swarm.run_period(picture, resigns=member.weak)
        if decides:
            is_far = swarm.phases.phase is SwarmPhase.TRANSIT and not self.arrives
            swarm.decide_phase(picture, FAR_M if is_far else 0.0)
        lease = swarm.election.lease
        counted = lease is not None and lease.quorum
        findings = swarm.findings(picture, clear_below=True)
        found = failsafe_engine.decide(findings)
        state, airborne = member.state, member.airborne
        lands = failsafe_engine.demands(found, Response.LAND)
        holds = failsafe_engine.demands(found, Response.HOLD) or failsafe_engine.demands(found, Response.REST)
        phase = swarm.phases.phase
        said = self._say(swarm, member, swarm.election.lease, period)
        listens = 0
        if state is FlightState.READY:
            if SwarmPhase.GATHER <= phase < SwarmPhase.LAND and not lands:
                state = FlightState.TAKING_OFF
        elif state is not FlightState.LANDED:
            if lands:
                state, airborne = FlightState.LANDED, False
            elif state is FlightState.TAKING_OFF:
                state, airborne = FlightState.HOLD, True
            elif state is FlightState.WAITING:
                listens = min(LISTEN_PERIODS, member.listens + 1)
                if swarm.may_join():
                    state, listens = FlightState.HOLD, 0
            else:
                state = FlightState.HOLD if holds else IN_FLIGHT[EVENT_OF_PHASE[phase]].state
        value = self._shelves[vehicle - 1].take(period, member.clock)
        member = member._replace(
            swarm=value,
            state=state,
            airborne=airborne,
            decides=decides and picture.is_steered,
            counted=counted,
            listens=listens,
        )
        return self.number(vehicle, member), said

    def _hear(self, number: int, said: int) -> int:
        vehicle, member = self._members[number]
        beacon, lease = self.said[said]
        swarm = self._give(vehicle, member)
        told = swarm.sanitise_beacon(replace(beacon, lease=give_lease(lease, EPOCH)), to_s(EPOCH + member.clock))
        swarm.receive_beacon(told, to_s(EPOCH + member.clock))
        kept = None if told.lease is None else replace(TOLD, leader=told.lease.leader)
        heard = list(member.heard)
        heard[beacon.sender - 1] = (0, self.said_number(Said(replace(told, lease=kept), None)))
        value = self._shelves[vehicle - 1].take(EPOCH, member.clock)
        return self.number(vehicle, member._replace(swarm=value, heard=tuple(heard)))

    def _spread_news(self, number: int) -> tuple[int, int] | None:
        vehicle, member = self._members[number]
        swarm = self._give(vehicle, member)
        if not swarm.election.changed:
            return None
        swarm.find_route(self._picture(member, EPOCH))
        said = self._say(swarm, member, swarm.election.early, EPOCH)
        return self.number(vehicle, member._replace(swarm=self._shelves[vehicle - 1].take(EPOCH, member.clock))), said

    def _give(self, vehicle: int, member: Member) -> Swarm:
        self._shelves[vehicle - 1].give(member.swarm, EPOCH, member.clock)
        return self._swarms[vehicle - 1]

    def _say(self, swarm: Swarm, member: Member, lease: Lease | None, period: int) -> int:
        beacon = swarm.make_beacon(
            None,
            time_s=0.0,
            vel_ned_mps=ZERO,
            ref_ned_mps=ZERO,
            dest_ned_m=None,
            state=member.state,
            airborne=member.airborne,
            range_m=self.mission.radio.full_range_m,
            sighting=None,
            echo=None,
        )
        return self.said_number(Said(beacon, take_lease(lease, period)))

    def _picture(self, member: Member, period: int) -> Picture:
        now_s = to_s(period + member.clock)
        contacts, neighbours = list[PeerContact](), list[Neighbour]()
        for one in member.heard:
            if one is None:
                continue
            periods, said = one
            beacon = self.said[said].beacon
            age_s = to_s(periods)
            contacts.append(
                PeerContact(
                    beacon, AWAY_M, now_s - age_s, now_s - age_s, ZERO, ZERO, ZERO, share=1.0, stale_s=STALE_PERIODS
                )
            )
            if periods <= STALE_PERIODS:
                neighbours.append(Neighbour(beacon, AWAY_M, None, age_s, ZERO, AWAY_M[0]))
        return Picture(
            now_s=now_s,
            own=Position(ZERO, ZERO),
            state=member.state,
            airborne=member.airborne,
            can_lead=member.state not in NOT_OURS,
            settled=member.state in STEERED,
            listens_s=to_s(member.listens),
            battery_percent=None,
            lacks=(),
            neighbours=neighbours,
            silent={},
            misses=False,
            hovering={},
            contacts=PeerContacts(tuple(contacts)),
            to_d2_mps=0.0,
            dest_ned_m=None,
            is_localised=True,
            not_localised="",
            reception=Reception.GOOD,
            may_lose_position=False,
            is_position_lost=False,
            offset_ned_m=ZERO,
            uncertain_peer=0,
            is_start_uncertain=False,
            unconfirmed_peers=(),
        )

    def _look(self, vehicle: int, member: Member) -> Seen:
        swarm = self._give(vehicle, member)
        election, phases = swarm.election, swarm.phases
        lease = election.lease
        return Seen(
            leader=0 if lease is None else lease.leader,
            acts=election.acts,
            decides=member.decides,
            counted=member.counted,
            quorum=lease is not None and lease.quorum,
            phase=phases.phase,
            progress=progress_of(phases.phase, phases.stop),
            started=swarm.operator.started,
            abort=swarm.operator.aborts,
            airborne=member.airborne,
            landed=member.state is FlightState.LANDED,
            flown=swarm.roster.flown,
            able=member.state not in NOT_OURS
            and not member.weak
            and (member.state in STEERED or phases.phase <= SwarmPhase.GATHER),
            blocks=swarm.trust.blocklist.bits(),
            role=election.role,
        )
