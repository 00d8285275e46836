"""The figures that the project holds itself to, measured now: `make bench`, or `python -m tests.bench NAME ...`.

Speed depends on the machine: compare ratios and figures of one run. Flights are the same on every machine.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from companion.core.types import SwarmPhase
from mission.load import load_mission
from mission.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.election import Course, Lied, all_lied, courses
from tests.bench.hardships import HARDSHIPS, hardships
from tests.bench.last_stage import last_stage
from tests.bench.reelection import SMALL_MAH, TERM_S, watched
from tests.bench.restarts import kills
from tests.bench.setpoint_gaps import gaps_ms
from tests.bench.table import Row, spread
from tests.core_election_net import acting_within, failover_within, overlap_within

EXAMPLES = Path("mission/examples")
SEEDS = range(1, 6)


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 when a figure was not reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"which: {', '.join(BENCHMARKS)} (default: all of these), setpoint-gaps, last-stage, hardships",
    )
    parser.add_argument("--write", type=Path, metavar="FILE", help="the table as Markdown, too")
    parser.add_argument("--minutes", type=float, default=10.0, metavar="M", help="of setpoint-gaps (10)")
    hard = parser.add_argument_group("hardships")
    hard.add_argument(
        "--only", action="append", default=[], choices=HARDSHIPS, metavar="KIND", help=f"of {', '.join(HARDSHIPS)}"
    )
    hard.add_argument("--seeds", type=_positive, metavar="N", help="seeds 1 to N (20; bias: 10)")
    hard.add_argument("--n", type=_positive, action="append", default=[], metavar="N", help="vehicles (6 and 8)")
    hard.add_argument("--jobs", type=_positive, default=2, metavar="N", help="flights at once, and of last-stage (2)")
    args = parser.parse_args(argv)
    benchmarks = BENCHMARKS | {
        "setpoint-gaps": partial(setpoint_gaps, args.minutes),
        "last-stage": partial(last_stage, args.jobs),
        "hardships": partial(hardships, args.only, seeds=args.seeds, sizes=args.n, jobs=args.jobs),
    }
    unknown = [name for name in args.names if name not in benchmarks]
    if unknown:
        parser.error(f"{', '.join(unknown)}: must be of {', '.join(benchmarks)}")
    lines = ["| what | wanted | seen | reached |", "|---|---|---|---|"]
    print("\n".join(lines), flush=True)
    reached = True
    for name in args.names or BENCHMARKS:
        for row in benchmarks[name]():
            lines.append(str(row))
            print(row, flush=True)
            reached &= row.reached
    if args.write is not None:
        args.write.write_text(page(lines, args.names), encoding="utf-8")
    return 0 if reached else 1


def _positive(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= 1000):
        raise argparse.ArgumentTypeError(f"{text!r}: must be a number from 1 to 1000")
    return int(text)


def page(lines: list[str], names: Sequence[str]) -> str:
    """The Markdown page."""
    command = " ".join(["python -m tests.bench", *names]) if names else "make bench"
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    head = f"""# Figures

