"""Between N external autopilots and their companions: links told apart by system id, whatever ports they share.

An autopilot is known by a valid HEARTBEAT of its vehicle's system id and component 1; from then on, frames go to the
address that it came from, while it lives. Frames are passed on unmodified; no bytes from outside raise.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Container, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from companion.mavlink import dialect
from companion.mavlink.framing import frames
from companion.mavlink.framing.frames import Framing
from mission.cli.main import EXIT_BAD_FILE, EXIT_ENVIRONMENT
from mission.common.problems import printable
from sim_bridge.drive.links.hub import Say, place
from sim_bridge.drive.links.ports import PORT_MAX, Address, bound_socket
from sim_bridge.errors import StartError
from sim_bridge.options.ports import PORT_FIELD as PORT_FIELD

AUTOPILOT_ALIVE_S = 3.0  # three heartbeats
_URL = re.compile(r"(udpin|udpout)://([A-Za-z0-9.-]{1,253}):([0-9]{1,5}|\{port\})")
HEARD = frozenset(
    {
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        dialect.MAVLINK_MSG_ID_HOME_POSITION,
    }
)


class Way(StrEnum):
    """The side that sends first."""

    IN = "udpin"  # the autopilots send to a port of ours
    OUT = "udpout"  # we send to theirs


@dataclass(frozen=True, slots=True)
class Url:
    """Address of the autopilots. `port` None: {port}, one for each vehicle; else all share it."""

    way: Way
    host: str  # IPv4
    port: int | None


def parse_url(text: str) -> Url:
    """ValueError in words."""
    match = _URL.fullmatch(text)
    shown = repr(printable(text))
    if match is None:
        raise ValueError(f"{shown}: must be udpin://HOST:PORT or udpout://HOST:PORT, where PORT may be {PORT_FIELD}")
    port = None if match[3] == PORT_FIELD else int(match[3])
    if port is not None and not 1 <= port <= PORT_MAX:
        raise ValueError(f"{shown}: the port must be 1..{PORT_MAX}")
    try:
        host = socket.gethostbyname(match[2])
    except (OSError, UnicodeError):
        raise ValueError(f"{shown}: no such host") from None
    if Way(match[1]) is Way.OUT and host == "0.0.0.0":
        raise ValueError(f"{shown}: 0.0.0.0 is no address to send to")
    return Url(Way(match[1]), host, port)


@dataclass(frozen=True, slots=True)
class AutopilotSockets:
    """One socket for each port in use, and each vehicle's."""

    ports: Mapping[int, int]  # by vehicle id: ours, or for `udpout` the autopilot's
    bound: Mapping[int, socket.socket]  # by vehicle id; shared ones stand there several times
    targets: Mapping[int, Address]  # `udpout`: where to send before anything is heard

    def close(self) -> None:
        """Close all."""
        for bound in self.bound.values():
            bound.close()


def open_sockets(url: Url, ids: Iterable[int], first_port: int) -> AutopilotSockets:
    """`first_port`: vehicle 1's {port}; 0: free ones. StartError names a port that cannot be had."""
    with ExitStack() as opened:
        ports: dict[int, int] = {}
        sockets: dict[int, socket.socket] = {}
        by_port: dict[int, socket.socket] = {}
        for vehicle_id in ids:
            port = url.port or (first_port + vehicle_id - 1 if first_port else 0)
            if port > PORT_MAX:
                raise StartError(f"--first-port (vehicle {vehicle_id}): no port {port}", EXIT_BAD_FILE)
            bound = by_port.get(port) if port else None
            if bound is None:
                own = port if url.way is Way.IN else 0
                host = url.host if url.way is Way.IN else ""
                bound = opened.enter_context(bound_socket(f"--autopilots (vehicle {vehicle_id})", own, host=host))
                by_port[port] = bound
            sockets[vehicle_id] = bound
            ports[vehicle_id] = port or (bound.getsockname()[1] if url.way is Way.IN else _free_port(url.host))
        opened.pop_all()
    targets = {k: (url.host, port) for k, port in ports.items()} if url.way is Way.OUT else {}
    return AutopilotSockets(ports, sockets, targets)


