"""The records of one vehicle, as its endpoint sees them: companion.records keeps them and passes them on."""

from __future__ import annotations

from typing import Protocol


class RecordLink(Protocol):
    """Measurements that come into a log, and frames of the peers' link by which they reach the base station."""

    def append(self, kind: int, body: bytes, now_s: float) -> None:
        """One more record of this vehicle's own."""

    def receive(self, frame: bytes, now_s: float) -> bool:
        """A whole frame of the peers' link; False: it is none of records, or not valid."""

    def frames(self, now_s: float, beacon_bytes: int) -> list[tuple[int, bytes]]:
        """Message ids and payloads to send now, behind so many bytes of beacons."""

    def lines(self) -> list[str]:
        """Lines for the operator, since last asked."""

    def counters(self) -> dict[str, int]:
        """Counts for the log: what is made, delivered, lost and refused."""
