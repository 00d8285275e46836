"""`sim-bridge serve`: a world on the wall clock, spoken to over UDP on loopback as one speaks to PX4.

One port for ground stations and all vehicles, one "onboard" port for each vehicle's companion, one port for the
radio between the companions. One thread: wait for datagrams until the next step is due, step, send what is due.
"""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import json
import math
import os
import shlex
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from mission import simulator
from mission.cli import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.fields import MAX_VEHICLES
from mission.frames import enu_to_ned
from mission.load import MAX_PLACE_CHARS, dump_mission, load_mission
from mission.model import Mission, Personality
from mission.problems import MissionError, printable
from sim_bridge.drive.hub import RadioHub, Say, place
from sim_bridge.drive.ports import LOOPBACK, PORT_MAX, Address, Listener, Reader, bound_socket
from sim_bridge.drive.ticks import world_tick
from sim_bridge.errors import StartError
from sim_bridge.judge.tick import Tick
from sim_bridge.world.airframe.base import AirframeError
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.wind import Wind
from sim_bridge.world.autopilot import PROFILES, Link, StreamProfile
from sim_bridge.world.autopilot.links import Port
from sim_bridge.world.world import DEFAULT_ORIGIN, AirframeFactory, Vehicle, World

SPEED_MIN, SPEED_MAX = 0.01, 100.0
STEP_S = 0.01  # PX4's fastest stream has 100 Hz
LAG_MAX_S = 0.25  # wall time that is made up for by stepping faster; what is more is given up
PACE_WINDOW_S = 5.0  # over which the speed reached is measured
PACE_SHARE = 0.95  # of the speed asked for: less is worth a word
POLL_MAX_S = 0.1  # how late a signal may be seen when steps are far apart
STREAMS = {"px4": PROFILES, "minimal": dict.fromkeys(Link, StreamProfile.MINIMAL)}
TAKEOFF_NOTES = {
    Personality.PX4: "PX4: takeoff altitudes are above sea level",
    Personality.ARDUPILOT: "ArduPilot: takeoff altitudes are above home; it can be armed after about 42 s",
}
CLIENTS_MAX = 16  # on one port
CLIENT_SILENCE_S = 10.0
UNHEARD_STEPS = 50  # nobody listens: encoding a vehicle's streams costs more than flying it


# --- who is at the other end ---


class Clients:
    """Addresses that spoke on one port not long ago, at most `limit`; later ones wait. `now_s`: wall time."""

    __slots__ = ("_heard_s", "_limit", "addresses")

    def __init__(self, fixed: Iterable[Address] = (), limit: int = CLIENTS_MAX) -> None:
        """`fixed` are sent to whether they speak or not."""
        self._heard_s = dict.fromkeys(fixed, math.inf)
        self._limit = limit + len(self._heard_s)
        self.addresses: Sequence[Address] = tuple(self._heard_s)  # to send to

    def hear(self, address: Address, now_s: float) -> None:
        """`address` has spoken."""
        known = self._heard_s.get(address)
        if known is not None:
            self._heard_s[address] = max(known, now_s)
        elif len(self._heard_s) < self._limit:
            self._heard_s[address] = now_s
            self.addresses = tuple(self._heard_s)

    def forget(self, now_s: float) -> None:
        """Drop those silent for CLIENT_SILENCE_S."""
        silent = [a for a, heard_s in self._heard_s.items() if now_s - heard_s > CLIENT_SILENCE_S]
        if silent:
            for address in silent:
                del self._heard_s[address]
            self.addresses = tuple(self._heard_s)


# --- time ---


class Pacer:
    """When the next step is due, without drift. A machine too slow for it goes on slower. `now_s`: wall time."""

    def __init__(self, now_s: float, speed: float) -> None:
        self._period_s = STEP_S / speed
        self._due_s = now_s
        self._window_s = now_s
        self._steps = 0
        self._slow = False

    def wait_s(self, now_s: float) -> float:
        """Until the next step is due; 0 or less: now."""
        return self._due_s - now_s

    def stepped(self, now_s: float) -> float | None:
        """A step was made. Once, when the speed asked for is not reached: the share of it that is."""
        self._due_s = max(self._due_s + self._period_s, now_s - LAG_MAX_S)
        self._steps += 1
        elapsed_s = now_s - self._window_s
        if elapsed_s < PACE_WINDOW_S:
            return None
        share = self._steps * self._period_s / elapsed_s
        self._window_s, self._steps = now_s, 0
        if share >= PACE_SHARE or self._slow:
            return None
        self._slow = True
        return share


