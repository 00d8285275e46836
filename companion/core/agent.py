"""The companion agent: `receive` what comes in, `tick` at 20 Hz, do what it returns. It does no I/O by itself."""

from __future__ import annotations

import math
from typing import Final

from companion.core.guidance.excitation import ExcitationManoeuvre
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import WEAVES, Guidance
from companion.core.localisation.global_localisation import GlobalLocalisation
from companion.core.localisation.localiser import Localiser
from companion.core.model.actions import Action, Say, SendBeacon, VelocitySetpoint, brief
from companion.core.model.beacon import Lease, PeerReport, RelativeReport
from companion.core.model.events import Event, HeardBeacon, ObstacleScan, OperatorOrder, Position, Ranges, Satellites
from companion.core.model.states import STEERED, FlightState, Order, Severity, SwarmPhase
from companion.core.model.vectors import ZERO, add, sub
from companion.core.perception.obstacle_cloud import find_hovering
from companion.core.perception.obstacle_perception import build_perception
from companion.core.safety.descent import is_clear_below
from companion.core.safety.disturbance import build_disturbance_observer
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.setpoint import AT_REST
from companion.core.safety.surroundings import Surroundings
from companion.core.status import Status
from companion.core.swarm.swarm import Swarm
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause, Readings, Source
from companion.core.vehicle.flight import Flight
from companion.core.vehicle.obstacle_sensor_monitor import ObstacleSensorMonitor
from mission.common.frames import Vec3
from mission.document.model import Mission

TICK_HZ: Final = 20
TICK_S = 1.0 / TICK_HZ
NOT_YET = (FlightState.WAITING, FlightState.READY)  # to fly
ANCHOR_MPS: Final = 0.5  # a leader goes over to what satellites say this fast: no setpoint jumps, 10 m take 20 s


