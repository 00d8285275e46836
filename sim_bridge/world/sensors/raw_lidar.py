"""Lidars that tell every ray, with noise and dropouts, and their driver: SWARM_LIDAR_SCAN, a turn in pieces."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, NOT_MEASURED_MM, NOTHING_MM, encode_lidar_scan
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission, Sensing
from mission.schema.kinds import RAW_LIDARS
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import EPSILON_S, MOUNTED_UP_M, RANGE_MIN_M, SALT, bodies
from sim_bridge.world.sensors.raw_scan import Floats, RayPattern, cast
from sim_bridge.world.sensors.scene import Scene
from sim_bridge.world.sensors.simulated import SimulatedSensor
from sim_bridge.world.sensors.stems.shapes import shapes_of
from sim_bridge.world.sensors.stems.stem_scan import take_stems

PIECE_RAYS: Final = 90
STILL = (0.0, 0.0)
Others = Sequence[tuple[Vec3, tuple[float, float]]]  # position NED m, velocity north and east, m/s


@dataclass(frozen=True, slots=True)
class RawScan:
    """One turn. `ranges_m`: (layers, rays around); inf: nothing there, nan: not measured."""

    taken_s: float  # its last ray
    turn: int
    ranges_m: Floats


class RawLidar:
    """One vehicle's. Its draws depend on `seed` and `vehicle_id` alone, as lidar.Lidar's; so do the times of turns."""

    def __init__(self, scene: Scene, sensing: Sensing, errors: LidarErrors, *, seed: int, vehicle_id: int) -> None:
        self._scene = scene
        self._spec = RAW_LIDARS[sensing.sensor]
        self._period_s = 1.0 / sensing.rate_hz
        self.pattern: Final = RayPattern(self._spec, self._period_s, upside_down=sensing.upside_down)
        self.max_m: Final = sensing.range_m
        self._body_m = sensing.vehicle_radius_m
        self._errors = errors
        self._usual_noise_m = self._spec.range_sd_m if errors.noise_m is None else errors.noise_m
        self._noise_m, self._delay_s = self._usual_noise_m, errors.delay_s
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._begin_s = self._next_s = self._period_s * (1.0 + self._rng.random())  # the first turn begins after 0
        self._turns = 0
        off_deg = np.remainder(self.pattern.bearings_deg + 180.0, 360.0) - 180.0
        self._blind: NDArray[np.bool_] = np.abs(off_deg) > sensing.field_of_view_deg / 2.0 + EPSILON_S
        self._under_way: deque[RawScan] = deque()

    def set_errors(self, noise_m: float, delay_s: float) -> None:
        """Sets by how much noisier and later scans are than usual."""
        self._noise_m = math.hypot(self._usual_noise_m, noise_m)
        self._delay_s = self._errors.delay_s + delay_s

    def scan(self, state: AirframeState, others: Others, now_s: float) -> RawScan | None:
        """The scan that is ready at `now_s`, or None. To be called at every step, in the order of time.

        A turn that ends between two steps is measured as if it ended at the later one.
        """
        if now_s >= self._next_s - EPSILON_S:
            while self._next_s <= now_s + EPSILON_S:  # after a pause the missed turns are missed
                self._turns += 1
                self._next_s = self._begin_s + self._turns * self._period_s
            self._under_way.append(RawScan(now_s, self._turns, self._spoilt(self.measure(state, others))))
        if self._under_way and self._under_way[0].taken_s + self._delay_s <= now_s + EPSILON_S:
            return self._under_way.popleft()
        return None

    def measure(self, state: AirframeState, others: Others) -> Floats:
        """Exact ranges of a turn that ends now: (layers, rays around), as `raw_scan.cast` has them."""
        north_m, east_m, down_m = state.pos_ned_m
        eye = (north_m, east_m, down_m - MOUNTED_UP_M)
        hulls = [
            (*cylinder, *vel_ne_mps)
            for pos_ned_m, vel_ne_mps in others
            for cylinder in bodies(eye, (pos_ned_m,), self._body_m, self.max_m)
        ]
        cylinders = self._scene.cylinders(eye)
        rays = self.pattern.rays(state, MOUNTED_UP_M)
        found = cast(
            rays,
            np.vstack([cylinders, hulls]) if hulls else cylinders,
            [(box, self._scene.top_up_m(box)) for box in self._scene.boxes_around(eye)],
            self._scene.ground(eye),
            max_m=self.max_m,
            beam_deg=self._spec.beam_deg,
        )
        trunks = self._scene.trunks(eye)
        if trunks is not None:
            take_stems(found, rays, trunks, max_m=self.max_m, beam_deg=self._spec.beam_deg)
        return found

    def _spoilt(self, seen_m: Floats) -> Floats:
        """As it is told: with noise, without the rays that were missed or are out of view."""
        noise_m = self._noise_m * self._rng.standard_normal(seen_m.shape)
        missed = self._rng.random(seen_m.shape) < self._errors.dropout
        told = np.where(np.isfinite(seen_m), np.clip(seen_m + noise_m, RANGE_MIN_M, self.max_m), seen_m)
        told[missed | self._blind] = math.nan
        return told


class RawDriver:
    """Driver of a lidar, which sends its turns in pieces: a MAVLink sender of its own."""

    def __init__(self, lidar: RawLidar, vehicle_id: int) -> None:
        self.lidar = lidar
        self._sender = wire.Sender(vehicle_id, dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE)

    def frames(self, state: AirframeState, others: Others, now_s: float, stamp_s: Callable[[float], float]) -> bytes:
        """As RawLidar.scan, as frames of SWARM_LIDAR_SCAN; empty when there is no scan to tell. `stamp_s`: `pieces`."""
        scan = self.lidar.scan(state, others, now_s)
        if scan is None:
            return b""
        return b"".join(self._sender.frame(LIDAR_SCAN_ID, payload) for payload in self.pieces(scan, stamp_s))

    def pieces(self, scan: RawScan, stamp_s: Callable[[float], float]) -> Iterator[bytes]:
        """Payloads of a turn, in the order of their times; those in which nothing was measured are not sent.

        `stamp_s`: simulated time -> by the driver's clock.
        """
        pattern, max_m = self.lidar.pattern, self.lidar.max_m
        mm = np.where(np.isinf(scan.ranges_m), NOTHING_MM, np.round(1000.0 * scan.ranges_m))
        told = np.where(np.isnan(mm), NOT_MEASURED_MM, mm).astype(int)
        for first in range(0, told.shape[1], PIECE_RAYS):
            time_us = round(stamp_s(scan.taken_s - pattern.ages_s[first]) * 1e6)
            for layer, elevation_deg in enumerate(pattern.elevations_deg):
                ranges_mm = told[layer, first : first + PIECE_RAYS]
                if ranges_mm.any():
                    yield encode_lidar_scan(
                        time_us=time_us,
                        ray_time_s=pattern.ray_time_s,
                        first_bearing_deg=pattern.bearings_deg[first],
                        bearing_step_deg=pattern.step_deg,
                        elevation_deg=elevation_deg,
                        min_m=RANGE_MIN_M,
                        max_m=max_m,
                        turn=scan.turn,
                        ranges_mm=ranges_mm.tolist(),
                    )


class RawLidars(SimulatedSensor):
    """Lidars of all vehicles in one scene. How fast each vehicle is, is known by where it was at the step before."""

    def __init__(self, drivers: Mapping[int, RawDriver]) -> None:
        super().__init__("lidar", is_optical=True)
        self._drivers = drivers
        self._placed_s = -math.inf
        self._placed: Mapping[int, Vec3] = {}
        self._vel_ne_mps: dict[int, tuple[float, float]] = {}

    def set_errors(self, errors: Mapping[int, tuple[float, ...]]) -> None:
        """Noise and delay."""
        for vehicle_id, driver in self._drivers.items():
            driver.lidar.set_errors(*errors.get(vehicle_id, (0.0, 0.0)))

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """SWARM_LIDAR_SCAN, or nothing."""
        self._place(positions_ned_m, now_s)
        others = [
            (pos_ned_m, self._vel_ne_mps.get(other, STILL))
            for other, pos_ned_m in positions_ned_m.items()
            if other != vehicle_id
        ]
        return self._drivers[vehicle_id].frames(state, others, now_s, self.stamp_s)

    def _place(self, positions_ned_m: Mapping[int, Vec3], now_s: float) -> None:
        gone_s = now_s - self._placed_s
        if gone_s <= EPSILON_S:
            return
        self._vel_ne_mps = {
            k: ((now[0] - self._placed[k][0]) / gone_s, (now[1] - self._placed[k][1]) / gone_s)
            for k, now in positions_ned_m.items()
            if k in self._placed
        }
        self._placed_s, self._placed = now_s, dict(positions_ned_m)


def raw_lidars_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> RawLidars | None:
    """In a mission with [sensing] whose sensor tells every ray."""
    sensing, sim = mission.sensing, mission.sim
    if sensing is None or sensing.sensor not in RAW_LIDARS:
        return None
    scene = Scene(stand, sensing.range_m, shapes_of(mission, stand))
    return RawLidars({k: RawDriver(RawLidar(scene, sensing, sim.lidar, seed=sim.seed, vehicle_id=k), k) for k in ids})
