"""Airtime that records may take: what beacons leave of a shared channel, in equal parts to all that are heard."""

from __future__ import annotations

from typing import Final

from companion.mavlink.framing.wire import CRC_BYTES, HEADER_BYTES

USABLE_SHARE: Final = 0.6  # of a channel that many share without a schedule; beyond it, beacons would wait for records
LEAST_SHARE: Final = 0.02  # of the channel, for all records together: they get through, however many beacons there are
OVERHEAD_BYTES: Final = 16  # of a frame on the air beside MAVLink's own bytes: preamble, header, checksum
BURST_BYTES: Final = 300  # one record, of the longest
MEMORY_S: Final = 4.0  # over which is measured what goes ahead of records


class Airtime:
    """A token bucket of bytes."""

    __slots__ = ("_ahead_bps", "_bytes_per_s", "_refilled_s", "_tokens")

    def __init__(self, bit_rate_kbps: float) -> None:
        """`bit_rate_kbps`: of the channel that all share."""
        self._bytes_per_s: Final = bit_rate_kbps * 125.0
        self._ahead_bps = 0.0  # bytes per second of beacons and vectors; those of others are taken to be as many
        self._tokens = 0.0
        self._refilled_s: float | None = None

    def refill(self, now_s: float, ahead_bytes: int, heard: int, aside_bps: float = 0.0) -> None:
        """Once a tick. `ahead_bytes`: that this node sends now ahead of any record; `heard`: number of other nodes.

        `aside_bps`: bytes per second of a node that is not among them.
        """
        if self._refilled_s is None:
            self._refilled_s = now_s
            return
        passed_s = min(max(0.0, now_s - self._refilled_s), MEMORY_S)
        self._refilled_s = now_s
        self._ahead_bps += (ahead_bytes - self._ahead_bps * passed_s) / MEMORY_S
        left = self._bytes_per_s * USABLE_SHARE - self._ahead_bps * (heard + 1) - aside_bps
        share = max(left, self._bytes_per_s * LEAST_SHARE) / (heard + 1)
        self._tokens = min(BURST_BYTES, self._tokens + share * passed_s)

    def take_tokens(self, frame_bytes: int) -> bool:
        """True if a record may go out now; it has then taken its part."""
        cost = frame_bytes + OVERHEAD_BYTES
        if self._tokens < cost:
            return False
        self._tokens -= cost
        return True


def frame_bytes(payload: bytes) -> int:
    """Of its frame, as MAVLink 2 cuts trailing zeros off."""
    return len(payload.rstrip(b"\0")) + HEADER_BYTES + CRC_BYTES
