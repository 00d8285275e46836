"""The hub of the swarm's radio: one UDP socket for all companions; each gets what the radio delivers to it."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final

from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES, frames
from companion.mavlink.peers.session import OPERATOR_ID
from mission.common.frames import Vec3
from sim_bridge.drive.links.ports import Address
from sim_bridge.drive.links.radio_node import RadioNode
from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.world.autopilot.protocols.links import Port
from sim_bridge.world.radio import Radio

COMPANION_ALIVE_S: Final = 0.5  # five beacons: one that is started again is let in when its forerunner is surely gone
OPERATORS_MAX: Final = 8  # programs that speak with the operator's key at a time
CARRIED = frozenset(  # to the other companions
    {
        dialect.MAVLINK_MSG_ID_SWARM_BEACON,
        dialect.MAVLINK_MSG_ID_SWARM_RECORD,
        dialect.MAVLINK_MSG_ID_SWARM_MANIFEST,
        dialect.MAVLINK_MSG_ID_SWARM_ORDER,
        dialect.MAVLINK_MSG_ID_SWARM_TRUNKS,
        dialect.MAVLINK_MSG_ID_SWARM_RECORD_VECTOR,
        dialect.MAVLINK_MSG_ID_SWARM_SIGNED_RECORD,
        dialect.MAVLINK_MSG_ID_SWARM_BASE_VECTOR,
    }
)
SPOKEN = CARRIED | {dialect.MAVLINK_MSG_ID_HEARTBEAT}  # on the radio

Say = Callable[[str], None]


class RadioGate:
    """Addresses of each vehicle's radio: the one that spoke first, while it lives; of the operator's, several.

    `now_s`: wall time. A companion speaks with messages of SPOKEN, of its vehicle's id and component 191; the rest is
    ignored. The operator's programs share the operator's id, as on a radio of their own: the page, and a terminal.
    """

    def __init__(self, ids: Iterable[int], say: Say) -> None:
        self.refused = 0  # valid frames of the wrong kind, vehicle, component or address
        self._ids = frozenset(ids)
        self._say = say
        self._told: set[int] = set()  # vehicles about which an impostor was reported
        self._heard_s: dict[int, dict[Address, float]] = {}  # by vehicle
        self._vehicle_at: dict[Address, int] = {}
        self._port = Port(0)  # only to read

    @property
    def garbage_bytes(self) -> int:
        """Count of received bytes that were no frame."""
        return self._port.counts.garbage_bytes

    def addresses_of(self, vehicle_id: int) -> tuple[Address, ...]:
        """Of this vehicle's companion, or the operator's programs; none before they have spoken."""
        return tuple(self._heard_s.get(vehicle_id, ()))

    def is_alive(self, vehicle_id: int, now_s: float) -> bool:
        """This vehicle's companion spoke not long ago."""
        return any(now_s - heard_s <= COMPANION_ALIVE_S for heard_s in self._heard_s.get(vehicle_id, {}).values())

    def admit_datagram(self, data: bytes, address: Address, now_s: float) -> tuple[int, bytes]:
        """The vehicle that `address` speaks for (0: none), and its frames in `data` to be carried, unmodified."""
        beacons = []
        vehicle_id = 0
        for incoming in self._port.parse_datagram(data):
            system = incoming.system
            words = incoming.message_id in SPOKEN and incoming.component == COMPONENT
            if not words or not self._may_speak(system, address, now_s):
                self.refused += 1
                continue
            vehicle_id = system
            self._bind(system, address, now_s)
            if incoming.message_id in CARRIED:
                beacons.append(incoming.frame)
        return vehicle_id, b"".join(beacons)

    def _may_speak(self, system: int, address: Address, now_s: float) -> bool:
        if system not in self._ids:
            return False
        owner = self._vehicle_at.get(address, system)
        if owner != system and now_s - self._heard_s[owner][address] <= COMPANION_ALIVE_S:
            self._report_once(system, f"{place(address)} is vehicle {owner}'s, and now speaks as vehicle {system}")
            return False
        longest = self._longest_silent(system, address)
        if longest is not None and now_s - self._heard_s[system][longest] <= COMPANION_ALIVE_S:
            other = place(longest)
            self._report_once(system, f"{place(address)} speaks as vehicle {system}, which {other} already does")
            return False
        return True

    def _longest_silent(self, system: int, address: Address) -> Address | None:
        """Whose place as `system` a new `address` would take; None: it has one, or one is free."""
        heard_s = self._heard_s.get(system, {})
        if address in heard_s or len(heard_s) < (OPERATORS_MAX if system == OPERATOR_ID else 1):
            return None
        return min(heard_s, key=heard_s.__getitem__)

    def _bind(self, system: int, address: Address, now_s: float) -> None:
        longest = self._longest_silent(system, address)
        if longest is not None:
            del self._heard_s[system][longest], self._vehicle_at[longest]
        former = self._vehicle_at.get(address, system)
        if former != system:
            del self._heard_s[former][address]
        self._heard_s.setdefault(system, {})[address] = now_s
        self._vehicle_at[address] = system

    def _report_once(self, system: int, what: str) -> None:
        if system not in self._told:
            self._told.add(system)
            self._say(f"radio: {what}: refused for as long as the other lives, and {COMPANION_ALIVE_S:g} s more")


