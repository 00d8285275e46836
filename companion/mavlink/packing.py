"""Values of messages that take more than one number: what rows of the schema pack and unpack by.

MAVLink 2 cuts trailing zeros off, so a small swarm sends a few bytes of a set, and few ranges are few bytes.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from companion.core.model.beacon import RangeTo, ToldTrunk

MOST: Final = 32  # ranges in a message
FARTHEST_M: Final = 650.0  # a range that fits
AGE_S: Final = 0.01
UNKNOWN_CM: Final = 0xFFFF
_AGE_MAX: Final = 255
_RANGES_BYTES: Final = 4 * MOST
_SETS_BYTES: Final = 96
_TRUNK_BYTES: Final = 5
_TRUNKS_BYTES: Final = 12 * _TRUNK_BYTES
_CM_MAX: Final = 0x7FFF  # of an int16
_SEEN_AGE_BITS: Final = 13
_SEEN_AGE_MAX: Final = (1 << _SEEN_AGE_BITS) - 1


def pack_seen(age_s: float, relays: int) -> int:
    """Age of a sighting in ds, 819.1 s at most, and above it over how many members it came, 0..7."""
    return min(_SEEN_AGE_MAX, round(age_s * 10.0)) | relays << _SEEN_AGE_BITS


def unpack_seen(packed: int) -> tuple[float, int]:
    """`pack_seen` back."""
    return (packed & _SEEN_AGE_MAX) / 10.0, packed >> _SEEN_AGE_BITS


def pack_sets(first: int, second: int, third: int) -> bytes:
    """Three sets (bit k-1: vehicle k, at most 256), their bytes in turn."""
    data = bytearray(_SETS_BYTES)
    data[0::3] = first.to_bytes(_SETS_BYTES // 3, "little")
    data[1::3] = second.to_bytes(_SETS_BYTES // 3, "little")
    data[2::3] = third.to_bytes(_SETS_BYTES // 3, "little")
    return bytes(data)


def unpack_sets(data: bytes) -> tuple[int, int, int]:
    """`pack_sets` back."""
    data = data.rstrip(b"\0")  # 3 bytes for each 8 vehicles are left
    return (
        int.from_bytes(data[0::3], "little"),
        int.from_bytes(data[1::3], "little"),
        int.from_bytes(data[2::3], "little"),
    )


def pack_ranges(ranges: Iterable[RangeTo]) -> bytes:
    """Groups of four bytes: system id (0: none), centimetres as uint16, age in units of AGE_S; MOST at most."""
    data = bytearray()
    for vehicle, metres, age_s in ranges:
        cm = round(min(max(metres, 0.0), FARTHEST_M) * 100.0)
        age = min(_AGE_MAX, max(0, round(age_s / AGE_S)))
        data += bytes((vehicle, cm & 0xFF, cm >> 8, age))
    return bytes(data[:_RANGES_BYTES]).ljust(_RANGES_BYTES, b"\0")


def unpack_ranges(data: Iterable[int]) -> tuple[RangeTo, ...]:
    """Back again; groups without a vehicle, or without a distance, are none."""
    groups = bytes(data)
    found: list[RangeTo] = []
    for at in range(0, len(groups) - 3, 4):
        vehicle, cm = groups[at], groups[at + 1] | groups[at + 2] << 8
        if vehicle and cm:
            found.append((vehicle, cm / 100.0, groups[at + 3] * AGE_S))
    return tuple(found)


def pack_cm(metres: float | None) -> int:
    """Metres -> centimetres of uint16; UNKNOWN_CM: None."""
    return UNKNOWN_CM if metres is None else min(UNKNOWN_CM - 1, max(0, round(metres * 100.0)))


def unpack_cm(cm: int) -> float | None:
    """`pack_cm` back."""
    return None if cm == UNKNOWN_CM else cm / 100.0


def pack_trunks(trunks: Iterable[ToldTrunk]) -> bytes:
    """Groups of five bytes: north and east in centimetres as int16, diameter in centimetres; twelve at most."""
    data = bytearray()
    for north_m, east_m, diameter_m in trunks:
        for metres in (north_m, east_m):
            data += (max(-_CM_MAX, min(_CM_MAX, round(metres * 100.0))) & 0xFFFF).to_bytes(2, "little")
        data.append(max(1, min(255, round(diameter_m * 100.0))))
    return bytes(data[:_TRUNKS_BYTES]).ljust(_TRUNKS_BYTES, b"\0")


def unpack_trunks(data: bytes) -> tuple[ToldTrunk, ...]:
    """`pack_trunks` back; a group without a diameter is none."""
    found: list[ToldTrunk] = []
    for at in range(0, _TRUNKS_BYTES, _TRUNK_BYTES):
        if data[at + 4]:
            north = int.from_bytes(data[at : at + 2], "little", signed=True)
            east = int.from_bytes(data[at + 2 : at + 4], "little", signed=True)
            found.append((north / 100.0, east / 100.0, data[at + 4] / 100.0))
    return tuple(found)
