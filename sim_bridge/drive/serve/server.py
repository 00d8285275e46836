"""A world on the wall clock, spoken to over UDP on loopback as one speaks to PX4.

One port for ground stations and all vehicles, one "onboard" port for each vehicle's companion, one port for the
radio between the companions, and one for the drivers of each vehicle's sensors where it has any. One thread: wait
for datagrams until the next step is due, step, send what is due.
"""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from companion.mavlink.peers.session import OPERATOR_ID
from companion.records.record import BASE_ID
from mission.cli.main import EXIT_BAD_FILE
from mission.common.frames import Vec3
from sim_bridge.drive.links.hub import RadioHub, Say, split
from sim_bridge.drive.links.ports import PORT_MAX, Address, Listener, Reader, bound_socket
from sim_bridge.drive.lockstep.harvest import base_place
from sim_bridge.drive.serve.drivers_clock import DriversClock
from sim_bridge.drive.ticks import world_tick
from sim_bridge.errors import StartError
from sim_bridge.judge.tick import Tick
from sim_bridge.world.autopilot import Link
from sim_bridge.world.autopilot.protocols.links import Port
from sim_bridge.world.radio import Radio
from sim_bridge.world.world import Vehicle, World

POLL_MAX_S = 0.1  # how late a signal, or a datagram, may be seen when steps are far apart
STEP_S = 0.01  # PX4's fastest stream has 100 Hz
LAG_MAX_S = 0.25  # wall time that is made up for by stepping faster; what is more is given up
PACE_WINDOW_S = 5.0  # over which the speed reached is measured
PACE_SHARE = 0.95  # of the speed asked for: less is worth a word
CLIENTS_MAX = 16  # on one port
CLIENT_SILENCE_S = 10.0
UNHEARD_STEPS = 50  # between two transmissions on a link without clients: encoding costs more than flying


# --- clients ---


class Clients:
    """Addresses that spoke on one port not long ago, at most `limit`; later ones wait. `now_s`: wall time."""

    __slots__ = ("_heard_s", "_limit", "addresses")

    def __init__(self, fixed: Iterable[Address] = (), limit: int = CLIENTS_MAX) -> None:
        """`fixed` are sent to whether they speak or not."""
        self._heard_s = dict.fromkeys(fixed, math.inf)
        self._limit = limit + len(self._heard_s)
        self.addresses: Sequence[Address] = tuple(self._heard_s)  # to send to

    def note_client(self, address: Address, now_s: float) -> None:
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
    """Schedules the steps, without drift. A machine too slow for it goes on slower. `now_s`: wall time."""

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
    """The ports asked for; 0: any free port."""

    ground: int = 0
    radio: int = 0
    first_onboard: int = 0
    push: Address | None = None  # a ground station that listens
    first_sensor: int | None = None  # None: no sensor has a link


@dataclass(frozen=True, slots=True)
class Ports:
    """Bound, non-blocking sockets on loopback."""

    ground: socket.socket
    radio: socket.socket
    onboard: Mapping[int, socket.socket]  # by vehicle id
    sensors: Mapping[int, socket.socket]  # by vehicle id, of its sensors' drivers; empty: none has a link

    def close(self) -> None:
        """Close all."""
        for bound in (self.ground, self.radio, *self.onboard.values(), *self.sensors.values()):
            bound.close()


