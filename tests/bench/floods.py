"""What floods cost a companion: the dearest datagrams that there are, and 10,000 a second on each of its links.

`python -m tests.bench floods`: first CPU time of datagrams of 64 KiB, and of the longest that is read, on each link;
then a vehicle in the air whose links are flooded one by one, from the very address that its autopilot, its radio and
its sensor's driver have. Its neighbour's beacons come by the same radio.
"""

from __future__ import annotations

import argparse
import random
import re
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
import psutil

from companion.mavlink import dialect
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import end
from sim_bridge.drive.links.hub import split
from sim_bridge.drive.links.ports import Address, bound_socket
from sim_bridge.drive.lockstep.processes import start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.sensors.table import link_name
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.bench.flood_costs import cost_rows, costs
from tests.bench.setpoint_gaps import SETPOINT_ID, TIMESTAMPNS, point_mass, received
from tests.bench.table import Row
from tests.fuzz.mutations import DATAGRAM_MAX

RATE_HZ = 10_000
STEP_S = 0.01
READY_LIMIT_S = 120.0
SETTLED_S = 5.0  # in the air, before the flood
GAP_MS = 250.0
DELAY_MAX_S = 0.05  # of a beacon, drawn
FLOODED = 1  # the vehicle; 2 is its neighbour
SENDER = """
import socket, sys, time
bound = socket.socket(fileno=int(sys.argv[1]))
to = (sys.argv[2], int(sys.argv[3]))
data, rate, for_s = open(sys.argv[4], "rb").read(), float(sys.argv[5]), float(sys.argv[6])
began = time.monotonic()
sent = lost = 0
while (now := time.monotonic() - began) < for_s:
    while sent < now * rate and time.monotonic() - began < for_s:
        try:
            bound.sendto(data, to)
        except OSError:
            lost += 1
        sent += 1
    time.sleep(0.001)
print(sent - lost)
"""


def mission() -> Mission:
    """Two vehicles with obstacle sensors, steered for as long as it takes."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "floods",
            "route": {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 3600.0},
            "swarm": {"size": 2},
            "sensing": {"sensor": "scan-1deg", "range_m": 12.0},
        }
    ).with_origin(DEFAULT_ORIGIN)


@dataclass
class Seen:
    """What a flood did."""

    sent: int = 0
    stamps_ns: list[int] = field(default_factory=list)  # of the flooded vehicle's setpoints
    cpu: float = 0.0  # share of one core
    log: str = ""

    @property
    def gap_ms(self) -> float:
        """The longest."""
        return float(np.diff(np.array(self.stamps_ns, dtype=np.int64)).max()) / 1e6

    @property
    def reported(self) -> str:
        """What the flight log says of it."""
        found = [re.findall(rf"\] (.*{word}.*)", self.log)[-1:] for word in ("flooded", "flood over")]
        return "; ".join(line for lines in found for line in lines) or "nothing lost"


class Swarm:
    """Two vehicles, their companions as processes, and this process between them."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._mission = mission()
        (folder / "mission.toml").write_text(dump_mission(self._mission))
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self._world = World(self._mission, point_mass, links=links)
        self._autopilots = {k: stack.enter_context(bound_socket("autopilot", 0)) for k in self._world.vehicles}
        self._radio, self._drivers = (stack.enter_context(bound_socket(name, 0)) for name in ("radio", "drivers"))
        for bound in (*self._autopilots.values(), self._radio, self._drivers):
            bound.setsockopt(socket.SOL_SOCKET, TIMESTAMPNS, 1)
        self._at: dict[tuple[str, int], Address] = {}  # by link and vehicle
        self._folder = folder
        self._seen = Seen()
        self._under_way: list[tuple[float, bytes, Address]] = []
        self._rng = random.Random(1)
        self._order_s = 0.0
        self._due_s = time.monotonic()
        sensor = link_name(self._mission)
        self.children = [
            start_companion(
                k,
                folder / "mission.toml",
                folder / f"companion-{k}.log",
                autopilot_port=self._autopilots[k].getsockname()[1],
                radio_port=self._radio.getsockname()[1],
                sensor_ports={sensor: self._drivers.getsockname()[1]},
                clock="monotonic",
            )
            for k in self._world.vehicles
        ]
        stack.callback(end, self.children)

    def flood(self, link: str, data: bytes, for_s: float) -> Seen:
        """Once it is in the air and steered. RuntimeError when it never is."""
        until_s = time.monotonic() + READY_LIMIT_S
        while not self._seen.stamps_ns:
            if time.monotonic() > until_s:
                raise RuntimeError(f"no setpoint within {READY_LIMIT_S:g} s: see {self._folder}")
            self._turn()
        self._run(SETTLED_S)
        self._seen = Seen()
        bound = {"autopilot": self._autopilots[FLOODED], "peers": self._radio, "sensor": self._drivers}[link]
        file = self._folder / "datagram"
        file.write_bytes(data)
        host, port = self._at[link, FLOODED]
        arguments = (str(bound.fileno()), host, str(port), str(file), str(RATE_HZ if data else 0), str(for_s))
        companion = psutil.Process(self.children[FLOODED - 1].pid)
        before = companion.cpu_times()
        command = [sys.executable, "-c", SENDER, *arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, pass_fds=(bound.fileno(),), text=True) as child:
            self._run(for_s)
            after = companion.cpu_times()
            self._run(2.0)
            self._seen.sent = int(child.communicate()[0])
        self._run(6.0)  # until the log has said that it is over
        self._seen.cpu = (after.user + after.system - before.user - before.system) / for_s
        self._seen.log = (self._folder / f"companion-{FLOODED}.log").read_text()
        return self._seen

    def _run(self, for_s: float) -> None:
        until_s = time.monotonic() + for_s
        while time.monotonic() < until_s:
            self._turn()

    def _turn(self) -> None:
        sockets = [*self._autopilots.values(), self._radio, self._drivers]
        select.select(sockets, (), (), max(0.0, self._due_s - time.monotonic()))
        for k, bound in self._autopilots.items():
            for data, stamp_ns, address in received(bound):
                self._at["autopilot", k] = address
                if k == FLOODED and SETPOINT_ID in data:
                    self._seen.stamps_ns.append(stamp_ns)
                self._world.vehicles[k].autopilot.receive(Link.ONBOARD, data, self._world.now_s)
        self._relay()
        now_s = time.monotonic()
        for _, data, address in [one for one in self._under_way if one[0] <= now_s]:
            self._send(self._radio, data, address)
        self._under_way = [one for one in self._under_way if one[0] > now_s]
        for data, _, address in received(self._drivers):
            self._at["sensor", data[5]] = address
        if time.monotonic() >= self._due_s:
            self._due_s = max(self._due_s + STEP_S, time.monotonic() - 0.25)
            self._step()

    def _relay(self) -> None:
        """Beacons of each to the other."""
        for data, _, address in received(self._radio):
            sender = data[5]
            self._at["peers", sender] = address
            other = self._at.get(("peers", 3 - sender))
            if other is not None:  # at any time of its tick
                self._under_way.append((time.monotonic() + self._rng.uniform(0.0, DELAY_MAX_S), data, other))

    def _step(self) -> None:
        world = self._world
        world.step(STEP_S)
        if not self._seen.stamps_ns and world.now_s - self._order_s > 1.0:
            self._order_s = world.now_s
            for k, vehicle in world.vehicles.items():
                vehicle.autopilot.receive(Link.GROUND, operator_order(k, dialect.MAV_CMD_MISSION_START), world.now_s)
        for k, vehicle in world.vehicles.items():
            for datagram in vehicle.autopilot.transmit(Link.ONBOARD, world.now_s):
                if ("autopilot", k) in self._at:
                    self._send(self._autopilots[k], datagram, self._at["autopilot", k])
            for _, data in world.sense(k):
                for datagram in split(data) if ("sensor", k) in self._at else ():
                    self._send(self._drivers, datagram, self._at["sensor", k])

    @staticmethod
    def _send(bound: socket.socket, data: bytes, address: Address) -> None:
        try:
            bound.sendto(data, address)
        except OSError:  # a full buffer
            return


