"""What floods cost a companion: each link, signed and unsigned, beside the same flight without a flood.

`python -m tests.bench floods`: CPU time of single datagrams, the dearest that there are and drawn ones; then a vehicle
in the air whose links are flooded one after the other with 10,000 drawn datagrams a second, from the very address that
its autopilot, its radio and its sensor's driver have. Its neighbour's beacons come by the same radio.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
import psutil

from companion.keys.fleet_folder import file_name, make_fleet
from companion.keys.keyring import OPERATOR
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import end
from sim_bridge.drive.links.hub import split
from sim_bridge.drive.links.ports import Address, bound_socket
from sim_bridge.drive.lockstep.processes import PROGRAM, start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.sensors.table import link_name
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.bench.flood_costs import cost_rows, costs, drawn_rows
from tests.bench.flood_datagrams import FLOODS, frames_of
from tests.bench.options import number
from tests.bench.setpoint_gaps import SETPOINT_ID, TIMESTAMPNS, point_mass, received
from tests.bench.table import Row

RATE_HZ = 10_000
SEED = 25
STEP_S = 0.01
READY_LIMIT_S = 120.0
ORDERED_S = 5.0  # of the world, when the operator of a signed swarm gives its order
SETTLED_S = 5.0  # in the air, before the flood
GAP_MS = 250.0
NICE = -15  # of companion/board/understory-companion.service
DELAY_MAX_S = 0.01  # of a beacon, drawn; more, and two of them are echoed as one
FLOODED, NEIGHBOUR = 1, 2
DRAWN = 256  # datagrams of a flood, sent over and over
PAUSE_S = 8.0  # after each: until the log has said that it is over, and the swarm flies on
SENDER = """
import socket, sys, time
bound = socket.socket(fileno=int(sys.argv[1]))
to = (sys.argv[2], int(sys.argv[3]))
data, rate, for_s = open(sys.argv[4], "rb").read(), float(sys.argv[5]), float(sys.argv[6])
drawn = []
while data:
    size = int.from_bytes(data[:4], "little")
    drawn.append(data[4 : 4 + size])
    data = data[4 + size :]
began = time.monotonic()
sent = lost = 0
while (now := time.monotonic() - began) < for_s:
    while sent < now * rate and time.monotonic() - began < for_s:
        try:
            bound.sendto(drawn[sent % len(drawn)], to)
        except OSError:
            lost += 1
        sent += 1
    time.sleep(0.001)
print(sent - lost)
"""


def mission(*, senses: bool) -> Mission:
    """Two vehicles, steered for as long as it takes. `senses`: with lidars, which cost the simulator most of all."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "floods",
            "route": {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 3600.0},
            "swarm": {"size": 2},
            **({"sensing": {"sensor": "scan-1deg", "range_m": 12.0}} if senses else {}),
        }
    ).with_origin(DEFAULT_ORIGIN)


@dataclass
class Seen:
    """What a flood did."""

    sent: int = 0
    stamps_ns: list[int] = field(default_factory=list)  # of the flooded vehicle's setpoints
    beacons: int = 0  # that its neighbour sent
    heard: set[int] = field(default_factory=set)  # stamps of those that it has said that it heard
    cpu_s: float = 0.0
    log: str = ""

    @property
    def gap_ms(self) -> float:
        """The longest."""
        if len(self.stamps_ns) < 2:
            return float("inf")
        return float(np.diff(np.array(self.stamps_ns, dtype=np.int64)).max()) / 1e6

    @property
    def share(self) -> float:
        """Of its neighbour's beacons that it says that it heard: it echoes one with each of its own."""
        return len(self.heard) / max(1, self.beacons)

    @property
    def lost(self) -> int:
        """Datagrams, by its log."""
        found = re.findall(r"(?:flooded|flood over): (\d+) lost unread", self.log)
        return max(map(int, found), default=0)

    @property
    def is_told(self) -> bool:
        """To the operator: what is in the log as a warning went out as a STATUSTEXT."""
        return re.search(r"warning: .* flooded: \d+ lost unread", self.log) is not None


