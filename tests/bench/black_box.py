"""Black boxes: do faulted flights replay bit for bit, and what does recording cost: `python -m tests.bench black-box`.

The missions are those that `sim-bridge search` draws (size, route, stand, radio, makes, sensors, faults), of at most
eight vehicles and with a fault, on point masses, half of them with signed frames; none with raw lidars, whose
simulation takes most of the time unless --raw asks for them. Their faults begin 5 to 30 s after
the start, and flights end after 45 s: how they end is not what is asked. Every companion keeps its black box, and each
box is run again of itself alone. The cost is of one vehicle's traffic, recorded once, handed to its endpoint with a box
and without by turns, in one process.
"""

from __future__ import annotations

import argparse
import gc
import io
import shutil
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.journal.reading import find_flights
from companion.journal.replay import replay_flight
from mission.common.compiled import STATE
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.black_box import FOLDER_NAME, SimulatedBox
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.search.draw import draw
from sim_bridge.options.search import as_count, as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link
from sim_bridge.world.world import World
from tests.bench.options import number
from tests.bench.table import spread
from tests.flights import point_masses, short_mission

SALT = 0xB0C5
BEGIN_S = (5.0, 30.0)  # faults
SIZE_MAX = 8
TICK_BUDGET_US = 50e3  # 20 Hz
COSTED = (8, 12)  # vehicles
ROUNDS = 7
SKIPPED_TICKS = 400  # from the ground


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight and its black boxes."""

    seed: int
    vehicles: int
    faults: str  # that struck
    boxes: int
    same: int  # boxes of which every tick was the same, and the chain whole
    ticks: int
    ticks_same: int
    bytes_per_s: float  # of one vehicle
    replay_s: float  # CPU, of all boxes
    problem: str


def fly_one(job: tuple[int, float]) -> Flown:
    """Flies one for some seconds, and replays its boxes."""
    seed, seconds = job
    mission = early_faults(draw(seed).mission)
    struck: Counter[str] = Counter()

    def watch(flight: fly.Flight) -> None:
        struck.clear()
        struck.update(event.kind.value for event in flight.faults.happened)
        if flight.world.now_s >= seconds:
            raise KeyboardInterrupt  # ends the flight, not its report

    folder = Path(tempfile.mkdtemp(prefix="black-box-"))
    try:
        with Progress(io.StringIO()) as progress:
            outcome = fly.fly(
                mission,
                folder,
                progress,
                in_process=True,
                airframes=lambda _frame, pos, _seed: PointMass(pos, 0.0, drag=mission.sim.drag, ground_down_m=pos[2]),
                watch=watch,
                keys=FleetKeys(mission) if seed % 2 else None,
                black_box=True,
            )
        flights = find_flights(folder / FOLDER_NAME)
        size = sum(path.stat().st_size for path in (folder / FOLDER_NAME).iterdir())
        began_s = time.process_time()
        replays = [replay_flight(flight) for flight in flights]
        replay_s = time.process_time() - began_s
    finally:
        shutil.rmtree(folder)
    ticks = sum(replayed.summary.ticks for replayed in replays)
    return Flown(
        seed,
        mission.swarm.size,
        ", ".join(f"{count} {kind}" for kind, count in sorted(struck.items())),
        len(replays),
        sum(replayed.is_same for replayed in replays),
        ticks,
        sum(replayed.same for replayed in replays),
        20.0 * size / max(1, ticks),
        replay_s,
        "; ".join(
            line for replayed in replays for line in (*replayed.difference, *replayed.breaks, replayed.stopped) if line
        )
        or str(outcome.summary["grade"]),
    )


def early_faults(mission: Mission) -> Mission:
    """The same faults, soon after the start."""
    rng = np.random.default_rng([SALT, mission.sim.seed])
    tables = mission.model_dump(mode="json", by_alias=True, exclude_none=True)
    for fault in tables["sim"]["faults"]:
        fault.pop("phase", None)
        fault["at_s"] = round(float(rng.uniform(*BEGIN_S)), 1)
    return Mission.model_validate(tables)


def drawn_seeds(first: int, count: int, *, raw: bool) -> Iterator[int]:
    """Seeds of missions with a fault, of at most SIZE_MAX vehicles. `raw`: raw lidars, too."""
    seed = first
    while count:
        mission = draw(seed).mission
        has_raw = mission.sensing is not None and mission.sensing.sensor is not SensorClass.SECTORS
        if mission.sim.faults and mission.swarm.size <= SIZE_MAX and (raw or not has_raw):
            yield seed
            count -= 1
        seed += 1


# --- cost ---


def tick_us(mission: Mission, traffic: Sequence[tuple[bytes, bytes, float]], folder: Path | None) -> float:
    """CPU time of a tick of vehicle 2, mean, us."""
    box = None if folder is None else SimulatedBox(folder, mission, "", 2)
    companion = InProcess(mission, 2, box=box)
    gc.collect()
    gc.freeze()
    began_ns = 0
    for k, (peers, autopilot, now_s) in enumerate(traffic):
        if k == SKIPPED_TICKS:
            began_ns = time.thread_time_ns()
        companion.send(peers, autopilot, now_s)
    spent_ns = time.thread_time_ns() - began_ns
    gc.unfreeze()
    companion.close()
    return spent_ns / 1e3 / (len(traffic) - SKIPPED_TICKS)


class _Noting:
    """A companion in this process whose traffic is kept."""

    def __init__(self, companion: InProcess) -> None:
        self.id = companion.id
        self.traffic: list[tuple[bytes, bytes, float]] = []
        self.receive, self.kill, self.close = companion.receive, companion.kill, companion.close
        self.fill_disk = companion.fill_disk
        self._companion = companion

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self.traffic.append((from_peers, from_autopilot, now_s))
        self._companion.send(from_peers, from_autopilot, now_s, from_sensor)


def cost_row(size: int) -> str:
    """One row: ticks with a box and without, by turns."""
    mission = short_mission(swarm={"size": size}, coverage={"radius_m": 20.0}, sim={"seed": 1})
    world = World(mission, point_masses, links={link: fly.LINKS[link] for link in Link})
    companions = [_Noting(InProcess(mission, k)) for k in world.vehicles]
    flight = fly.Flight(mission, list(companions), world, None)
    while flight.finished() is None and len(companions[1].traffic) < 1600:
        flight.tick()
    flight.close()
    traffic = companions[1].traffic
    plain, boxed, size_bytes = [], [], 0
    for _ in range(ROUNDS):
        plain.append(tick_us(mission, traffic, None))
        folder = Path(tempfile.mkdtemp(prefix="black-box-"))
        boxed.append(tick_us(mission, traffic, folder))
        size_bytes = sum(path.stat().st_size for path in folder.iterdir())
        shutil.rmtree(folder)
    more = [with_us - without_us for without_us, with_us in zip(plain, boxed, strict=True)]
    ratios = [with_us / without_us for without_us, with_us in zip(plain, boxed, strict=True)]
    rate = 20.0 * size_bytes / len(traffic)
    return (
        f"| {size} | {spread(plain, ' us')} | {spread(boxed, ' us')} | {spread(ratios, '')} "
        f"| {100.0 * statistics.median(more) / TICK_BUDGET_US:.3f} % | {rate / 1e3:.1f} kB/s |"
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then the sums; exit code 1: a box was not the same."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench black-box", description=__doc__)
    parser.add_argument("--flights", type=as_count, default=100, metavar="N", help="0: the cost alone (100)")
    parser.add_argument("--first-seed", type=as_seed, default=7000, metavar="S", help="(7000)")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    parser.add_argument(
        "--seconds", type=number(1.0, 3600.0), default=45.0, metavar="S", help="of each flight at most (45)"
    )
    parser.add_argument("--raw", action="store_true", help="missions with raw lidars, too")
    args = parser.parse_args(argv)
    print(f"{STATE}\n\n| vehicles | tick | with a black box | ratio | of 50 ms | log of one vehicle |")
    print("|---|---|---|---|---|---|")
    for size in COSTED:
        print(cost_row(size), flush=True)
    flown: list[Flown] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(
            fly_one, [(seed, args.seconds) for seed in drawn_seeds(args.first_seed, args.flights, raw=args.raw)]
        ):
            print(row, flush=True)
            flown.append(row)
    if not flown:
        return 0
    signed = sum(row.seed % 2 for row in flown)
    boxes, same = sum(row.boxes for row in flown), sum(row.same for row in flown)
    ticks, ticks_same = sum(row.ticks for row in flown), sum(row.ticks_same for row in flown)
    kinds = Counter(kind.split(" ", 1)[1] for row in flown for kind in row.faults.split(", ") if kind)
    struck = sum(row.faults != "" for row in flown)
    vehicles = sum(row.vehicles for row in flown)
    print(f"\n{len(flown)} flights, {vehicles} vehicles, {signed} signed; {struck} struck: {dict(kinds)}")
    print(f"{same} of {boxes} black boxes, {ticks_same} of {ticks} ticks the same to the bit")
    print(f"log of one vehicle: {spread([row.bytes_per_s / 1e3 for row in flown], ' kB/s')}")
    return 0 if same == boxes else 1