Measured with `{command}` on {datetime.now(UTC):%Y-%m-%d} ({machine}). Flights: JSBSim, calm air, no radio loss,
every companion a process; "worst" is over all the seeds named. What each figure means: [metrics](metrics.md). Speed
depends on the machine and on what else it does; flights do not.
"""
    return "\n".join([head, *lines, ""])


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
        ">= 20x real time",
        f"{spread(factors, 'x')}",
        statistics.median(factors) >= 20.0,
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


def election() -> Iterator[Row]:
    """Random graphs of two families that radios make, and of deeper ones: trees and chains. Then lies."""
    for family, sizes, graphs in (
        ("grown", (4, 8, 12), 1000),
        ("grown", (50,), 200),
        ("geometric", (4, 8, 12), 1000),
        ("geometric", (50,), 200),
        ("tree", (12, 50), 200),
        ("chain", (4, 8, 12, 20, 50), 100),
    ):
        for n in sizes:
            yield from election_rows(f"{family}, n = {n}, {graphs} graphs, 10 % loss", courses(family, n, graphs), n)
    for n in (4, 8, 12):
        yield from lie_rows(n, all_lied(n, 300))


def election_rows(what: str, found: list[Course], n: int) -> Iterator[Row]:
    """Figures in beacon periods. "less the way": what is left when a period is taken off for each hop of it."""
    told = what.startswith(("tree", "chain"))
    settled = sum(c.settled for c in found)
    depth = spread([c.diameter for c in found], " hops")
    yield Row(f"election, {what}, diameter {depth}", "one acting leader", f"{settled}", settled == len(found))
    extra = spread([c.extra for c in found], "")
    yield Row("- beacons that were not due until one acts, per vehicle", "told", extra, True)

    def timed(name: str, most: int, times: list[int], ways: list[int]) -> Row:
        less = spread([time - way for time, way in zip(times, ways, strict=True)], "")
        late = sum(time > most for time in times)
        seen = f"{spread(times, '')}; {late} of {len(times)} above {most}; less the way {less}"
        return Row(f"- {name}", "told" if told else f"<= {most}", seen, told or not late)

    yield timed("agreement", 10, [c.agreement for c in found], [c.agreement_way for c in found])
    yield Row("- one acts", "told", spread([c.acting for c in found], ""), True)
    most = 25 if n <= 12 else 30
    for parts, name in ((False, "failover"), (True, "the same where the loss divides the swarm")):
        some = [c for c in found if c.split is parts]
        if some:
            yield timed(name, most, [c.failover for c in some], [c.failover_way for c in some])
    two = sum(c.start_overlap + c.failover_overlap > 0 for c in found)
    yield Row("- two acting at start or failover", "never", f"in {two}", two == 0)
    yield timed("two acting in a merge", 5, [c.merge_overlap for c in found], [c.merge_way for c in found])
    for name, times in (
        ("one acts", [(c.acting, acting_within(c.diameter)) for c in found]),
        ("failover", [(c.failover, failover_within(c.left_diameter)) for c in found]),
        ("two acting in a merge", [(c.merge_overlap, overlap_within(c.diameter)) for c in found]),
    ):
        late = sum(time > most for time, most in times)
        yield Row(f"- {name}: beyond the bound by depth", "never", f"in {late}", late == 0)


def lie_rows(n: int, found: list[Lied]) -> Iterator[Row]:
    """Figures in beacon periods, from the last lie on."""
    what = f"election, one of {n} lies for 2 to 8 s, grown, {len(found)} graphs: one acts again"
    late = sum(c.acting > c.most for c in found)
    seen = f"{spread([c.acting for c in found], '')}; {late} beyond the bound by depth"
    yield Row(what, "by its bound", seen, late == 0)
    two = [c.overlap for c in found]
    seen = f"in {sum(t > 0 for t in two)}, in {sum(t > 10 for t in two)} for more than 10, at most {max(two)}"
    yield Row("- two acting", "told", seen, True)


def reelection() -> Iterator[Row]:
    """With a term of 10 s and without, 5 seeds; then with equal batteries."""
    changed = [watched(seed, term_s=TERM_S, battery_mah=SMALL_MAH) for seed in SEEDS]
    stayed = [watched(seed, term_s=0.0, battery_mah=SMALL_MAH) for seed in SEEDS]
    equal = [watched(seed, term_s=TERM_S, battery_mah={}) for seed in SEEDS]
    once = sum(f.phases == [SwarmPhase.TRANSIT] for f in changed)
    what = f"re-election every {TERM_S:g} s, lone tree, n = 8, leader with a tenth of the others' battery, seeds 1-5"
    yield Row(f"{what}: another takes over, once, in transit", "5 of 5", f"{once} of 5", once == 5)
    for name, some in (("", changed), (" with equal batteries", equal)):
        ticks = sum(f.not_one_ticks for f in some)
        yield Row(f"- ticks in which not exactly one acts{name}", "0", str(ticks), ticks == 0)
    arrived = sum(f.figures["arrived"] and not f.figures["contacts"] for f in changed)
    yield Row("- the swarm arrives, without contact", "5 of 5", f"{arrived} of 5", arrived == 5)
    least_m, plain_m = (min(f.figures["min_separation_m"] for f in some) for some in (changed, stayed))
    seen = f"worst {least_m:.2f} m (without: {plain_m:.2f} m)"
    yield Row("- separation", ">= 4 m", seen, least_m >= 4.0)
    connected = min(f.figures["connected_fraction_transit"] for f in changed)
    yield Row("- connected in transit", ">= 99.9 %", f"worst {100 * connected:.2f} %", connected >= 0.999)
    for who in ("leader", "last"):
        late_s = [
            a.figures[f"arrival_{who}_s"] - b.figures[f"arrival_{who}_s"] for a, b in zip(changed, stayed, strict=True)
        ]
        yield Row(f"- arrival of {who}, later than without re-election by", "told", spread(late_s, " s"), True)
    way_s = [f.farther_m / 3.0 for f in changed]
    yield Row("- what the new leader's place makes of that: its longer way at 3 m/s", "told", spread(way_s, " s"), True)
    kept = sum(len(f.leaders) == 1 for f in equal)
    terms = min(f.figures["sim_time_s"] for f in equal) // TERM_S
    yield Row(f"- equal batteries, {terms:g} terms and more: the same one leads", "5 of 5", f"{kept} of 5", kept == 5)


def physics() -> Iterator[Row]:
    """Our quadrotor with its loops against the wheel's bare F450."""
    done = subprocess.run(
        [sys.executable, "-m", "sim_bridge.world.airframe.bench", "--json"], capture_output=True, text=True, check=True
    )
    figures = json.loads(done.stdout)
    ratio, low, high = (figures[f"ratio_{key}"] for key in ("median", "lower_quartile", "upper_quartile"))
    yield Row(
        "physics with loops / bare JSBSim F450 run(), 200 Hz",
        "<= 1.2x",
        f"{ratio:.2f}x (quartiles {low:.2f}-{high:.2f})",
        ratio <= 1.2,
    )


