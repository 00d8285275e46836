"""The operator's orders of one vehicle: which is genuine, new and about this flight; passed on; remembered.

Pure: the disk is handed in (`Marks`), the time is an argument. What protects from what:

| | |
|---|---|
| forged, or changed on the way | the signature of the operator's key |
| of another mission | the mission file's digest |
| recorded in this flight, and sent again | the counter, whose highest value is written before an order is acted on |
| recorded before this companion was started again | the same; if that write was lost, on the ground: its boot nonce |
| recorded in an earlier flight | the counter, which the START of this one has raised |

LAND and ABORT of the flight that it is in, by the nonce that its START drew, count whatever their counter: they may
come after a later order, and acting twice changes nothing.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from typing import Final, Protocol

from companion.core.model.actions import Say
from companion.core.model.events import OperatorOrder
from companion.core.model.states import Severity
from companion.keys.crypto import Verifier
from companion.mavlink.orders.candidates import Candidates
from companion.mavlink.orders.order import (
    DIGEST_BYTES,
    NO_FLIGHT,
    OrderKind,
    SignedOrder,
    names_boot,
    order_holds,
    order_payload,
    read_order,
)
from companion.mavlink.orders.repeats import Repeats

CHECKS_MAX: Final = 8  # of signatures in a tick: 1 ms of its 50
TOLD_S: Final = 10.0  # between two words about what is refused for one reason
SETTLED_S: Final = 5.0  # after an order others may still pass on the one before
STATE_VERSION: Final = 1
_HEAD: Final = Struct("<BQ8s")
_SUM_BYTES: Final = 8
REASONS: Final = {  # of a refusal: what an operator is told
    "malformed": "order refused: cannot be read",
    "forged": "order refused: not of the operator's key",
    "other mission": "order refused: other mission file",
    "replayed": "order refused: replayed",
    "other flight": "order refused: other flight",
    "other boot": "START refused: names another boot of this one",
    "ended": "START refused: this flight was landed",
    "not saved": "START refused: cannot write to the disk",
}


class Marks(Protocol):
    """A disk, on which the state of a book outlives its process, and a power cut."""

    def save(self, state: bytes, *, wait: bool) -> bool:
        """Write it in place of the last. `wait`: until it is on the disk; False: it could not be written."""


@dataclass(frozen=True, slots=True)
class BookStart:
    """All that a book begins with, but for its disk; nothing of it is secret. Fields: as OrderBook's arguments."""

    operator: bytes
    digest: bytes
    me: int
    size: int
    boot: int
    kept: bytes