def open_ports(plan: PortPlan, ids: Sequence[int]) -> Ports:
    """Bind every port of `plan`; StartError names the one that cannot be had, and what to do."""
    onboard = {vehicle_id: f"--first-port (vehicle {vehicle_id})" for vehicle_id in ids}
    wanted = {"--ground-port": plan.ground, "--radio-port": plan.radio}
    sensors: dict[int, str] = {}
    if plan.first_sensor is not None:
        sensors = {vehicle_id: f"--first-sensor-port (vehicle {vehicle_id})" for vehicle_id in ids}
    for options, first in ((onboard, plan.first_onboard), (sensors, plan.first_sensor)):
        for vehicle_id, option in options.items():
            wanted[option] = first + vehicle_id - 1 if first else 0
    _refuse_collisions(wanted | ({"--ground": plan.push[1]} if plan.push else {}))
    bound: dict[str, socket.socket] = {}
    with contextlib.ExitStack() as opened:
        # The free ones last, or one of them might be a port that was asked for.
        for option, port in sorted(wanted.items(), key=lambda item: item[1] == 0):
            bound[option] = opened.enter_context(bound_socket(option, port, avoid=plan.push))
        opened.pop_all()
    by_vehicle = [{k: bound[option] for k, option in options.items()} for options in (onboard, sensors)]
    return Ports(bound["--ground-port"], bound["--radio-port"], *by_vehicle)


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
        self.hub = RadioHub(ports.radio, *_radios(world), say)
        self.unsent = 0  # datagrams that the kernel did not take
        self._ports = ports
        self._ground = Clients((push,) if push else ())
        pushed = push_onboard or {}
        self._onboard = {k: Clients([pushed[k]] if k in pushed else ()) for k in world.vehicles}
        self._sensors = {k: Clients() for k in ports.sensors}
        self._ground_port = Port(0)  # only to read
        self._steps = 0
        self._drivers_clock = DriversClock(STEP_S)
        for sensor in world.sensors:
            sensor.set_clock(self._drivers_clock.stamp_s)
        self._listener = Listener()
        self._listener.listen(ports.ground, self._from_ground)
        self._listener.listen(ports.radio, self._from_radio)
        for vehicle_id, bound in ports.onboard.items():
            self._listener.listen(bound, self._onboard_reader(vehicle_id))
        for vehicle_id, bound in ports.sensors.items():
            self._listener.listen(bound, self._sensor_reader(vehicle_id))

    def close(self) -> None:
        """Stop listening; the sockets are their owner's to close."""
        self._listener.close()

    def poll(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Wait for datagrams, at most `timeout_s`, and take in what has come."""
        self._listener.poll(timeout_s, clock)

    def run_step(self, pacer: Pacer) -> float | None:
        """Until the next step is due, but at most POLL_MAX_S; then all that has come, and the step. As `Pacer.stepped`.

        It does not wake for each datagram: the world moves only in steps.
        """
        wait_s = pacer.wait_s(time.monotonic())
        if wait_s > 0.0:
            time.sleep(min(wait_s, POLL_MAX_S))
        self.poll(0.0)
        now_s = time.monotonic()
        if pacer.wait_s(now_s) > 0.0:
            return None
        self.step(now_s)
        return pacer.stepped(time.monotonic())

    def step(self, now_s: float) -> None:
        """STEP_S of the world, then everything that is due. `now_s`: wall time."""
        self.world.step(STEP_S)
        self._drivers_clock.note_step(self.world.now_s, now_s)
        self._steps += 1
        if self._steps % round(1.0 / STEP_S) == 0:
            for clients in (self._ground, *self._onboard.values(), *self._sensors.values()):
                clients.forget(now_s)
        for vehicle_id, vehicle in self.world.vehicles.items():
            onboard = self._onboard[vehicle_id].addresses
            self._transmit(vehicle, Link.ONBOARD, self._ports.onboard[vehicle_id], onboard)
            self._transmit(vehicle, Link.GROUND, self._ports.ground, self._ground.addresses)
        self._send_sensed()
        self.hub.deliver(self.world.now_s)

    def tick(self, now_s: float) -> Tick:
        """The world as it stands; a companion that the radio heard not long ago is alive. `now_s`: wall time."""
        alive = [vehicle_id for vehicle_id in self.world.vehicles if self.hub.gate.is_alive(vehicle_id, now_s)]
        return world_tick(self.world, self.hub.transmitter, alive=alive, answered=alive)

    # in

    def _from_ground(self, data: bytes, address: Address, now_s: float) -> None:
        """Each message to the vehicle that it is for; to all without one."""
        self._ground.note_client(address, now_s)
        parts: dict[int, list[bytes]] = {}
        for incoming in self._ground_port.parse_datagram(data):
            target = getattr(incoming.message, "target_system", 0)
            for vehicle_id in self.world.vehicles if target == 0 else (target,):
                parts.setdefault(vehicle_id, []).append(incoming.frame)
        for vehicle_id, its in parts.items():
            vehicle = self.world.vehicles.get(vehicle_id)
            if vehicle:
                vehicle.autopilot.receive(Link.GROUND, b"".join(its), self.world.now_s)

    def _onboard_reader(self, vehicle_id: int) -> Reader:
        clients, autopilot = self._onboard[vehicle_id], self.world.vehicles[vehicle_id].autopilot

        def receive_datagram(data: bytes, address: Address, now_s: float) -> None:
            clients.note_client(address, now_s)
            autopilot.receive(Link.ONBOARD, data, self.world.now_s)

        return receive_datagram

    def _sensor_reader(self, vehicle_id: int) -> Reader:
        """Whatever is sent there: it tells where to send the scans."""
        clients = self._sensors[vehicle_id]

        def receive_datagram(_data: bytes, address: Address, now_s: float) -> None:
            clients.note_client(address, now_s)

        return receive_datagram

    def _from_radio(self, data: bytes, address: Address, now_s: float) -> None:
        self.hub.receive_datagram(data, address, now_s, self.world.now_s)

    # out

    def _transmit(self, vehicle: Vehicle, link: Link, bound: socket.socket, to: Sequence[Address]) -> None:
        if not to and self._steps % UNHEARD_STEPS:
            return
        for datagram in vehicle.autopilot.transmit(link, self.world.now_s):
            for address in to:
                self._send(bound, datagram, address)

    def _send_sensed(self) -> None:
        """From the port of each vehicle's drivers, or forwarded by its autopilot."""
        for vehicle_id in self.world.vehicles:
            for sensor, data in self.world.sense(vehicle_id):
                own = None if sensor.by_autopilot else self._ports.sensors.get(vehicle_id)
                bound = self._ports.onboard[vehicle_id] if own is None else own
                clients = self._onboard[vehicle_id] if own is None else self._sensors[vehicle_id]
                for datagram in split(data) if clients.addresses else ():
                    for address in clients.addresses:
                        self._send(bound, datagram, address)

    def _send(self, bound: socket.socket, data: bytes, address: Address) -> None:
        try:
            bound.sendto(data, address)
        except OSError:  # a full buffer, or a closed port: UDP loses datagrams
            self.unsent += 1


def _radios(world: World) -> tuple[tuple[int, ...], Radio, Callable[[], dict[int, Vec3]]]:
    """Ids of the radios, what is between them, and where they are: the operator's, too; of a survey the base station's.

    `companion order` and `companion base` speak as those, as companions do. The operator walks with the swarm: orders
    can be practised wherever it is, and go on from vehicle to vehicle.
    """
    world.radio.set_range(OPERATOR_ID, math.inf)
    places: dict[int, Vec3] = {}
    if world.mission.keeps_records:
        places[BASE_ID] = base_place(world.mission, world.stand)
        world.radio.set_range(BASE_ID, world.mission.radio.full_range_m)

    def positions() -> dict[int, Vec3]:
        vehicles = world.positions()
        north_m, east_m = (sum(at[axis] for at in vehicles.values()) / len(vehicles) for axis in (0, 1))
        nearest = min(vehicles.values(), key=lambda at: math.hypot(at[0] - north_m, at[1] - east_m))
        return {**vehicles, **places, OPERATOR_ID: nearest}

    return (*world.vehicles, OPERATOR_ID, *places), world.radio, positions