class RadioHub:
    """A `Radio` and its socket. `positions`: NED metres of those that are on the air; asked for once in each step."""

    def __init__(
        self,
        bound: socket.socket,
        ids: Iterable[int],
        radio: Radio,
        positions: Callable[[], Mapping[int, Vec3]],
        say: Say,
        base: RadioNode | None = None,
    ) -> None:
        """`bound`: non-blocking; its owner closes it. `base`: the base station, where it is in this process."""
        self.radio = radio
        self.transmitter = Transmitter(radio)
        self.gate = RadioGate(ids, say)
        self.unsent = 0  # datagrams that the kernel did not take
        self._ids = tuple(ids)
        self._bound = bound
        self._positions = positions
        self._base = base
        self._placed: Mapping[int, Vec3] | None = None  # in this step

    def receive_datagram(self, data: bytes, address: Address, wall_s: float, now_s: float) -> None:
        """A datagram has come. `wall_s`: when, for the gate; `now_s`: the radio's own time."""
        vehicle_id, beacons = self.gate.admit_datagram(data, address, wall_s)
        if beacons:  # the operator's programs hear each other, as on one computer's radio
            self._send_radio(vehicle_id, beacons, but=address)
        if beacons and vehicle_id in self._place_radios():
            self.transmitter.send(vehicle_id, beacons, now_s)

    def deliver(self, now_s: float) -> None:
        """To each companion the beacons that have reached its vehicle; none while it has not spoken. At each step."""
        self._placed = None
        if self._base is not None:
            self._place_radios()
            self._base.receive(self.radio.deliver(self._base.id, now_s), now_s)
            for frame in self._base.tick(now_s):
                self.radio.send(self._base.id, frame, now_s, aside=True)
        for vehicle_id in self._ids:
            beacons = self.radio.deliver(vehicle_id, now_s)
            if beacons:
                self._send_radio(vehicle_id, beacons)

    def _place_radios(self) -> Mapping[int, Vec3]:
        """Positions of all radios in this step."""
        if self._placed is None:
            self._placed = self._positions()
            if self._base is not None:
                self._placed = {**self._placed, self._base.id: self._base.pos_ned_m}
            self.radio.place(self._placed)
        return self._placed

    def _send_radio(self, vehicle_id: int, beacons: bytes, but: Address | None = None) -> None:
        """To all that speak as this vehicle, `but` one."""
        for address in self.gate.addresses_of(vehicle_id):
            for datagram in split(beacons) if address != but else ():
                self._send(datagram, address)

    def _send(self, data: bytes, address: Address) -> None:
        try:
            self._bound.sendto(data, address)
        except OSError:  # a full buffer, or a closed port: UDP loses datagrams
            self.unsent += 1


def split(data: bytes, size_max: int = DATAGRAM_MAX_BYTES) -> Iterator[bytes]:
    """The valid frames in `data` in parts of at most `size_max` bytes, but at least a frame each."""
    part = 0
    for start, end, _ in frames(data):
        if end - part > size_max and start > part:
            yield data[part:start]
            part = start
    if part < len(data):
        yield data[part:]


def place(address: Address) -> str:
    """HOST:PORT, as it is typed."""
    return f"{address[0]}:{address[1]}"
