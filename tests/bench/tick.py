"""Where the time of a live companion's tick goes: one companion's exact traffic, replayed warm, cold, and to a process.

Recorded from a flight of lone_tree, n = 8, in transit. Live, a companion sleeps between two ticks, and others have the
processor and its caches meanwhile. What it runs is the same in each case.
"""

from __future__ import annotations

import gc
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from companion.mavlink.endpoint import Endpoint
from mission.document.load import dump_mission, load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.children import ForkClient
from sim_bridge.drive.lockstep.lockstep import CompanionLostError, InProcess
from sim_bridge.drive.lockstep.processes import Launcher, RadioSocket
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.bench.flights import EXAMPLES
from tests.bench.live import cpu_s, point_masses
from tests.bench.table import Row

LISTENED = 3  # the vehicle whose traffic it is
BEFORE_TICKS = 900  # on the ground, assembling and departing: not measured
TICKS = 300
PERIOD_S = 0.05
CACHE_BYTES = 24 << 20  # touched between two ticks: more than a core has to itself

Traffic = list[tuple[float, bytes, bytes]]  # time, from the peers, from the autopilot


def tick() -> Iterator[Row]:
    """CPU time of one tick, in microseconds; each beside the same in one process, at once."""
    mission = load_mission(EXAMPLES / "lone_tree.toml").with_size(8).with_seed(1).with_origin(DEFAULT_ORIGIN)
    traffic = recorded(mission)
    others = np.zeros(CACHE_BYTES, dtype=np.uint8)
    warm_us = replayed(mission, traffic, lambda: None)
    yield Row("a tick, replayed in one process, at once", "told", f"{warm_us:.0f} us", True)
    with tempfile.TemporaryDirectory() as folder, ForkClient() as forks:
        for what, us in (
            (f"- {CACHE_BYTES >> 20} MB touched between ticks", replayed(mission, traffic, lambda: others[::64].sum())),
            ("- asleep between ticks, 20 a second", replayed(mission, traffic, lambda: time.sleep(PERIOD_S))),
            ("a tick of a process, over UDP, at once", as_process(mission, traffic, 0.0, forks, Path(folder))),
            ("- 20 a second", as_process(mission, traffic, PERIOD_S, forks, Path(folder))),
        ):
            yield Row(what, "told", f"{us:.0f} us, {us / warm_us:.1f} times as much", True)
        pages = touched_pages(mission, traffic, forks, Path(folder))
    yield Row("pages of 4 KB that a process touches in a tick", "told", f"median {pages}", True)


class _Noting:
    """A companion in this process whose traffic is kept."""

    def __init__(self, companion: InProcess) -> None:
        self.traffic: Traffic = []
        self.id = companion.id
        self._companion = companion
        self.receive = companion.receive

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self.traffic.append((now_s, from_peers, from_autopilot))
        self._companion.send(from_peers, from_autopilot, now_s, from_sensor)

    def kill(self) -> None:
        self._companion.kill()

    def close(self) -> None:
        self._companion.close()


def recorded(mission: Mission) -> Traffic:
    """What LISTENED receives, tick by tick."""
    world = World(mission, point_masses, links=fly.LINKS)
    companions = [_Noting(InProcess(mission, k)) for k in world.vehicles]
    flight = fly.Flight(mission, list(companions), world, None)
    for _ in range(BEFORE_TICKS + TICKS):
        flight.tick()
    flight.close()
    return companions[LISTENED - 1].traffic


def replayed(mission: Mission, traffic: Traffic, meanwhile: Callable[[], object]) -> float:
    """Median CPU time of a tick in this process, `meanwhile` between two not counted."""
    endpoint = Endpoint(mission, LISTENED)
    endpoint.agent.waive("all")
    gc.collect()
    gc.freeze()
    spent_ns = []
    for now_s, from_peers, from_autopilot in traffic:
        if len(spent_ns) >= BEFORE_TICKS:
            meanwhile()
        began_ns = time.thread_time_ns()
        endpoint.from_peers(from_peers, now_s)
        endpoint.from_autopilot(from_autopilot, now_s)
        endpoint.tick(now_s)
        spent_ns.append(time.thread_time_ns() - began_ns)
    gc.unfreeze()
    return statistics.median(spent_ns[BEFORE_TICKS:]) / 1e3


def as_process(mission: Mission, traffic: Traffic, period_s: float, forks: ForkClient, folder: Path) -> float:
    """Mean CPU time of a tick of a forked companion that gets one each `period_s`."""
    spent_s = 0.0

    def look(pid: int, before: bool) -> None:
        nonlocal spent_s
        spent_s += -cpu_s([pid]) if before else cpu_s([pid])

    _drive(mission, traffic, period_s, forks, folder, (BEFORE_TICKS, len(traffic) - 1), look)
    return 1e6 * spent_s / TICKS


def touched_pages(mission: Mission, traffic: Traffic, forks: ForkClient, folder: Path) -> int:
    """Of a forked companion, in one tick: median over some (Linux, /proc/PID/clear_refs)."""
    counts: list[int] = []

    def look(pid: int, before: bool) -> None:
        if before:
            Path(f"/proc/{pid}/clear_refs").write_text("1")
            return
        lines = Path(f"/proc/{pid}/smaps").read_text().splitlines()
        counts.append(sum(int(line.split()[1]) for line in lines if line.startswith("Referenced:")) // 4)

    for at in range(BEFORE_TICKS, BEFORE_TICKS + TICKS, TICKS // 5):
        _drive(mission, traffic[: at + 1], 0.0, forks, folder, (at, at), look)
    return round(statistics.median(counts))


def _drive(
    mission: Mission,
    traffic: Traffic,
    period_s: float,
    forks: ForkClient,
    folder: Path,
    looks: tuple[int, int],
    look: Callable[[int, bool], None],
) -> None:
    """Replay to a process; `look` (pid, True) before the first tick of `looks`, (pid, False) after the last."""
    file = folder / "mission.toml"
    file.write_text(dump_mission(mission))
    with ExitStack() as stack:
        radio = RadioSocket()
        stack.callback(radio.close)
        (companion,) = Launcher(file, folder, radio, forks).launch([LISTENED], _refuse)
        stack.callback(companion.close)
        for at, (now_s, from_peers, from_autopilot) in enumerate(traffic):
            if at == looks[0]:
                time.sleep(PERIOD_S)  # its work is done
                look(companion.process.pid, True)
            if at >= looks[0]:
                time.sleep(period_s)
            companion.send(from_peers, from_autopilot, now_s)
            companion.receive()
            if at == looks[1]:
                time.sleep(PERIOD_S)
                look(companion.process.pid, False)


def _refuse(lost: CompanionLostError) -> None:
    raise lost
