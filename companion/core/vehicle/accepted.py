"""The risks that an operator has accepted for a flight, and when the ground is told of them."""

from __future__ import annotations

from typing import Final, final

from companion.core.model.actions import Say, brief
from companion.core.model.states import FlightState, Severity

UNSIGNED: Final = "UNSIGNED radio: anyone in range can command it"


@final
class Accepted:
    """One vehicle's. It grounds nothing."""

    def __init__(self) -> None:
        self._waived = ""  # failed checks of the preflight
        self._unsigned = False
        self._state = FlightState.WAITING

    def accept(self, checks: str, *, unsigned: bool) -> None:
        """Failed checks, by name; a radio without keys."""
        self._waived, self._unsigned = checks, unsigned

    def texts(self, state: FlightState, *, started: bool) -> list[Say]:
        """Each tick. Checks once, when the flight is allowed (`started`); the radio each time a vehicle gets ready."""
        says: list[Say] = []
        if self._waived and started:
            says.append(Say(Severity.WARNING, brief(f"preflight waived: {self._waived}")))
            self._waived = ""
        if self._unsigned and state is FlightState.READY and self._state is not FlightState.READY:
            says.append(Say(Severity.WARNING, UNSIGNED))
        self._state = state
        return says
