"""Companions as processes in real time, on this machine, beside the bridge and its physics.

Served: each companion ticks by its own clock, as on a board. How many hold 20 Hz, what each costs, what is short.
In lockstep at real time, as `sim-bridge fly --speed 1`: how long an answer takes.
"""

from __future__ import annotations

import fcntl
import gc
import os
import statistics
import struct
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from mission.common.frames import Vec3
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.children import Child, ForkClient, end
from sim_bridge.drive.links.ports import Address, Reader
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys, key_files
from sim_bridge.drive.lockstep.lockstep import CompanionLostError
from sim_bridge.drive.lockstep.processes import CompanionProcess, Launcher, RadioSocket, start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.drive.serve.server import Pacer, PortPlan, Ports, Server, open_ports
from sim_bridge.world.airframe.base import AirframeFactory
from sim_bridge.world.airframe.jsbsim_quad import jsbsim_airframes
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S, World
from tests.bench.table import Row

SIZES = (8, 20, 50, 60, 100, 200)
POINT_MASSES_FROM = 50  # vehicles: from here on also with airframes that cost next to nothing
WINDOW_S = 20.0  # of wall time, with all in the air
PREPARE_LIMIT_S = 90.0  # of wall time until all have setpoints; then it is measured with those that have
GAP_LIMIT_MS = 75.0  # p99: half a tick late
ENOUGH_GAPS = 0.9  # of those that 20 Hz has: fewer, and a companion does not hold it
SIOCGSTAMPNS = 0x8907  # linux/sockios.h: when the kernel took the datagram that was read last
STAMP = struct.Struct("@ll")  # seconds, nanoseconds
SETPOINT_ID = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED.to_bytes(3, "little")


def flight_of(n: int) -> Mission:
    """`n` vehicles on a grid, under way for as long as it takes."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "live",
            "route": {"d1_enu_m": (0, 0, 10), "d2_enu_m": (2000, 0, 10), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 0.0, "radius_m": max(15.0, 1.5 * n)},
            "swarm": {"size": n},
            "sim": {"placement": "grid", "placement_spacing_m": 8.0, "seed": 1},
        }
    ).with_origin(DEFAULT_ORIGIN)


def point_masses(_frame: object, pos_ned_m: Vec3, _seed: int) -> PointMass:
    """Airframes without JSBSim."""
    return PointMass(pos_ned_m, 0.0)


@dataclass(frozen=True, slots=True)
class Lived:
    """What a window of WINDOW_S has shown."""

    n: int
    gaps_ms: tuple[NDArray[np.float64], ...]  # between setpoints, for each companion
    agent_share: float  # of a core, mean
    bridge_share: float
    speed: float  # simulated over wall time
    private_mb: tuple[float, ...]  # for each companion, at the end
    start_s: float  # from the first fork to the last companion's first beacon
    window_s: float

    @property
    def holding(self) -> int:
        """Companions that hold 20 Hz."""
        enough = ENOUGH_GAPS * 20.0 * self.window_s
        return sum(bool(len(gaps) >= enough and np.percentile(gaps, 99) < GAP_LIMIT_MS) for gaps in self.gaps_ms)

    def gives_way(self) -> str:
        """What is short, in words."""
        busy = self.bridge_share + self.n * self.agent_share
        bridge = f"bridge {100 * self.bridge_share:.0f} % of a core, at {self.speed:.2f}x real time"
        return f"{bridge}; all: {busy:.2f} of {os.cpu_count()} cores"


class _StampingServer(Server):
    """Notes when the kernel took each setpoint."""

    def __init__(self, world: World, ports: Ports) -> None:
        self.stamps_ns: dict[int, list[int]] = {k: [] for k in world.vehicles}
        super().__init__(world, ports, say=lambda _: None)

    def _onboard_reader(self, vehicle_id: int) -> Reader:
        read, stamps_ns = super()._onboard_reader(vehicle_id), self.stamps_ns[vehicle_id]
        bound = self._ports.onboard[vehicle_id]

        def read_and_note(data: bytes, address: Address, now_s: float) -> None:
            if SETPOINT_ID in data:
                stamps_ns.append(stamp_ns(bound.fileno()))
            read(data, address, now_s)

        return read_and_note


def stamp_ns(fd: int) -> int:
    """When the kernel took the datagram that was last read from this socket, CLOCK_REALTIME."""
    seconds, nanoseconds = STAMP.unpack(fcntl.ioctl(fd, SIOCGSTAMPNS, bytes(STAMP.size)))
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def live_together(n: int, airframes: AirframeFactory | None, folder: Path) -> Lived:
    """One window of `n` companions that a `Server` serves. `airframes`: JSBSim's by default."""
    mission = flight_of(n)
    with ExitStack() as stack:
        forks = stack.enter_context(ForkClient())
        world = World(mission, airframes or jsbsim_airframes(mission), links=fly.LINKS)
        ports = open_ports(PortPlan(), list(world.vehicles))
        stack.callback(ports.close)
        server = _StampingServer(world, ports)
        stack.callback(server.close)
        file = folder / "mission.toml"
        file.write_text(dump_mission(mission))
        agents: dict[int, Child] = {}
        stack.callback(lambda: end(list(agents.values())))
        began_s = time.monotonic()
        for k in world.vehicles:
            agents[k] = start_companion(
                k,
                file,
                folder / f"companion-{k}.log",
                autopilot_port=ports.onboard[k].getsockname()[1],
                radio_port=ports.radio.getsockname()[1],
                clock="monotonic",
                program=forks,
            )
        gc.collect()
        gc.freeze()
        stack.callback(gc.unfreeze)
        run = _Run(server)
        start_s = run.take_off(began_s)
        for stamps in server.stamps_ns.values():
            stamps.clear()
        pids = [child.pid for child in agents.values()]
        before_s, bridge_before_s = cpu_s(pids), cpu_s([os.getpid()])
        sim_before_s, wall_before_s = world.now_s, time.monotonic()
        run.until_s(wall_before_s + WINDOW_S)
        window_s = time.monotonic() - wall_before_s
        return Lived(
            n,
            tuple(
                np.diff(np.array(stamps, dtype=np.int64)).astype(np.float64) / 1e6
                for stamps in server.stamps_ns.values()
            ),
            (cpu_s(pids) - before_s) / window_s / n,
            (cpu_s([os.getpid()]) - bridge_before_s) / window_s,
            (world.now_s - sim_before_s) / window_s,
            tuple(private_mb(pid) for pid in pids),
            start_s,
            window_s,
        )


