"""N airframes with their autopilots, and the radio between them. Deterministic: it moves only in `step`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from mission.common.frames import LocalFrame, Vec3, enu_to_ned
from mission.document.model import Mission, Origin, Personality, Placement, Sky
from mission.schema.fault_kinds import FORMS, Needs
from mission.schema.kinds import FaultKind
from mission.stand.stand import Stand, stand_of
from sim_bridge.world.airframe.base import Airframe, AirframeFactory
from sim_bridge.world.airframe.fragile import Fragile
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import CANOPY_PARAMETERS, CAPACITY, Autopilot, Link, StreamProfile, make_autopilot
from sim_bridge.world.autopilot.estimates.aiding import Aided
from sim_bridge.world.autopilot.estimates.errors import errors_of
from sim_bridge.world.autopilot.estimates.estimator import estimated
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from sim_bridge.world.autopilot.estimates.odometry import Odometer
from sim_bridge.world.autopilot.estimates.position_faults import STRIKES_POSITION, FaultyPosition
from sim_bridge.world.autopilot.personality import RANGE_FINDER_PARAMETERS, odometry_parameters
from sim_bridge.world.contacts import Collisions, Contacts, Touched
from sim_bridge.world.radio import radio_of
from sim_bridge.world.sensors.satellites import Crowns, Receiver
from sim_bridge.world.sensors.simulated import SimulatedSensor
from sim_bridge.world.sensors.table import simulated_sensors

# PX4's simulators start over Zurich Irchel; a mission without [origin] is flown there.
DEFAULT_ORIGIN = Origin(lat_deg=47.397742, lon_deg=8.545594, alt_m=488.0)
TICK_S: Final = 0.05  # one tick of the agents
OPEN_FIELD: Final = Stand()


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One UAV of the world."""

    id: int
    airframe: Airframe  # the truth
    believed: Airframe  # the same, as the autopilot sees it and flies it
    autopilot: Autopilot
    receiver: Receiver | None = None  # of satellites, where it has odometry besides
    gnss: FaultyGnss | None = None  # where it has not, and a fault strikes it
    position: FaultyPosition | None = None  # where a fault strikes what it makes of all its sensors
    odometry: Odometer | Aided | None = None  # where it has any