class Swarm:
    """Two vehicles, their companions as processes, and this process between them."""

    def __init__(self, folder: Path, stack: ExitStack, *, signed: bool, senses: bool) -> None:
        self._mission = mission(senses=senses)
        (folder / "mission.toml").write_text(dump_mission(self._mission))
        if signed:
            make_fleet(folder / "keys", 2)
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self._world = World(self._mission, point_mass, links=links)
        self._autopilots = {k: stack.enter_context(bound_socket("autopilot", 0)) for k in self._world.vehicles}
        self._radio, self._drivers = (stack.enter_context(bound_socket(name, 0)) for name in ("radio", "drivers"))
        for bound in (*self._autopilots.values(), self._radio, self._drivers):
            bound.setsockopt(socket.SOL_SOCKET, TIMESTAMPNS, 1)
        self._at: dict[tuple[str, int], Address] = {}  # by link and vehicle
        self.genuine: dict[str, list[bytes]] = {"autopilot": [], "peers": [], "sensor": []}  # to the flooded one
        self._folder = folder
        self._seen = Seen()
        self._under_way: list[tuple[float, bytes, Address]] = []
        self._rng = random.Random(1)
        self._order_s = 0.0
        self._due_s = time.monotonic()
        sensors = {link_name(self._mission): self._drivers.getsockname()[1]} if senses else {}
        self.children = [
            start_companion(
                k,
                folder / "mission.toml",
                folder / f"companion-{k}.log",
                autopilot_port=self._autopilots[k].getsockname()[1],
                radio_port=self._radio.getsockname()[1],
                sensor_ports=sensors,
                clock="monotonic",
                key_file=folder / "keys" / file_name(k) if signed else None,
            )
            for k in self._world.vehicles
        ]
        stack.callback(end, self.children)
        with suppress(PermissionError):  # as its service has it: on a busy machine the scheduler is measured else
            for child in self.children:
                os.setpriority(os.PRIO_PROCESS, child.pid, NICE)
        self._orders: subprocess.Popen[bytes] | None = None
        self._order = (
            *(*PROGRAM, "order", "start", "--yes", "--key", str(folder / "keys" / file_name(OPERATOR))),
            *(
                "--mission",
                str(folder / "mission.toml"),
                "--peers",
                f"udpout://127.0.0.1:{self._radio.getsockname()[1]}",
            ),
        )
        self._signed = signed

    def take_off(self) -> None:
        """Until it is steered. RuntimeError when it never is."""
        until_s = time.monotonic() + READY_LIMIT_S
        while not self._seen.stamps_ns:
            if time.monotonic() > until_s:
                raise RuntimeError(f"no setpoint within {READY_LIMIT_S:g} s: see {self._folder}")
            self._turn()
        self._run(SETTLED_S)
        if self._orders is not None:
            self._orders.wait()
        self._run(PAUSE_S)

    @property
    def is_steered(self) -> bool:
        """It was given a setpoint within the last pause."""
        return bool(self._seen.stamps_ns) and time.time_ns() - self._seen.stamps_ns[-1] < 1e9

    def flood(self, link: str, drawn: Sequence[bytes], for_s: float) -> Seen:
        """Once it is in the air and steered; none drawn: no flood."""
        log = self._folder / f"companion-{FLOODED}.log"
        written = log.stat().st_size
        seen = self._seen = Seen()
        bound = {"autopilot": self._autopilots[FLOODED], "peers": self._radio, "sensor": self._drivers}[link]
        file = self._folder / "datagrams"
        file.write_bytes(b"".join(len(data).to_bytes(4, "little") + data for data in drawn))
        host, port = self._at[link, FLOODED]
        arguments = (str(bound.fileno()), host, str(port), str(file), str(RATE_HZ if drawn else 0), str(for_s))
        companion = psutil.Process(self.children[FLOODED - 1].pid)
        before = companion.cpu_times()
        command = [sys.executable, "-c", SENDER, *arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, pass_fds=(bound.fileno(),), text=True) as child:
            self._run(for_s)
            after = companion.cpu_times()
            self._run(0.5)
            seen.sent = int(child.communicate()[0])
        self._seen = Seen()
        self._run(PAUSE_S)
        seen.cpu_s = after.user + after.system - before.user - before.system
        seen.log = log.read_text()[written:]
        return seen

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
        """All of each to the others: the operator is one of them."""
        for data, _, address in received(self._radio):
            sender = data[5]
            self._at["peers", sender] = address
            for _, _, beacon in swarm_beacon.beacons(data):
                if sender == FLOODED and beacon.echo == NEIGHBOUR:
                    self._seen.heard.add(beacon.echo_time)
                self._seen.beacons += sender == NEIGHBOUR
            if sender == NEIGHBOUR:
                self._keep("peers", FLOODED, data)
            for (link, receiver), other in self._at.items():
                if link == "peers" and receiver != sender:
                    self._under_way.append((time.monotonic() + self._rng.uniform(0.0, DELAY_MAX_S), data, other))

    def _keep(self, link: str, vehicle: int, data: bytes) -> None:
        if vehicle == FLOODED and len(self.genuine[link]) < DRAWN:
            self.genuine[link].append(data)

    def _step(self) -> None:
        world = self._world
        world.step(STEP_S)
        if not self._seen.stamps_ns and world.now_s - self._order_s > 1.0:
            self._order_s = world.now_s
            if self._signed and world.now_s > ORDERED_S and (self._orders is None or self._orders.poll() is not None):
                self._orders = subprocess.Popen(self._order, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            for k, vehicle in world.vehicles.items():
                vehicle.autopilot.receive(Link.GROUND, operator_order(k, dialect.MAV_CMD_MISSION_START), world.now_s)
        for k, vehicle in world.vehicles.items():
            for datagram in vehicle.autopilot.transmit(Link.ONBOARD, world.now_s):
                self._keep("autopilot", k, datagram)
                if ("autopilot", k) in self._at:
                    self._send(self._autopilots[k], datagram, self._at["autopilot", k])
            for _, data in world.sense(k):
                for datagram in split(data) if ("sensor", k) in self._at else ():
                    self._keep("sensor", k, datagram)
                    self._send(self._drivers, datagram, self._at["sensor", k])

    @staticmethod
    def _send(bound: socket.socket, data: bytes, address: Address) -> None:
        try:
            bound.sendto(data, address)
        except OSError:  # a full buffer
            return


def flood_rows(for_s: float) -> Iterator[Row]:
    """A flight for each link, if it goes on; each flood is beside the part of that flight before any."""
    for (link, signed), draws in FLOODS.items():
        floods = list(draws)
        while floods:
            with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
                swarm = Swarm(Path(folder), stack, signed=signed, senses=link == "sensor")
                swarm.take_off()
                calm = swarm.flood("peers", (), for_s)
                name = f"{'signed' if signed else 'unsigned'}, {link}"
                yield _row(f"{name}: no flood", calm, calm, for_s)
                while floods and swarm.is_steered:  # else the rest floods another flight
                    what = floods.pop(0)
                    rng = random.Random(f"{SEED} {link} {what}")
                    frames = frames_of(swarm.genuine[link])
                    drawn = [draws[what](rng, frames) for _ in range(DRAWN)]
                    yield _row(f"{name}: {what}", swarm.flood(link, drawn, for_s), calm, for_s)


def _row(what: str, seen: Seen, calm: Seen, for_s: float) -> Row:
    each_us = 1e6 * (seen.cpu_s - calm.cpu_s) / seen.sent if seen.sent else 0.0
    told = "told" if seen.is_told else "not told"
    return Row(
        what,
        f"gap < {GAP_MS:g} ms; losses told",
        f"{seen.sent / for_s:.0f}/s; longest gap {seen.gap_ms:.0f} ms ({seen.gap_ms / calm.gap_ms:.2f}); "
        f"CPU {100.0 * seen.cpu_s / for_s:.0f} %, {each_us:.0f} us each; beacons heard {100.0 * seen.share:.0f} % "
        f"({seen.share / max(calm.share, 1e-9):.2f}); {seen.lost} lost unread{f', {told}' if seen.lost else ''}",
        seen.gap_ms < GAP_MS and (seen.is_told or not seen.lost),
    )


def main(argv: Sequence[str]) -> int:
    """0 where all bounds are kept."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench floods", description=__doc__)
    parser.add_argument("--seconds", type=number(0.1, 3600.0), default=8.0, metavar="S", help="of each flood (8)")
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
    for row in chain(cost_rows(), drawn_rows(), () if args.costs else flood_rows(args.seconds)):
        print(row, flush=True)
        reached &= row.reached
    return int(not reached)
