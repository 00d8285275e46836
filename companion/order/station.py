"""The operator's radio without its sockets: beacons in, orders out, and who has taken them. Times are a local clock's.

An order has reached a vehicle when that one passes it on, byte for byte, in a frame of the swarm's key. Its beacon
shows whether it acts on it, once its signature vouches for that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from companion.core.model.beacon import Beacon
from companion.core.model.states import FlightState, SwarmPhase
from companion.keys.crypto import Signer
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.beacon import REFUSED, Decoded
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import source
from companion.mavlink.orders.order import (
    NO_FLIGHT,
    NONCE_BYTES,
    ORDER_ID,
    OrderKind,
    make_order,
    order_payload,
    pack_boots,
)
from companion.mavlink.orders.repeats import NEW_PERIOD_S, Repeats
from companion.mavlink.own_messages import decode_beacon
from companion.mavlink.peers.guard import Guard
from companion.mavlink.peers.session import OPERATOR_ID
from mission.common.frames import Vec3

FRESH_S: Final = 3.0  # older, a vehicle is not heard
ENDED: Final = (FlightState.LANDING, FlightState.LANDED, FlightState.RELEASED)
HELD: Final = (FlightState.HOLD, FlightState.WAITING, FlightState.READY)
NOWHERE: Final[Vec3] = (0.0, 0.0, 0.0)  # no place is asked for here


class OrderFileError(ValueError):
    """The file is not one of these; the message names it."""


def reason_of(error: OSError | OrderFileError) -> str:
    """In words, without a number."""
    return error.strerror or "cannot be written" if isinstance(error, OSError) else str(error)


class Numbered(NamedTuple):
    """The next order's. `unsaved`: why it is not on the disk; empty: it is."""

    counter: int
    flight: bytes
    unsaved: str = ""


class OrderFile(Protocol):
    """The operator's count of orders, and the flight of each mission; on the disk before a START is sent."""

    def next_order(self, digest: bytes, choose: Callable[[bytes], bytes], *, only_stops: bool) -> Numbered:
        """`choose`: the flight by that of the last order of this mission. `only_stops`: it waits for no disk.

        OSError, ValueError, of a START alone: it cannot be written, and nothing may be sent.
        """


@dataclass(slots=True)
class _Heard:
    said: Beacon
    heard_s: float
    is_proven: bool  # its sender vouches for all of it
    passed_on: bytes = b""  # the last order that it sent


