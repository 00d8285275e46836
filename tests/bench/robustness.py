"""Flights in which much goes wrong: companions killed, a swarm cut in parts, estimates wrong, telemetry late.

60 m at 3 m/s to a ring of 15 m, 20 s of coverage, JSBSim in calm air, agents in process: a flight is the same wherever
it is flown.
"""

from __future__ import annotations

import io
import math
import re
import statistics
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from companion.core.model.states import STEERED, FlightState, SwarmPhase
from mission.common.frames import enu_to_ned
from mission.document.model import AtEnd, Mission
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge import run_folder
from sim_bridge.judge.metrics import acting_leader, swarm_phase
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.verdict import separation_tolerance_m
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S
from tests.bench.table import Row, spread

STILL_MPS = 0.5  # slower, a vehicle holds
UNDER_WAY_M = 10.0  # from d1, a leader that took over beside the line has come back to it
LATE_S = 1.5
SAID_WITHIN_S = 0.5
NUMBERS = re.compile(r"\b\d[\d.]*(, \d[\d.]*)*")  # what differs between like words
AUTOPILOT_HOLDS = {"HOLD", "LAND", "BRAKE"}
TIME_LIMIT_S = 600.0  # the alone land after 90 s, and a partition is over after 100 s


@dataclass(frozen=True, slots=True)
class FaultFlight:
    """One kind of flight: what goes wrong for n vehicles, and what must come of it."""

    what: str
    at_end: AtEnd
    faults: Callable[[int], list[dict[str, Any]]] = lambda _: []
    sim: dict[str, Any] = field(default_factory=dict)
    sizes: tuple[int, ...] = (6, 8)
    seeds: int = 20
    separation_m: float = 5.0
    verdict: str = "ARRIVED|FAILED"  # what it begins with
    track_m: float | None = None  # how far the leader may stray from the line d1-d2 on the way
    late: int = 0  # whose telemetry is late, counted from n


