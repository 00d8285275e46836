"""The companion agent: `receive` what comes in, `tick` at 20 Hz, do what it returns. It does no I/O by itself.

A tick is four stages between frozen values: `observe` -> Picture, `decide` -> Orders, `guide` -> Desired, `filter` ->
Setpoint. Which localiser, planner and perception a vehicle has is chosen here, when it is built, and not asked again.
"""

from __future__ import annotations

from typing import Final

from companion.core.guidance.guidance_input import Desired, GuidanceInput
from companion.core.localisation.integrity.own_position import OwnPosition
from companion.core.localisation.makes import build_localiser
from companion.core.model.actions import Action, Say, SendBeacon, SendOdometry, VelocitySetpoint, brief
from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.core.model.events import Event, HeardBeacon, OperatorOrder, Position, Ranges, Satellites, Scan
from companion.core.model.stand import RecordsWaiting, StandMeasured
from companion.core.model.states import NOT_YET_FLYING, BeaconFate, FlightState, Order, Role, Severity, SwarmPhase
from companion.core.model.vectors import ZERO, add
from companion.core.perception.obstacle_cloud import find_hovering
from companion.core.perception.obstacle_perception import build_perception
from companion.core.rise.rise import build_rise
from companion.core.safety.ascent import ClimbRoom
from companion.core.safety.descent import LandingRoom
from companion.core.safety.disturbance import build_disturbance_observer
from companion.core.safety.rest import RestHold
from companion.core.safety.setpoint import AT_REST, Setpoint
from companion.core.safety.surroundings import Surroundings
from companion.core.stages import FLIGHT_STAGES, StageFactory
from companion.core.status import Status
from companion.core.swarm.orders import Orders
from companion.core.swarm.picture import Picture
from companion.core.swarm.swarm import Swarm
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.accepted import Accepted
from companion.core.vehicle.failsafe import Readings, Source
from companion.core.vehicle.flight import Flight
from companion.core.vehicle.obstacle_sensor_monitor import ObstacleSensorMonitor
from companion.core.vehicle.operator_orders import FloodedOrders, OperatorOrders, answer_hand_back
from mission.document.model import Mission

TICK_HZ: Final = 20
TICK_S = 1.0 / TICK_HZ


