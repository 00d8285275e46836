"""Bytes of lidars, written from their makers' specifications alone: nothing of companion.lidar is used."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable

RPLIDAR_SCANNING = bytes.fromhex("a55a0500004081")
RPLIDAR_INFO = bytes.fromhex("a55a1400000004") + bytes([0x18, 29, 1, 7]) + bytes(range(16))
RPLIDAR_HEALTHY = bytes.fromhex("a55a0300000006") + bytes([0, 0, 0])
RPLIDAR_FAILED = bytes.fromhex("a55a0300000006") + bytes([2, 0x34, 0x12])

World = Callable[[float], float]  # azimuth of the lidar, degrees clockwise -> range, m; 0: nothing there


def everywhere(range_m: float) -> World:
    """A round wall."""
    return lambda _azimuth_deg: range_m


def post(azimuth_deg: float, range_m: float, wall_m: float = 0.0) -> World:
    """A post of 6 degrees, and a wall behind it (0: none)."""

    def world(at_deg: float) -> float:
        return range_m if abs(math.remainder(at_deg - azimuth_deg, 360.0)) <= 3.0 else wall_m

    return world


def rplidar_sample(azimuth_deg: float, range_m: float, *, starts: bool = False) -> bytes:
    """One measurement of 5 bytes."""
    angle = round(azimuth_deg * 64)
    quality_and_flags = 0x3C | (1 if starts else 2)
    return struct.pack(
        "<BBBH", quality_and_flags, (angle & 0x7F) << 1 | 1, angle >> 7, round(range_m * 4000) if range_m else 0
    )


def rplidar_revolution(world: World, samples: int = 360) -> bytes:
    """One turn."""
    step_deg = 360.0 / samples
    return b"".join(rplidar_sample(k * step_deg, world(k * step_deg), starts=k == 0) for k in range(samples))


def ld_crc8(data: bytes) -> int:
    """Bit by bit: polynomial x^8 + x^6 + x^3 + x^2 + 1, from 0, the highest bit first."""
    crc = 0
    for value in data:
        crc ^= value
        for _ in range(8):
            crc = (crc << 1 ^ 0x4D if crc & 0x80 else crc << 1) & 0xFF
    return crc


def ld_packet(start_deg: float, end_deg: float, ranges_m: Iterable[float]) -> bytes:
    """One packet of 12 points."""
    points = b"".join(struct.pack("<HB", round(range_m * 1000), 200) for range_m in ranges_m)
    ends_cdeg = [round(deg * 100) % 36000 for deg in (start_deg, end_deg)]
    body = b"\x54\x2c" + struct.pack("<HH", 3600, ends_cdeg[0]) + points + struct.pack("<HH", ends_cdeg[1], 1234)
    return body + bytes([ld_crc8(body)])


def ld_revolution(world: World, packets: int = 38) -> bytes:
    """One turn: 456 points at 10 Hz."""
    step_deg = 360.0 / (12 * packets)
    found = b""
    for packet in range(packets):
        at_deg = [(12 * packet + k) * step_deg for k in range(12)]
        found += ld_packet(at_deg[0], at_deg[-1], [world(deg) for deg in at_deg])
    return found


def mid360_datagram(kind: int, points: bytes, count: int) -> bytes:
    """Header and points."""
    return struct.pack("<BHHHHBBB12xIQ", 0, 36 + len(points), 500, count, 1, 0, kind, 0, 0, 10**9) + points


def mid360_points(kind: int, points_m: Iterable[tuple[float, float, float]]) -> bytes:
    """One datagram of points at x ahead, y left, z up, in metres."""
    data = b""
    at = list(points_m)
    for x, y, z in at:
        if kind == 1:
            data += struct.pack("<iiiBB", round(x * 1000), round(y * 1000), round(z * 1000), 50, 0)
        elif kind == 2:
            data += struct.pack("<hhhBB", round(x * 100), round(y * 100), round(z * 100), 50, 0)
        else:
            depth_m = math.sqrt(x * x + y * y + z * z)
            zenith_deg = math.degrees(math.acos(z / depth_m)) if depth_m else 0.0
            azimuth_deg = math.degrees(math.atan2(y, x)) % 360.0
            data += struct.pack(
                "<IHHBB", round(depth_m * 1000), round(zenith_deg * 100), round(azimuth_deg * 100) % 36000, 50, 0
            )
    return mid360_datagram(kind, data, len(at))
