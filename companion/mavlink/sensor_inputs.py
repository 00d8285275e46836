"""Routes what comes by sensors' links, or is forwarded by the autopilot, to the sensors of one vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from companion.core.model.events import Event
from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing, Incoming
from companion.mavlink.framing.signing import Gate
from companion.mavlink.sensor_source import PayloadValue, SensorSource
from companion.mavlink.streams import fastest_hz

FOREIGN_MAX: Final = 16  # systems of each sensor that are remembered, to be named
SHARED: Final = ""  # the link of all drivers, where no link has a name


class SensorInputs:
    """One vehicle's `sources`, and the framing of each link to their drivers.

    A driver sends with the vehicle's own system id, and any component but the autopilot's: what says that it is the
    autopilot, and is not on its link, is misconfigured. What is forwarded by the autopilot is passed over once that
    message has come by a sensor's link: the same late, or put together from others.
    """

    def __init__(self, sources: Sequence[SensorSource], vehicle_id: int, streams: Mapping[str, bool]) -> None:
        """`streams`: by the name of a link, whether its bytes may break anywhere (serial)."""
        self.sources: Final = tuple(sources)
        self.forwarded: Final = frozenset(id_ for source in sources if source.IS_FORWARDED for id_ in source.MESSAGES)
        self.autopilot_hz: Final = fastest_hz(*[source.AUTOPILOT_HZ for source in sources])
        self._by_message: Final = {id_: source for source in sources for id_ in source.MESSAGES}
        self._vehicle_id: Final = vehicle_id
        self._gate: Final = Gate(takes_signed=True)  # by wire, or from a simulator
        wanted = frozenset(self._by_message)
        self._framings: Final = {
            name: Framing(wanted, is_stream=is_stream) for name, is_stream in {SHARED: False, **streams}.items()
        }
        self._linked: Final = set[int]()  # messages that have come by a sensor's link
        self._foreign: Final = {source.NAME: set[int]() for source in sources}

    def read_link(self, link: str, data: bytes, now_s: float) -> list[Event]:
        """Bytes of a sensor's link, which arrive at `now_s` -> what is to be told at once."""
        found: list[Event] = []
        for incoming in self._framings[link].read_messages(data):
            if self._gate.admits(incoming.frame) and incoming.component != dialect.MAV_COMP_ID_AUTOPILOT1:
                source = self._by_message[incoming.message_id]
                if incoming.system == self._vehicle_id:
                    self._linked.add(incoming.message_id)
                event = self._decode(source, incoming, now_s)
                if event is not None:
                    found.append(event)
        return found

    def read_forwarded(self, incoming: Incoming, now_s: float) -> Event | None:
        """A message of `forwarded`, on the autopilot's link."""
        if incoming.message_id in self._linked:
            return None
        return self._decode(self._by_message[incoming.message_id], incoming, now_s)

    def read_autopilot(self, message_id: int, m: Any, now_s: float) -> None:
        """A message of `autopilot_hz`, of the own autopilot."""
        for source in self.sources:
            if message_id in source.AUTOPILOT_HZ:
                source.read_autopilot(m, now_s)

    def collect(self, now_s: float) -> list[Event]:
        """Events that waited for the tick."""
        return [event for source in self.sources for event in source.collect(now_s)]

    def take_values(self) -> list[PayloadValue]:
        """Values for [[payload]] that have come since last asked."""
        return [value for source in self.sources for value in source.take_values()]

    def foreign(self, name: str) -> frozenset[int]:
        """Other systems whose drivers of a sensor were heard, at most FOREIGN_MAX: theirs must be the vehicle's id."""
        return frozenset(self._foreign[name])

    def bad(self, link: str) -> int:
        """Frames of a link that were not whole or not valid."""
        return self._framings[link].bad

    def _decode(self, source: SensorSource, incoming: Incoming, now_s: float) -> Event | None:
        if incoming.system == self._vehicle_id:
            return source.decode(incoming.message, incoming.component, now_s)
        foreign = self._foreign[source.NAME]
        if len(foreign) < FOREIGN_MAX:
            foreign.add(incoming.system)
        return None