def _free_port(host: str) -> int:
    """For an autopilot that is launched to bind; no other program should have taken it by then."""
    try:
        with bound_socket("--autopilots", 0, host=host) as bound:
            port: int = bound.getsockname()[1]
            return port
    except StartError:
        raise StartError(f"--autopilots: {host} is not this machine: give --first-port", EXIT_ENVIRONMENT) from None


@dataclass(slots=True)
class _Speaker:
    source: tuple[socket.socket, Address]
    heard_s: float


class Router:
    """Routes datagrams between companions and autopilots by address. Tables are bounded by the number of vehicles."""

    def __init__(self, sockets: AutopilotSockets, say: Say, heard: Container[int] = HEARD) -> None:
        """`heard`: message ids that `route_datagram` returns, besides passing on all."""
        self.refused = 0  # frames in a vehicle's name from another address than its own
        self.unsent = 0  # datagrams without an address, or that the kernel did not take
        self._sockets = sockets
        self._say = say
        self._told: set[int] = set()  # system ids that something was said about: at most 256
        self._speakers: dict[int, _Speaker] = {}
        self._heard = Framing(heard)

    def knows(self, vehicle_id: int) -> bool:
        """This vehicle's autopilot has been heard."""
        return vehicle_id in self._speakers

    def route_datagram(
        self, bound: socket.socket, data: bytes, address: Address, now_s: float
    ) -> tuple[dict[int, bytes], list[Any]]:
        """Splits a datagram: bytes for each vehicle's companion, and the messages in it of `heard` from autopilots."""
        source = (bound, address)
        messages = [m for m in self._heard.parse(data) if m.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1]
        for m in messages:
            if m.get_msgId() == dialect.MAVLINK_MSG_ID_HEARTBEAT and m.autopilot != dialect.MAV_AUTOPILOT_INVALID:
                self._claim(m.get_srcSystem(), source, now_s)
        here = [k for k, speaker in self._speakers.items() if speaker.source == source]
        genuine = [m for m in messages if m.get_srcSystem() in here]
        for vehicle_id in {m.get_srcSystem() for m in genuine}:
            self._speakers[vehicle_id].heard_s = now_s
        systems = {frames.source(data, start)[0] for start, _, _ in frames.whole(data)}
        if len(here) == 1 and all(self._owner(system) in (None, here[0]) for system in systems):
            return {here[0]: data}, genuine
        return self._sort(data, here), genuine

    def send(self, vehicle_id: int, data: bytes) -> None:
        """To this vehicle's autopilot; lost while its address is unknown."""
        speaker = self._speakers.get(vehicle_id)
        if speaker is not None:
            bound, address = speaker.source
        elif vehicle_id in self._sockets.targets:
            bound, address = self._sockets.bound[vehicle_id], self._sockets.targets[vehicle_id]
        else:
            self.unsent += 1
            return
        try:
            bound.sendto(data, address)
        except OSError:  # a full buffer, no route, or a closed port
            self.unsent += 1

    def _owner(self, system: int) -> int | None:
        return system if system in self._sockets.bound else None

    def _sort(self, data: bytes, here: list[int]) -> dict[int, bytes]:
        """A vehicle's own frames to it; what others sent through these autopilots, to all that are here."""
        parts: dict[int, list[bytes]] = {}
        for start, end, _ in frames.whole(data):
            system, _ = frames.source(data, start)
            if self._owner(system) is not None and system not in here:
                self.refused += 1
                continue
            for vehicle_id in here if self._owner(system) is None else (system,):
                parts.setdefault(vehicle_id, []).append(data[start:end])
        return {vehicle_id: b"".join(its) for vehicle_id, its in parts.items()}

    def _claim(self, system: int, source: tuple[socket.socket, Address], now_s: float) -> None:
        """A valid heartbeat: its sender is that vehicle's autopilot, unless another one lives."""
        if system not in self._sockets.bound:
            self._report_once(
                system, f"{place(source[1])}: an autopilot with system id {system}: not one of this mission's"
            )
            return
        speaker = self._speakers.get(system)
        if speaker is None or speaker.source == source or now_s - speaker.heard_s > AUTOPILOT_ALIVE_S:
            self._speakers[system] = _Speaker(source, now_s)
            return
        other = place(speaker.source[1])
        self._report_once(system, f"two autopilots have system id {system}: {other}, and {place(source[1])}: refused")

    def _report_once(self, system: int, what: str) -> None:
        if system not in self._told:
            self._told.add(system)
            self._say(what)
