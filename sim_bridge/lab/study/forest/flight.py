"""One flight of n point masses through one forest, from the ground at d1 until all are gathered at d2.

Every vehicle is an agent of the flight software (`crew`) at 20 Hz. Each seed has its own stand, starts, losses and
noises; lidars, trunks in the air and what touches a tree are the world's own. Bodies are `airframe.PointMass`'s:
velocity lag 0.3 s, at most 3 m/s^2; they lean as it takes to accelerate, which tilts their scans. Gusts are what an
autopilot does not hold against: a velocity that is added, an Ornstein-Uhlenbeck process. A trunk, a crown or the ground
that a vehicle touches costs the vehicle.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel

from companion.core.agent import TICK_S
from companion.core.model.events import ObstacleScan
from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.swarm.phases import GATHER_LIMIT_S
from mission.common.forming import GAP_WINDOW_S
from mission.common.frames import Vec3, enu_to_ned, ned_to_enu
from mission.document.model import CoverageShape, Estimates, Forest, Gnss, Mission, SatelliteErrors
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.metrics import ideal_among_trees_deg, ring_gap_deg
from sim_bridge.lab.study.forest.air import MODELS, Air, trunks_between
from sim_bridge.lab.study.forest.crew import Crew, Stage
from sim_bridge.lab.study.forest.figures import Figures, FlightRecorder
from sim_bridge.lab.study.law import Floats, law_module
from sim_bridge.lab.study.point_mass import ACCELERATION_MAX_MPS2, LAG_S
from sim_bridge.world.airframe.point_mass import GRAVITY_MPS2
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.estimates.errors import VERTICAL_SHARE
from sim_bridge.world.autopilot.estimates.noise import POSITION_MEMORY_S, VELOCITY_MEMORY_S
from sim_bridge.world.contacts import Contacts, Touched
from sim_bridge.world.sensors.lidar import Lidar
from sim_bridge.world.sensors.scan import STEP_RAD
from sim_bridge.world.sensors.scene import Scene
from sim_bridge.world.world import spawn_points

GUST_MEMORY_S = 1.0  # of what is left of a gust when the autopilot has leaned into it
YAW_RATE_MAX_RADPS = 1.0  # as airframe.PointMass
DEPART_LIMIT_S = 60.0 + GATHER_LIMIT_S
STRAIGHT_TIMES = 4.0  # a flight that takes longer than so many straight times has failed
SENSOR = 196  # MAV_COMP_ID_OBSTACLE_AVOIDANCE


class Flight:
    """`fly` it once."""

    def __init__(self, mission: Mission, stand: Stand, *, stages: Sequence[Stage] = (), gusts_mps: float = 0.0) -> None:
        """`gusts_mps`: rms on each level axis, half of it up. ValueError for a mission without [sensing]."""
        if mission.sensing is None:
            raise ValueError("the mission has no [sensing]")
        sim, sensing, n = mission.sim, mission.sensing, mission.swarm.size
        rngs = [np.random.default_rng([sim.seed, 0xF02E57, k]) for k in range(4)]
        self.mission, self.stand, self.ticks = mission, stand, 0
        self.trunks_enu_m = trunks_of(stand)
        self.crew = Crew(mission, stages)
        starts = spawn_points(mission, np.random.default_rng([sim.seed, 0x5BA3]), stand)
        self.pos_enu_m: Floats = np.array([ned_to_enu(pos_ned_m) for pos_ned_m in starts])
        self.vel_enu_mps = np.zeros((n, 3))  # of the body, without the gust
        self.yaw_rad = np.zeros(n)
        self._accel_enu_mps2 = np.zeros((n, 3))
        self._gust = Wander(rngs[0], gusts_mps, GUST_MEMORY_S, n)
        self._pos_error = Wander(rngs[1], sim.position_noise_m or 0.0, POSITION_MEMORY_S, n)
        self._vel_error = Wander(rngs[2], sim.velocity_noise_mps or 0.0, VELOCITY_MEMORY_S, n)
        scene = Scene(stand, sensing.range_m)
        self._lidars = [Lidar(scene, sensing, sim.lidar, seed=sim.seed, vehicle_id=k) for k in range(1, n + 1)]
        self._contacts = Contacts(stand, reach_m=mission.vehicle_radius_m, ground=False)
        delay_ticks = max(1, round(sim.radio_delay_s / TICK_S))
        self._air = Air(sim.radio_trunks, sim.radio_trunk_db, sim.radio_loss, delay_ticks, rngs[3])
        self.watch = FlightRecorder(mission, n, TICK_S)
        self._ticks_per_beacon = round(1.0 / (mission.radio.beacon_rate_hz * TICK_S))
        self._gaps_deg: list[float] = []

    def fly(self, alone_s: float) -> Figures:
        """To its end."""
        limit_s, covers_s = DEPART_LIMIT_S, self.mission.coverage.duration_s
        majority = self.mission.swarm.size // 2 + 1  # fewer do not fly on
        while self.ticks * TICK_S < limit_s and self.watch.alive.sum() >= majority:
            self.tick()
            watch, now_s = self.watch, self.ticks * TICK_S
            if watch.departed_s is not None:
                limit_s = watch.departed_s + STRAIGHT_TIMES * (watch.straight_s or 0.0) + covers_s
                if watch.last_s is not None and now_s >= watch.departed_s + watch.last_s + covers_s:
                    break
        gap = None
        if self._gaps_deg:
            window = round(GAP_WINDOW_S / (self._ticks_per_beacon * TICK_S))
            gap = float(np.mean(self._gaps_deg[-window:]))
        alive = int(self.watch.alive.sum())
        ideal = ideal_among_trees_deg(self.mission, self.stand, alive) if gap is not None and alive else None
        return self.watch.figures(alone_s, self.ticks * TICK_S, (gap, ideal))

    def tick(self) -> None:
        """TICK_S."""
        now_s = self.ticks * TICK_S
        reported_m, reported_mps = self.pos_enu_m + self._pos_error.now, self._true_mps() + self._vel_error.now
        for sent in self._air.deliver(self.ticks):
            self.crew.receive_beacon(sent, reported_m, now_s)
        self._sense(now_s)
        alive: list[bool] = self.watch.alive.tolist()
        command, yaw, messages = self.crew.tick(reported_m, reported_mps, alive, now_s)
        distance_m = self._distances()
        looks = self.ticks % self._ticks_per_beacon == 0
        if messages or looks:
            trunks = trunks_between(self.pos_enu_m, self.trunks_enu_m)
            if messages:
                self._air.send(messages, distance_m, trunks, self.crew.range_m, self.ticks)
            if looks:
                self._watch_progress(distance_m, trunks, now_s)
        self._move(command, yaw)
        self._touch()
        self.ticks += 1

    # --- inside ---

    def _ground_m(self) -> Floats:
        """(n,) height of the ground below each."""
        east, north = self.stand.grade
        return np.asarray(east * self.pos_enu_m[:, 0] + north * self.pos_enu_m[:, 1])

    def _true_mps(self) -> Floats:
        """(n, 3) over ground, where no gust moves them that stand on it."""
        in_air = self.pos_enu_m[:, 2] > self._ground_m()
        return self.vel_enu_mps + np.where(in_air[:, None], self._gust.now, 0.0)

    def _sense(self, now_s: float) -> None:
        """Every lidar is asked, and its scan is handed over."""
        alive: list[bool] = self.watch.alive.tolist()
        positions_ned_m: list[Vec3] = [enu_to_ned((east, north, up)) for east, north, up in self.pos_enu_m.tolist()]
        for row, lidar in enumerate(self._lidars):
            if alive[row]:
                attitude_rad = lean(self._accel_enu_mps2[row].tolist(), float(self.yaw_rad[row]))
                state = AirframeState(positions_ned_m[row], ZERO, attitude_rad, ZERO, False, 0.0)
                scan = lidar.scan(state, positions_ned_m[:row] + positions_ned_m[row + 1 :], now_s)
                if scan is not None:
                    age_s = now_s - scan.taken_s
                    least_m, most_m = scan.range_min_m, scan.range_max_m
                    reading = ObstacleScan(SENSOR, scan.ranges_m, 0.0, STEP_RAD, least_m, most_m, *attitude_rad, age_s)
                    self.crew.receive_scan(row, reading, now_s)

    def _watch_progress(self, distance_m: Floats, trunks: Floats, now_s: float) -> None:
        crew, watch = self.crew, self.watch
        departed = crew.phase >= SwarmPhase.TRANSIT
        watch.record_leader(crew.leader, crew.acting, departed=departed, pos_enu_m=self.pos_enu_m, now_s=now_s)
        links = {model: self._air.links(model, distance_m, trunks, crew.range_m) for model in MODELS}
        watch.record_links(links, self.pos_enu_m, self._ticks_per_beacon * TICK_S, now_s)
        covers = watch.leader_s is not None and crew.phase is SwarmPhase.COVERAGE
        if covers and self.mission.coverage.shape is CoverageShape.RING:
            from_d2_m = (self.pos_enu_m - np.array(self.mission.route.d2_enu_m))[watch.alive]
            self._gaps_deg.append(ring_gap_deg(from_d2_m))

    def _move(self, command: Floats, yaw: Floats) -> None:
        alive = self.watch.alive[:, None]
        fraction = -math.expm1(-TICK_S / LAG_S)
        change = np.where(alive, fraction * (command - self._vel_error.now - self.vel_enu_mps), 0.0)
        size = np.sqrt((change * change).sum(axis=1, keepdims=True))
        most_mps = ACCELERATION_MAX_MPS2 * TICK_S
        change = change * (most_mps / np.maximum(size, most_mps))
        before = self._true_mps()
        self.vel_enu_mps = np.where(alive, self.vel_enu_mps + change, 0.0)
        self._gust.advance_time(TICK_S)
        after = self._true_mps()
        step_m = 0.5 * (before + after) * TICK_S
        self.pos_enu_m = np.where(alive, self.pos_enu_m + step_m, self.pos_enu_m)
        self.pos_enu_m[:, 2] = np.maximum(self.pos_enu_m[:, 2], self._ground_m())
        self._accel_enu_mps2 = change / TICK_S
        turn = np.remainder(yaw - self.yaw_rad + math.pi, math.tau) - math.pi
        self.yaw_rad = self.yaw_rad + np.clip(turn, -YAW_RATE_MAX_RADPS * TICK_S, YAW_RATE_MAX_RADPS * TICK_S)
        self._pos_error.advance_time(TICK_S)
        self._vel_error.advance_time(TICK_S)
        self.watch.record_motion(after, np.sqrt((change * change).sum(axis=1)))

    def _touch(self) -> None:
        up_m = self.pos_enu_m[:, 2]
        touched: dict[int, Touched] = {}
        steered = self.crew.steered
        for row in np.flatnonzero(self.watch.alive & steered).tolist():
            pos_ned_m = enu_to_ned(tuple(self.pos_enu_m[row].tolist()))
            found = self._contacts.find_contact(row, pos_ned_m, ZERO, on_ground=False)
            if up_m[row] <= self._ground_m()[row]:
                found = Touched.GROUND
            if found is not None:
                touched[row] = found
        trunks = self.trunks_enu_m
        off = self.pos_enu_m[:, None, :2] - trunks[:, :2]
        clear_m = np.sqrt((off * off).sum(axis=2)) - trunks[:, 2]
        clear_m = np.where(up_m[:, None] < trunks[:, 3], clear_m, np.inf)
        self.watch.record_contacts(touched, clear_m.min(axis=1, initial=np.inf), self._distances(), steered)

    def _distances(self) -> Floats:
        """(n, n), inf on the diagonal."""
        rel = self.pos_enu_m[None] - self.pos_enu_m[:, None]
        distance_m: Floats = np.sqrt((rel * rel).sum(axis=2))
        np.fill_diagonal(distance_m, np.inf)
        return distance_m


class Wander:
    """An Ornstein-Uhlenbeck process for each vehicle and axis, as `autopilot.estimator` has it; `now`: (n, 3)."""

    def __init__(self, rng: np.random.Generator, sd: float, memory_s: float, n: int) -> None:
        self._rng, self._memory_s = rng, memory_s
        self._sd = sd * np.array((1.0, 1.0, VERTICAL_SHARE))
        self.now: Floats = rng.standard_normal((n, 3)) * self._sd

    def advance_time(self, dt_s: float) -> None:
        """`dt_s` on."""
        kept = math.exp(-dt_s / self._memory_s)
        drawn = self._rng.standard_normal(self.now.shape)
        self.now = kept * self.now + drawn * (self._sd * math.sqrt(1.0 - kept * kept))


def trunks_of(stand: Stand) -> Floats:
    """(k, 4) east, north, radius, top."""
    trees = [
        (t.east_m, t.north_m, t.radius_m, stand.ground_up_m(t.east_m, t.north_m) + t.height_m) for t in stand.trees
    ]
    return np.array(trees).reshape(-1, 4)


def lean(accel_enu_mps2: Sequence[float], yaw_rad: float) -> Vec3:
    """Roll, pitch and yaw (rad) of a multicopter that accelerates so: its thrust points along what it needs."""
    east, north, up = accel_enu_mps2
    ahead = north * math.cos(yaw_rad) + east * math.sin(yaw_rad)
    right = east * math.cos(yaw_rad) - north * math.sin(yaw_rad)
    lift = GRAVITY_MPS2 + up
    pitch = math.atan2(-ahead, lift)
    return math.atan2(right * math.cos(pitch), lift), pitch, yaw_rad


def fly(mission: Mission, law: str, params: BaseModel, gusts_mps: float = 0.0) -> Figures:
    """One flight through the stand of `mission`, by a law of `study.law.LAWS`."""
    flight = Flight(mission, stand_of(mission), stages=_stages(mission, law, params), gusts_mps=gusts_mps)
    return flight.fly(_alone_s(alone(mission).model_dump_json(by_alias=True), law, params))


def _stages(mission: Mission, law: str, params: BaseModel) -> list[Stage]:
    module = law_module(law)
    if not hasattr(module, "stage"):
        return []
    return [module.stage(mission, params) for _ in range(mission.swarm.size)]


@functools.lru_cache(maxsize=64)
def _alone_s(mission_json: str, law: str, params: BaseModel) -> float:
    """T0 of the mission in this JSON."""
    mission = Mission.model_validate_json(mission_json)
    flight = Flight(mission, Stand(), stages=_stages(mission, law, params))
    flight.fly(math.nan)
    leader_s = flight.watch.leader_s
    assert leader_s is not None, "one alone arrives"
    return leader_s


def alone(mission: Mission) -> Mission:
    """One vehicle on the same route: no trees, nothing that goes wrong, satellites, and no others to range or name."""
    calm = {"wind_mps": (0.0, 0.0, 0.0), "turbulence_mps": 0.0, "radio_loss": 0.0, "faults": ()}
    exact = {
        "estimates": Estimates.EXACT,
        "position_noise_m": None,
        "velocity_noise_mps": None,
        "estimate_delay_s": 0.0,
    }
    clear = {"satellites": SatelliteErrors(), "velocity_bias_mps": None, "climb_bias_mps": None, "seed": 1}
    changed = {
        "sim": mission.sim.model_copy(update={**calm, **exact, **clear}),
        "swarm": mission.swarm.model_copy(update={"gnss": Gnss.ALL, "leader_priority": ()}),
        "coverage": mission.coverage.model_copy(update={"duration_s": 0.0}),
    }
    return mission.model_copy(update={**changed, "forest": Forest(), "ranging": None}).with_size(1)
