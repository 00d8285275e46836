"""A ground station's commands, made orders of the operator's key: bytes in, bytes out, no sockets.

A START that finds vehicles not ready is refused once, with their names; the same command again within CONFIRM_S means
it. Everything else is ordered at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from companion.core.model.states import Severity
from companion.mavlink import dialect
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import texts, wire
from companion.mavlink.framing.frames import Framing, Incoming
from companion.mavlink.orders.commands import order_of
from companion.mavlink.orders.order import OrderKind
from companion.mavlink.peers.session import OPERATOR_ID
from companion.order.station import OperatorStation, OrderFileError, list_ids, reason_of

HEARTBEAT_S: Final = 1.0
CONFIRM_S: Final = 10.0

WANTED: Final = frozenset({dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT})


class GroundStation:
    """The link to one ground station. It is seen there as an onboard computer, component 191 of system 253."""

    def __init__(self, station: OperatorStation, size: int, tell: Callable[[str], None]) -> None:
        """`tell`: a line for whoever runs it."""
        self._station, self._size, self._tell = station, size, tell
        self._framing = Framing(WANTED)
        self._out: list[bytes] = []
        self._seq = 0
        self._text_id = 0
        self._heartbeat_s = self._asked_s = -math.inf

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram of the ground station. Whatever it is, nothing raises."""
        for incoming in self._framing.read_messages(data):
            self._command(incoming, now_s)

    def datagrams(self, now_s: float) -> list[bytes]:
        """Datagrams to send with this turn."""
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            beat = dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
            )
            self._send(beat)
        out, self._out = self._out, []
        return out

    def _command(self, incoming: Incoming, now_s: float) -> None:
        m = incoming.message
        is_ours = m.target_component in (0, COMPONENT) and (m.target_system in (0, OPERATOR_ID) or self._is_vehicle(m))
        order = order_of(m.command, m.param1) if is_ours else None
        if not is_ours:
            return
        result = dialect.MAV_RESULT_UNSUPPORTED
        if order is not None:
            result = self._order(OrderKind[order.name], now_s)
        acknowledged = dialect.MAVLink_command_ack_message(m.command, result, 0, 0, incoming.system, incoming.component)
        self._send(acknowledged, system=m.target_system or OPERATOR_ID)

    def _is_vehicle(self, m: Any) -> bool:
        return bool(1 <= m.target_system <= self._size)

    def _order(self, kind: OrderKind, now_s: float) -> int:
        missing = self._station.not_ready(now_s) if kind is OrderKind.START else {}
        if missing and now_s - self._asked_s > CONFIRM_S:
            self._asked_s = now_s
            self._report_text(f"START again within {CONFIRM_S:.0f} s to go without {list_ids(list(missing))}")
            return int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
        self._asked_s = -math.inf
        try:
            warning = self._station.send_order(kind, now_s)
        except (OSError, OrderFileError) as error:
            self._report_text(f"{kind.name}: not ordered: {reason_of(error)}", Severity.CRITICAL)
            return int(dialect.MAV_RESULT_FAILED)
        if warning:
            self._report_text(warning, Severity.WARNING)
        self._report_text(f"{kind.name}: ordered")
        return int(dialect.MAV_RESULT_ACCEPTED)

    def _report_text(self, text: str, severity: Severity = Severity.NOTICE) -> None:
        self._tell(text)
        self._text_id = self._text_id % texts.ID_MAX + 1
        for message in texts.encode(severity, text, self._text_id):
            self._send(message)

    def _send(self, message: Any, *, system: int = OPERATOR_ID) -> None:
        self._out.append(wire.pack(message, seq=self._seq, system=system, component=COMPONENT))
        self._seq = (self._seq + 1) & 0xFF