class Agent:
    """One vehicle's companion. `now_s` is any monotonic clock, in seconds."""

    def __init__(self, mission: Mission, vehicle_id: int) -> None:
        """ValueError when `vehicle_id` is not one of the mission's 1..size."""
        if not 1 <= vehicle_id <= mission.swarm.size:
            raise ValueError(f"vehicle id {vehicle_id}: the mission has 1..{mission.swarm.size}")
        self.id = vehicle_id
        self.mission = mission
        self.localiser = Localiser(mission, vehicle_id)
        self.swarm = Swarm(mission, vehicle_id)
        self.movement = Guidance(mission, vehicle_id)
        self.sensors = ObstacleSensorMonitor(None if mission.sensing is None else mission.sensing.stale_s)
        self.perception = build_perception(mission)
        self.disturbances = build_disturbance_observer(mission)
        self.safety_filter = SafetyFilter.of(mission)
        self.setpoint = AT_REST  # the last that went out
        self.flight = Flight(mission.route.d1_enu_m[2], self.sensors)
        receives = mission.has_satellites(vehicle_id)
        self.place = GlobalLocalisation(receives=receives) if mission.flies_by_ranges else None
        self._weaves = ExcitationManoeuvre(vehicle_id)
        self._ticks_per_beacon = round(TICK_HZ / mission.radio.beacon_rate_hz)
        self._ticks = 0
        self._said_early = False  # a beacon before its time, in this period
        self._located_s = 0.0
        self._last_tick_s: float | None = None
        self._hovering: dict[int, PeerReport] = {}  # vehicles in the air that no companion steers, by id
        self._says: list[Say] = []
        self._waived = ""  # checks of the preflight that an operator took as accepted

    def waive(self, checks: str, unknown: str = "") -> None:
        """An operator accepts these failed checks of the preflight: it is said once, when the flight is allowed.

        `unknown`: what could not be, in words; heard now.
        """
        self._waived = checks
        if unknown:
            self._say(Severity.WARNING, brief(unknown))

    def ground(self, why: str) -> None:
        """Why this vehicle must not arm, in words; empty: it may. One that is in the air already flies on."""
        self.flight.grounded = why

    def receive(self, event: Event, now_s: float) -> None:
        """Store one event; `now_s` is its local time of arrival."""
        match event:
            case HeardBeacon():
                self._hear(event, now_s)
            case OperatorOrder(order):
                self._obey(order)
            case Position():
                if self.place is not None:
                    event = self.place.split_position(event, now_s, airborne=self.flight.vehicle.airborne)
                self.localiser.see_own(event, now_s)
                self.flight.receive(event, now_s)
            case Satellites():
                if self.place is not None:
                    self.place.receive_satellites(event, now_s)
            case Ranges() | RelativeReport():
                self.localiser.read(event, now_s)
            case ObstacleScan():
                self.sensors.record_scan(event, now_s)
                self._map(event, now_s)
            case _:
                self.flight.receive(event, now_s)

    def tick(self, now_s: float) -> list[Action]:
        """Decide: what to send to the neighbours, to the autopilot and to the operator."""
        gap_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        if failsafe_engine.detect(Source.TICK, Readings(tick_gap_s=gap_s)):
            self._wake(now_s)
        self._last_tick_s = now_s
        self._look_around(now_s)
        if self.place is not None:
            self.place.update_reception(now_s, leads=self.swarm.election.acts)
            self._mind_place(self.place, now_s)
        neighbours, peers, swarm = self.localiser.neighbours, self.localiser.peers, self.swarm
        self.flight.unplaced = self.localiser.unplaced(now_s)
        swarm.update_peer_contact(self.flight, [] if self.localiser.is_lost else neighbours, now_s)
        lacks = self.flight.vehicle.findings(now_s)
        actions: list[Action] = []
        if self._ticks % self._ticks_per_beacon == 0:
            resigns, to_d2_mps = failsafe_engine.resigns(lacks), self.movement.to_d2_mps
            if swarm.run_period(self.flight, peers, neighbours, now_s, resigns=resigns, to_d2_mps=to_d2_mps):
                swarm.decide_phase(self._to_goal_m(), now_s)
            actions += self._beacon(swarm.election.lease, now_s)
            self._said_early = False
        elif swarm.election.changed and not self._said_early:
            # At most one more beacon a period: so news of a leader does not wait at every hop.
            swarm.find_route(self.flight, neighbours)
            actions += self._beacon(swarm.election.early, now_s)
            self._said_early = True
        self._ticks += 1
        self._tell_waived()
        for said in (self._says, self.localiser.said, swarm.said):
            actions += said
            said.clear()
        gathers = swarm.phases.phase is SwarmPhase.GATHER and not swarm.phases.overdue(now_s)
        findings = [*lacks, *self.localiser.findings(leader=self._leader, gathers=gathers)]
        findings += swarm.findings(peers, now_s, clear_below=swarm.lands(now_s) and self._is_clear_below())
        actions += self.flight.step(swarm.phases.phase, now_s, findings=findings, may_join=swarm.may_join())
        if self.flight.steers:
            actions.append(self._steer(now_s, rests=failsafe_engine.rests(lacks)))
        else:
            self._rest()
        return actions

    def status(self, now_s: float) -> Status:
        """What this agent knows and does, as of its last tick."""
        vehicle, swarm, election = self.flight.vehicle, self.swarm, self.swarm.election
        lease = election.lease
        return Status(
            id=self.id,
            state=self.flight.state,
            cause=self.flight.cause,
            phase=swarm.phases.phase,
            waits_for=self.flight.waits_for,
            grounded=self.flight.grounded,
            lease=lease,
            leader=lease.leader if lease is not None and lease.established else 0,
            acts=election.acts,
            hop=election.hop,
            parent=swarm.route.parent,
            route_cost=swarm.route.cost,
            governor=swarm.governor,
            neighbours=tuple([n.id for n in self.localiser.neighbours]),
            silent=tuple(self.localiser.silent),
            done=swarm.roster.done,
            present=swarm.roster.present,
            flown=swarm.roster.flown,
            mode="" if vehicle.mode is None else vehicle.mode.name,
            armed=vehicle.armed,
            airborne=vehicle.airborne,
            position=vehicle.position,
            position_known=not vehicle.position_missing(now_s),
            telemetry_late_s=vehicle.delay.late_s,
            battery_percent=vehicle.battery_percent,
            dest_ned_m=self.movement.dest_ned_m,
            setpoint_ned_mps=self.setpoint.vel_ned_mps,
        )

    # --- what comes in ---

    def _hear(self, heard: HeardBeacon, now_s: float) -> None:
        own, sender = self.flight.vehicle.position, heard.said.sender
        if own is None or sender == self.id or not self.swarm.has(sender):
            return
        said = self.swarm.sanitise_beacon(heard.said)
        if said is not heard.said:
            heard = HeardBeacon(said, heard.rel_ned_m)
        if self.localiser.hear(heard, own.pos_ned_m, now_s):
            self.swarm.receive_beacon(said, now_s)

    def _map(self, scan: ObstacleScan, now_s: float) -> None:
        own = self.flight.vehicle.position
        if own is not None:
            moves = Position(own.pos_ned_m, self._velocity(own))
            self.perception.integrate_scan(scan, moves, now_s, [n.rel_ned_m for n in self.localiser.neighbours])

    def _obey(self, order: Order) -> None:
        match order:
            case Order.START:
                self.swarm.started = True
                if self.flight.grounded:
                    self._say(Severity.ERROR, brief(f"grounded, {self.flight.grounded}"))
                self.flight.hand_back()
            case Order.LAND_ALL:
                if not self.swarm.abort:
                    self._say(Severity.WARNING, "land all: ordered by the operator")
                self.swarm.abort = True

    def _tell_waived(self) -> None:
        """Once, when the flight is allowed."""
        if self._waived and self.swarm.started:
            self._say(Severity.WARNING, brief(f"preflight waived: {self._waived}"))
            self._waived = ""

    def _wake(self, now_s: float) -> None:
        """After a stall: what is known is old, and the autopilot has acted by itself."""
        self.flight.stall()
        self.localiser.stalled(now_s)
        self.swarm.forget_leader()
        self._rest()

    def _rest(self) -> None:
        """Not steered: what was desired and commanded before does not count."""
        self.movement.reset()
        self.disturbances.reset()
        self.setpoint = AT_REST

    # --- each tick ---

    def _look_around(self, now_s: float) -> None:
        """Where the others are by now, and what stands in the way."""
        own, localiser = self.flight.vehicle.position, self.localiser
        if own is None:
            return
        airborne = self.flight.vehicle.airborne
        if airborne or self.flight.state is FlightState.TAKING_OFF:
            self.swarm.roster.mark_airborne()
        localiser.settle(self.flight.vehicle.landed, waits=self.flight.state in NOT_YET)
        localiser.look(own.pos_ned_m, now_s, range_m=self._radio_range_m(), launched=self.swarm.launched)
        scans, sensing = self.perception.scans, self.mission.sensing
        seeks = self.flight.state is FlightState.SEEKING  # only then do they bar the way to the others
        if seeks and scans is not None and sensing is not None:
            localiser.look_for_silent(scans, own.pos_ned_m, now_s, fresh_s=sensing.stale_s)
        self._hovering = find_hovering(localiser.silent, localiser.neighbours)

    def _velocity(self, own: Position) -> Vec3:
        """What is believed of the own one, NED m/s."""
        return add(own.vel_ned_mps, self.localiser.drift_ned_mps)

    @property
    def _leader(self) -> int:
        """The established one; 0: none."""
        lease = self.swarm.election.lease
        return lease.leader if lease is not None and lease.established else 0

    def _radio_range_m(self) -> float:
        return self.swarm.radio_range_m(airborne=self.flight.vehicle.airborne, misses=self.localiser.misses)

    def _beacon(self, lease: Lease | None, now_s: float) -> list[Action]:
        own = self.flight.vehicle.position
        if own is None:
            return []
        beacon = self.swarm.beacon(
            lease,
            time_s=now_s,
            vel_ned_mps=self._velocity(own),
            ref_ned_mps=self.movement.ref_ned_mps,
            dest_ned_m=self._destination(own, now_s),
            state=self.flight.state,
            airborne=self.flight.vehicle.airborne,
            range_m=self._radio_range_m(),
            sighting=self.localiser.to_tell(own.pos_ned_m, now_s),
        )
        ranging, swarm = self.localiser.ranging, self.swarm
        if ranging is None:
            return [SendBeacon(beacon)]
        place = add(own.pos_ned_m, self.swarm.off_ned_m) if swarm.election.acts else None
        place_sd_m = None if self.place is None or beacon.dest_ned_m is None else self.place.sd_m
        return [SendBeacon(beacon, ranging.make_report(self._leader, beacon.time_ms, now_s, place_sd_m), place)]

    def _steer(self, now_s: float, *, rests: bool) -> VelocitySetpoint:
        own = self.flight.vehicle.position
        assert own is not None
        self._destination(own, now_s)
        if self.flight.state is FlightState.TAKING_OFF:  # on the ground: nothing may move it
            return VelocitySetpoint(ZERO, self.movement.yaw_rad)
        if rests:
            self._rest()  # from an old place nothing can be kept clear of: brake
            return VelocitySetpoint(ZERO, self.movement.yaw_rad)
        swarm, leads, range_m = self.swarm, self.swarm.election.acts, self._radio_range_m()
        around = self._observe(own, now_s)
        desired = self.movement.guide(
            GuidanceInput(
                around,
                state=self.flight.state,
                phase=SwarmPhase.LAND if swarm.lands(now_s) else swarm.phases.phase,
                route=swarm.route,
                range_m=swarm.range_m,
                leads=leads,
                governor=swarm.governor,
                lease_freshness=swarm.lease_freshness(),
                goal=swarm.goal() if leads else None,
                size=swarm.roster.flown.bit_count(),
                corridors=self.localiser.peers.predict_corridors(own.pos_ned_m, now_s, range_m=range_m)
                if self.safety_filter.senses
                else (),
                excitation_ned_mps=self._weave(now_s),
            ),
            dt_s=TICK_S,
        )
        self.setpoint = self.safety_filter.apply(desired.vel_ned_mps, around, dt_s=TICK_S)
        return VelocitySetpoint(self.setpoint.vel_ned_mps, desired.yaw_rad)

    def _observe(self, reported: Position, now_s: float) -> Surroundings:
        """The surroundings of a vehicle that is steered: once a tick, as wind is estimated from one to the next."""
        own, bias = Position(reported.pos_ned_m, self._velocity(reported)), self.localiser.drift_ned_mps
        off_ned_m, commanded = self.swarm.off_ned_m, self.setpoint.vel_ned_mps
        disturbance = self.disturbances.observe_disturbance(own, add(commanded, bias), TICK_S)
        placed_ned_m = own.pos_ned_m if off_ned_m == ZERO else add(own.pos_ned_m, off_ned_m)
        return Surroundings(
            own,
            self.localiser.neighbours,
            self._hovering,
            self.perception.observe_obstacles(own.pos_ned_m, placed_ned_m, self._hovering, now_s),
            off_ned_m=off_ned_m,
            bias_ned_mps=bias,
            disturbance=disturbance,
            commanded_ned_mps=commanded,
        )

    def _weave(self, now_s: float) -> Vec3:
        ranging, flight = self.localiser.ranging, self.flight
        if ranging is None:
            return ZERO
        seeks = math.inf if self.localiser.seeks_start else 0.0
        velocity = self._weaves.velocity(max(seeks, ranging.rotation_sd_rad), now_s)
        return velocity if flight.state in WEAVES or flight.cause is Cause.PLACE_UNSURE else ZERO

    def _destination(self, own: Position, now_s: float) -> Vec3 | None:
        """Vector to d2, as far as it is known here."""
        ranging, place, movement, swarm = self.localiser.ranging, self.place, self.movement, self.swarm
        leads, stop = swarm.election.acts, swarm.phases.stop
        if ranging is None or place is None:
            movement.locate(own, swarm.route, leads=leads, stop=stop)
            return movement.dest_ned_m
        flown = own
        if not self.mission.has_satellites(self.id):
            flown = Position(sub(own.pos_ned_m, ranging.strayed_ned_m), own.vel_ned_mps)
        fix, most_m = place.fix_ned_m(now_s), ANCHOR_MPS * (now_s - self._located_s)
        self._located_s = now_s
        movement.locate(flown, swarm.route, leads=leads, stop=stop, fix_ned_m=fix, most_m=most_m)
        told_sd_m = ranging.place_sd_m([n.id for n in swarm.route.up])
        place.update_destination_sd(told_sd_m, now_s, lag_m=movement.lag_m if leads else None)
        swarm.off_ned_m = movement.off_ned_m(own)
        return movement.dest_ned_m

    def _mind_place(self, place: GlobalLocalisation, now_s: float) -> None:
        """How well it hears satellites, and whether it knows where it is well enough to lead on."""
        own, swarm = self.flight.vehicle.position, self.swarm
        swarm.reception = place.reception
        budget_m = self.mission.swarm.place_budget_m
        swarm.lost = swarm.election.acts and place.is_lost(now_s, budget_m)
        if own is not None and self.flight.state in STEERED:
            swarm.update_trail(own.pos_ned_m)

    def _to_goal_m(self) -> float:
        """A leader's: how far it has to go in this phase."""
        own, goal = self.flight.vehicle.position, self.swarm.own_goal()
        if own is None or goal is None:
            return 0.0
        left_m = self.swarm.trail_left_m(own.pos_ned_m)
        if left_m is not None:
            return left_m
        return self.movement.to_goal_m(own.pos_ned_m, goal, self._hovering)

    def _is_clear_below(self) -> bool:
        apart = self.mission.separation
        return is_clear_below(
            self.localiser.neighbours, self.localiser.silent, soft_m=apart.soft_m, hard_m=apart.hard_m
        )

    def _say(self, severity: Severity, text: str) -> None:
        self._says.append(Say(severity, text))
