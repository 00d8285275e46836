"""The figures that the project holds itself to, measured now: `make bench`, or `python -m tests.bench NAME ...`.

Speed depends on the machine: compare ratios and figures of one run. Flights are the same on every machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from mission.common.exit_codes import EXIT_ENVIRONMENT

if find_spec("pytest") is None:  # the kits of tests that are measured with import it
    print("tests.bench: the development tools are missing: `make dev` installs them", file=sys.stderr)
    sys.exit(EXIT_ENVIRONMENT)

import numpy as np

from companion.core.model.states import SwarmPhase
from sim_bridge.judge.progress import Progress
from sim_bridge.options.study import positive
from tests.bench import (
    bad_radio,
    black_box,
    cloud,
    defences,
    encounters,
    floods,
    gaps,
    hashes,
    insiders,
    layers,
    lost_fixes,
    meetings,
    orders,
    own_motion,
    quorum_losses,
    shared_trunks,
    signed_radio,
    speed,
    spoofing,
    stand_figures,
    stand_flights,
    stand_map,
    stand_until,
    survey,
    survey_fits,
    survey_lanes,
    trunks,
)
from tests.bench.agent import agent
from tests.bench.election import Course, Lied, all_lied, courses
from tests.bench.flights import SEEDS, leader_killed, lone_tree, paper, quick_start
from tests.bench.live import live
from tests.bench.live_map import live_map
from tests.bench.options import number
from tests.bench.other_simulators import other_simulators
from tests.bench.page import TABLE_HEAD, section, with_section
from tests.bench.planted_defects import planted_defects
from tests.bench.raw_scans import raw_scans
from tests.bench.records import records
from tests.bench.reelection import SMALL_MAH, TERM_S, watched
from tests.bench.restarts import kills
from tests.bench.robustness import ROBUSTNESS, robustness
from tests.bench.safety_filter import safety_filter
from tests.bench.setpoint_gaps import gaps_ms
from tests.bench.table import Row, spread
from tests.bench.tick import tick
from tests.unit.core.core_election_net import acting_within, failover_within, overlap_within

# Benchmarks with options of their own.
PROGRAMS = {
    "bad-radio": bad_radio.main,
    "black-box": black_box.main,
    "defences": defences.main,
    "encounters": encounters.main,
    "hashes": hashes.main,
    "insiders": insiders.main,
    "layers": layers.main,
    "floods": floods.main,
    "gaps": gaps.main,
    "lost-fixes": lost_fixes.main,
    "meetings": meetings.main,
    "orders": orders.main,
    "own-motion": own_motion.main,
    "quorum-losses": quorum_losses.main,
    "shared-trunks": shared_trunks.main,
    "signed-radio": signed_radio.main,
    "spoofing": spoofing.main,
    "stand-figures": stand_figures.main,
    "stand-flights": stand_flights.main,
    "stand-map": stand_map.main,
    "cloud": cloud.main,
    "stand-until": stand_until.main,
    "survey": survey.main,
    "survey-fits": survey_fits.main,
    "survey-lanes": survey_lanes.main,
    "trunks": trunks.main,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 when a figure was not reached."""
    argv = sys.argv[1:] if argv is None else argv
    if argv[:1] and argv[0] in PROGRAMS:
        return PROGRAMS[argv[0]](argv[1:])
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench",
        description=__doc__,
        epilog=about(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which of those below")
    parser.add_argument("--write", type=Path, metavar="FILE", help="put each table into its section of this page")
    parser.add_argument(
        "--beside", type=Path, metavar="PATH", help="of speed: another checkout flies in turn with this"
    )
    parser.add_argument("--minutes", type=number(0.1, 600.0), default=10.0, metavar="M", help="of setpoint-gaps (10)")
    hard = parser.add_argument_group("robustness")
    hard.add_argument(
        "--only", action="append", default=[], choices=ROBUSTNESS, metavar="KIND", help=f"of {', '.join(ROBUSTNESS)}"
    )
    hard.add_argument("--seeds", type=positive, metavar="N", help="seeds 1 to N (20; bias: 10)")
    hard.add_argument(
        "--n", type=positive, action="append", default=[], metavar="N", help="vehicles (6 and 8), also of live"
    )
    hard.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once, and of safety-filter (2)")
    args = parser.parse_args(argv)
    benchmarks = BENCHMARKS | {
        "speed": partial(speed.speed, args.beside and args.beside.resolve()),
        "table1": speed.table1,
        "setpoint-gaps": partial(setpoint_gaps, args.minutes),
        "safety-filter": partial(safety_filter, args.jobs),
        "live": partial(live, args.n),
        "map": live_map,
        "planted-defects": planted_defects,
        "tick": tick,
        "raw-scans": raw_scans,
        "records": records,
        "robustness": partial(robustness, args.only, seeds=args.seeds, sizes=args.n, jobs=args.jobs),
    }
    unknown = [name for name in args.names if name not in benchmarks]
    if unknown:
        parser.error(f"{', '.join(unknown)}: must be of {', '.join(benchmarks)}")
    print("\n".join(TABLE_HEAD), flush=True)
    reached = True
    for name in args.names or BENCHMARKS:
        rows = []
        measured = benchmarks[name]()
        while (row := _next(measured, f"{name}, row {len(rows) + 1}")) is not None:
            rows.append(row)
            print(row, flush=True)
            reached &= row.reached
        if args.write is not None:  # at once: the whole takes long
            before = args.write.read_text(encoding="utf-8") if args.write.exists() else ""
            args.write.write_text(with_section(before, name, section(name, rows), list(benchmarks)), encoding="utf-8")
    return 0 if reached else 1


def _next(measured: Iterator[Row], what: str) -> Row | None:
    """The next row, with signs of life until it is there; None: there is no more."""
    with Progress(sys.stderr) as signs, signs.working(what):
        return next(measured, None)


def about() -> str:
    """What each benchmark measures, a line each."""
    usual = [f"  {name:14} {ABOUT[name]}" for name in ABOUT if name in BENCHMARKS]
    named = [f"  {name:14} {ABOUT[name]}" for name in ABOUT if name not in BENCHMARKS]
    return "\n".join(("without a NAME all of these:", *usual, "", "only when named:", *named))


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


ABOUT = {
    "speed": "processor time of a flight over that of the bare airframe, and how it grows with n",
    "large-swarms": "whole flights of 50 and 100 vehicles",
    "other-simulators": "one task flown here and in other simulators (make other-simulators)",
    "lone-tree": "that example with 4, 8 and 12 vehicles: arrival, links, separation, coverage",
    "paper": "the paper's own flight, the same figures",
    "leader-killed": "the leader's process is killed in transit: another takes over, the swarm arrives",
    "election": "random graphs, losses and lies: agreement, failover, merges, two that act at once",
    "reelection": "a leader with a small battery hands over in flight: what that costs",
    "agent-killed": "companions are killed and started again: hold, restart, rejoining",
    "physics": "our quadrotor with its loops over the bare airframe",
    "agent": "a companion's processor time and memory, to start and in flight",
    "quick-start": "the whole of make fly",
    "table1": "the wall time of make table1",
    "setpoint-gaps": "gaps between setpoints at 20 Hz beside programs that never rest (--minutes)",
    "safety-filter": "a million inputs to the safety filter: does any break a promise (--jobs)",
    "live": "companions as processes in real time: how many this machine carries (--n)",
    "map": "what a live map costs its flight, and how fast its page draws",
    "tick": "where the time of a companion's tick goes",
    "raw-scans": "what a turn of each class of obstacle sensor costs the simulator and a companion",
    "records": "records: how many reach the base station, how soon, and what beacons lose by it",
    "robustness": "kills, partitions, wrong estimates, late telemetry: does the swarm arrive (--only ...)",
    "planted-defects": "after how many flights sim-bridge search finds a defect that is put into a copy",
    "black-box": "faulted flights replayed bit for bit, and the cost of recording: see black-box --help",
    "gaps": "swarms that must all pass one gap in a closed wall of trunks, there and back: see gaps --help",
    "meetings": "two and three vehicles that meet at one gap: how long they hold one another up: see meetings --help",
    "encounters": "two vehicles that do not hear each other meet: how near they come: see encounters --help",
    "orders": "orders of the operator's key, forged, replayed, in floods, and how fast one spreads: see orders --help",
    "floods": "datagrams of 64 KiB, and 10,000 a second on each link: CPU, gaps between setpoints, beacons lost",
    "lost-fixes": "vehicles that lose their GNSS fix among trees, sent ODOMETRY or not: see lost-fixes --help",
    "insiders": "one member whose beacons lie, and what comes of it for the others: see insiders --help",
    "own-motion": "errors of velocity, heading and place by scans beside the reported ones: see own-motion --help",
    "quorum-losses": "how often a leader has no majority by lost beacons alone: see quorum-losses --help",
    "shared-trunks": "relative errors with trunks shared and without, false alignments: see --help",
    "signed-radio": "frames forged or sent again, by the million; what signing costs: see signed-radio --help",
    "spoofing": "own positions that jump, freeze, drift: what is noticed, and false alarms: see spoofing --help",
    "stand-figures": "a stand's figures of drawn and real stands against the truth: see stand-figures --help",
    "cloud": "how far the point cloud of a flight that surveyed lies from the true bark: see cloud --help",
    "stand-flights": "fused stem maps of drawn flights, leader-only GNSS too, against the trees: see --help",
    "stand-map": "the fused stem map of a flight that surveyed against its trees: see stand-map --help",
    "stand-until": "surveys that stop by the interval of their basal area: see stand-until --help",
    "survey": "stems measured by a lidar of each class against the bridge's trees: see survey --help",
    "survey-fits": "our fits of stems beside a library's on the same clouds: see survey-fits --help",
    "survey-lanes": "one stand surveyed by one vehicle and by eight: area a minute: see survey-lanes --help",
    "trunks": "contacts with trunks by estimates as recorded, by class of sensor: see trunks --help",
    "defences": "which failsafes and limits acted in flights of sim-bridge search: see defences --help",
    "bad-radio": "beacons lost, late or cut off: what is said, who counts as silent: see bad-radio --help",
    "layers": "parts that do not hear each other, with layers of height and without: see layers --help",
    "hashes": "what flies, as hashes, to compare two versions: see hashes --help",
}
BENCHMARKS: dict[str, Callable[[], Iterator[Row]]] = {
    "speed": partial(speed.speed, None),
    "large-swarms": speed.large_swarms,
    "other-simulators": other_simulators,
    "lone-tree": lone_tree,
    "paper": paper,
    "leader-killed": leader_killed,
    "election": election,
    "reelection": reelection,
    "agent-killed": agent_killed,
    "physics": physics,
    "agent": agent,
    "quick-start": quick_start,
}

if __name__ == "__main__":
    sys.exit(main())
