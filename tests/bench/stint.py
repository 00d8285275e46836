"""One flight in stints, each when a line on standard input asks for it, and the processor time of each.

A program of its own that imports nothing of tests: it flies whatever checkout it is started in, so that two of them can
take turns. A line is a number (so many simulated seconds), `transit` (until the swarm flies to d2) or `end` (to the
flight's end); the end of the input ends the flight. Each is answered with a line of JSON; the last one has "ended".
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from companion.core.model.states import SwarmPhase
from companion.mavlink import endpoint
from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.options.study import positive

try:
    from sim_bridge.drive import fly
    from sim_bridge.judge.progress import Progress
    from sim_bridge.world.airframe.jsbsim_quad import quiet_jsbsim
    from sim_bridge.world.world import DEFAULT_ORIGIN
except ImportError:  # a checkout from before the bridge was divided
    from sim_bridge.airframe.jsbsim_quad import quiet_jsbsim
    from sim_bridge.progress import Progress

    from sim_bridge import fly
    from sim_bridge.world import DEFAULT_ORIGIN

PHYSICS_HZ = 200
NS = 1e9


def main() -> int:
    """Fly until the flight or the input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", type=Path, help="a mission file, or `bare`: JSBSim's F450, and nothing else")
    parser.add_argument("--n", type=positive, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", action="store_true", help="each agent a process")
    parser.add_argument(
        "--set", default="{}", metavar="JSON", help="keys of the mission's tables, instead of the file's"
    )
    args = parser.parse_args()
    if str(args.mission) == "bare":
        bare(args.n)
        return 0
    tables = load_mission(args.mission).model_dump(mode="json", by_alias=True)
    tables["swarm"]["size"] = args.n
    for name, keys in json.loads(args.set).items():
        tables[name] |= keys
    mission = Mission.model_validate(tables).with_seed(args.seed).with_origin(DEFAULT_ORIGIN)
    with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
        stints = Stints(args.n)
        outcome = fly.fly(mission, Path(folder), progress, in_process=not args.processes, watch=stints.look)
    kept = ("ended", "arrived", "verdict", "contacts", "min_separation_m", "trace_hash", "coverage_settled_s")
    figures = {key: outcome.summary[key] for key in kept}
    stints.answer(outcome.metrics.sim_time_s, figures | {"compiled": not str(endpoint.__file__).endswith(".py")})
    return 0


class Stints:
    """`look` after each tick: reads what to fly next when a stint is over."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._phase = "start"
        self._began_s = 0.0  # simulated
        self._until_s = 0.0
        self._until_transit = False
        self._read()

    def look(self, flight: fly.Flight) -> None:
        """For fly's `watch`."""
        now_s = flight.world.now_s
        if self._until_transit:
            if flight.phase() < SwarmPhase.TRANSIT:
                return
        elif now_s < self._until_s:
            return
        self.answer(now_s, {"phase": flight.phase().name.lower()})
        self._until_s = now_s
        self._read()

    def answer(self, now_s: float, more: dict[str, Any]) -> None:
        """What the stint that ends now has cost."""
        cpu_s, wall_s = cpu_time_s() - self._cpu_s, time.perf_counter() - self._wall_s
        simulated_s = now_s - self._began_s
        print(json.dumps({"vehicle_s": self._n * simulated_s, "cpu_s": cpu_s, "wall_s": wall_s, **more}), flush=True)
        self._began_s = now_s

    def _read(self) -> None:
        order = sys.stdin.readline().strip()
        if not order:
            raise KeyboardInterrupt  # as a person ends a flight
        self._until_transit = order == "transit"
        if order == "end":
            self._until_s = math.inf
        elif not self._until_transit:
            self._until_s += float(order)
        self._cpu_s, self._wall_s = cpu_time_s(), time.perf_counter()


def cpu_time_s() -> float:
    """Processor time of this process and of all that it has started, living or reaped."""
    reaped = resource.getrusage(resource.RUSAGE_CHILDREN)
    total_s = time.process_time() + reaped.ru_utime + reaped.ru_stime
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error, OSError):
            spent = child.cpu_times()
            total_s += _own_s(child.pid, spent.user + spent.system) + spent.children_user + spent.children_system
    return total_s


def _own_s(pid: int, coarse_s: float) -> float:
    """Of a process's threads, to the nanosecond where the kernel tells; `coarse_s` counts in hundredths of a second."""
    try:
        return sum(int(file.read_text().split()[0]) for file in Path(f"/proc/{pid}/task").glob("*/schedstat")) / NS
    except (OSError, ValueError, IndexError):
        return coarse_s


def bare(n: int) -> None:
    """So many seconds of one F450 as n vehicles fly in a stint, in the air, its rotors as fast as in hover."""
    fdm: Any = quiet_jsbsim().FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / PHYSICS_HZ)
    fdm.load_model("F450")
    fdm["ic/lat-geod-deg"] = 45.0
    fdm["ic/h-agl-ft"] = 300.0
    fdm["fcs/throttle-cmd-norm"] = 0.41
    for line in sys.stdin:
        simulated_s = float(line)
        fdm.run_ic()
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        for _ in range(round(n * simulated_s * PHYSICS_HZ)):
            fdm.run()
        spent = {"cpu_s": time.process_time() - cpu_s, "wall_s": time.perf_counter() - wall_s}
        print(json.dumps({"vehicle_s": n * simulated_s, **spent}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
