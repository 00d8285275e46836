"""MAVLink 2's signature of a frame: link id, timestamp and the first 48 bits of a SHA-256, behind the checksum.

https://mavlink.io/en/guide/message_signing.html: SHA-256 of key, header, payload, checksum, link id and timestamp. The
link id says with which of the swarm's secrets it was made (its epoch); the timestamp is a counter of 10 us of the
sender's own clock, which grows with every frame.
"""

from __future__ import annotations

import hmac
from hashlib import sha256
from typing import Final

from companion.mavlink.framing.frames import MAGIC_V2, SIGNATURE_BYTES, SIGNED

UNITS_PER_S: Final = 100_000  # of a timestamp
MAC_BYTES: Final = 6
TIMESTAMP_MAX: Final = (1 << 48) - 1


def is_signed(frame: bytes) -> bool:
    """A whole MAVLink 2 frame that bears a signature."""
    return frame[0] == MAGIC_V2 and frame[2] & SIGNED != 0


def seal(frame: bytes, key: bytes, epoch: int, timestamp: int) -> bytes:
    """A whole frame whose header says that it is signed, as yet without its signature -> with it."""
    body = frame + bytes([epoch]) + timestamp.to_bytes(6, "little")
    return body + sha256(key + body).digest()[:MAC_BYTES]


def epoch_of(frame: bytes) -> int:
    """Of a signed frame: which secret it was made with."""
    return frame[-SIGNATURE_BYTES]


def timestamp_of(frame: bytes) -> int:
    """Of a signed frame, in 10 us of its sender's clock."""
    return int.from_bytes(frame[-SIGNATURE_BYTES + 1 : -MAC_BYTES], "little")


def mac_of(frame: bytes) -> bytes:
    """Of a signed frame: six bytes, by which it is named in its sender's manifest."""
    return frame[-MAC_BYTES:]


def mac_holds(frame: bytes, key: bytes) -> bool:
    """A signed frame was made with this key; in constant time."""
    return hmac.compare_digest(sha256(key + frame[:-MAC_BYTES]).digest()[:MAC_BYTES], frame[-MAC_BYTES:])
