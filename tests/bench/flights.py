"""Flights of the examples as `make fly` flies them: what they reach, and what they cost."""

from __future__ import annotations

import io
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from companion.core.model.states import SwarmPhase
from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.table import Row, spread

EXAMPLES = Path("mission/examples")
STUDIES = Path("mission/studies")
SEEDS = range(1, 6)


def lone_tree() -> Iterator[Row]:
    """5 seeds each with 4, 8 and 12 vehicles."""
    factors = []
    for n in (4, 8, 12):
        flights = [flight("lone_tree", n, seed) for seed in SEEDS]
        what = f"lone tree, 3 m/s, n = {n}, seeds 1-5"
        yield from flight_rows(what, flights, overhead_max=0.05, gap_max=1.15)
        if n == 8:
            factors = [f["real_time_factor"] for f in flights]
    yield Row(
        "lockstep, n = 8, 200 Hz physics, companions as processes",
        ">= 35x real time",
        f"{spread(factors, 'x')}",
        statistics.median(factors) >= 35.0,
    )


def paper() -> Iterator[Row]:
    """The paper's own flight."""
    for n in (4, 8, 12):
        flights = [flight("paper", n, seed) for seed in SEEDS]
        what = f"paper, 0.7 m/s, n = {n}, seeds 1-5"
        yield from flight_rows(what, flights, overhead_max=0.02, gap_max=1.2)


def flight_rows(what: str, flights: list[dict[str, Any]], *, overhead_max: float, gap_max: float) -> Iterator[Row]:
    """The figures of several flights of one kind."""
    arrived = sum(f["arrived"] and f["ended"] == "coverage complete" for f in flights)
    yield Row(what, "all arrive", f"{arrived} of {len(flights)}", arrived == len(flights))
    for who in ("leader", "last"):
        worst = max(f[f"overhead_{who}"] for f in flights)
        seen = spread([100.0 * f[f"overhead_{who}"] for f in flights], " %")
        yield Row(f"- overhead of {who}", f"<= {100 * overhead_max:.1f} %", seen, worst <= overhead_max)
    least = min(f["min_separation_m"] for f in flights)
    yield Row("- separation", ">= 4 m", f"worst {least:.2f} m", least >= 4.0)
    contacts = sum(f["contacts"] for f in flights)
    yield Row("- contacts", "0", str(contacts), contacts == 0)
    connected = min(f["connected_fraction_transit"] for f in flights)
    yield Row("- connected in transit", ">= 99.9 %", f"worst {100 * connected:.2f} %", connected >= 0.999)
    gap = max(f["coverage_gap_deg"] / f["coverage_gap_ideal_deg"] for f in flights)
    yield Row("- coverage gap", f"<= {gap_max:g}x ideal", f"worst {gap:.3f}x", gap <= gap_max)
    settled = max(math.inf if f["coverage_settled_s"] is None else f["coverage_settled_s"] for f in flights)
    yield Row("- coverage settled after", "<= 60 s", f"worst {settled:.1f} s", settled <= 60.0)


def leader_killed() -> Iterator[Row]:
    """kill -9 of the leader's process in mid-transit."""
    takeovers, arrived, least = [], 0, 1e9
    for seed in SEEDS:
        killed: dict[str, float] = {}

        def kill(f: fly.Flight, killed: dict[str, float] = killed) -> None:
            leader, now_s = f.leader(), f.world.now_s
            if f.phase() is SwarmPhase.TRANSIT and leader is not None:
                killed.setdefault("transit_s", now_s)
            if "at_s" not in killed and leader is not None and now_s > killed.get("transit_s", 1e9) + 15.0:
                killed.update(at_s=now_s, leader=leader)
                os.kill(f.lockstep.companions[leader].process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
            elif "at_s" in killed and "again_s" not in killed and leader not in (None, killed["leader"]):
                killed["again_s"] = now_s

        figures = flight("lone_tree", 8, seed, watch=kill)
        takeovers.append(killed.get("again_s", 1e9) - killed["at_s"])
        arrived += figures["arrived"] and not figures["contacts"]
        least = min(least, figures["min_separation_m"])
    yield Row(
        "leader killed (kill -9) in mid-transit, n = 8, seeds 1-5: another acts",
        "<= 3.5 s",
        spread(takeovers, " s"),
        max(takeovers) <= 3.5,
    )
    yield Row("- the swarm arrives, without contact", "5 of 5", f"{arrived} of 5", arrived == 5)
    yield Row("- separation, the dead leader's vehicle included", ">= 4 m", f"worst {least:.2f} m", least >= 4.0)


def quick_start() -> Iterator[Row]:
    """The whole of `make fly` once the dependencies are there."""
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.perf_counter()
        command = [sys.executable, "-m", "sim_bridge.cli", "fly", str(EXAMPLES / "lone_tree.toml")]
        subprocess.run([*command, "--out", folder], capture_output=True, check=True)
        seconds = time.perf_counter() - began_s
    yield Row("make fly, dependencies installed, to the verdict", "<= 90 s", f"{seconds:.1f} s", seconds <= 90.0)


def flight(
    name: str,
    n: int,
    seed: int,
    *,
    folder: Path = EXAMPLES,
    factor: float | None = None,
    watch: Callable[[fly.Flight], None] | None = None,
    sensing: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """metrics.json's content of one flight. `sensing`: keys of that table, instead of the file's."""
    tables = load_mission(folder / f"{name}.toml").model_dump(mode="json", by_alias=True)
    if sensing is not None:
        tables["sensing"] |= sensing
    mission: Mission = Mission.model_validate(tables).with_size(n).with_seed(seed).with_origin(DEFAULT_ORIGIN)
    with tempfile.TemporaryDirectory() as run, Progress(io.StringIO()) as progress:
        return fly.fly(mission, Path(run), progress, factor=factor, watch=watch).summary
