"""An operator's orders as one vehicle holds them: what is allowed, held, landed. ABORT is above LAND, LAND above HOLD.

By what an order comes to count is chosen once, when an agent is built. In an unsigned swarm the flags START and ABORT
of others' beacons count as the operator's word (`FloodedOrders`). In a signed one they count for nothing: an order
comes as the operator's own signed message, over whomever, or not at all (`OperatorOrders`).
"""

from __future__ import annotations

from typing import Final

from companion.core.model.actions import Say
from companion.core.model.beacon import Beacon
from companion.core.model.states import FlightState, Order, Severity

SAID: Final = {Order.LAND: "swarm lands: ordered by the operator", Order.ABORT: "land all: ordered by the operator"}


def answer_hand_back(state: FlightState, *, airborne: bool) -> list[Say]:
    """Text about a vehicle in `state` that an operator hands back to its companion; none where it has it already."""
    if state is FlightState.RELEASED:
        text = "handed back: companion steers again" if airborne else "handed back: waiting on the ground"
        return [Say(Severity.NOTICE, text)]
    if state is FlightState.LANDED:
        return [Say(Severity.WARNING, "not handed back: landed, restart companion")]
    return []


class OperatorOrders:
    """Base, and the make of a signed swarm."""

    def __init__(self) -> None:
        self.started = False  # this vehicle may take off
        self.aborts = False  # it lands where it is, now
        self.lands = False  # the swarm lands as at its mission's end
        self._holds = False

    @property
    def holds(self) -> bool:
        """The vehicle holds where it is: no phase, and no timer of one, goes on."""
        return self._holds and not (self.lands or self.aborts)

    @property
    def may_take_off(self) -> bool:
        """A vehicle on the ground may arm, and take off as its phase says."""
        return self.started and not (self._holds or self.lands or self.aborts)

    def obey(self, order: Order) -> list[Say]:
        """Takes an order; what is to be said of it: once, of one that cannot be taken back."""
        before = (self.lands, self.aborts)
        self.started |= order is Order.START
        self._holds = order is Order.HOLD or (self._holds and order is not Order.START)
        self.lands |= order is Order.LAND
        self.aborts |= order is Order.ABORT
        is_news = before != (self.lands, self.aborts)
        return [Say(Severity.WARNING, SAID[order])] if is_news else []

    def receive_flags(self, beacon: Beacon) -> None:
        """Flags of another's beacon: whoever sends it could say so."""


class FloodedOrders(OperatorOrders):
    """The make of an unsigned swarm: START and ABORT spread by the beacons' flags."""

    def receive_flags(self, beacon: Beacon) -> None:
        """They count as the operator's word."""
        self.started |= beacon.start
        self.aborts |= beacon.abort