def flood_rows(for_s: float) -> Iterator[Row]:
    """One flight for each flood."""
    for link in ("none", "peers", "autopilot", "sensor"):
        for what, data in datagrams_of(link):
            with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
                seen = Swarm(Path(folder), stack).flood("peers" if link == "none" else link, data, for_s)
            yield Row(
                f"{link}: {what}, {for_s:g} s" if data else "no flood",
                f"no gap of {GAP_MS:g} ms",
                f"{seen.sent / for_s:.0f}/s; longest gap {seen.gap_ms:.0f} ms of {len(seen.stamps_ns)} setpoints; "
                f"CPU {100.0 * seen.cpu:.0f} %; log: {seen.reported}",
                seen.gap_ms < GAP_MS,
            )


def datagrams_of(link: str) -> Iterator[tuple[str, bytes]]:
    """What a link is flooded with."""
    if link == "none":
        yield "", b""
        return
    yield "one byte", b"\0"
    worst = next(cost for cost in costs(DATAGRAM_MAX_BYTES) if cost.link == link)
    yield f"the dearest of {len(worst.data)} bytes ({worst.name})", worst.data
    yield "64 KiB", bytes(DATAGRAM_MAX)


def main(argv: Sequence[str]) -> int:
    """0 where all bounds are kept."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench floods", description=__doc__)
    parser.add_argument("--seconds", type=float, default=25.0, metavar="S", help="of each flood (25)")
    parser.add_argument(
        "--costs", action="store_true", help="only what single datagrams cost, the dearest 20 of each link"
    )
    args = parser.parse_args(argv)
    if args.costs:
        for link in ("peers", "autopilot", "sensor"):
            for cost in [one for one in costs(DATAGRAM_MAX_BYTES) if one.link == link][:20]:
                print(f"{cost.read_ms:7.2f} ms, tick {cost.tick_ms:6.2f} ms  {link}: {cost.name}")
    print("| what | wanted | seen | reached |\n|---|---|---|---|")
    reached = True
    for row in chain(cost_rows(), () if args.costs else flood_rows(args.seconds)):
        print(row, flush=True)
        reached &= row.reached
    return int(not reached)