# --- the ports ---


@dataclass(frozen=True, slots=True)
class PortPlan:
    """What was asked for; 0: any free port."""

    ground: int = 0
    radio: int = 0
    first_onboard: int = 0
    push: Address | None = None  # a ground station that listens


@dataclass(frozen=True, slots=True)
class Ports:
    """Bound, non-blocking sockets on loopback."""

    ground: socket.socket
    radio: socket.socket
    onboard: Mapping[int, socket.socket]  # by vehicle id

    def close(self) -> None:
        """Close all."""
        for bound in (self.ground, self.radio, *self.onboard.values()):
            bound.close()


def open_ports(plan: PortPlan, ids: Sequence[int]) -> Ports:
    """Bind every port of `plan`; StartError names the one that cannot be had, and what to do."""
    onboard = {vehicle_id: f"--first-port (vehicle {vehicle_id})" for vehicle_id in ids}
    wanted = {"--ground-port": plan.ground, "--radio-port": plan.radio}
    for vehicle_id, option in onboard.items():
        wanted[option] = plan.first_onboard + vehicle_id - 1 if plan.first_onboard else 0
    _refuse_collisions(wanted | ({"--ground": plan.push[1]} if plan.push else {}))
    bound: dict[str, socket.socket] = {}
    with contextlib.ExitStack() as opened:
        # The free ones last, or one of them might be a port that was asked for.
        for option, port in sorted(wanted.items(), key=lambda item: item[1] == 0):
            bound[option] = opened.enter_context(bound_socket(option, port, avoid=plan.push))
        opened.pop_all()
    return Ports(bound["--ground-port"], bound["--radio-port"], {k: bound[o] for k, o in onboard.items()})


def _refuse_collisions(wanted: Mapping[str, int]) -> None:
    """`wanted`: option -> port; 0: any."""
    taken: dict[int, str] = {}
    for option, port in wanted.items():
        if port > PORT_MAX:
            raise StartError(f"{option}: no port {port}: must be at most {PORT_MAX}", EXIT_BAD_FILE)
        if port in taken:
            raise StartError(f"{option}: port {port} is {taken[port]}'s: choose others", EXIT_BAD_FILE)
        if port:
            taken[port] = option


# --- the server ---


