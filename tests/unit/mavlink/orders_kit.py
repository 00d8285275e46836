"""An operator, and books of orders on disks that can fail."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from companion.core.model.events import OperatorOrder
from companion.core.model.states import Order, Severity
from companion.keys.crypto import Signer, public_key
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.order import NO_FLIGHT, ORDER_ID, OrderKind, make_order, pack_boots

SIZE = 4
OPERATOR_SEED, VEHICLE_SEED = bytes([1]) * 32, bytes([2]) * 32
DIGEST = hashlib.sha256(b"mission").digest()
FLIGHT, OTHER_FLIGHT = b"flight A", b"flight B"
BOOTS = {k: 1000 + k for k in range(1, SIZE + 1)}
TICK_S = 0.05


def order(
    kind: OrderKind,
    counter: int,
    *,
    flight: bytes = FLIGHT,
    boots: Mapping[int, int] = BOOTS,
    size: int = SIZE,
    seed: bytes = OPERATOR_SEED,
    digest: bytes = DIGEST,
    hand_back: int = 0,
) -> bytes:
    """A payload; of LAND, HOLD and ABORT the boots are named, too, unless `boots` is empty."""
    return make_order(
        Signer(seed),
        kind,
        counter=counter,
        flight=flight,
        digest=digest,
        boots=pack_boots(boots, size),
        hand_back=hand_back,
    )


def frame(payload: bytes, system: int = 255) -> bytes:
    """As whoever passes it on sends it."""
    return wire.frame(ORDER_ID, payload, seq=0, system=system, component=COMPONENT)


class Disk:
    """Keeps what a book saves; may be full, or lose what it took."""

    def __init__(self) -> None:
        self.kept = b""
        self.is_full = self.loses = False
        self.waited: list[bool] = []

    def save(self, state: bytes, *, wait: bool) -> bool:
        self.waited.append(wait)
        if self.is_full:
            return False
        if not self.loses:
            self.kept = state
        return True


class Vehicle:
    """A book, and its disk: started again it has the disk alone, and another boot."""

    def __init__(self, me: int = 1, size: int = SIZE, **book: Any) -> None:
        self.me, self.size, self.boot = me, size, BOOTS.get(me, 1000 + me)
        self.disk, self.now_s = Disk(), 100.0
        self.airborne: bool | None = False
        self.said: list[str] = []
        self._more = book
        self.open_book()

    def open_book(self) -> None:
        keys = {"operator": public_key(OPERATOR_SEED), "digest": DIGEST, **self._more}
        self.book = OrderBook(**keys, me=self.me, size=self.size, boot=self.boot, marks=self.disk, kept=self.disk.kept)

    def restart(self) -> None:
        self.boot += 77_777
        self.open_book()

    def hear(self, *payloads: bytes, ticks: int = 1) -> list[OperatorOrder]:
        """What it acts on when these come, and then nothing for the other ticks."""
        events = []
        for payload in payloads:
            assert self.book.receive(frame(payload), self.now_s)
        for _ in range(ticks):
            self.now_s += TICK_S
            events += self.book.tick(self.now_s, airborne=self.airborne)
            self.said += [say.text for say in self.book.take_says() if say.severity is Severity.WARNING]
        return events

    def obeys(self, *payloads: bytes) -> list[Order]:
        return [event.order for event in self.hear(*payloads)]


K = OrderKind
__all__ = ["NO_FLIGHT", "K"]
