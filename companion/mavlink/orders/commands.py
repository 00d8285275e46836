"""MAVLink's commands that a ground station's operator orders a swarm by. They bear no key."""

from __future__ import annotations

from typing import Final

from companion.core.model.states import Order
from companion.mavlink import dialect

COMMANDS: Final = {
    dialect.MAV_CMD_MISSION_START: Order.START,
    dialect.MAV_CMD_NAV_LAND: Order.ABORT,
}
PAUSE: Final = {0.0: Order.HOLD, 1.0: Order.START}  # by param1 of MAV_CMD_DO_PAUSE_CONTINUE


def order_of(command: int, param1: float) -> Order | None:
    """The order that a COMMAND_LONG means; None: none."""
    if command == dialect.MAV_CMD_DO_PAUSE_CONTINUE:
        return PAUSE.get(param1)
    return COMMANDS.get(command)