class OrderBook:
    """One vehicle's. `receive` frames, `tick` for what to act on, `payloads` for what to pass on."""

    def __init__(
        self, *, operator: bytes, digest: bytes, me: int, size: int, boot: int, marks: Marks, kept: bytes = b""
    ) -> None:
        """`operator`: its public key. `digest`: the mission file's, SHA-256. `boot`: of this start, drawn at random.

        `kept`: what `marks` saved last, before this start; empty: nothing. ValueError: it is no public key.
        """
        self.start: Final = BookStart(operator, digest, me, size, boot, kept)
        self._operator = Verifier(operator)
        self._digest = digest[:DIGEST_BYTES]
        self._me, self._size, self._boot = me, size, boot
        self._marks = marks
        self._candidates = Candidates(boot)
        self._mark = 0  # the highest counter that was seen,
        self._newest = b""  # and the genuine order that it is of
        self._flight = NO_FLIGHT  # that this vehicle is in
        self._latched = 0  # the rank of what it has obeyed, and cannot be taken back
        self._carried: SignedOrder | None = None  # passed on
        self._repeats = Repeats()  # of that
        self._was_restored = False
        self._says: list[Say] = []
        self._told_s: dict[str, float] = {}
        self.refused: Counter[str] = Counter()  # orders that came, by reason
        if kept:
            self._load(kept)

    def with_marks(self, wrap: Callable[[Marks], Marks]) -> OrderBook:
        """This book as it began, with what `wrap` makes of its disk."""
        start = self.start
        return OrderBook(
            operator=start.operator,
            digest=start.digest,
            me=start.me,
            size=start.size,
            boot=start.boot,
            marks=wrap(self._marks),
            kept=start.kept,
        )

    # --- in ---

    def receive(self, frame: bytes, now_s: float, *, is_proven: bool = False) -> bool:
        """A whole frame of the peers' link; False: it is no order. `is_proven`: the link's MAC holds for it."""
        payload = order_payload(frame)
        if payload is None:
            return False
        carried = self._carried
        if payload == self._newest or (carried is not None and payload == carried.payload):
            return True  # decided on: its sender goes on sending it
        order = read_order(payload)
        if order is None:
            self._refuse("malformed", now_s)
        elif order.mission != self._digest:
            self._refuse("other mission", now_s)
        elif not self._is_news(order):
            self._refuse("replayed", now_s)
        elif self._candidates.is_bad(payload):
            self._refuse("forged", now_s)
        else:
            self._candidates.offer(payload, is_proven=is_proven)
        return True

    def tick(self, now_s: float, *, airborne: bool | None) -> list[OperatorOrder]:
        """Orders to act on now. `airborne`: None until the autopilot has said so: until then they wait."""
        if airborne is None:
            return []
        events = self._restore(now_s, airborne=airborne)
        genuine: list[SignedOrder] = []
        for payload in self._candidates.take_likeliest(CHECKS_MAX):
            order = read_order(payload)
            if order is not None and order_holds(payload, self._operator):
                genuine.append(order)
            else:
                self._candidates.add_bad(payload)
                self._refuse("forged", now_s)
        for order in sorted(genuine, key=lambda order: order.counter):
            if self._is_news(order) and self._accept(order, now_s, airborne=airborne):
                events.append(self._act(order, hands_back=order.hand_back == self._me))
        return events

    def _is_news(self, order: SignedOrder) -> bool:
        is_this_flight = order.flight == self._flight != NO_FLIGHT
        return order.counter > self._mark or (is_this_flight and order.kind.latched > self._latched)

    def _accept(self, order: SignedOrder, now_s: float, *, airborne: bool) -> bool:
        """A genuine one, which is news: passed on in any case; True: it is to be acted on."""
        reason = self._find_objection(order, airborne=airborne)
        before = self._flight
        if order.counter > self._mark:  # also of what is refused: what was ordered before it is over
            self._mark, self._newest = order.counter, order.payload
        if not reason and order.flight != NO_FLIGHT:
            self._flight = order.flight
        if self._replaces(order):
            self._carried, self._repeats = order, Repeats(now_s)
        is_saved = self._marks.save(self._state(), wait=not airborne)
        if not reason and not is_saved:
            if order.kind is OrderKind.START and not airborne:
                reason, self._flight = "not saved", before
            else:  # what holds, lands or goes on in the air does not wait for a disk
                self._report_text("not saved: ", "order obeyed, but not written to the disk", now_s)
        if reason:
            self._refuse(reason, now_s)
        return not reason

    def _find_objection(self, order: SignedOrder, *, airborne: bool) -> str:
        """The reason for which a genuine order is none for this vehicle now; empty: it is one."""
        is_start = order.kind is OrderKind.START
        if is_start and self._latched:
            return "ended"
        if airborne and not is_start:
            return ""  # its START is older than this: no other flight's order could be newer, or it knows of none
        if names_boot(order.boots, self._me, self._size, self._boot):
            return ""
        if is_start:
            return "" if airborne else "other boot"
        return "other flight" if self._flight == NO_FLIGHT else ""

    def _replaces(self, order: SignedOrder) -> bool:
        """It is passed on instead of the one before."""
        carried = self._carried
        if carried is None:
            return True
        if carried.flight != order.flight and not self._latched:
            return order.counter > carried.counter
        return (order.kind.latched, order.counter) > (carried.kind.latched, carried.counter)

    def _act(self, order: SignedOrder, *, hands_back: bool) -> OperatorOrder:
        self._latched = max(self._latched, order.kind.latched)
        say = Say(Severity.INFO, f"order obeyed: {order.kind.name}")
        if order.kind.latched < self._latched:
            above = OrderKind(self._latched).name
            say = Say(Severity.WARNING, f"{order.kind.name} changes nothing: {above} stays in force")
        self._says.append(say)
        return OperatorOrder(order.kind.order, hands_back)

    # --- out ---

    def payloads(self, now_s: float) -> list[bytes]:
        """Payloads to broadcast with this tick, each in a datagram of its own."""
        return [] if self._carried is None else [self._carried.payload] * self._repeats.copies(now_s)

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""
        says, self._says = self._says, []
        return says

    def counters(self) -> dict[str, int]:
        """Counts for the log, of what was bad."""
        refused = {f"orders refused, {reason}": count for reason, count in sorted(self.refused.items())}
        return {**refused, "orders dropped unread": self._candidates.dropped}

    def _refuse(self, reason: str, now_s: float) -> None:
        self.refused[reason] += 1
        if reason != "replayed" or now_s - self._repeats.begun_s > SETTLED_S:
            self._report_text(reason, REASONS[reason], now_s)

    def _report_text(self, reason: str, text: str, now_s: float) -> None:
        if now_s - self._told_s.get(reason, -math.inf) >= TOLD_S:
            self._told_s[reason] = now_s
            self._says.append(Say(Severity.WARNING, text))

    # --- what outlives the process ---

    def _state(self) -> bytes:
        carried = b"" if self._carried is None else self._carried.payload
        state = _HEAD.pack(STATE_VERSION, self._mark, self._flight) + carried
        return state + hashlib.sha256(state).digest()[:_SUM_BYTES]

    def _load(self, kept: bytes) -> None:
        """A file that cannot be read is as none: then the boot nonce alone tells an old START from a new one."""
        state = _state_in(kept)
        if state is None:
            self._says.append(Say(Severity.WARNING, "orders seen before: file cannot be read"))
            return
        version, mark, flight = _HEAD.unpack_from(state)
        if version != STATE_VERSION:
            return
        self._mark = mark
        payload = state[_HEAD.size :]
        order = read_order(payload)
        if order is not None and order.mission == self._digest and order_holds(payload, self._operator):
            self._carried, self._flight = order, flight

    def _restore(self, now_s: float, *, airborne: bool) -> list[OperatorOrder]:
        """Once: a companion that was started again in the air goes by what it obeyed; on the ground it waits."""
        if self._was_restored:
            return []
        self._was_restored = True
        order = self._carried
        if order is None or not airborne or order.flight != self._flight:
            return []
        self._repeats = Repeats(now_s)
        return [self._act(order, hands_back=False)]


def with_higher_mark(kept: bytes, earlier: bytes) -> bytes:
    """Of two states that one vehicle saved, that of which less can count as new; `kept` where neither can be read."""
    return max((kept, earlier), key=_mark_of)


def _mark_of(kept: bytes) -> int:
    state = _state_in(kept)
    if state is None:
        return -1 if kept else -2
    version, mark, _ = _HEAD.unpack_from(state)
    return int(mark) if version == STATE_VERSION else -1


def _state_in(kept: bytes) -> bytes | None:
    """Without its checksum; None: there is none, or it does not hold."""
    state, checksum = kept[:-_SUM_BYTES], kept[-_SUM_BYTES:]
    holds = len(state) >= _HEAD.size and hashlib.sha256(state).digest()[:_SUM_BYTES] == checksum
    return state if holds else None