class Agent:
    """One vehicle's companion. `now_s` is any monotonic clock, in seconds."""

    def __init__(
        self,
        mission: Mission,
        vehicle_id: int,
        stages: StageFactory = FLIGHT_STAGES,
        operator: OperatorOrders | None = None,
    ) -> None:
        """`stages`: guidance and safety filter; `operator`: orders, else flooded. ValueError: no such vehicle."""
        if not 1 <= vehicle_id <= mission.swarm.size:
            raise ValueError(f"vehicle id {vehicle_id}: the mission has 1..{mission.swarm.size}")
        self.id, self.mission = vehicle_id, mission
        self.localiser = build_localiser(mission, vehicle_id)
        self.swarm = Swarm(mission, vehicle_id, operator or FloodedOrders())
        self.movement = stages.build_guidance(mission, vehicle_id)
        self.perception = build_perception(mission, vehicle_id, is_odometry=self.localiser.may_lose_position)
        self.own_position = OwnPosition(mission, self.localiser, self.perception)
        self.rise, self.sensors = build_rise(mission, self.perception), ObstacleSensorMonitor(self.perception.stale_s)
        self._lane_ends, self._visits = 2 * len(mission.lanes), len(mission.visits)  # lanes' ends come first
        self.disturbances = build_disturbance_observer(mission)
        self.safety_filter = stages.build_safety_filter(mission)
        self._climb_room, self._landing_room = ClimbRoom(mission), LandingRoom(mission)
        self._rest, self._accepted, self.setpoint = RestHold(), Accepted(), AT_REST  # the last that went out
        self.flight = Flight(mission.route.d1_enu_m[2], self.sensors)
        self._ticks_per_beacon = round(TICK_HZ / mission.radio.beacon_rate_hz)
        self._ticks, self._sent_early = 0, False  # a beacon before its time, in this period
        self._last_tick_s: float | None = None
        self._says: list[Say] = []

    def waive(self, checks: str, unknown: str = "", *, unsigned: bool = False) -> None:
        """An operator accepts these failed checks, and with `unsigned` a radio without keys: said to the ground.

        `unknown`: checks that could not be waived.
        """
        self._accepted.accept(checks, unsigned=unsigned)
        if unknown:
            self._says.append(Say(Severity.WARNING, brief(unknown)))

    def ground(self, why: str) -> None:
        """The reason not to arm this vehicle, in words; empty: it may. One that is in the air already flies on."""
        self.flight.ground(why)

    def receive(self, event: Event, now_s: float) -> None:
        """Store one event; `now_s` is its local time of arrival."""
        match event:
            case HeardBeacon():
                self.receive_beacon(event, now_s)
            case OperatorOrder():
                self._obey(event)
            case StandMeasured():
                self.swarm.phases.note_stand(event.basal_area_pct)
            case RecordsWaiting():
                self.rise.note_waiting(event.count, now_s)
            case Position():
                airborne, commanded = self.flight.vehicle.airborne, self.setpoint.vel_ned_mps
                flown = self.own_position.receive(event, now_s, airborne=airborne, commanded_ned_mps=commanded)
                self.flight.receive(flown, now_s)
            case Satellites():
                self.localiser.receive_satellites(event, now_s)
            case Ranges() | RelativeReport() | TrunkReport():
                self.localiser.receive_ranging(event, now_s)
            case Scan():
                self.sensors.record_scan(event, now_s)
                own = self.flight.vehicle.position
                if own is not None:
                    near, unheard = [n.rel_ned_m for n in self.localiser.neighbours], self.localiser.unheard
                    self.perception.integrate_scan(event, self.own_position.find_motion(own), now_s, near, unheard)
            case _:
                self.flight.receive(event, now_s)

    def receive_beacon(self, heard: HeardBeacon, now_s: float) -> BeaconFate:
        """As `receive`, of a beacon; whether it counts."""
        own, sender = self.flight.vehicle.position, heard.said.sender
        if own is None or sender == self.id or not self.swarm.has(sender):
            return BeaconFate.UNPLACED if own is None else BeaconFate.NO_MEMBER
        heard = self.own_position.locate_sender(heard)
        said = self.swarm.sanitise_beacon(heard.said, now_s)
        heard = heard if said is heard.said else HeardBeacon(said, heard.rel_ned_m, is_vouched=heard.is_vouched)
        if not self.localiser.receive_beacon(heard, own.pos_ned_m, now_s):
            return BeaconFate.NO_NEWS
        self.swarm.receive_beacon(said, now_s)
        return BeaconFate.KEPT

    def tick(self, now_s: float) -> list[Action]:
        """Decide: what to send to the neighbours, to the autopilot and to the operator."""
        gap_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        if failsafe_engine.detect(Source.TICK, Readings(tick_gap_s=gap_s)):
            self._recover_from_stall(now_s)
        self._last_tick_s = now_s
        picture = self.observe(now_s)
        orders = self.decide(picture)
        self._says += self.rise.update(picture, orders)
        actions: list[Action] = []
        if picture.own is not None and (orders.broadcasts or orders.steers):  # it is asked for
            here, up, stop, leader = picture.own.pos_ned_m, orders.route.up, orders.stop, orders.leader
            self.localiser.update_destination(here, up, now_s, role=orders.role, stop=stop, leader=leader)
            if orders.broadcasts:
                actions.append(self._broadcast(picture, picture.own, orders))
        if picture.own is not None and self.perception.take_odometry():
            self.localiser.note_odometry(self.perception.velocity_bias(ZERO), now_s)
            actions.append(SendOdometry(picture.own.vel_ned_mps))
        self.localiser.confirm_start(orders.leader, gathers=orders.gathers)
        self._says += self._accepted.texts(orders.state, started=self.swarm.operator.started)
        for said in (self._says, self.localiser.said):
            actions += said
            said.clear()
        actions += [*orders.reports, *orders.requests]
        if orders.steers:
            actions.append(self._compute_setpoint(picture, orders))
        else:
            self._command_zero_velocity()
        return actions

    def observe(self, now_s: float) -> Picture:
        """Bring all that is known up to now."""
        flight, localiser = self.flight, self.localiser
        vehicle, reported = flight.vehicle, flight.vehicle.position
        if reported is not None:
            pos_ned_m, swarm = reported.pos_ned_m, self.swarm
            localiser.update_landed_state(vehicle.landed, waits=flight.state in NOT_YET_FLYING)
            range_m = swarm.radio_range_m(airborne=vehicle.airborne, misses=localiser.misses)
            localiser.update_peers(pos_ned_m, now_s, range_m=range_m, launched=swarm.launched)
            if flight.state is FlightState.SEEKING:  # only then do they bar the way to the others
                localiser.clear_ghosts(self.perception, pos_ned_m, now_s)
        localiser.update_position_quality(now_s, role=self.swarm.election.role)
        return Picture(
            now_s=now_s,
            own=None if reported is None else self.own_position.find_motion(reported),
            state=flight.state,
            airborne=vehicle.airborne,
            can_lead=flight.can_lead,
            settled=flight.settled,
            listens_s=flight.listens_s(now_s),
            battery_percent=vehicle.battery_percent,
            lacks=[
                *vehicle.findings(now_s, gnss_lost_s=localiser.gnss_lost_s(now_s)),
                *self.own_position.findings(now_s, airborne=vehicle.airborne, began_aloft=vehicle.began_aloft),
            ],
            neighbours=localiser.neighbours,
            silent=localiser.silent,
            misses=localiser.misses,
            hovering=find_hovering(localiser.silent, localiser.neighbours),
            contacts=localiser.peers.contacts(),
            to_d2_mps=localiser.destination.closing_mps(self.movement.ref_ned_mps),
            dest_ned_m=localiser.destination.ned_m,
            is_localised=localiser.is_initialised,
            not_localised=localiser.missing(now_s),
            reception=localiser.reception,
            may_lose_position=localiser.may_lose_position,
            is_position_lost=localiser.is_position_lost,
            offset_ned_m=localiser.offset_ned_m,
            uncertain_peer=localiser.uncertain_peer,
            is_start_uncertain=localiser.is_start_uncertain,
            unconfirmed_peers=localiser.unconfirmed_peers,
        )

    def decide(self, picture: Picture) -> Orders:
        """The swarm's part, then the own flight's."""
        swarm, flight, now_s = self.swarm, self.flight, picture.now_s
        swarm.update_picture(picture)
        due, early = self._ticks % self._ticks_per_beacon == 0, False
        self._ticks += 1
        if due:
            if swarm.run_period(picture, resigns=failsafe_engine.resigns(picture.lacks)) and not self.rise.is_away:
                swarm.decide_phase(picture, self._to_goal_m(picture))
        elif swarm.election.changed and not self._sent_early:
            swarm.find_route(picture)
            early = True  # one more beacon a period at most: so news of a leader does not wait at every hop
        self._sent_early = early or (self._sent_early and not due)
        lease, phase, lands = swarm.election.lease, swarm.phases.phase, swarm.lands(now_s)
        leader = lease.leader if lease is not None and lease.established else 0
        gathers = phase is SwarmPhase.GATHER and not swarm.phases.overdue(now_s)
        uncertain = picture.find_uncertain_peer(self.id, leader, gathers=gathers)
        findings = [*picture.lacks, *failsafe_engine.detect(Source.LOCALISATION, Readings(unsure_of=uncertain))]
        neighbours, silent, own = picture.neighbours, picture.silent, picture.own
        has_room = lands and self._landing_room.is_clear(neighbours, silent, self.perception.nearest_m(own), now_s)
        findings += swarm.findings(picture, clear_below=has_room)
        up = own if picture.airborne else None
        room = flight.state is not FlightState.TAKING_OFF or self._climb_room.is_clear(neighbours, silent, up, now_s)
        joins, allowed, why = swarm.may_join(), swarm.operator.may_take_off, picture.not_localised
        requests = flight.update_flight(
            phase, now_s, findings=findings, may_join=joins, may_take_off=allowed, climb_room=room, not_localised=why
        )
        return Orders(
            leader=leader,
            role=swarm.election.role,
            phase=SwarmPhase.LAND if lands else phase,
            gathers=gathers,
            stop=swarm.phases.stop,
            route=swarm.route,
            range_m=swarm.formation_range_m,
            radio_range_m=swarm.radio_range_m(airborne=picture.airborne, misses=picture.misses),
            governor=swarm.governor,
            lease_freshness=swarm.lease_freshness(),
            goal=swarm.goal() if swarm.election.role is Role.LEADER else None,
            size=swarm.roster.flown.bit_count(),
            layer_m=swarm.update_layer(picture, lease),
            state=flight.state,
            cause=flight.cause,
            steers=flight.steers,
            rests=failsafe_engine.rests(picture.lacks),
            broadcasts=due or early,
            lease=swarm.election.early if early else lease,
            reports=swarm.take_reports(),
            requests=requests,
        )

    def guide(self, brief: GuidanceInput) -> Desired:
        """The velocity and heading that the mission wishes for. `brief`: surroundings and orders."""
        return self.movement.guide(brief, dt_s=TICK_S)

    def filter(self, around: Surroundings, desired: Desired) -> Setpoint:
        """The setpoint that the safety filter makes of what is desired."""
        return self.safety_filter.apply(desired.vel_ned_mps, around, dt_s=TICK_S)

    def status(self, now_s: float) -> Status:
        """The state of this agent, as of its last tick."""
        vehicle, swarm, lease = self.flight.vehicle, self.swarm, self.swarm.election.lease
        return Status(
            id=self.id,
            state=self.flight.state,
            cause=self.flight.cause,
            phase=swarm.phases.phase,
            waits_for=self.flight.waits_for,
            grounded=self.flight.grounded,
            lease=lease,
            leader=lease.leader if lease is not None and lease.established else 0,
            role=swarm.election.role,
            hop=swarm.election.hop,
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
            motion_seen=self.perception.sees_motion,
            battery_percent=vehicle.battery_percent,
            dest_ned_m=self.localiser.destination.ned_m,
            setpoint_ned_mps=self.setpoint.vel_ned_mps,
        )

    def _obey(self, event: OperatorOrder) -> None:
        self._says += self.swarm.operator.obey(event.order)
        if event.order is Order.START and self.flight.grounded:
            self._says.append(Say(Severity.ERROR, brief(f"grounded, {self.flight.grounded}")))
        if event.order is Order.START and event.hands_back:
            self._says += answer_hand_back(self.flight.state, airborne=self.flight.vehicle.airborne)
            self.flight.hand_back()

    def _recover_from_stall(self, now_s: float) -> None:
        """After a stall: what is known is old, and the autopilot has acted by itself."""
        self.flight.stall()
        self.localiser.handle_stall(now_s)
        self.swarm.forget_leader()
        self._command_zero_velocity()

    def _command_zero_velocity(self) -> None:
        """Not steered: what was desired and commanded before does not count."""
        self.movement.reset()
        self.disturbances.reset()
        self.setpoint = AT_REST

    def _broadcast(self, picture: Picture, own: Position, orders: Orders) -> SendBeacon:
        beacon = self.swarm.make_beacon(
            orders.lease,
            time_s=picture.now_s,
            vel_ned_mps=own.vel_ned_mps,
            ref_ned_mps=self.movement.ref_ned_mps,
            dest_ned_m=self.localiser.destination.ned_m,
            state=picture.state,
            airborne=picture.airborne,
            range_m=orders.radio_range_m,
            sighting=self.localiser.select_report(own.pos_ned_m, picture.now_s),
            echo=self.localiser.ages.make_echo(picture.now_s),
            position_error_m=self.own_position.error_m(picture.now_s) if picture.airborne else 0.0,
        )
        leader, role = orders.leader, orders.role
        sent = self.localiser.make_broadcast(beacon, own.pos_ned_m, picture.now_s, leader=leader, role=role)
        return self.own_position.correct_broadcast(sent)

    def _compute_setpoint(self, picture: Picture, orders: Orders) -> VelocitySetpoint:
        if orders.state is FlightState.TAKING_OFF:  # on the ground nothing may move it
            return VelocitySetpoint(ZERO, self.movement.yaw_rad)
        if orders.rests:
            self._command_zero_velocity()  # from an old position, or blind, nothing can be kept clear of: brake
            own = picture.own if failsafe_engine.knows_position(picture.lacks) else None
            bias = self.own_position.rest_bias_ned_mps  # not by scans, which are late, or none
            return VelocitySetpoint(self._rest.hold(own, bias, picture.now_s), self.movement.yaw_rad)
        around = self._observe_surroundings(picture)
        desired = self.rise.steer_rise(self.guide(self._brief(picture, orders, around)))
        self.setpoint = self.filter(around, desired)
        return VelocitySetpoint(self.setpoint.vel_ned_mps, desired.yaw_rad)

    def _observe_surroundings(self, picture: Picture) -> Surroundings:
        """The surroundings of a vehicle that is steered: once a tick, as wind is estimated from one to the next."""
        vehicle, now_s, last = self.flight.vehicle, picture.now_s, self.setpoint.vel_ned_mps
        assert vehicle.position is not None
        own, bias = self.own_position.find_motion(vehicle.position), self.own_position.setpoint_bias_ned_mps
        disturbance = self.disturbances.observe_disturbance(own, add(last, bias), TICK_S, vehicle.shaping)
        others, off_ned_m = self.rise.bring_beside(picture), self.localiser.offset_ned_m
        seen = self.perception.find_vehicles(own.pos_ned_m, picture.neighbours, now_s)
        return Surroundings(
            own,
            *others,
            self.perception.observe_obstacles(own.pos_ned_m, add(own.pos_ned_m, off_ned_m), others[1], now_s, seen),
            seen=seen,
            off_ned_m=off_ned_m,
            bias_ned_mps=bias,
            disturbance=disturbance,
            commanded_ned_mps=last,
            relayed=self.localiser.relayed,
            free_up_m=self.rise.free_up_m,
            error_m=self.own_position.error_m(now_s),
        )

    def _brief(self, picture: Picture, orders: Orders, around: Surroundings) -> GuidanceInput:
        """The input of guidance: surroundings, orders, and the vector to d2."""
        localiser, goal, range_m = self.localiser, orders.goal, orders.radio_range_m
        pos_ned_m, now_s = around.own.pos_ned_m, picture.now_s
        return GuidanceInput(
            around,
            state=orders.state,
            phase=orders.phase,
            route=orders.route,
            range_m=orders.range_m,
            role=orders.role,
            governor=orders.governor,
            lease_freshness=orders.lease_freshness,
            goal=None if goal is None else goal.resolve(localiser.offset_ned_m),
            goal_moves=localiser.may_lose_position or self._visits > 1,
            dest_ned_m=None if orders.stop < self._lane_ends else localiser.destination.ned_m,
            size=orders.size,
            layer_m=orders.layer_m,
            corridors=self.movement.predict_corridors(localiser.peers, pos_ned_m, now_s, range_m=range_m),
            excitation_ned_mps=localiser.excite(orders.state, orders.cause, now_s),
        )

    def _to_goal_m(self, picture: Picture) -> float:
        """A leader's: how far it has to go in this phase."""
        own, goal = picture.own, self.swarm.own_goal()
        if own is None or goal is None:
            return 0.0
        if (left_m := self.swarm.trail_left_m(own.pos_ned_m)) is not None:
            return left_m
        return self.movement.to_goal_m(own.pos_ned_m, goal.resolve(picture.offset_ned_m), picture.hovering)
