"""Livox Mid-360: Livox wiki, Livox LiDAR Communication Protocol - Mid360 (v1.4.11).

UDP, little-endian. Point data come to the host's port 56301: a header of 36 bytes (version 0, length u16, time interval
u16, points u16, packet count u16, frame count, data type, time type, 12 reserved, CRC-32, time u64) and 96 points. Type
1 is Cartesian in mm (i32), type 2 in cm (i16), each with reflectivity and tag; type 3 is spherical: depth (u32, mm),
zenith angle and azimuth (u16, 0.01 degree), reflectivity, tag; type 0 is the IMU's. x ahead, y left, z up; a point at
the origin, or of depth 0: nothing came back. The datagram's own checksum is relied on. Tags, which grade points as rain
or dust, are left alone: the safe side.

Commands go to its port 56100: AA, version 0, length u16, sequence u32, command u16, type (0: request, 1: answer),
sender, 6 reserved, CRC-16 (CCITT-FALSE) of these 18 bytes, CRC-32 of the data, data. Command 0100 writes parameters:
how many u16, reserved u16, then key u16, length u16, value of each. Its answer: return code u8, key in error u16.
"""

from __future__ import annotations

import math
import socket
import zlib
from collections.abc import Callable, Iterator
from struct import Struct, pack
from typing import Final

from fastcrc.crc16 import ibm_3740

from companion.lidar.driver import Return

COMMAND_PORT: Final = 56100
HEADER_BYTES: Final = 36
COMMAND_BYTES: Final = 24
REQUEST_S: Final = 1.0  # between two, while it sends no points
WRITE_PARAMETERS: Final = 0x0100
KEY_DATA_TYPE: Final = 0x0000
KEY_POINTS_HOST: Final = 0x0006  # IPv4 address, its port, the lidar's port
KEY_WORK_MODE: Final = 0x001A
SPHERICAL: Final = 3  # half of the work, and 10 bytes a point
SAMPLING: Final = 1
POINTS_SOURCE_PORT: Final = 56300

_HEADER: Final = Struct("<BHHHHBB")
_ANSWER: Final = Struct("<BBHIHBB")
_CDEG: Final = math.degrees(100.0)  # of a radian
_SINES: Final = tuple(0.001 * math.sin(math.radians(k / 100.0)) for k in range(18001))  # m of a mm, by zenith angle
_COSINES: Final = tuple(0.001 * math.cos(math.radians(k / 100.0)) for k in range(18001))


class Mid360:
    """Points of its datagrams; where it may, it is told to send them here."""

    def __init__(self, host: tuple[str, int] | None = None) -> None:
        """`host`: IPv4 address and port of this computer, to be set as where points go; None: it is set up already."""
        self.bad = 0
        self.notes: list[str] = []
        self._host = host
        self._due_s = 0.0
        self._sequence = 0
        self._has_measured = False

    def poll(self, now_s: float) -> bytes:
        """Request to send points here, once a second until they come."""
        if self._has_measured:
            self._has_measured = False
            self._due_s = now_s + REQUEST_S
        if self._host is None or now_s < self._due_s:
            return b""
        self._due_s = now_s + REQUEST_S
        self._sequence += 1
        return start_request(self._host, self._sequence)

    def decode(self, data: bytes) -> list[Return]:
        """Points of one datagram."""
        if len(data) < HEADER_BYTES:
            self.bad += 1
            return []
        version, length, _interval, count, _packets, _frame, data_type = _HEADER.unpack_from(data)
        layout = _LAYOUTS.get(data_type)
        if version != 0 or length != len(data) or (layout is None and data_type != 0):
            self.bad += 1
            return []
        if layout is None:  # of its IMU
            return []
        points, make = layout
        if HEADER_BYTES + count * points.size != len(data):
            self.bad += 1
            return []
        self._has_measured = True
        return make(points.iter_unpack(memoryview(data)[HEADER_BYTES:]))

    def decode_answer(self, data: bytes) -> None:
        """One datagram of its command port: a refusal becomes a note."""
        if len(data) < COMMAND_BYTES + 3:
            return
        start, _version, _length, _sequence, command, kind, _sender = _ANSWER.unpack_from(data)
        if (start, command, kind) == (0xAA, WRITE_PARAMETERS, 1) and data[COMMAND_BYTES]:
            key = data[COMMAND_BYTES + 1] | data[COMMAND_BYTES + 2] << 8
            self.notes.append(f"Mid-360 refuses parameter {key:#06x}: return code {data[COMMAND_BYTES]:#04x}")

    def shutdown(self) -> bytes:
        """Nothing: it may be another program's, too."""
        return b""


def start_request(host: tuple[str, int], sequence: int) -> bytes:
    """Command that has it send spherical points to `host`."""
    address, port = host
    values = {
        KEY_DATA_TYPE: bytes([SPHERICAL]),
        KEY_POINTS_HOST: socket.inet_aton(address) + pack("<HH", port, POINTS_SOURCE_PORT),
        KEY_WORK_MODE: bytes([SAMPLING]),
    }
    data = pack("<HH", len(values), 0)
    for key, value in values.items():
        data += pack("<HH", key, len(value)) + value
    head = pack("<BBHIHBB6x", 0xAA, 0, COMMAND_BYTES + len(data), sequence, WRITE_PARAMETERS, 0, 0)
    return head + pack("<HI", ibm_3740(head), zlib.crc32(data)) + data


def _from_cartesian(unit_m: float) -> Callable[[Iterator[tuple[int, ...]]], list[Return]]:
    def make(points: Iterator[tuple[int, ...]]) -> list[Return]:
        return [
            (round(-_CDEG * math.atan2(y, x)) % 36000, math.hypot(x, y) * unit_m, z * unit_m, False)
            for x, y, z, _reflectivity, _tag in points
            if x or y or z
        ]

    return make


def _from_spherical(points: Iterator[tuple[int, ...]]) -> list[Return]:
    return [
        (-azimuth_cdeg % 36000, depth_mm * _SINES[zenith_cdeg], depth_mm * _COSINES[zenith_cdeg], False)
        for depth_mm, zenith_cdeg, azimuth_cdeg, _reflectivity, _tag in points
        if depth_mm and zenith_cdeg <= 18000
    ]


_LAYOUTS: Final = {
    1: (Struct("<iiiBB"), _from_cartesian(0.001)),
    2: (Struct("<hhhBB"), _from_cartesian(0.01)),
    SPHERICAL: (Struct("<IHHBB"), _from_spherical),
}