class World:
    """`vehicles` by id 1..n in their `stand`, `radio`, and simulated time. `touched`: what each has run into, by id.

    A vehicle that touches another, a trunk, a crown, or with a sensor the ground where it does not land, has its
    propellers broken: it falls where it is and stays there.
    """

    def __init__(
        self,
        mission: Mission,
        airframe: AirframeFactory,
        *,
        links: Mapping[Link, StreamProfile],
        parameters: Mapping[Personality, Mapping[str, float]] = CANOPY_PARAMETERS,
        stand: Stand | None = None,
    ) -> None:
        """`stand`: the mission's, where it has been made already. ValueError when the mission has no origin."""
        if mission.origin is None:
            raise ValueError("the mission has no [origin]")
        self.mission = mission
        self.frame = LocalFrame(mission.origin.wgs84)
        sim = mission.sim
        self.stand = stand = stand_of(mission) if stand is None else stand
        self.touched: dict[int, Touched] = {}
        self.still_air = False  # no wind moves point masses
        self._motor_failed: set[int] = set()
        senses = mission.sensing is not None
        reach_m = mission.vehicle_radius_m
        self._contacts = Contacts(stand, reach_m=reach_m, ground=senses) if senses or stand.has_obstacles else None
        self._collisions = Collisions(reach_m) if mission.swarm.size > 1 else None
        crowns = Crowns(stand) if sim.satellites.crowns is Sky.SHADE else None
        gnss_fails = any(FORMS[fault.kind].needs is Needs.SATELLITES for fault in sim.faults)
        if crowns is None and gnss_fails and mission.flies_by_ranges:
            crowns = Crowns(OPEN_FIELD)
        lies = any(fault.kind in STRIKES_POSITION for fault in sim.faults)
        motor_fails = any(fault.kind is FaultKind.MOTOR for fault in sim.faults)
        starts_ned_m = spawn_points(mission, np.random.default_rng([sim.seed, 0x5BA3]), stand)
        self.vehicles: dict[int, Vehicle] = {}
        for vehicle_id, pos_ned_m in enumerate(starts_ned_m, start=1):
            body = airframe(self.frame, pos_ned_m, sim.seed * 1000 + vehicle_id)
            self.still_air = isinstance(body, PointMass)
            if self._contacts is not None or self._collisions is not None or motor_fails:
                body = Fragile(body, stand.ground_up_m)
            personality = sim.personality_of(vehicle_id)
            presets = dict(parameters.get(personality, {}))
            if vehicle_id in sim.battery_mah:
                presets[CAPACITY[personality]] = sim.battery_mah[vehicle_id]
            if sim.range_finder:
                presets |= RANGE_FINDER_PARAMETERS[personality]
            receiver: Receiver | None = None
            shaded: Aided | None = None
            gnss: FaultyGnss | None = None
            position: FaultyPosition | None = None
            odometry: Odometer | Aided | None = None
            blind = not mission.has_satellites(vehicle_id)
            if blind:
                odometry = Odometer(body, sim.odometry, seed=sim.seed, vehicle_id=vehicle_id)
                believed: Airframe = odometry
                presets |= odometry_parameters(personality, mission.route.d1_enu_m[2])
            elif crowns is not None:
                receiver = Receiver(crowns, sim.satellites.crown_db_per_m, seed=sim.seed, vehicle_id=vehicle_id)
                believed = shaded = odometry = Aided(body, receiver, sim.odometry, seed=sim.seed, vehicle_id=vehicle_id)
            else:
                believed = estimated(body, errors_of(sim, vehicle_id), sim.seed, vehicle_id)
                if lies:
                    believed = position = FaultyPosition(believed)
                if gnss_fails:
                    believed = gnss = FaultyGnss(believed, seed=sim.seed, vehicle_id=vehicle_id, body=body)
            if lies and position is None:
                believed = position = FaultyPosition(believed)
            autopilot = make_autopilot(
                personality,
                vehicle_id,
                believed,
                self.frame,
                parameters=presets,
                links=links,
                satellites=not blind,
                shaded=shaded,
            )
            self.vehicles[vehicle_id] = Vehicle(
                vehicle_id, body, believed, autopilot, receiver, gnss, position, odometry
            )
        self.radio = radio_of(mission, stand)
        self.sensors = simulated_sensors(mission, stand, list(self.vehicles))
        self._sensed: dict[int, Vec3] = {}  # where the vehicles were at the last step that was sensed
        self._sensed_us = -1
        self._slopes = stand.grade != (0.0, 0.0)
        self._steps_us = 0

    @property
    def now_s(self) -> float:
        """Simulated time since all vehicles were switched on."""
        return self._steps_us / 1e6

    def set_winds(self, winds_enu_mps: Mapping[int, Vec3]) -> None:
        """Sets the wind about each vehicle, by id; about the others as the mission says."""
        for vehicle_id, vehicle in self.vehicles.items():
            vehicle.airframe.set_wind(enu_to_ned(winds_enu_mps.get(vehicle_id, self.mission.sim.wind_mps)))

    def positions(self) -> dict[int, Vec3]:
        """Positions of the vehicles: NED metres about the origin, by id."""
        return {v.id: v.airframe.state.pos_ned_m for v in self.vehicles.values()}

    def step(self, dt_s: float) -> None:
        """Advance everything by `dt_s`, vehicle by vehicle: JSBSim runs best with many steps of one at a time."""
        for vehicle_id in self.vehicles:
            self.step_vehicle(vehicle_id, dt_s)
        self.advance_clock(dt_s)

    def step_vehicle(self, vehicle_id: int, dt_s: float) -> None:
        """One vehicle's part of a step. Who touches whom is looked at afterwards: the order does not matter."""
        vehicle = self.vehicles[vehicle_id]
        vehicle.autopilot.update(self.now_s)
        if self._slopes:
            north_m, east_m, _ = vehicle.airframe.state.pos_ned_m
            vehicle.airframe.set_ground(-self.stand.ground_up_m(east_m, north_m))
        vehicle.believed.step(dt_s)
        self.check_contact(vehicle_id)

    def fail_motor(self, vehicle_id: int) -> None:
        """One motor of this vehicle fails: it tips over and falls. What it then meets of the stand is no contact."""
        body = self.vehicles[vehicle_id].airframe
        assert isinstance(body, Fragile)
        self._motor_failed.add(vehicle_id)
        body.fall()

    def check_contact(self, vehicle_id: int) -> None:
        """A vehicle that has touched something of the stand since the last look falls."""
        if self._contacts is None or vehicle_id in self.touched or vehicle_id in self._motor_failed:
            return
        body = self.vehicles[vehicle_id].airframe
        state = body.state
        touched = self._contacts.find_contact(
            vehicle_id,
            state.pos_ned_m,
            state.vel_ned_mps,
            on_ground=state.on_ground,
            hit_ned_mps=state.hit_ned_mps,
        )
        if touched is not None:
            self._fell(vehicle_id, touched)

    def _fell(self, vehicle_id: int, touched: Touched) -> None:
        body = self.vehicles[vehicle_id].airframe
        assert isinstance(body, Fragile)
        self.touched[vehicle_id] = touched
        body.fall()

    def check_collisions(self) -> None:
        """Vehicles that have touched one another since the last look fall; those on the ground stand fast."""
        if self._collisions is None:
            return
        flying = {k: v.airframe.state.pos_ned_m for k, v in self.vehicles.items() if not self._lies(k, v)}
        for vehicle_id in self._collisions.find_touching(flying):
            self._fell(vehicle_id, Touched.VEHICLE)

    def _lies(self, vehicle_id: int, vehicle: Vehicle) -> bool:
        return vehicle_id in self.touched or vehicle.airframe.state.on_ground

    def sense(self, vehicle_id: int) -> list[tuple[SimulatedSensor, bytes]]:
        """Frames that the drivers of this vehicle's sensors send now. To be called at every step, for all vehicles."""
        if not self.sensors:
            return []
        if self._sensed_us != self._steps_us:
            self._sensed_us, self._sensed = self._steps_us, self.positions()
        state, positions_ned_m = self.vehicles[vehicle_id].airframe.state, self._sensed
        found: list[tuple[SimulatedSensor, bytes]] = []
        for sensor in self.sensors:
            data = sensor.frames(vehicle_id, state, positions_ned_m, self.now_s)
            if data:
                found.append((sensor, data))
        return found

    def advance_clock(self, dt_s: float) -> None:
        """Ends a step of which each vehicle has made its part."""
        self.check_collisions()
        self._steps_us += round(dt_s * 1e6)