class OperatorStation:
    """One mission's. `receive`, `send_order`, `datagrams` in each turn."""

    def __init__(
        self,
        seed: bytes,
        digest: bytes,
        size: int,
        *,
        file: OrderFile,
        draw: Callable[[int], bytes],
        guard: Guard,
    ) -> None:
        """`seed`: the operator's private key. `digest`: of the mission file. `draw`: so many random bytes.

        `guard`: of its radio, as OPERATOR_ID.
        """
        self._signer = Signer(seed)
        self._digest, self._size = digest, size
        self._file = file
        self._draw = draw
        self._guard: Final = guard
        self._sender = wire.Sender(OPERATOR_ID, swarm_beacon.COMPONENT, guard.flags)
        self._heard: dict[int, _Heard] = {}
        self._payload = b""  # sent now
        self._kind: OrderKind | None = None
        self._repeats = Repeats()

    # --- in ---

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram of the swarm's radio. Whatever it is, nothing raises."""

        guard = self._guard

        def take_frame(frame: bytes) -> bool:
            if guard.take_proof(frame, now_s):
                return True
            payload = order_payload(frame)
            heard = None if payload is None else self._heard.get(source(frame)[0])
            if payload is not None and heard is not None and guard.holds_mac(frame):  # else anybody's copy would do
                heard.passed_on = payload
            return payload is not None

        def read_beacon(frame: bytes) -> Decoded | None:
            fields, sender = swarm_beacon.unpack(frame), source(frame)[0]
            if fields is None:
                return None
            said = decode_beacon(sender, fields)
            if said is None or not 1 <= sender <= self._size or not guard.admits(frame, now_s, said):
                return REFUSED
            return Decoded(fields.version, said, NOWHERE)

        for sender, _, decoded in swarm_beacon.read_each(data, read_beacon, take_frame):
            believed = guard.believe(decoded, sender, now_s)  # by the proof that came with it
            if believed.said is not None:
                self._keep_beacon(believed.said, now_s, is_proven=believed is decoded)

    def _keep_beacon(self, said: Beacon, now_s: float, *, is_proven: bool) -> None:
        known = self._heard.get(said.sender)
        if known is None:
            self._heard[said.sender] = _Heard(said, now_s, is_proven)
        else:
            known.said, known.heard_s, known.is_proven = said, now_s, is_proven

    def vehicles(self, now_s: float) -> dict[int, Beacon]:
        """The last beacon of each vehicle that is heard now, by its id."""
        return {
            vehicle: heard.said for vehicle, heard in sorted(self._heard.items()) if now_s - heard.heard_s <= FRESH_S
        }

    def named(self) -> set[int]:
        """Vehicles that have proven which start of their companion this is: those that a START names."""
        return {*self._guard.boots()}

    def not_ready(self, now_s: float) -> dict[int, str]:
        """Vehicles of the mission that a START finds neither ready nor in the air, and what they are instead."""
        heard, named = self.vehicles(now_s), self.named()
        found: dict[int, str] = {}
        for vehicle in range(1, self._size + 1):
            said = heard.get(vehicle)
            if said is None:
                found[vehicle] = "not heard"
            elif vehicle not in named and not said.airborne:
                found[vehicle] = "heard, but does not prove who it is"
            elif not said.airborne and said.state is not FlightState.READY:
                found[vehicle] = said.state.name.lower().replace("_", " ")
        return found

    # --- out ---

    def send_order(self, kind: OrderKind, now_s: float, *, hand_back: int = 0) -> str:
        """Begins to send an order, instead of the last one -> a warning: its count is not on the disk; or nothing.

        OSError, OrderFileError, of a START alone: its count cannot be kept, and it is not sent.
        """
        is_flying = any(said.airborne for said in self.vehicles(now_s).values())
        draws = kind is OrderKind.START and not is_flying

        def choose(last: bytes) -> bytes:
            if draws or (kind is OrderKind.START and last == NO_FLIGHT):
                return self._draw(NONCE_BYTES)
            return last

        counter, flight, unsaved = self._file.next_order(self._digest, choose, only_stops=kind is not OrderKind.START)
        self._payload = make_order(
            self._signer,
            kind,
            counter=counter,
            flight=flight,
            digest=self._digest,
            boots=pack_boots(self._guard.boots(), self._size),
            hand_back=hand_back,
        )
        self._kind, self._repeats = kind, Repeats(now_s, late_period_s=NEW_PERIOD_S)
        return f"{kind.name} goes out, counted by the clock alone: {unsaved}" if unsaved else ""

    def datagrams(self, now_s: float) -> list[bytes]:
        """Datagrams to send with this turn: what proves this station's boot, which vehicles echo, and the order."""
        proof = self._guard.proof(now_s)
        frames = [] if proof is None else [self._sender.frame(*proof)]
        if self._kind is not None:
            frames += [self._sender.frame(ORDER_ID, self._payload) for _ in range(self._repeats.copies(now_s))]
        return [self._guard.seal_proof(frame) for frame in frames]

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""
        return [say.text for say in self._guard.take_says()]

    def waits_for(self, now_s: float) -> list[int]:
        """Vehicles that are heard and do not show that they act on the order."""
        return [vehicle for vehicle in self.vehicles(now_s) if not self._acts(self._heard[vehicle])]

    def overruled(self, now_s: float) -> list[int]:
        """Vehicles of which a LAND is ordered, and which an ABORT lands, that is above it."""
        if self._kind is not OrderKind.LAND:
            return []
        return [vehicle for vehicle, said in self.vehicles(now_s).items() if said.abort]

    def _acts(self, heard: _Heard) -> bool:
        said, has_it = heard.said, heard.passed_on == self._payload
        if self._kind is not None and not heard.is_proven:
            return False
        match self._kind:
            case OrderKind.ABORT:
                return said.abort
            case OrderKind.LAND:
                return (has_it and said.phase is SwarmPhase.LAND) or said.state in ENDED or said.abort
            case OrderKind.HOLD:
                return has_it and said.state in (*HELD, *ENDED)
            case OrderKind.START:
                return has_it and said.start and said.state is not FlightState.WAITING
            case None:
                return True


def list_ids(vehicles: Sequence[int]) -> str:
    """For a line."""
    return ", ".join(map(str, vehicles))
