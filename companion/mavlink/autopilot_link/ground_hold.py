"""The way out of the mode in which the last flight ended, for a make that is not armed in it.

PX4 goes back to the mode chosen last when a landing disarms it. That is OFFBOARD, where its prearm check fails without
setpoints: recorded, and so a vehicle that had flown was never ready again. Only one that waits on the ground, disarmed,
is asked, and a few times: whoever wants it in OFFBOARD keeps it there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from companion.core.model.actions import Say
from companion.core.model.states import FlightState, Severity
from companion.core.vehicle.flight import Flight
from companion.mavlink.codec import Codec

RETRY_S: Final = 2.0  # a HEARTBEAT comes once a second, and one may be lost
ASKS_MAX: Final = 3  # until it has left that mode
TEXT: Final = "left in OFFBOARD, not ready: HOLD asked for"


class GroundHold:
    """One companion's: `asks` each tick."""

    def __init__(self, codec: Codec, tell: Callable[[Say], None]) -> None:
        """`tell`: takes a word for the operator."""
        self._codec: Final = codec
        self._tell: Final = tell
        self._asked_s = -1e9
        self._asks = 0

    def asks(self, flight: Flight, now_s: float) -> list[Any]:
        """The command, when it is due."""
        make = self._codec.make
        hold = None if make is None else make.ground_hold
        if hold is None or flight.state is not FlightState.WAITING or not flight.vehicle.was_left_in_offboard(now_s):
            self._asks = 0
            return []
        if self._asks >= ASKS_MAX or now_s - self._asked_s < RETRY_S:
            return []
        if not self._asks:
            self._tell(Say(Severity.INFO, TEXT))
        self._asked_s, self._asks = now_s, self._asks + 1
        command, parameters = hold
        return [self._codec.command(command, *parameters)]