ROBUSTNESS = {
    "kill-at-departure-return": FaultFlight(
        "leader killed at departure, then return",
        AtEnd.RETURN,
        lambda _: [{"kind": "kill", "phase": "transit", "at_s": 0.0}],
        verdict="ARRIVED without",
    ),
    "dead-at-d1-return": FaultFlight(
        "a follower killed at d1, then return",
        AtEnd.RETURN,
        lambda n: [{"kind": "kill", "vehicles": [n], "phase": "gather", "at_s": 12.0}],
        verdict="ARRIVED without",
    ),
    "half-a-ring-dead-return": FaultFlight(
        "half of the swarm killed in coverage, then return",
        AtEnd.RETURN,
        lambda n: [{"kind": "kill", "vehicles": list(range(2, n + 1, 2)), "phase": "coverage", "at_s": 8.0}],
    ),
    "half-a-ring-dead-land": FaultFlight(
        "half of the swarm killed in coverage, then land",
        AtEnd.LAND,
        lambda n: [{"kind": "kill", "vehicles": list(range(2, n + 1, 2)), "phase": "coverage", "at_s": 8.0}],
    ),
    "partition": FaultFlight(
        "vehicles 1, 2, 3 cut off for 100 s in transit, then land",
        AtEnd.LAND,
        lambda _: [{"kind": "partition", "vehicles": [1, 2, 3], "phase": "transit", "at_s": 5.0, "for_s": 100.0}],
    ),
    "leader-dies-in-gather": FaultFlight(
        "leader killed while gathering, then return",
        AtEnd.RETURN,
        lambda _: [{"kind": "kill", "phase": "gather", "at_s": 12.0}],
        verdict="ARRIVED without",
    ),
    "bias": FaultFlight(
        "velocities 0.4 m/s wrong, positions 0.3 s late, drag of PX4's simulator",
        AtEnd.HOLD,
        # PX4's simulator told climb rates that were 0.06 m/s wrong
        sim={"velocity_bias_mps": 0.4, "climb_bias_mps": 0.06, "estimate_delay_s": 0.3, "drag": "sih"},
        sizes=(8, 16),
        seeds=10,
        separation_m=4.5,
        track_m=1.0,
    ),
    "late-telemetry": FaultFlight(
        f"a follower's telemetry {LATE_S:g} s late from 5 s of transit on, then land",
        AtEnd.LAND,
        lambda n: [{"kind": "late", "vehicles": [n - 1], "phase": "transit", "at_s": 5.0, "late_s": LATE_S}],
        late=-1,
    ),
}


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of one flight."""

    contacts: int
    separation_m: float
    ended: str
    verdict: str
    arrived: bool
    safe: bool  # everyone on the ground, or holding
    right: bool  # the verdict claims no more than is so
    level_m: float  # the leader's greatest distance from the line d1-d2 on the way, and in height
    height_m: float
    held_s: float  # from when its telemetry is late, until it holds
    said_s: float  # ... until it says so
    said: str
    steered_s: float  # ... how long it then steers all the same


def mission(kind: FaultFlight, n: int, seed: int) -> Mission:
    """What is flown."""
    values = {
        "schema": 1,
        "name": kind.what,
        "route": {"d1_enu_m": (0, 0, 8), "d2_enu_m": (60, 0, 8), "vel_leader_mps": 3.0, "at_end": kind.at_end},
        "coverage": {"duration_s": 20.0},
        "swarm": {"size": n},
        "sim": {"seed": seed, "time_limit_s": TIME_LIMIT_S, "faults": kind.faults(n), **kind.sim},
    }
    return Mission.model_validate(values).with_origin(DEFAULT_ORIGIN)


class Watch:
    """Each tick: what the vehicle whose telemetry is late does; at last, how everyone stands."""

    def __init__(self, late: int) -> None:
        self._late = late
        self._struck_s: float | None = None
        self.held_s = self.said_s = math.inf
        self.said = ""
        self.steered_s = 0.0
        self.safe = False

    def __call__(self, flight: fly.Flight) -> None:
        """After each tick."""
        alive, heard = flight.lockstep.companions, flight.last.said
        self.safe = True
        for k, vehicle in flight.world.vehicles.items():
            autopilot, state = vehicle.autopilot.snapshot, vehicle.airframe.state
            still = math.hypot(*state.vel_ned_mps) < STILL_MPS
            if k in alive and k in heard:
                covers = flight.mission.route.at_end is AtEnd.HOLD and heard[k].flight_state == FlightState.COVERAGE
                still = covers or (still and heard[k].flight_state == FlightState.HOLD)
            else:
                still &= autopilot.mode in AUTOPILOT_HOLDS
            self.safe &= still or (state.on_ground and not autopilot.armed)
        if self._late:
            self._look_at_late(flight, flight.world.now_s)

    def _look_at_late(self, flight: fly.Flight, now_s: float) -> None:
        if self._struck_s is None:
            if not flight.lockstep.late_s:
                return
            self._struck_s = now_s - TICK_S  # this tick began with it
        after_s = round(now_s - TICK_S - self._struck_s, 3)  # companions have decided when the tick began
        companion = flight.lockstep.companions[self._late]
        assert isinstance(companion, InProcess)
        state = companion.endpoint.agent.status(now_s).state
        if state is FlightState.HOLD:
            self.held_s = min(self.held_s, after_s)
        elif self.held_s < math.inf and state in STEERED:
            self.steered_s += TICK_S
        said = [event for event in flight.events if event[1].startswith(f"vehicle {self._late}: ")]
        if said and not self.said:  # noted a tick later, with the time when it was said
            self.said, self.said_s = said[0][1].partition(": ")[2], round(said[0][0] - self._struck_s, 3)


def flown(name: str, n: int, seed: int) -> Flown:
    """One flight."""
    kind = ROBUSTNESS[name]
    flies = mission(kind, n, seed)
    watch = Watch(n + kind.late if kind.late else 0)
    with tempfile.TemporaryDirectory(prefix="fault-") as folder, Progress(io.StringIO()) as progress:
        outcome = fly.fly(flies, Path(folder), progress, in_process=True, watch=watch)
        level_m, height_m = off_the_line(run_folder.load(Path(folder)), flies)
    figures, verdict = outcome.metrics, outcome.summary["verdict"]
    separation_m = math.inf if figures.min_separation_m is None else figures.min_separation_m
    up = set(figures.aloft) - set(figures.lost) if flies.route.at_end is not AtEnd.HOLD else set()
    least_m = flies.separation.hard_m - separation_tolerance_m(flies)
    good = figures.arrived and not figures.contacts and separation_m >= least_m and not up
    return Flown(
        contacts=figures.contacts,
        separation_m=separation_m,
        ended=outcome.ended,
        verdict=verdict,
        arrived=figures.arrived,
        safe=watch.safe,
        right=good or verdict.startswith("FAILED"),
        level_m=level_m,
        height_m=height_m,
        held_s=watch.held_s,
        said_s=watch.said_s,
        said=watch.said,
        steered_s=watch.steered_s,
    )


def off_the_line(recording: Recording, flies: Mission) -> tuple[float, float]:
    """The acting leader's greatest distance from the line d1-d2 in TRANSIT: level, and in height; m."""
    d1, d2 = (np.array(enu_to_ned(place)) for place in (flies.route.d1_enu_m, flies.route.d2_enu_m))
    leader, phase = acting_leader(recording), swarm_phase(recording)
    ticks = np.flatnonzero((leader > 0) & (phase == SwarmPhase.TRANSIT))
    from_d1 = recording.pos_ned_m[ticks, leader[ticks] - 1] - d1
    way = (d2 - d1) / np.linalg.norm(d2 - d1)
    along = from_d1 @ way
    off = (from_d1 - np.outer(along, way))[along > UNDER_WAY_M]
    if not len(off):
        return math.inf, math.inf
    return float(np.hypot(off[:, 0], off[:, 1]).max()), float(np.abs(off[:, 2]).max())


