"""SWARM_RANGES, what a range radio's driver tells its companion, and SWARM_RELATIVE, what goes with beacons.

Both carry ranges as MOST groups of four bytes: system id (0: none), centimetres as uint16, age in units of 10 ms.
MAVLink 2 cuts trailing zeros off, so few ranges are few bytes. `swarm.xml` says what each field means.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from typing import Any, Final

from companion.core.model.beacon import RangeTo, RelativeReport
from companion.mavlink import dialect
from companion.mavlink.beacon import FURTHEST_M
from companion.mavlink.frames import payload_of

MOST: Final = 32
RELATIVE_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_RELATIVE
FARTHEST_M: Final = 650.0  # fits
AGE_S: Final = 0.01
_AGE_MAX: Final = 255
_BYTES: Final = 4 * MOST
_UNKNOWN: Final = 0xFFFF
_RELATIVE = struct.Struct(f"<IfffffH{_BYTES}s")
_RELATIVE_ID_BYTES: Final = RELATIVE_ID.to_bytes(3, "little")
_RELATIVE_CRC = bytes([dialect.MAVLink_swarm_relative_message.crc_extra])


def pack_ranges(ranges: Iterable[RangeTo]) -> bytes:
    """SWARM_RANGES' payload; at most MOST of them are told."""
    data = bytearray()
    for vehicle, metres, age_s in ranges:
        cm = round(min(max(metres, 0.0), FARTHEST_M) * 100.0)
        age = min(_AGE_MAX, max(0, round(age_s / AGE_S)))
        data += bytes((vehicle, cm & 0xFF, cm >> 8, age))
    return bytes(data[:_BYTES]).ljust(_BYTES, b"\0")


def ranges_of(data: Iterable[int]) -> tuple[RangeTo, ...]:
    """Back again; groups without a vehicle, or without a distance, are none."""
    groups = bytes(data)
    found: list[RangeTo] = []
    for at in range(0, len(groups) - 3, 4):
        vehicle, cm = groups[at], groups[at + 1] | groups[at + 2] << 8
        if vehicle and cm:
            found.append((vehicle, cm / 100.0, groups[at + 3] * AGE_S))
    return tuple(found)


def own_ranges(m: Any) -> tuple[RangeTo, ...]:
    """SWARM_RANGES -> what was measured."""
    return ranges_of(m.ranges)


def pack_word(word: RelativeReport) -> bytes:
    """SWARM_RELATIVE's payload."""
    to_leader = word.to_leader_ne_m
    leader_n, leader_e, sd_m = (0.0, 0.0, -1.0) if to_leader is None else (*to_leader, word.leader_sd_m)
    odo_n, odo_e = word.odo_ne_m
    time_ms = word.time_ms & 0xFFFFFFFF
    place_sd_m = word.place_sd_m
    place_cm = _UNKNOWN if place_sd_m is None else min(_UNKNOWN - 1, max(0, round(place_sd_m * 100.0)))
    return _RELATIVE.pack(time_ms, odo_n, odo_e, leader_n, leader_e, sd_m, place_cm, pack_ranges(word.ranges))


def word_of(frame: bytes) -> RelativeReport | None:
    """A whole SWARM_RELATIVE frame -> what it says, a signature unread; None: it is none, or not to be believed."""
    payload = payload_of(frame, _RELATIVE_ID_BYTES, _RELATIVE_CRC, _RELATIVE.size)
    if payload is None:
        return None
    time_ms, odo_n, odo_e, leader_n, leader_e, sd_m, place_cm, groups = _RELATIVE.unpack(payload)
    if not all([math.isfinite(x) and abs(x) <= FURTHEST_M for x in (odo_n, odo_e, leader_n, leader_e, sd_m)]):
        return None
    to_leader = None if sd_m < 0.0 else (leader_n, leader_e)
    place_sd_m = None if place_cm == _UNKNOWN else place_cm / 100.0
    return RelativeReport(frame[5], time_ms, (odo_n, odo_e), to_leader, max(0.0, sd_m), ranges_of(groups), place_sd_m)
