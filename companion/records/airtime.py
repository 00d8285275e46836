"""Airtime that records may take: what beacons leave of a shared channel, in equal parts to all that are heard."""

from __future__ import annotations

from typing import Final

USABLE_SHARE: Final = 0.7  # of a channel that many share without a schedule; beyond it, beacons would wait for records
LEAST_SHARE: Final = 0.02  # of the channel, for all records together: they get through, however many beacons there are
OVERHEAD_BYTES: Final = 16  # of a frame on the air beside MAVLink's own bytes: preamble, header, checksum
BURST_BYTES: Final = 600  # two records in a row
MEMORY_S: Final = 2.0  # over which the own beacons are measured


class Airtime:
    """A token bucket of bytes."""

    __slots__ = ("_beacons_bps", "_bytes_per_s", "_refilled_s", "_tokens")

    def __init__(self, bit_rate_kbps: float) -> None:
        """`bit_rate_kbps`: of the channel that all share."""
        self._bytes_per_s: Final = bit_rate_kbps * 125.0
        self._beacons_bps = 0.0  # bytes per second of the own beacons; the others' are taken to be as many
        self._tokens = 0.0
        self._refilled_s: float | None = None

    def refill(self, now_s: float, beacon_bytes: int, heard: int) -> None:
        """Once a tick. `beacon_bytes`: that this node has just sent ahead of any record; `heard`: other nodes."""
        if beacon_bytes:
            beacon_bytes += OVERHEAD_BYTES
        if self._refilled_s is None:
            self._refilled_s = now_s
            return
        passed_s = min(max(0.0, now_s - self._refilled_s), MEMORY_S)
        self._refilled_s = now_s
        self._beacons_bps += (beacon_bytes - self._beacons_bps * passed_s) / MEMORY_S
        left = self._bytes_per_s * USABLE_SHARE - self._beacons_bps * (heard + 1)
        share = max(left, self._bytes_per_s * LEAST_SHARE) / (heard + 1)
        self._tokens = min(BURST_BYTES, self._tokens + share * passed_s)

    def take_tokens(self, frame_bytes: int) -> bool:
        """True if a frame may go out now; it has then taken its part."""
        cost = frame_bytes + OVERHEAD_BYTES
        if self._tokens < cost:
            return False
        self._tokens -= cost
        return True

    def charge(self, frame_bytes: int) -> None:
        """A frame goes out whatever is left: the records after it wait the longer."""
        self._tokens -= frame_bytes + OVERHEAD_BYTES
