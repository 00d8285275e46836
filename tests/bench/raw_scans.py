"""CPU time of a turn of each class of obstacle sensor: the simulator's cast and its messages, and the companion's part.

12 vehicles 8 m apart in a generated stand of 400 trees/ha, at 200 drawn places, flying at 3 m/s, leaning and turning.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeVar

from companion.core.model.events import LidarScan, ObstacleScan, Position
from companion.core.perception.obstacle_perception import SensingPerception
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from companion.sensors.table import sensors_of
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from mission.stand.stand import Stand, stand_of
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import Lidar
from sim_bridge.world.sensors.raw_lidar import RawLidar
from sim_bridge.world.sensors.scene import Scene
from sim_bridge.world.sensors.table import simulated_sensors
from tests.bench.table import Row

T = TypeVar("T")
DENSITY_PER_HA: Final = 400.0
PLACES: Final = 200
REPETITIONS: Final = 5
CAST_MAX_MS: Final = 2.0
RATE_HZ: Final = 10.0
SENSORS: Final = {
    SensorClass.SECTORS: 8.0,
    SensorClass.SCAN_1DEG: 12.0,
    SensorClass.SCAN_HALF_DEG: 20.0,
    SensorClass.MULTI_LAYER: 20.0,
}


def raw_scans() -> Iterator[Row]:
    """Each class, and how many times as much as sectors it costs the companion."""
    stand = stand_of(_mission(SensorClass.SECTORS))
    told_ms: dict[SensorClass, float] = {}
    for sensor, range_m in SENSORS.items():
        cast_ms, sent_ms, taken_ms, size = _measure(sensor, stand)
        told_ms[sensor] = taken_ms
        what = f"{sensor.value}, {range_m:g} m, {DENSITY_PER_HA:g} trees/ha: cast, a turn"
        yield Row(what, f"<= {CAST_MAX_MS:g} ms", f"{cast_ms:.2f} ms", cast_ms <= CAST_MAX_MS)
        yield Row("- cast and sent", "told", f"{sent_ms:.2f} ms, {size} bytes", True)
        ratio = taken_ms / told_ms[SensorClass.SECTORS]
        share = taken_ms * RATE_HZ / 10.0
        seen = f"{taken_ms:.2f} ms, {ratio:.1f} times sectors', {share:.1f} % of a core at {RATE_HZ:g} Hz"
        yield Row("- decoded and placed by a companion", "told", seen, True)


def _mission(sensor: SensorClass) -> Mission:
    route = {"d1_enu_m": (0.0, 0.0, 3.0), "d2_enu_m": (130.0, 0.0, 3.0), "vel_leader_mps": 3.0}
    sensing = {"sensor": sensor.value, "range_m": SENSORS[sensor]}
    forest = {"stand": {"density_per_ha": DENSITY_PER_HA}}
    return Mission.model_validate({"schema": 1, "route": route, "sensing": sensing, "forest": forest})


def _measure(sensor: SensorClass, stand: Stand) -> tuple[float, float, float, int]:
    """Median CPU times, ms: of a cast, of that and its messages, and of the companion; bytes of a turn."""
    mission = _mission(sensor)
    cast = _cast(mission, stand)
    (simulated,) = simulated_sensors(mission, stand, [1])
    rng = random.Random(1)
    turns: list[tuple[AirframeState, bytes]] = []
    cast_ms: list[float] = []
    sent_ms: list[float] = []
    now_s = 0.0
    for _ in range(PLACES):
        north_m, east_m = rng.uniform(-25.0, 25.0), rng.uniform(25.0, 105.0)
        state = AirframeState((north_m, east_m, -3.0), (2.8, 1.0, 0.1), (0.1, -0.1, 0.3), (0.1, 0.1, 0.5), False, 0.4)
        for _ in range(REPETITIONS):
            now_s += 1.0
            data, ms = _timed(partial(simulated.frames, 1, state, _swarm(state.pos_ned_m), now_s))
            sent_ms.append(ms)
            cast_ms.append(_timed(partial(cast, state, now_s))[1])
        turns.append((state, data))
    taken_ms = [_taken_ms(mission, state, data) for state, data in turns]
    medians = [statistics.median(found_ms) for found_ms in (cast_ms, sent_ms, taken_ms)]
    return medians[0], medians[1], medians[2], max(len(data) for _, data in turns)


def _cast(mission: Mission, stand: Stand) -> Callable[[AirframeState, float], object]:
    """One vehicle's scan among the others."""
    assert mission.sensing is not None
    scene = Scene(stand, mission.sensing.range_m)
    if mission.sensing.sensor is SensorClass.SECTORS:
        lidar = Lidar(scene, mission.sensing, LidarErrors(), seed=1, vehicle_id=1)
        return lambda state, now_s: lidar.scan(state, list(_swarm(state.pos_ned_m).values())[1:], now_s)
    raw = RawLidar(scene, mission.sensing, LidarErrors(), seed=1, vehicle_id=1)
    moves = (2.8, 1.0)
    return lambda state, now_s: raw.scan(
        state, [(at, moves) for at in list(_swarm(state.pos_ned_m).values())[1:]], now_s
    )


def _taken_ms(mission: Mission, state: AirframeState, data: bytes) -> float:
    """A companion's CPU time for one turn: its frames, joined to an attitude, into the map."""
    assert mission.sensing is not None
    (source,) = sensors_of(mission)
    perception, framing = SensingPerception(mission, mission.sensing), Framing(frozenset(source.MESSAGES))
    own = Position(state.pos_ned_m, state.vel_ned_mps)
    attitude = dialect.MAVLink_attitude_message(0, *state.attitude_rad, *state.rates_radps)

    def take() -> None:
        now_s = 100.0
        for incoming in framing.read_messages(data):
            source.decode(incoming.message, incoming.component, now_s)
        source.read_autopilot(wire.fields(wire.pack(attitude, seq=0, system=1, component=1)), now_s)
        for scan in source.collect(now_s):
            assert isinstance(scan, ObstacleScan | LidarScan)
            perception.integrate_scan(scan, own, now_s, ())

    return statistics.median(_timed(take)[1] for _ in range(REPETITIONS))


def _swarm(middle_ned_m: Vec3) -> dict[int, Vec3]:
    north_m, east_m, down_m = middle_ned_m
    return {k + 1: (north_m + 8.0 * (k % 3), east_m + 8.0 * (k // 3), down_m) for k in range(12)}


def _timed(job: Callable[[], T]) -> tuple[T, float]:
    began_ns = time.thread_time_ns()
    done = job()
    return done, (time.thread_time_ns() - began_ns) / 1e6
