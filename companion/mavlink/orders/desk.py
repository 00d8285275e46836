"""The orders of one endpoint, signed or not: the choice is made when it is built.

In an unsigned swarm a ground station's COMMAND_LONG is obeyed, and the flags of beacons. In a signed one both count for
nothing: a command is refused, and the operator is told what to use instead.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, Final, Protocol

from companion.core.agent import Agent
from companion.core.model.actions import Say
from companion.core.model.events import OperatorOrder
from companion.core.model.states import LandedState, Severity
from companion.core.vehicle.operator_orders import FloodedOrders, OperatorOrders
from companion.mavlink import dialect
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.commands import order_of

NEEDS_KEY: Final = "needs the operator's key: companion order"


class OrderDesk(Protocol):
    """The orders of one endpoint."""

    operator: OperatorOrders  # of its agent

    @property
    def refused(self) -> Counter[str]:
        """Orders that came, by the reason why they are not obeyed."""

    def receive(self, frame: bytes, now_s: float, *, is_proven: bool) -> bool:
        """A whole frame of the peers' link; False: it is no order. `is_proven`: the link's MAC holds for it."""

    def command(self, m: Any) -> tuple[int, OperatorOrder | None]:
        """A COMMAND_LONG to this companion -> the MAV_RESULT to answer, and what to act on."""

    def tick(self, agent: Agent, now_s: float) -> list[OperatorOrder]:
        """Orders to act on now."""

    def payloads(self, now_s: float) -> list[bytes]:
        """Payloads of SWARM_ORDER to broadcast with this tick."""

    def take_says(self) -> list[Say]:
        """Words for the operator, since last asked."""

    def counters(self) -> dict[str, int]:
        """Counts for the log, of what was bad."""


class UnsignedOrders:
    """By commands and flags."""

    def __init__(self) -> None:
        self.operator: OperatorOrders = FloodedOrders()
        self._refused: Counter[str] = Counter()

    @property
    def refused(self) -> Counter[str]:
        """None."""
        return self._refused

    def receive(self, frame: bytes, now_s: float, *, is_proven: bool) -> bool:  # noqa: ARG002
        """None is taken: whose key could it bear?"""
        return False

    def command(self, m: Any) -> tuple[int, OperatorOrder | None]:
        """It is obeyed."""
        order = order_of(m.command, m.param1)
        if order is None:
            return dialect.MAV_RESULT_UNSUPPORTED, None
        return dialect.MAV_RESULT_ACCEPTED, OperatorOrder(order)

    def tick(self, agent: Agent, now_s: float) -> list[OperatorOrder]:  # noqa: ARG002
        """None: commands are obeyed as they come."""
        return []

    def payloads(self, now_s: float) -> list[bytes]:  # noqa: ARG002
        """None: flags spread by the beacons."""
        return []

    def take_says(self) -> list[Say]:
        """Nothing."""
        return []

    def counters(self) -> dict[str, int]:
        """None."""
        return {}


class SignedOrders:
    """By the messages of the operator's key."""

    def __init__(self, book: OrderBook) -> None:
        self.operator = OperatorOrders()
        self._book = book
        self._says: list[Say] = []

    @property
    def refused(self) -> Counter[str]:
        """The book's."""
        return self._book.refused

    def receive(self, frame: bytes, now_s: float, *, is_proven: bool) -> bool:
        """To the book."""
        return self._book.receive(frame, now_s, is_proven=is_proven)

    def command(self, m: Any) -> tuple[int, OperatorOrder | None]:
        """Refused, and said."""
        order = order_of(m.command, m.param1)
        if order is None:
            return dialect.MAV_RESULT_UNSUPPORTED, None
        self._says = [Say(Severity.WARNING, f"{order.name} {NEEDS_KEY}")]
        return dialect.MAV_RESULT_DENIED, None

    def tick(self, agent: Agent, now_s: float) -> list[OperatorOrder]:
        """As the book, once the autopilot has said whether it flies."""
        vehicle = agent.flight.vehicle
        known = vehicle.landed is not LandedState.UNDEFINED
        return self._book.tick(now_s, airborne=vehicle.airborne if known else None)

    def payloads(self, now_s: float) -> list[bytes]:
        """As the book."""
        return self._book.payloads(now_s)

    def take_says(self) -> list[Say]:
        """The book's, and what was refused."""
        says, self._says = self._says, []
        return says + self._book.take_says()

    def counters(self) -> dict[str, int]:
        """The book's."""
        return self._book.counters()


def open_desk(book: OrderBook | None) -> OrderDesk:
    """The make of a swarm that has keys, or of one that has none."""
    return UnsignedOrders() if book is None else SignedOrders(book)
