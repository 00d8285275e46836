"""CPU time of what a stand adds to a flight: scans, looks for contacts, links through trunks.

python -m sim_bridge.world.sensors.bench [--seed 1]
"""

from __future__ import annotations

import argparse
import random
import statistics
import time
from collections.abc import Callable
from typing import Final

from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission, RadioTrunks, Sensing, Sim
from mission.stand.stand import Stand, stand_of
from sim_bridge.trunk_attenuation import range_share
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.contacts import Contacts
from sim_bridge.world.radio import Radio
from sim_bridge.world.sensors.lidar import Lidar, obstacle_distance
from sim_bridge.world.sensors.scene import Scene

VEHICLES: Final = 12
APART_M: Final = 8.0
RANGE_M: Final = 30.0
PLACES: Final = 400
REPETITIONS: Final = 15
FRAME: Final = bytes(48)  # about as long as a beacon


def main(argv: list[str] | None = None) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(prog="sim_bridge.world.sensors.bench", description=__doc__, allow_abbrev=False)
    parser.add_argument("--seed", type=int, default=1, help="of the stands and the places")
    args = parser.parse_args(argv)
    print(f"{VEHICLES} vehicles {APART_M:g} m apart, seed {args.seed}; CPU time, us, median of {REPETITIONS}")
    print("| trees/ha | a scan, level | tilted | its message | a look | a send: disc | attenuated | cut |")
    print("|---|---|---|---|---|---|---|---|")
    for density_per_ha in (100, 200, 400, 600):
        costs = measure(density_per_ha, args.seed)
        print(f"| {density_per_ha} | " + " | ".join(f"{cost:.1f}" for cost in costs) + " |")
    return 0


def measure(density_per_ha: int, seed: int) -> list[float]:
    """The columns of the table, repetitions interleaved, so that the load on the machine falls on all."""
    stand = _make_stand(density_per_ha, seed)
    rng = random.Random(seed)
    middles = [(rng.uniform(-25.0, 25.0), rng.uniform(25.0, 105.0), -3.0) for _ in range(PLACES)]
    jobs = [
        _scans(stand, middles, (0.0, 0.0), seed),
        _scans(stand, middles, (0.15, -0.1), seed),
        _messages(stand, middles, seed),
        _looks(stand, middles),
        *(_sends(stand, middles, model) for model in RadioTrunks),
    ]
    costs: list[list[float]] = [[] for _ in jobs]
    for _ in range(REPETITIONS):
        for job, found in zip(jobs, costs, strict=True):
            begin_s = time.process_time()
            calls = job()
            found.append((time.process_time() - begin_s) * 1e6 / calls)
    return [statistics.median(found) for found in costs]


def _make_stand(density_per_ha: int, seed: int) -> Stand:
    route = {"d1_enu_m": (0.0, 0.0, 3.0), "d2_enu_m": (130.0, 0.0, 3.0), "vel_leader_mps": 3.0}
    tables = {"sensing": {}, "forest": {"stand": {"density_per_ha": float(density_per_ha)}}, "sim": {"seed": seed}}
    return stand_of(Mission.model_validate({"schema": 1, "route": route, **tables}))


def _swarm(middle_ned_m: Vec3) -> dict[int, Vec3]:
    """Four columns of three."""
    north_m, east_m, down_m = middle_ned_m
    return {
        k + 1: (north_m + (k % 3 - 1) * APART_M, east_m + (k // 3 - 1.5) * APART_M, down_m) for k in range(VEHICLES)
    }


def _state(pos_ned_m: Vec3, roll_pitch_rad: tuple[float, float]) -> AirframeState:
    return AirframeState(pos_ned_m, (0.0, 0.0, 0.0), (*roll_pitch_rad, 0.3), (0.0, 0.0, 0.0), False, 0.4)


def _scans(stand: Stand, middles: list[Vec3], roll_pitch_rad: tuple[float, float], seed: int) -> Callable[[], int]:
    sensing = Sensing()
    lidar = Lidar(Scene(stand, sensing.range_m), sensing, LidarErrors(), seed=seed, vehicle_id=1)
    flown = [(_state(middle, roll_pitch_rad), list(_swarm(middle).values())[:-1]) for middle in middles]
    times = iter(range(1, 1_000_000))

    def job() -> int:
        for state, others in flown:
            assert lidar.scan(state, others, float(next(times))) is not None
        return len(flown)

    return job


def _messages(stand: Stand, middles: list[Vec3], seed: int) -> Callable[[], int]:
    sensing = Sensing()
    lidar = Lidar(Scene(stand, sensing.range_m), sensing, LidarErrors(), seed=seed, vehicle_id=1)
    scans = [lidar.scan(_state(middle, (0.0, 0.0)), (), float(k)) for k, middle in enumerate(middles, start=1)]

    def job() -> int:
        for scan in scans:
            assert scan is not None
            obstacle_distance(scan, scan.taken_s)
        return len(scans)

    return job


def _looks(stand: Stand, middles: list[Vec3]) -> Callable[[], int]:
    contacts = Contacts(stand)

    def job() -> int:
        for vehicle_id, (north_m, east_m, down_m) in enumerate(middles):  # each on a way of its own, there and back
            for k in (0, 1, 2, 3, 4, 5, 4, 3, 2, 1):
                contacts.find_contact(
                    vehicle_id, (north_m + 0.15 * k, east_m, down_m), (3.0, 0.0, 0.0), on_ground=False
                )
        return 10 * len(middles)

    return job


def _sends(stand: Stand, middles: list[Vec3], model: RadioTrunks) -> Callable[[], int]:
    share = range_share(Sim(radio_trunks=model), stand)
    radio = Radio(range_m=RANGE_M, loss=0.0, delay_s=0.0, seed=1, share=share)
    swarms = [_swarm(middle) for middle in middles[:40]]

    def job() -> int:
        for swarm in swarms:
            radio.place(swarm)
            for k in swarm:
                radio.send(k, FRAME, 0.0)
            for k in swarm:
                radio.deliver(k, 0.0)
        return len(swarms) * VEHICLES

    return job


if __name__ == "__main__":
    raise SystemExit(main())
