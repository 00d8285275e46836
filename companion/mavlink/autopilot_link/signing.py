"""MAVLink 2 signing of the autopilot's link: what goes out is sealed, what comes in without the key is refused.

Timestamps are MAVLink's, 10 us since 2015 (https://mavlink.io/en/guide/message_signing.html), and never fall back. A
board whose clock is not set begins at FLOOR: the autopilot, which refuses what is a minute old, hears it once it has
heard the autopilot, whose time it takes over from the first frame that the key holds for; so do autopilots with ours.
"""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from typing import Final, final

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import SIGNED
from companion.mavlink.framing.signing import Gate
from companion.mavlink.peers.frame_mac import (
    TIMESTAMP_MAX,
    UNITS_PER_S,
    epoch_of,
    is_signed,
    mac_holds,
    seal,
    timestamp_of,
)

BEGUN: Final = int(datetime(2015, 1, 1, tzinfo=UTC).timestamp())
FLOOR: Final = int(datetime(2026, 1, 1, tzinfo=UTC).timestamp() - BEGUN) * UNITS_PER_S  # no clock that is set is before
OLD: Final = 60 * UNITS_PER_S  # a sender that was not heard yet may be behind by this much, as MAVLink has it
STREAMS_MAX: Final = 16  # senders by link, as many as autopilots remember
LINK_ID: Final = 1


def timestamp_at(unix_s: float) -> int:
    """The timestamp of a clock, FLOOR where it is not set."""
    return max(FLOOR, min(int((unix_s - BEGUN) * UNITS_PER_S), TIMESTAMP_MAX))


def as_signed(frame: bytes) -> bytes:
    """An unsigned frame of the dialect with the header, and so the checksum, of a signed one; without its signature."""
    body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3 : -wire.CRC_BYTES]
    message_id = frame[7] | frame[8] << 8 | frame[9] << 16
    crc: int = mcrf4xx(body[1:] + bytes([dialect.mavlink_map[message_id].crc_extra]))
    return body + crc.to_bytes(2, "little")


@final
class LinkSigning(Gate):
    """One end of a link whose other ends have the same key. Frames that were not made by it leave no trace."""

    def __init__(self, key: bytes, *, timestamp: int = FLOOR, link_id: int = LINK_ID) -> None:
        """`key`: 32 bytes. `timestamp`: of now, by the clock, as far as there is one."""
        super().__init__(takes_signed=True)
        self._key = key
        self._link_id = link_id
        self._timestamp = self._begun = timestamp
        self._begun_s: float | None = None
        self._streams: dict[tuple[int, int, int], int] = {}  # system, component, link -> the last timestamp
        self.refusals: Counter[str] = Counter()

    @property
    def timestamp(self) -> int:
        """The last that was sent or heard."""
        return self._timestamp

    def admits(self, frame: bytes) -> bool:
        refusal = self._refusal(frame)
        if refusal:
            self.refused += 1
            self.refusals[refusal] += 1
            return False
        timestamp = timestamp_of(frame)
        self._streams[frame[5], frame[6], epoch_of(frame)] = timestamp
        self._timestamp = max(self._timestamp, timestamp)
        self.signed += 1
        return True

    def is_foreign(self, frame: bytes) -> bool:
        """Not made by the key."""
        return not is_signed(frame) or not mac_holds(frame, self._key)

    def _refusal(self, frame: bytes) -> str:
        if self.is_foreign(frame):
            return "another key" if is_signed(frame) else "unsigned"
        last = self._streams.get((frame[5], frame[6], epoch_of(frame)))
        if last is not None:
            return "" if timestamp_of(frame) > last else "repeated"
        if timestamp_of(frame) + OLD < self._timestamp:
            return "old"
        return "" if len(self._streams) < STREAMS_MAX else "too many senders"

    def seal(self, frame: bytes, now_s: float) -> bytes:
        if self._begun_s is None:
            self._begun_s = now_s
        by_clock = self._begun + int((now_s - self._begun_s) * UNITS_PER_S)
        self._timestamp = min(max(self._timestamp + 1, by_clock), TIMESTAMP_MAX)
        return seal(as_signed(frame), self._key, self._link_id, self._timestamp)

    def counters(self) -> dict[str, int]:
        return {f"frames of the autopilot refused, {why}": n for why, n in sorted(self.refusals.items())}