class Server:
    """A world and its sockets. `poll` takes in what has come; `step` moves the world and sends what is due."""

    def __init__(
        self,
        world: World,
        ports: Ports,
        *,
        push: Address | None = None,
        push_onboard: Mapping[int, Address] | None = None,
        say: Say,
    ) -> None:
        """`push`: a ground station, and `push_onboard`: by vehicle, a companion, that are sent to unasked."""
        self.world = world
        self.hub = RadioHub(ports.radio, world.vehicles, world.radio, world.positions, say)
        self.unsent = 0  # datagrams that the kernel did not take
        self._ports = ports
        self._ground = Clients((push,) if push else ())
        pushed = push_onboard or {}
        self._onboard = {k: Clients([pushed[k]] if k in pushed else ()) for k in world.vehicles}
        self._ground_port = Port(0)  # only to read
        self._steps = 0
        self._listener = Listener()
        self._listener.listen(ports.ground, self._from_ground)
        self._listener.listen(ports.radio, self._from_radio)
        for vehicle_id, bound in ports.onboard.items():
            self._listener.listen(bound, self._onboard_reader(vehicle_id))

    def close(self) -> None:
        """Stop listening; the sockets are their owner's to close."""
        self._listener.close()

    def poll(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Wait for datagrams, at most `timeout_s`, and take in what has come."""
        self._listener.poll(timeout_s, clock)

    def step(self, now_s: float) -> None:
        """STEP_S of the world, then everything that is due. `now_s`: wall time."""
        self.world.step(STEP_S)
        self._steps += 1
        if self._steps % round(1.0 / STEP_S) == 0:
            for clients in (self._ground, *self._onboard.values()):
                clients.forget(now_s)
        for vehicle_id, vehicle in self.world.vehicles.items():
            onboard = self._onboard[vehicle_id].addresses
            self._transmit(vehicle, Link.ONBOARD, self._ports.onboard[vehicle_id], onboard)
            self._transmit(vehicle, Link.GROUND, self._ports.ground, self._ground.addresses)
        self.hub.deliver(self.world.now_s)

    def tick(self, now_s: float) -> Tick:
        """The world as it stands; a companion that the radio heard not long ago is alive. `now_s`: wall time."""
        alive = [vehicle_id for vehicle_id in self.world.vehicles if self.hub.gate.is_alive(vehicle_id, now_s)]
        return world_tick(self.world, self.hub.transmitter, alive=alive, answered=alive)

    # in

    def _from_ground(self, data: bytes, address: Address, now_s: float) -> None:
        """Each message to the vehicle that it is for; to all without one."""
        self._ground.hear(address, now_s)
        parts: dict[int, list[bytes]] = {}
        for incoming in self._ground_port.read(data):
            target = getattr(incoming.message, "target_system", 0)
            for vehicle_id in self.world.vehicles if target == 0 else (target,):
                parts.setdefault(vehicle_id, []).append(incoming.frame)
        for vehicle_id, its in parts.items():
            vehicle = self.world.vehicles.get(vehicle_id)
            if vehicle:
                vehicle.autopilot.receive(Link.GROUND, b"".join(its), self.world.now_s)

    def _onboard_reader(self, vehicle_id: int) -> Reader:
        clients, autopilot = self._onboard[vehicle_id], self.world.vehicles[vehicle_id].autopilot

        def read(data: bytes, address: Address, now_s: float) -> None:
            clients.hear(address, now_s)
            autopilot.receive(Link.ONBOARD, data, self.world.now_s)

        return read

    def _from_radio(self, data: bytes, address: Address, now_s: float) -> None:
        self.hub.read(data, address, now_s, self.world.now_s)

    # out

    def _transmit(self, vehicle: Vehicle, link: Link, bound: socket.socket, to: Sequence[Address]) -> None:
        if not to and self._steps % UNHEARD_STEPS:
            return
        for datagram in vehicle.autopilot.transmit(link, self.world.now_s):
            for address in to:
                self._send(bound, datagram, address)

    def _send(self, bound: socket.socket, data: bytes, address: Address) -> None:
        try:
            bound.sendto(data, address)
        except OSError:  # a full buffer, or nobody there any more: UDP loses datagrams
            self.unsent += 1


# --- the command ---

_ABOUT = """\
Flies the vehicles of a mission on the wall clock and offers them over UDP on 127.0.0.1 as PX4 does: to ground
stations (QGroundControl, MAVProxy, MAVSDK) and to companions. Prints where to connect; ends with Ctrl-C.
"""
_EXAMPLE = """\
example:
  sim-bridge serve mission/examples/paper.toml -n 3 --ground 127.0.0.1:14550

exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a bad mission, 3 a taken port or a missing package
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `serve`."""
    parser.description = _ABOUT
    parser.epilog = _EXAMPLE
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("mission", metavar="MISSION", help="a mission file (TOML)")
    parser.add_argument("-n", type=int, metavar="N", help=f"number of vehicles, 1..{MAX_VEHICLES} (the mission's)")
    parser.add_argument("--seed", type=int, metavar="S", help="of placement, wind and radio (the mission's)")
    parser.add_argument(
        "--personality",
        choices=[personality.value for personality in Personality],
        help="of every autopilot, instead of the mission's sim.personality and sim.personalities",
    )
    parser.add_argument(
        "--speed",
        type=_speed,
        default=1.0,
        metavar="FACTOR",
        help=f"simulated over wall time, {SPEED_MIN:g}..{SPEED_MAX:g} (1); MAVSDK's own timers want 1",
    )
    parser.add_argument(
        "--ground-port",
        type=_port,
        default=0,
        metavar="P",
        help="for ground stations that connect (a free one)",
    )
    parser.add_argument(
        "--ground",
        type=_loopback,
        metavar="HOST:PORT",
        help="a ground station that listens on this machine, as QGroundControl at 127.0.0.1:14550 (none)",
    )
    parser.add_argument(
        "--first-port", type=_port, default=0, metavar="P", help="vehicle 1's, then counting up (free ones)"
    )
    parser.add_argument(
        "--onboard-to",
        type=_onboard_to,
        metavar="HOST:PORT[+]",
        help="send every vehicle's onboard stream there unasked, as PX4 does; with a + the port counts up (nowhere)",
    )
    parser.add_argument(
        "--streams",
        choices=STREAMS,
        default="px4",
        help="as PX4 by default (400 messages a second for each companion), or only what is asked for (px4)",
    )
    parser.add_argument(
        "--radio-port", type=_port, default=0, metavar="P", help="for the companions' beacons (a free one)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="where to write the mission as flown, for the companions (a temporary file)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, when ready")


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; returns the exit code."""
    plan = PortPlan(args.ground_port, args.radio_port, args.first_port, args.ground)
    try:
        mission = _mission(args)
        with _Stop() as stop, contextlib.ExitStack() as stack:
            ports = open_ports(plan, range(1, mission.swarm.size + 1))
            stack.callback(ports.close)
            world = World(mission, _quads(mission), links=STREAMS[args.streams])
            mission_file = stack.enter_context(_written(mission, args.out))
            onboard = args.onboard_to.of(world.vehicles) if args.onboard_to else None
            server = Server(world, ports, push=args.ground, push_onboard=onboard, say=_to_stderr)
            stack.callback(server.close)
            notice = _notice(mission, mission_file, ports, args.speed)
            print(json.dumps(notice) if args.json else _table(notice, args.ground), flush=True)
            _serve(server, args.speed, stop)
    except MissionError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except StartError as error:
        _to_stderr(str(error))
        return error.exit_code
    except AirframeError as error:
        _to_stderr(str(error))
        return EXIT_ENVIRONMENT
    return EXIT_DONE


def _serve(server: Server, speed: float, stop: _Stop) -> None:
    pacer = Pacer(time.monotonic(), speed)
    while not stop.asked:
        server.poll(min(pacer.wait_s(time.monotonic()), POLL_MAX_S))
        now_s = time.monotonic()
        if pacer.wait_s(now_s) > 0.0:
            continue
        server.step(now_s)
        share = pacer.stepped(time.monotonic())
        if share is not None:
            _to_stderr(f"this machine reaches {share * speed:.2f} x real time, not {speed:g}: going on at that")


class _Stop:
    """SIGINT and SIGTERM ask to stop; they no longer interrupt."""

    def __init__(self) -> None:
        self.asked = False
        self._before: list[tuple[signal.Signals, Any]] = []

    def __enter__(self) -> _Stop:
        self._before = [(n, signal.signal(n, self._ask)) for n in (signal.SIGINT, signal.SIGTERM)]
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True


def _to_stderr(message: str) -> None:
    print(f"sim-bridge serve: {message}", file=sys.stderr, flush=True)


def _mission(args: argparse.Namespace) -> Mission:
    mission = load_mission(args.mission)
    if args.personality is not None:
        mission = mission.with_personality(args.personality)
    if args.n is not None:
        mission = mission.with_size(args.n, place="-n")
    if args.seed is not None:
        mission = mission.with_seed(args.seed)
    simulator.check(mission, str(args.mission))
    return mission if mission.origin else mission.with_origin(DEFAULT_ORIGIN)


def _quads(mission: Mission) -> AirframeFactory:
    wind = Wind(enu_to_ned(mission.sim.wind_mps), mission.sim.turbulence_mps)
    drag = mission.sim.drag
    return lambda frame, place, seed: JsbsimQuad(frame, place, 0.0, seed=seed, wind=wind, drag=drag)


@contextlib.contextmanager
def _written(mission: Mission, out: Path | None) -> Iterator[Path]:
    """The mission as flown, in `out`, or in a temporary file for as long as it is served."""
    with contextlib.ExitStack() as stack:
        try:
            if out is None:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="understory-"))
                out = Path(folder, "mission.toml")
            out.write_text(dump_mission(mission), encoding="utf-8")
        except OSError as error:
            place = printable(str(out or tempfile.gettempdir()), MAX_PLACE_CHARS)
            reason = os.strerror(error.errno or 0)
            raise StartError(f"--out: cannot write {place}: {reason}", EXIT_ENVIRONMENT) from None
        yield out.absolute()


