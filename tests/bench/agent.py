"""What a companion costs: to start, executed and forked, and in flight."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.core.model.states import SwarmPhase
from mission.document.load import dump_mission, load_mission
from sim_bridge.drive import fly
from sim_bridge.drive.children import ForkClient
from sim_bridge.drive.lockstep.lockstep import CompanionLostError
from sim_bridge.drive.lockstep.processes import PROGRAM, Launcher, RadioSocket
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.flights import EXAMPLES, STUDIES, flight
from tests.bench.live import cpu_s, private_mb
from tests.bench.table import Row, spread

STARTS = 9
LIMIT_MB = {"executed": 12.0, "forked": 5.0}
RAW = {"sensor": "scan-1deg", "range_m": 12.0, "rate_hz": 10.0}
WATCHED_S = 25.0  # of flight: a busy machine may take longer for it


@dataclass(frozen=True, slots=True)
class Started:
    """A companion that has said its first word."""

    cpu_s: float  # user and system
    private_mb: float


def agent() -> Iterator[Row]:
    """A start, alone; then memory and processor in real time, in the open and among trees."""
    executed, forked = starts()
    seen = spread([s.cpu_s for s in executed], " s")
    reached = statistics.median(s.cpu_s for s in executed) <= 0.3
    yield Row("a companion's start, executed: CPU time to its first word", "<= 0.3 s", seen, reached)
    yield memory_row("executed", "at its first word", [s.private_mb for s in executed])
    seen = spread([1e3 * s.cpu_s for s in forked], " ms")
    reached = statistics.median(s.cpu_s for s in forked) <= 0.3
    yield Row("a companion's start, forked: CPU time to its first word", "<= 0.3 s", seen, reached)
    yield memory_row("forked", "at its first word", [s.private_mb for s in forked])
    shares, memory_mb = in_flight("lone_tree", 8, EXAMPLES, SwarmPhase.GATHER)
    yield memory_row("forked", "in flight, n = 8", memory_mb)
    yield share_row("n = 8", shares, most=0.005)
    shares, _ = in_flight("through_trees", 12, STUDIES, SwarmPhase.TRANSIT)
    yield share_row("n = 12, on the way through 400 trees/ha, sectors", shares, most=0.03)
    shares, _ = in_flight("through_trees", 12, STUDIES, SwarmPhase.TRANSIT, RAW)
    yield share_row("the same, raw scans of 1 degree, 10 turns a second", shares, most=0.03)


def memory_row(how: str, when: str, found_mb: Sequence[float]) -> Row:
    """Of its own: what nobody shares, written to or not."""
    limit_mb = LIMIT_MB[how]
    seen = spread(found_mb, " MB")
    return Row(f"a companion's private memory, {how}, {when}", f"<= {limit_mb:g} MB", seen, max(found_mb) <= limit_mb)


def share_row(what: str, shares: Sequence[float], *, most: float) -> Row:
    """Of a core, for each companion."""
    seen, reached = spread([100.0 * s for s in shares], " %"), statistics.median(shares) <= most
    return Row(f"a companion's share of a core in real time, {what}", f"<= {100.0 * most:g} %", seen, reached)


def starts() -> tuple[list[Started], list[Started]]:
    """Executed and forked, in turn."""
    with tempfile.TemporaryDirectory() as name, ForkClient() as forks:
        folder = Path(name)
        file = folder / "mission.toml"
        file.write_text(dump_mission(load_mission(EXAMPLES / "lone_tree.toml").with_origin(DEFAULT_ORIGIN)))
        _start(file, forks, executed=False)  # for the first one the server loads the mission
        pairs = [(_start(file, forks, executed=True), _start(file, forks, executed=False)) for _ in range(STARTS)]
    return [e for e, _ in pairs], [f for _, f in pairs]


def _start(file: Path, forks: ForkClient, *, executed: bool) -> Started:
    with ExitStack() as stack:
        radio = RadioSocket()
        stack.callback(radio.close)
        (companion,) = Launcher(file, file.parent, radio, forks, {1: PROGRAM} if executed else {}).launch([1], _refuse)
        stack.callback(companion.close)
        return Started(cpu_s([companion.process.pid]), private_mb(companion.process.pid))


def in_flight(
    name: str, n: int, folder: Path, phase: SwarmPhase, sensing: Mapping[str, Any] | None = None
) -> tuple[list[float], list[float]]:
    """Of each companion, WATCHED_S long from `phase` on: CPU time a second of flight; then its private memory, MB."""
    before_s: dict[int, float] = {}
    shares: list[float] = []
    memory_mb: list[float] = []
    began_s = 0.0

    def look(f: fly.Flight) -> None:
        nonlocal began_s
        pids = {k: c.process.pid for k, c in f.lockstep.companions.items()}  # type: ignore[attr-defined]
        if not before_s and f.phase() is phase:
            before_s.update({k: cpu_s([pid]) for k, pid in pids.items()})
            began_s = f.world.now_s
        elif before_s and f.world.now_s - began_s > WATCHED_S:
            flown_s = f.world.now_s - began_s
            shares.extend((cpu_s([pid]) - before_s[k]) / flown_s for k, pid in pids.items())
            memory_mb.extend(private_mb(pid) for pid in pids.values())
            raise KeyboardInterrupt

    flight(name, n, 1, folder=folder, factor=1.0, watch=look, sensing=sensing)
    return shares, memory_mb


def _refuse(lost: CompanionLostError) -> None:
    raise lost
