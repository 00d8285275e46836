"""Counts which defences acted in flights of the search: `python -m tests.bench defences`.

Flies the missions that `sim-bridge search` draws of these seeds, by the same stack, and looks at every companion in
every tick: the failsafe that decides, the limits that cut its setpoint, what it says, what it dropped or refused. What
is written with `--write` is what docs/reference/hazards.md shows.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import Framing
from companion.mavlink.framing.texts import Reader
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.lab.search.draw import VERSION, draw
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive

NUMBER = re.compile(r"(?<![a-z])\d+(\.\d+)?(, \d+)*")  # not d1
MODE = re.compile(r"mode .*")  # of an autopilot's make


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight, and how often each event happened in it."""

    seed: int
    grade: str
    events: Counter[str]


class Watch:
    """Looks at the companions of one flight after every tick; `events`: onsets, by name."""

    def __init__(self) -> None:
        self.events: Counter[str] = Counter()
        self._now: dict[int, frozenset[str]] = {}  # by vehicle: what is there since
        self._framings: dict[int, tuple[Framing, Reader]] = {}
        self._dropped: dict[int, dict[str, int]] = {}  # by endpoint: one that is started again counts from 0
        self._endpoints: list[Endpoint] = []  # kept, so that no id is given twice
        self.faults: Counter[str] = Counter()

    def check_flight(self, flight: Flight) -> None:
        """After a tick."""
        lockstep = flight.lockstep
        for vehicle, companion in lockstep.companions.items():
            assert isinstance(companion, InProcess)
            if vehicle not in lockstep.from_companion:  # stopped
                continue
            self._read_agent(vehicle, companion.endpoint)
            self._read_texts(vehicle, lockstep.from_companion[vehicle])
        self.faults = Counter(f"fault: {event.kind.value}" for event in flight.faults.happened)

    def conclude(self) -> Counter[str]:
        """All events of the flight."""
        dropped: Counter[str] = Counter()
        for counts in self._dropped.values():
            dropped.update(counts)
        return self.events + self.faults + dropped

    def _read_agent(self, vehicle: int, endpoint: Endpoint) -> None:
        agent = endpoint.agent
        cause = agent.flight.cause
        now = {f"state: {agent.flight.state.name.lower()}"}
        if cause is not None:
            now.add(f"failsafe: {cause.name.lower()}")
        if agent.perception.sees_motion:
            now.add("own motion: corrected by trunks in sight")
        if agent.flight.steers:
            now |= {f"cut: {cut.reason.value}" for cut in agent.setpoint.cuts()}
        self.events.update(now - self._now.get(vehicle, frozenset()))
        self._now[vehicle] = frozenset(now)
        if id(endpoint) not in self._dropped:
            self._endpoints.append(endpoint)
        refused = {f"refused: {reason}": count for reason, count in endpoint.peers.guard.refused.items()}
        self._dropped[id(endpoint)] = refused | {
            "dropped: bad frames of the autopilot": endpoint.autopilot.bad,
            "dropped: beacons of another version": endpoint.codec.other_versions,
            "dropped: messages with invalid values": endpoint.codec.dropped,
        }

    def _read_texts(self, vehicle: int, sent: bytes) -> None:
        wanted = frozenset({dialect.MAVLINK_MSG_ID_STATUSTEXT})
        framing, reader = self._framings.setdefault(vehicle, (Framing(wanted), Reader()))
        for message in framing.parse(sent):
            text = reader.read_text(message)
            if text is not None:
                self.events[f"text: {MODE.sub('mode #', NUMBER.sub('#', text))}"] += 1


def fly_one(job: tuple[int, bool]) -> Flown:
    """Flies the mission of a seed."""
    seed, on_jsbsim = job
    watch = Watch()
    drawn = draw(seed)
    outcome = fly_stack(drawn.mission, None, on_jsbsim=on_jsbsim, watch=watch.check_flight, signed=drawn.signed)
    return Flown(seed, str(outcome.summary["grade"]), watch.conclude())


def table(flown: Sequence[Flown], backend: str) -> dict[str, Any]:
    """The file's content: per event the flights in which it happened, and how often in all."""
    flights: Counter[str] = Counter()
    times: Counter[str] = Counter()
    for one in flown:
        flights.update(event for event, count in one.events.items() if count)
        times.update(one.events)
    first = min(one.seed for one in flown)
    return {
        "command": f"python -m tests.bench defences --backend {backend} --seed {first} --flights {len(flown)}",
        "search_version": VERSION,
        "first_seed": first,
        "flights": len(flown),
        "grades": dict(sorted(Counter(one.grade for one in flown).items())),
        "events": {event: [flights[event], times[event]] for event in sorted(flights)},
    }


def main(argv: Sequence[str]) -> int:
    """Prints a line for each flight, then one for each event."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench defences", description=__doc__)
    parser.add_argument("--flights", type=positive, default=150, metavar="N", help="(150)")
    parser.add_argument(
        "--seed", type=as_seed, default=36000, metavar="S", help="of the first; the others follow (36000)"
    )
    parser.add_argument("--backend", choices=("jsbsim", "point-mass"), default="point-mass", help="(point-mass)")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the counts there, as JSON")
    args = parser.parse_args(argv)
    flown: list[Flown] = []
    jobs = [(seed, args.backend == "jsbsim") for seed in range(args.seed, args.seed + args.flights)]
    with ProcessPoolExecutor(args.jobs) as pool:
        for one in pool.map(fly_one, jobs):
            print(one.seed, one.grade, flush=True)
            flown.append(one)
            if args.write is not None:  # at once: the whole takes long
                args.write.write_text(json.dumps(table(flown, args.backend), indent=1) + "\n", encoding="utf-8")
    found = table(flown, args.backend)
    for event, (flights, times) in found["events"].items():
        print(f"{event}: {times} times in {flights} of {len(flown)} flights")
    return 0
