"""LDROBOT LD06 and LD19 (STL-06P, STL-19P): LDROBOT, LD06 and LD19 Development Manual (data protocol).

It sends by itself at 230400 baud, one way: packets of 47 bytes, little-endian. 54, 2C (12 points), speed (degrees/s),
start angle (0.01 degree), 12 times distance (mm, 0 where nothing came back) and intensity, end angle, timestamp (ms,
modulo 30000), CRC-8 (polynomial 4D) of what is before. Angles are clockwise, seen from above, evenly spaced.
"""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from typing import Final

from companion.lidar.driver import Return

HEADER: Final = b"\x54\x2c"
POINTS: Final = 12
PACKET_BYTES: Final = 47
TURN_CDEG: Final = 36000
_PACKET: Final = Struct("<2xHH" + "HB" * POINTS + "HHx")
_POLYNOMIAL: Final = 0x4D


def _crc_of_byte(value: int) -> int:
    for _ in range(8):
        value = value << 1 ^ (_POLYNOMIAL if value & 0x80 else 0)
    return value & 0xFF


_CRC: Final = bytes(_crc_of_byte(value) for value in range(256))


def crc8(data: bytes) -> int:
    """Checksum of a packet."""
    crc = 0
    for value in data:
        crc = _CRC[crc ^ value]
    return crc


class LdLidar:
    """Only listens: it needs no request, and takes none."""

    def __init__(self) -> None:
        self.bad = 0
        self.notes: list[str] = []
        self._buffer = b""
        self._front_cdeg: int | None = None  # the farthest round: packets may overlap

    def poll(self, _now_s: float) -> bytes:
        """Nothing, ever."""
        return b""

    def decode(self, data: bytes) -> Iterator[Return]:
        """Points of whole packets with the right checksum."""
        buffer = self._buffer + data
        at = 0
        while len(buffer) - at >= PACKET_BYTES:
            packet = buffer[at : at + PACKET_BYTES]
            if packet.startswith(HEADER) and crc8(packet[:-1]) == packet[-1]:
                yield from self._points(packet)
                at += PACKET_BYTES
            else:
                self.bad += 1
                at += 1
        self._buffer = buffer[at:]

    def shutdown(self) -> bytes:
        """Nothing: it turns while it has power."""
        return b""

    def _points(self, packet: bytes) -> Iterator[Return]:
        _speed, start_cdeg, *points, end_cdeg, _time_ms = _PACKET.unpack(packet)
        step_cdeg = (end_cdeg - start_cdeg) % TURN_CDEG / (POINTS - 1)
        for k in range(POINTS):
            at_cdeg = round(start_cdeg + k * step_cdeg) % TURN_CDEG
            yield at_cdeg, points[2 * k] / 1000.0, 0.0, self._passes_zero(at_cdeg)

    def _passes_zero(self, at_cdeg: int) -> bool:
        """True for the first point of a revolution; one that goes back by less than half a turn begins none."""
        front_cdeg = at_cdeg if self._front_cdeg is None else self._front_cdeg
        is_ahead = (at_cdeg - front_cdeg) % TURN_CDEG < TURN_CDEG // 2
        self._front_cdeg = at_cdeg if is_ahead else front_cdeg
        return is_ahead and at_cdeg < front_cdeg