def _notice(mission: Mission, mission_file: Path, ports: Ports, speed: float) -> dict[str, Any]:
    """Where to connect: what --json prints."""

    def port(bound: socket.socket) -> int:
        number: int = bound.getsockname()[1]
        return number

    def url(bound: socket.socket) -> str:
        return f"udpout://{LOOPBACK}:{port(bound)}"

    return {
        "name": mission.name,
        "pid": os.getpid(),
        "mission": str(mission_file),
        "seed": mission.sim.seed,
        "speed": speed,
        "ground_amsl_m": None if mission.origin is None else mission.origin.alt_m,
        "host": LOOPBACK,
        "ground": {
            "port": port(ports.ground),
            "mavsdk": url(ports.ground),
            "mavproxy": f"--master=udpout:{LOOPBACK}:{port(ports.ground)}",
        },
        "radio": {"port": port(ports.radio)},
        "vehicles": [
            {
                "id": vehicle_id,
                "personality": mission.sim.personality_of(vehicle_id).value,
                "port": port(bound),
                "mavsdk": url(bound),
                "mavproxy": f"--master=udpout:{LOOPBACK}:{port(bound)}",
                "companion": [
                    *(_program("companion"), "run", "--mission", str(mission_file), "--id", str(vehicle_id)),
                    *("--autopilot", url(bound), "--peers", url(ports.radio), "--waive", "all"),
                ],
            }
            for vehicle_id, bound in ports.onboard.items()
        ],
    }


