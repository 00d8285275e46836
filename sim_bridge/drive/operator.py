"""The simulated operator: when the flight is allowed, and what an order looks like."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.beacon import WireBeacon
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing import wire
from mission.document.model import Mission, Personality

GROUND_STATION = (255, 190)  # system and component id of the operator
ORDERS = 3  # the same order so often, as a datagram may be lost
REPEAT_S = 1.0
# Waits for a vehicle's readiness this long and no longer: twice PX4's boot; ArduPilot's, and its estimator's doubts.
PATIENCE_S = {Personality.PX4: 10.0, Personality.ARDUPILOT: 60.0}


class Operator:
    """Allows the flight once every live companion announces that it is ready, or after PATIENCE_S."""

    def __init__(self, mission: Mission) -> None:
        personalities = {mission.sim.personality_of(k) for k in range(1, mission.swarm.size + 1)}
        self._patience_s = max(PATIENCE_S[personality] for personality in personalities)
        self._ordered = 0
        self._next_s: float | None = None

    def orders_start(self, now_s: float, alive: Collection[int], said: Mapping[int, WireBeacon]) -> bool:
        """True if the order is sent now; to be called each tick. `alive`: ids; `said`: by id, the last beacons."""
        if self._next_s is None:
            ready = all(k in said and said[k].flight_state >= FlightState.READY for k in alive)
            if not ready and now_s < self._patience_s:
                return False
            self._next_s = now_s
        if self._ordered == ORDERS or now_s < self._next_s:
            return False
        self._ordered += 1
        self._next_s += REPEAT_S
        return True


def operator_order(vehicle_id: int, command: int) -> bytes:
    """The operator's COMMAND_LONG to one companion."""
    message = dialect.MAVLink_command_long_message(vehicle_id, COMPONENT, command, 0, *(0.0,) * 7)
    return wire.pack(message, seq=0, system=GROUND_STATION[0], component=GROUND_STATION[1])