def spawn_points(mission: Mission, rng: np.random.Generator, stand: Stand = OPEN_FIELD) -> list[Vec3]:
    """Places on the ground about d1 (NED m), at least `placement_spacing_m` apart, as `[sim] placement` says.

    A swarm that flies by ranges starts where its mission says, but for `sim.ranging.start_error_m`.
    """
    n, spacing_m = mission.swarm.size, mission.sim.placement_spacing_m
    if mission.flies_by_ranges and mission.ranging is not None:
        off = rng.normal(0.0, mission.sim.ranging.start_error_m, (n, 2)).tolist()
        starts = [(x + dx, y + dy) for (x, y, _), (dx, dy) in zip(mission.ranging.start_enu_m, off, strict=False)]
        return [enu_to_ned((x, y, stand.ground_up_m(x, y))) for x, y in starts]
    match mission.sim.placement:
        case Placement.GRID:
            side = math.ceil(math.sqrt(n))
            offsets = [
                ((k % side - (side - 1) / 2) * spacing_m, (k // side - (side - 1) / 2) * spacing_m) for k in range(n)
            ]
        case Placement.RING:
            radius_m = 0.0 if n == 1 else spacing_m / (2.0 * math.sin(math.pi / n))
            turns = [math.tau * k / n for k in range(n)]
            offsets = [(radius_m * math.sin(turn), radius_m * math.cos(turn)) for turn in turns]
        case Placement.RANDOM:
            offsets = _blue_noise(n, spacing_m, mission.placement_radius_m, mission.start_link_m, rng)
    east_m, north_m, _ = mission.route.d1_enu_m
    level_enu_m = [(east_m + x, north_m + y) for x, y in offsets]
    return [enu_to_ned((x, y, stand.ground_up_m(x, y))) for x, y in level_enu_m]


def _blue_noise(
    n: int, spacing_m: float, radius_m: float, link_m: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """`n` random points of a disc, at least `spacing_m` apart, all joined by links of at most `link_m`."""
    points: list[tuple[float, float]] = []
    while len(points) < n or not _joined(points, link_m):
        # The disc is sparse enough to hold n, and link_m is long enough to join nearly all draws (see
        # mission.rules.flight_rules), but an unlucky start can jam or fall apart: begin again.
        points = []
        for _ in range(200 * n):
            turn, reach_m = math.tau * rng.random(), radius_m * math.sqrt(rng.random())
            point = (reach_m * math.cos(turn), reach_m * math.sin(turn))
            if all(math.dist(point, other) >= spacing_m for other in points):
                points.append(point)
            if len(points) == n:
                break
    return points


def _joined(points: list[tuple[float, float]], link_m: float) -> bool:
    """True if one can go from any of the points to any other in steps of at most `link_m`."""
    reached, rest = points[:1], points[1:]
    for here in reached:
        near = [point for point in rest if math.dist(here, point) <= link_m]
        reached += near
        rest = [point for point in rest if point not in near]
    return not rest
