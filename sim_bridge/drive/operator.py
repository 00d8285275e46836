"""The simulated operator: when the flight is allowed, and what an order looks like, with a key and without."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from typing import Final

from companion.core.model.states import FlightState
from companion.keys.keyring import Keyring
from companion.mavlink import dialect
from companion.mavlink.beacon import WireBeacon
from companion.mavlink.endpoint import COMPONENT
from companion.mavlink.framing import wire
from companion.mavlink.orders.order import OrderKind
from companion.mavlink.peers.guard import Guard
from companion.mavlink.peers.session import OPERATOR_ID
from companion.order.station import Numbered, OperatorStation
from mission.common.frames import Vec3
from mission.document.model import Mission, Personality

GROUND_STATION = (255, 190)  # system and component id of the operator
ORDERS = 3  # the same order so often, as a datagram may be lost
REPEAT_S = 1.0
# Waits for a vehicle's readiness this long and no longer: twice PX4's boot; ArduPilot's, and its estimator's doubts.
PATIENCE_S = {Personality.PX4: 10.0, Personality.ARDUPILOT: 60.0}


class Operator:
    """Allows the flight once every live companion announces that it is ready, or after PATIENCE_S.

    With a key it waits for their proofs, too: a START that does not name the boot of a vehicle is none to it.
    """

    def __init__(self, mission: Mission, keyholder: SignedOperator | None = None) -> None:
        """`keyholder`: of a swarm with keys, who orders the START."""
        self._keyholder = keyholder
        personalities = {mission.sim.personality_of(k) for k in range(1, mission.swarm.size + 1)}
        self._patience_s = max(PATIENCE_S[personality] for personality in personalities)
        self._ordered = 0
        self._next_s: float | None = None

    def orders_start(self, now_s: float, alive: Collection[int], said: Mapping[int, WireBeacon]) -> bool:
        """True if the order is sent now; to be called each tick. `alive`: ids; `said`: by id, the last beacons."""
        if self._next_s is None:
            ready = all(k in said and said[k].flight_state >= FlightState.READY for k in alive)
            if self._keyholder is not None:
                ready = ready and self._keyholder.station.named().issuperset(alive)
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


class OrderCount:
    """An `OrderFile` in memory, whose flights are drawn by a seed."""

    def __init__(self) -> None:
        self._counter = 0
        self._flight = bytes(8)

    def next_order(self, digest: bytes, choose: Callable[[bytes], bytes], *, only_stops: bool) -> Numbered:  # noqa: ARG002
        """As `OrderFile`."""
        self._counter += 1
        self._flight = choose(self._flight)
        return Numbered(self._counter, self._flight)


class SignedOperator:
    """The operator of a signed swarm, with a radio: a `RadioNode`. `order` begins an order, which is then repeated."""

    def __init__(self, keyring: Keyring, digest: bytes, size: int, guard: Guard, *, seed: int, pos_ned_m: Vec3) -> None:
        """`keyring`: the operator's; `digest`: of the mission file; `guard`: of its radio; `pos_ned_m`: the antenna."""
        self._seed, self._drawn = seed, 0
        self._started = False
        self.pos_ned_m: Final = pos_ned_m
        self.station: Final = OperatorStation(
            keyring.seed, digest, size, file=OrderCount(), draw=self._draw, guard=guard
        )

    @property
    def id(self) -> int:
        """Its system id."""
        return OPERATOR_ID

    def start(self, now_s: float) -> None:
        """START, the first time."""
        if not self._started:
            self._started = True
            self.order(OrderKind.START, now_s)

    def order(self, kind: OrderKind, now_s: float) -> None:
        """Orders this from now on."""
        self.station.send_order(kind, now_s)

    def receive(self, data: bytes, now_s: float) -> None:
        """To its station."""
        self.station.receive(data, now_s)

    def tick(self, now_s: float) -> list[bytes]:
        """Frames of its order."""
        return self.station.datagrams(now_s)

    def _draw(self, size: int) -> bytes:
        self._drawn += 1
        return hashlib.sha256(f"understory simulated operator: {self._seed}, {self._drawn}".encode()).digest()[:size]