class _Run:
    """Makes time pass, as `sim-bridge serve` does."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._pacer = Pacer(time.monotonic(), 1.0)

    def step(self) -> None:
        self._server.run_step(self._pacer)

    def until_s(self, end_s: float) -> None:
        while time.monotonic() < end_s:
            self.step()

    def take_off(self, began_s: float) -> float:
        """Until all have setpoints, or PREPARE_LIMIT_S; seconds from `began_s` to the last first beacon."""
        world, heard = self._server.world, self._server.hub.transmitter.said
        start_s = float("nan")
        ordered_s = -1.0
        assert isinstance(self._server, _StampingServer)
        while time.monotonic() - began_s < PREPARE_LIMIT_S and not all(self._server.stamps_ns.values()):
            self.step()
            if len(heard) == len(world.vehicles) and start_s != start_s:
                start_s = time.monotonic() - began_s
            waiting = [k for k in world.vehicles if k not in heard or heard[k].flight_state == FlightState.WAITING]
            late = time.monotonic() - began_s > PREPARE_LIMIT_S / 2.0
            if (not waiting or late) and world.now_s - ordered_s > 1.0:
                ordered_s = world.now_s
                for k, vehicle in world.vehicles.items():
                    order = operator_order(k, dialect.MAV_CMD_MISSION_START)
                    vehicle.autopilot.receive(Link.GROUND, order, world.now_s)
        return start_s


class _Timed:
    """A companion whose answers are timed: from its telemetry, handed to the kernel, to its setpoint, arrived there."""

    def __init__(self, companion: CompanionProcess) -> None:
        self.ms: list[float] = []
        self.process = companion.process
        self._companion = companion
        self._sent_ns = 0

    @property
    def id(self) -> int:
        return self._companion.id

    def send(self, from_peers: bytes, from_autopilot: bytes, now_s: float, from_sensor: bytes = b"") -> None:
        self._sent_ns = time.time_ns()
        self._companion.send(from_peers, from_autopilot, now_s, from_sensor)

    def receive(self) -> tuple[bytes, bytes]:
        answer = self._companion.receive()
        if SETPOINT_ID in answer[1]:
            self.ms.append((stamp_ns(self._companion.fileno()) - self._sent_ns) / 1e6)
        return answer

    def kill(self) -> None:
        self._companion.kill()

    def close(self) -> None:
        self._companion.close()


@dataclass(frozen=True, slots=True)
class Answered:
    """Lockstep at real time, over WINDOW_S."""

    ms: NDArray[np.float64]  # (N,) telemetry to setpoint
    agent_share: float  # of a core, mean
    private_mb: tuple[float, ...]
    start_s: float  # from the launch to the last companion's first word; the world is made meanwhile
    late_ticks: int  # of the bridge: more than 75 ms after the one before


def answers_of(n: int, folder: Path, *, signed: bool = False) -> Answered:
    """One window of `n` companions, all with setpoints, as `sim-bridge fly --speed 1` drives them."""
    mission = flight_of(n)
    file = folder / "mission.toml"
    file.write_text(dump_mission(mission))
    keys = FleetKeys(mission) if signed else None
    with ExitStack() as stack:
        began_s = time.perf_counter()
        forks = stack.enter_context(ForkClient())
        world = World(mission, jsbsim_airframes(mission), links=fly.LINKS)
        radio = RadioSocket()
        stack.callback(radio.close)
        launcher = Launcher(file, folder, radio, forks, key_file=key_files(keys, folder / "keys"))
        companions = [_Timed(c) for c in launcher.launch(list(world.vehicles), _refuse)]
        start_s = time.perf_counter() - began_s
        keyholder = None if keys is None else keys.operator(world)
        flight = fly.Flight(mission, list(companions), world, folder, keyholder=keyholder)
        stack.callback(flight.close)
        gc.collect()
        gc.freeze()
        stack.callback(gc.unfreeze)
        while not all(c.ms for c in companions):
            flight.tick()
        for c in companions:
            c.ms.clear()
        pids = [c.process.pid for c in companions]
        before, due_s, ended_s, late = cpu_s(pids), time.perf_counter(), time.perf_counter(), 0
        for _ in range(round(WINDOW_S / TICK_S)):
            flight.tick()
            late += time.perf_counter() - ended_s > GAP_LIMIT_MS / 1e3
            due_s += TICK_S
            time.sleep(max(0.0, due_s - time.perf_counter()))
            ended_s = time.perf_counter()
        return Answered(
            np.concatenate([c.ms for c in companions]),
            (cpu_s(pids) - before) / WINDOW_S / n,
            tuple(private_mb(pid) for pid in pids),
            start_s,
            late,
        )


def _refuse(lost: CompanionLostError) -> None:
    raise lost


def live(sizes: Sequence[int] = ()) -> Iterator[Row]:
    """The rows of `sizes` (SIZES)."""
    with tempfile.TemporaryDirectory() as folder:
        yield from answer_rows(8, answers_of(8, Path(folder)))
    for n in sizes or SIZES:
        for name, airframes in (("JSBSim", None), ("point masses", point_masses)):
            if airframes is None or n >= POINT_MASSES_FROM:
                with tempfile.TemporaryDirectory() as folder:
                    yield from live_rows(f"live, served, n = {n}, {name}", live_together(n, airframes, Path(folder)))


def answer_rows(n: int, seen: Answered) -> Iterator[Row]:
    """Telemetry to setpoint."""
    p50_ms, p99_ms, most_ms = np.percentile(seen.ms, [50, 99, 100])
    what = f"live, lockstep at real time, n = {n}, forked"
    shown = f"p50 {p50_ms:.2f}, p99 {p99_ms:.2f}, most {most_ms:.2f} ms of {len(seen.ms)}; {seen.late_ticks} ticks late"
    yield Row(f"{what}: telemetry to setpoint", "p50 <= 1, p99 <= 5 ms", shown, bool(p50_ms <= 1.0 and p99_ms <= 5.0))
    percent, private_mb = 100.0 * seen.agent_share, max(seen.private_mb)
    yield Row("- a companion's share of a core", "<= 0.5 %", f"{percent:.2f} %", percent <= 0.5)
    yield Row("- private memory in flight", "<= 5 MB", f"worst {private_mb:.1f} MB", private_mb <= 5.0)
    yield Row("- start, all of them, with the world", "told", f"{seen.start_s:.2f} s", True)


def live_rows(what: str, seen: Lived) -> Iterator[Row]:
    """One window."""
    gaps_ms = np.concatenate(seen.gaps_ms)
    p50, p99, most = np.percentile(gaps_ms, [50, 99, 100]) if len(gaps_ms) else (np.inf,) * 3
    wanted = min(seen.n, 60)
    shown = f"{seen.holding} of {seen.n}; gaps p50 {p50:.1f}, p99 {p99:.1f}, most {most:.1f} ms"
    yield Row(f"{what}: hold 20 Hz (p99 < {GAP_LIMIT_MS:g} ms)", f">= {wanted}", shown, seen.holding >= wanted)
    yield Row("- what is short", "told", seen.gives_way(), True)
    cost = f"{100 * seen.agent_share:.2f} % of a core, {statistics.median(seen.private_mb):.1f} MB of its own (median)"
    yield Row("- a companion", "told", f"{cost}; all heard {seen.start_s:.2f} s after the first fork", True)


def cpu_s(pids: Sequence[int]) -> float:
    """CPU time of these processes so far, user and system, in seconds."""
    return sum(int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) for pid in pids) / 1e9


def private_mb(pid: int) -> float:
    """Memory that no other process shares, written to or not (Private_Dirty and Private_Clean), in MB."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in rollup if line.startswith("Private_")) / 1e3
