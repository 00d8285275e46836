"""Hashes of kinds of flights, to show that a change of the code has not changed what flies.

`python -m tests.bench hashes --write FILE` records them before the change, `--against FILE` compares after it. n = 8,
JSBSim, agents in process. Each flight has two hashes: `trace` is that of metrics.json (vehicles, and the bytes of every
beacon); `motion` is of positions, velocities, arming, leaders and phases, and stays when only beacons look otherwise.
Both depend on the machine's floating point: see the head of the recorded table.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import platform
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge import run_folder
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN

EXAMPLES = Path("mission/examples")
SIZE = 8
MOTION = ("time_s", "pos_ned_m", "vel_ned_mps", "on_ground", "armed", "leader", "phase")  # of a Recording
UNKNOWN = "-"
COLUMNS = "# flight seed trace motion simulated_s verdict"
FLIGHTS: dict[str, tuple[str, dict[str, Any]]] = {  # example, keys of [sim]
    "lone_tree": ("lone_tree", {}),
    "paper": ("paper", {}),
    "wind": ("lone_tree", {"wind_mps": (3.0, 2.0, 0.0), "turbulence_mps": 1.0}),
    "loss": ("lone_tree", {"radio_loss": 0.1, "radio_delay_s": 0.05}),
    "ardupilot": ("lone_tree", {"personality": "ardupilot"}),
    "mixed": ("lone_tree", {"personalities": {str(k): "ardupilot" for k in (2, 4, 6, 8)}}),
    "killed": ("lone_tree", {"faults": [{"kind": "kill", "at_s": 45.0}]}),
    "managed_stand": ("managed_stand", {}),
    "natural_stand": ("natural_stand", {}),
    "only_the_leader": ("only_the_leader", {}),
    "natural_killed": ("natural_stand", {"faults": [{"kind": "kill", "phase": "transit", "at_s": 12.0}]}),
    "ranges_killed": ("only_the_leader", {"faults": [{"kind": "kill", "phase": "transit", "at_s": 8.0}]}),
    "natural_parted": (
        "natural_stand",
        {"faults": [{"kind": "partition", "vehicles": [2, 4], "phase": "transit", "at_s": 5.0, "for_s": 20.0}]},
    ),
}


@dataclass(frozen=True, slots=True)
class Hashes:
    """One flight: a line of the table."""

    name: str
    seed: int
    trace: str
    motion: str  # UNKNOWN in a table: not recorded
    sim_time_s: float
    verdict: str

    def __str__(self) -> str:
        return " ".join(map(str, astuple(self)))


def mission(name: str, seed: int) -> Mission:
    """One of FLIGHTS."""
    example, sim = FLIGHTS[name]
    tables = load_mission(EXAMPLES / f"{example}.toml").model_dump(mode="json", by_alias=True)
    tables["swarm"]["size"] = SIZE
    tables["sim"] |= sim
    return Mission.model_validate(tables).with_seed(seed).with_origin(DEFAULT_ORIGIN)


def fly_one(name: str, seed: int) -> Hashes:
    """Fly it, some 10 s of a processor."""
    with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
        summary = fly.fly(mission(name, seed), Path(folder), progress, in_process=True).summary
        recording = run_folder.load(Path(folder))
    motion = hashlib.sha256()
    for column in MOTION:
        motion.update(getattr(recording, column).tobytes())
    return Hashes(
        name, seed, summary["trace_hash"], motion.hexdigest(), summary["sim_time_s"], summary["verdict"].split()[0]
    )


def table(lines: Iterable[Hashes]) -> str:
    """The file, with what the hashes hold for."""
    libc = " ".join(platform.libc_ver()) or platform.system()
    versions = ", ".join(f"{name} {version(name)}" for name in ("jsbsim", "numpy"))
    head = f"""\
# Hashes of flights, n = {SIZE}: python -m tests.bench hashes --write FILE
# On {platform.machine()}, {libc}, Python {platform.python_version()}, {versions}.
# Another processor or libm may round otherwise, and then has hashes of its own.
{COLUMNS}
"""
    return head + "".join(f"{line}\n" for line in sorted(lines, key=lambda one: (one.name, one.seed)))


def read(text: str) -> dict[tuple[str, int], Hashes]:
    """A table, by flight and seed. ValueError with the number of a line that is none."""
    found = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line or line.startswith("#"):
            continue
        try:
            name, seed, trace, motion, sim_time_s, verdict = line.split()
            found[name, int(seed)] = Hashes(name, int(seed), trace, motion, float(sim_time_s), verdict)
        except ValueError:
            raise ValueError(f"line {number}: must be {COLUMNS.removeprefix('# ')}") from None
    return found


def difference(seen: Hashes, recorded: Hashes | None) -> str:
    """What a change has changed, or "equal"."""
    if recorded is None:
        return "not recorded"
    if recorded.motion == UNKNOWN:
        return "equal" if seen.trace == recorded.trace else "ANOTHER FLIGHT, OR OTHER BEACONS"
    if seen == recorded:
        return "equal"
    if seen.motion != recorded.motion:
        return "ANOTHER FLIGHT"
    return "OTHER BEACONS OR MODES, the same motion"


def main(argv: Sequence[str]) -> int:
    """Exit code 1 when a flight differs from `--against`, or is not in it."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench hashes", description=__doc__)
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with a table")
    parser.add_argument("--write", type=Path, metavar="FILE", help="record the flights flown as a table")
    parser.add_argument("--seeds", type=seeds, default=range(1, 6), metavar="A-B", help="seeds A to B, or one (1-5)")
    parser.add_argument(
        "--only", action="append", default=[], choices=FLIGHTS, metavar="NAME", help=f"of {', '.join(FLIGHTS)}"
    )
    parser.add_argument("--jobs", type=int, choices=range(1, 65), default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    try:
        recorded = None if args.against is None else read(args.against.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        parser.error(f"--against {args.against}: {error}")
    flown = []
    with ProcessPoolExecutor(args.jobs) as pool:
        flights = [(name, seed) for seed, name in product(args.seeds, args.only or FLIGHTS)]
        for seen in pool.map(fly_one, *zip(*flights, strict=True)):
            flown.append(seen)
            told = "" if recorded is None else f"  {difference(seen, recorded.get((seen.name, seen.seed)))}"
            print(f"{seen}{told}", flush=True)
    if args.write is not None:
        args.write.write_text(table(flown), encoding="utf-8")
    if recorded is None:
        return 0
    equal = sum(difference(seen, recorded.get((seen.name, seen.seed))) == "equal" for seen in flown)
    print(f"{equal} of {len(flown)} flights equal")
    return 0 if equal == len(flown) else 1


def seeds(text: str) -> range:
    """`A-B` or `A`."""
    first, _, last = text.partition("-")
    if all(part.isascii() and part.isdecimal() for part in (first, last or first)):
        found = range(int(first), int(last or first) + 1)
        if found and found.start >= 1:
            return found
    raise argparse.ArgumentTypeError(f"{text!r}: must be A-B with 1 <= A <= B, or one number")