def robustness(names: Sequence[str], *, seeds: int | None, sizes: Sequence[int], jobs: int) -> Iterator[Row]:
    """The rows of each kind and size. `seeds`, `sizes`: instead of the kind's own; `jobs`: worker processes."""
    with ProcessPoolExecutor(jobs) as pool:
        for name in names or ROBUSTNESS:
            kind = ROBUSTNESS[name]
            for n in sizes or kind.sizes:
                flights = range(1, 1 + (seeds or kind.seeds))
                found = list(pool.map(flown, [name] * len(flights), [n] * len(flights), flights))
                yield from rows(f"{kind.what}, n = {n}, seeds 1-{len(flights)}", kind, found)


def rows(what: str, kind: FaultFlight, found: Sequence[Flown]) -> Iterator[Row]:
    """What must be, and what came of it."""
    contacts = [f.contacts for f in found]
    yield Row(f"{what}: contacts", "0", f"{sum(contacts)}, worst {max(contacts)}", not any(contacts))
    apart_m = [f.separation_m for f in found]
    seen = f"worst {min(apart_m):.2f} m, median {statistics.median(apart_m):.2f} m"
    yield Row("- separation", f">= {kind.separation_m:g} m", seen, min(apart_m) >= kind.separation_m)
    yield Row("- ended", "told", counted(NUMBERS.sub("#", f.ended) for f in found), True)
    safe = sum(f.safe for f in found)
    yield Row("- on the ground, or holding", "all", f"{safe} of {len(found)}", safe == len(found))
    right = [re.match(kind.verdict, f.verdict) is not None and f.right for f in found]
    said = counted(NUMBERS.sub("#", f.verdict) for f in found)
    yield Row("- verdict", f"{kind.verdict.replace('|', ' or ')}, and right", said, all(right))
    if kind.track_m is not None:
        for name, off_m in (("height", [f.height_m for f in found]), ("track", [f.level_m for f in found])):
            seen = spread(off_m, " m")
            yield Row(f"- leader's {name} off the line", f"<= {kind.track_m:g} m", seen, max(off_m) <= kind.track_m)
        arrived = sum(f.arrived for f in found)
        yield Row("- arrive", "all", f"{arrived} of {len(found)}", arrived == len(found))
    if kind.late:
        for name, times_s in (("holds", [f.held_s for f in found]), ("says so", [f.said_s for f in found])):
            reached = max(times_s) <= SAID_WITHIN_S
            yield Row(f"- {name} after", f"<= {SAID_WITHIN_S:g} s", spread(times_s, " s"), reached)
        yield Row("- says", "told", counted(NUMBERS.sub("#", f.said) or "nothing" for f in found), True)
        steered_s = [f.steered_s for f in found]
        yield Row("- steers on meanwhile", "0 s", spread(steered_s, " s"), not any(steered_s))


def counted(texts: Iterator[str]) -> str:
    """Each text with how often it came, the most frequent first."""
    return " / ".join(f"{count} x {text}" for text, count in Counter(texts).most_common())