def agent() -> Iterator[Row]:
    """Memory and processor of a companion, n = 8, in real time, from departure on."""
    shares: list[float] = []
    memory_mb: list[float] = []
    before: dict[int, float] = {}
    began_s = 0.0

    def look(f: fly.Flight) -> None:
        nonlocal began_s
        companions = f.lockstep.companions.items()
        processes = {k: psutil.Process(c.process.pid) for k, c in companions}  # type: ignore[attr-defined]
        if not before and f.phase() is SwarmPhase.GATHER:
            before.update({k: sum(p.cpu_times()[:2]) for k, p in processes.items()})
            began_s = time.perf_counter()
        elif before and time.perf_counter() - began_s > 25.0:
            wall_s = time.perf_counter() - began_s
            shares.extend((sum(p.cpu_times()[:2]) - before[k]) / wall_s for k, p in processes.items())
            memory_mb.extend(p.memory_info().rss / 1e6 for p in processes.values())
            raise KeyboardInterrupt

    flight("lone_tree", 8, 1, factor=1.0, watch=look)
    worst_mb = max(memory_mb)
    yield Row("a companion's memory, n = 8", "<= 70 MB resident", f"worst {worst_mb:.1f} MB", worst_mb <= 70.0)
    yield Row(
        "a companion's share of a core in real time, n = 8",
        "<= 2 %",
        spread([100.0 * s for s in shares], " %"),
        statistics.median(shares) <= 0.02,
    )


def front_door() -> Iterator[Row]:
    """The whole of `make fly` once the dependencies are there."""
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.perf_counter()
        command = [sys.executable, "-m", "sim_bridge.cli", "fly", str(EXAMPLES / "lone_tree.toml")]
        subprocess.run([*command, "--out", folder], capture_output=True, check=True)
        seconds = time.perf_counter() - began_s
    yield Row("make fly, dependencies installed, to the verdict", "<= 90 s", f"{seconds:.1f} s", seconds <= 90.0)


def setpoint_gaps(minutes: float) -> Iterator[Row]:
    """One companion by the monotonic clock beside two processes that never rest."""
    for hogs, percent, limit_ms in ((2, 99.9, 100.0), (4, 100.0, 250.0)):
        length = minutes if hogs == 2 else min(minutes, 1.0)
        with tempfile.TemporaryDirectory() as folder:
            gaps = gaps_ms(length, hogs=hogs, folder=Path(folder))
        reached = float(np.percentile(gaps, percent))
        p50, p99, p999, most = (float(np.percentile(gaps, share)) for share in (50.0, 99.0, 99.9, 100.0))
        yield Row(
            f"gaps between setpoints at 20 Hz, {length:g} min, {hogs} CPU hogs",
            f"{'p99.9' if percent < 100.0 else 'most'} < {limit_ms:g} ms",
            f"p50 {p50:.1f}, p99 {p99:.1f}, p99.9 {p999:.1f}, most {most:.1f} ms of {len(gaps)} "
            f"(load average {os.getloadavg()[0]:.1f})",
            reached < limit_ms,
        )


def agent_killed() -> Iterator[Row]:
    """kill -9 of a follower's companion, then of the leader's; on the wall clock, started again as by systemd."""
    done, arrived = [], 0
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            flown, is_there = kills(seed, Path(folder))
        done += flown
        arrived += is_there
    what = f"agent killed (kill -9) at 2 m/s, n = 4, seeds 1-5, {len(done)} kills"
    for name, text, limit_s in (
        ("held_s", "its autopilot holds (mode) by its own failsafe", 1.0),
        ("up_s", "- the agent is up again: its first beacon", 2.0),
        ("rejoined_s", "- rejoined: steered with the swarm", 5.0),
    ):
        seconds = [getattr(kill, name) for kill in done]
        shown = f"{what}: {text}" if name == "held_s" else text
        yield Row(shown, f"<= {limit_s:g} s", spread(seconds, " s"), max(seconds) <= limit_s)
    yield Row("- the vehicle has come to rest (< 0.3 m/s)", "told", spread([k.still_s for k in done], " s"), True)
    yield Row("- the swarm arrives", "5 of 5", f"{arrived} of 5", arrived == 5)


def flight(
    name: str,
    n: int,
    seed: int,
    *,
    factor: float | None = None,
    watch: Callable[[fly.Flight], None] | None = None,
) -> dict[str, Any]:
    """metrics.json's content of one flight."""
    mission: Mission = load_mission(EXAMPLES / f"{name}.toml").with_size(n).with_seed(seed).with_origin(DEFAULT_ORIGIN)
    with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
        return fly.fly(mission, Path(folder), progress, factor=factor, watch=watch).summary


BENCHMARKS: dict[str, Callable[[], Iterator[Row]]] = {
    "lone-tree": lone_tree,
    "paper": paper,
    "leader-killed": leader_killed,
    "election": election,
    "reelection": reelection,
    "agent-killed": agent_killed,
    "physics": physics,
    "agent": agent,
    "front-door": front_door,
}

if __name__ == "__main__":
    sys.exit(main())
