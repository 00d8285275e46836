"""CRC-16/MCRF4XX by the standard library's CRC of the same polynomial, which goes through bits the other way round."""

from __future__ import annotations

import binascii
from typing import Final

_REVERSED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def mcrf4xx(data: bytes, initial: int = 0xFFFF) -> int:
    """Of `data`, begun with `initial`."""
    begun = _REVERSED[initial & 0xFF] << 8 | _REVERSED[initial >> 8]
    found = binascii.crc_hqx(bytes(data).translate(_REVERSED), begun)
    return _REVERSED[found & 0xFF] << 8 | _REVERSED[found >> 8]
