"""The base station without its sockets: the radio's bytes in, datagrams out. The same on a laptop and in lockstep."""

from __future__ import annotations

from typing import Final

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.records.exchange import Progress, RecordExchange
from companion.records.record import BASE_ID


class BaseStation:
    """Takes in records, and answers with the vector of what it has on its disk. Times are the local clock's, s."""

    def __init__(self, records: RecordExchange) -> None:
        """`records`: the base station's, by `companion.records.node.open_base`."""
        self.records: Final = records
        self._sender = wire.Sender(BASE_ID, swarm_beacon.COMPONENT)
        self._heard_s: dict[int, float] = {}  # by system id, at most 255

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram of the swarm's radio."""

        def take_record(frame: bytes) -> bool:
            return self.records.receive(frame, now_s)

        for sender, _, _ in swarm_beacon.read_each(data, swarm_beacon.unpack, take_record):
            self._heard_s[sender] = now_s

    def tick(self, now_s: float) -> list[bytes]:
        """Datagrams to send now."""
        return [self._sender.frame(*frame) for frame in self.records.frames(now_s, 0)]

    def in_range(self, now_s: float, within_s: float = 3.0) -> list[int]:
        """Vehicles whose beacons were heard lately."""
        return sorted(k for k, heard_s in self._heard_s.items() if now_s - heard_s <= within_s)

    @property
    def progress(self) -> Progress:
        """Count of the records that were heard of, and of those that are here."""
        return self.records.progress()
