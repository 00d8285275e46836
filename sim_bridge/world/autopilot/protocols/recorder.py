"""Records what a recorder on the vehicle hears of its autopilot beside the companion's link: a port of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.protocols.links import Port
from sim_bridge.world.autopilot.protocols.streams import StreamTable

# A few a second are what tools need to draw a track; a companion asks for what it needs itself.
RATES_HZ: Final = {
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
}


class Recorder:
    """Its streams and its sequence numbers: nothing that another link sends changes with it.

    It does not hear again what `heard`, the companion's link, streams at least as often.
    """

    def __init__(self, sysid: int, order: Iterable[int], heard: StreamTable) -> None:
        self.port = Port(sysid)
        self._streams = StreamTable(order, RATES_HZ)
        self._heard = heard

    def due(self, now_us: int) -> list[int]:
        """Message ids to be recorded now."""
        return [message_id for message_id in self._streams.due(now_us) if not self._is_heard(message_id)]

    def _is_heard(self, message_id: int) -> bool:
        return 0 < self._heard.interval_us(message_id) <= self._streams.interval_us(message_id)