def _table(notice: Mapping[str, Any], push: Address | None) -> str:
    """The same for people, ready to paste."""
    vehicles = notice["vehicles"]
    ground = notice["ground"]
    count = "1 vehicle" if len(vehicles) == 1 else f"{len(vehicles)} vehicles"
    rows = [(f"vehicle {v['id']}", v["mavsdk"], v["mavproxy"]) for v in vehicles]
    rows.insert(0, ("all, ground side", ground["mavsdk"], ground["mavproxy"]))
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    lines = [
        f"{notice['name'] or 'unnamed mission'}: {count}, seed {notice['seed']}, "
        f"{notice['speed']:g} x real time; Ctrl-C ends it",
        "",
        f"{'':{widths[0]}}  {'MAVSDK':{widths[1]}}  mavproxy.py",
        *(f"{name:{widths[0]}}  {mavsdk:{widths[1]}}  {mavproxy}" for name, mavsdk, mavproxy in rows),
        "",
        f"a ground station that listens: {place(push) if push else 'none (--ground HOST:PORT)'}",
        "",
        "companions, each in a shell of its own:",
        *(f"  {shlex.join(v['companion'])}" for v in vehicles),
        "",
        "they wait for an operator; from MAVProxy on the ground side, for one of them (it tells the others):",
        "  set target_component 191",
        "  long MISSION_START 0 0 0 0 0 0 0",
        f"the ground is at {notice['ground_amsl_m']:g} m above sea level",
        *(TAKEOFF_NOTES[Personality(name)] for name in sorted({v["personality"] for v in vehicles}, reverse=True)),
    ]
    return "\n".join(lines)


def _program(name: str) -> str:
    """How to call one of our programs from the shell that started this one."""
    beside = Path(sys.argv[0]).parent / name
    return name if shutil.which(name) or not beside.is_file() else str(beside)


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not SPEED_MIN <= speed <= SPEED_MAX:  # false for NaN
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be {SPEED_MIN:g}..{SPEED_MAX:g}")
    return speed


def _port(text: str) -> int:
    port = int(text) if text.isascii() and text.isdecimal() and len(text) <= 5 else 0
    if not 1 <= port <= PORT_MAX:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be 1..{PORT_MAX}")
    return port


@dataclass(frozen=True, slots=True)
class _OnboardTo:
    """One address for all vehicles, or vehicle 1's of a row."""

    first: Address
    counts_up: bool

    def of(self, ids: Iterable[int]) -> dict[int, Address]:
        """By vehicle id. StartError when the row does not end in time."""
        host, port = self.first
        addresses = {k: (host, port + k - 1 if self.counts_up else port) for k in ids}
        if any(number > PORT_MAX for _, number in addresses.values()):
            raise StartError(f"--onboard-to: port {port} and up is too high for so many vehicles", EXIT_BAD_FILE)
        return addresses


def _onboard_to(text: str) -> _OnboardTo:
    return _OnboardTo(_loopback(text.removesuffix("+")), text.endswith("+"))


def _loopback(text: str) -> Address:
    """HOST:PORT, with a host that is this machine: the bridge speaks to no other."""
    host, _, port = text.rpartition(":")
    try:
        address = socket.gethostbyname(host)
    except (OSError, UnicodeError):
        address = ""
    if not address or not ipaddress.ip_address(address).is_loopback:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be on this machine, as 127.0.0.1:14550")
    return address, _port(port)
