"""Other bytes out of genuine ones: any bytes, and frames whose fields are changed and whose checksum holds again."""

from __future__ import annotations

import struct
from random import Random
from typing import Final

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect
from companion.mavlink.framing.frames import MAGIC_V1, MAGIC_V2, SIGNED, frames

CRC_EXTRA: Final = {message_id: bytes([m.crc_extra]) for message_id, m in dialect.mavlink_map.items()}
IDS: Final = sorted(dialect.mavlink_map)
DATAGRAM_MAX: Final = 65_507  # of UDP over IPv4
NUMBERS: Final = tuple(
    [
        *(struct.pack("<f", x) for x in (float("nan"), float("inf"), float("-inf"), 0.0, -0.0, 1e-45, 3.4e38, -3.4e38)),
        *(struct.pack("<d", x) for x in (float("nan"), float("inf"), 1e308, -1e308, 5e-324)),
        *(struct.pack("<i", x) for x in (0, -1, 2**31 - 1, -(2**31), 1, 900_000_000, -1_800_000_001)),
        *(struct.pack("<q", x) for x in (0, -1, 2**63 - 1, -(2**63), 1)),
        *(struct.pack("<H", x) for x in (0, 1, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF)),
        *(bytes([x]) for x in (0, 1, 0x7F, 0x80, 0xFE, 0xFF, MAGIC_V1, MAGIC_V2)),
    ]
)


def frame_of(message_id: int, payload: bytes, header: bytes, *, is_v1: bool = False) -> bytes:
    """A frame whose checksum holds. `header`: incompatible flags, compatible flags, sequence, system, component."""
    if is_v1:
        head = bytes([len(payload), *header[2:], message_id & 0xFF])
        return _sealed(bytes([MAGIC_V1]), head + payload, CRC_EXTRA.get(message_id & 0xFF, b""))
    head = bytes([len(payload), *header]) + message_id.to_bytes(3, "little")
    return _sealed(bytes([MAGIC_V2]), head + payload, CRC_EXTRA.get(message_id, b""))


def _sealed(magic: bytes, body: bytes, extra: bytes) -> bytes:
    return magic + body + int(mcrf4xx(body + extra)).to_bytes(2, "little")


def change_datagram(rng: Random, data: bytes, other: bytes) -> bytes:
    """Bytes that are near `data`, of which some are `other`'s: half of the time with whole, valid frames."""
    draw = rng.random()
    if draw < 0.6:
        return change_frames(rng, data)
    if draw < 0.7:
        return change_frames(rng, other) + data
    if draw < 0.75:
        return draw_frame(rng)
    return change_bytes(rng, data, other)


def change_bytes(rng: Random, data: bytes, other: bytes) -> bytes:
    """Flips, cuts, doubles and splices, without an eye on what the bytes are."""
    found = bytearray(data)
    for _ in range(1 + (rng.getrandbits(8) & 3)):
        size = len(found)
        at = rng.randrange(size) if size else 0
        match rng.randrange(8):
            case 0 | 1:
                found[at : at + 1] = bytes([rng.getrandbits(8)])
            case 2:
                if size:
                    found[at] ^= 1 << rng.randrange(8)
            case 3:
                number = rng.choice(NUMBERS)
                found[at : at + len(number)] = number
            case 4:
                del found[at : at + 1 + rng.randrange(32)]
            case 5:
                found[at:at] = found[at : at + rng.randrange(64)]
            case 6:
                begins = rng.randrange(len(other)) if other else 0
                found[at:at] = other[begins : begins + rng.randrange(300)]
            case _:
                del found[at:]
    return bytes(found[:DATAGRAM_MAX])


def change_frames(rng: Random, data: bytes) -> bytes:
    """`data` with one of its frames changed and sealed again; the others stay, go or come twice."""
    found = frames(data)
    if not found:
        return draw_frame(rng)
    start, end, message_id = rng.choice(found)
    if end > len(data) or data[start] != MAGIC_V2:
        return draw_frame(rng)
    changed = change_frame(rng, data[start:end], message_id)
    match rng.randrange(4):
        case 0:
            return changed
        case 1:
            return data[:start] + changed + data[end:]
        case 2:
            return data + changed
        case _:
            return changed * (1 + rng.randrange(4))


def change_frame(rng: Random, frame: bytes, message_id: int) -> bytes:
    """One MAVLink 2 frame with other fields, another sender, or another length, and a checksum that holds."""
    size = frame[1]
    header, payload = bytearray(frame[2:7]), bytearray(frame[10 : 10 + size])
    for _ in range(1 + (rng.getrandbits(8) & 3)):
        draw = rng.randrange(12)
        if draw < 7 and payload:
            number = rng.choice(NUMBERS) if draw < 5 else rng.randbytes(rng.choice((1, 2, 4, 8)))
            at = rng.randrange(len(payload)) // len(number) * len(number)
            payload[at : at + len(number)] = number
        elif draw == 7:
            header[3] = rng.choice((0, 1, 2, 3, 4, 5, 250, 254, 255, rng.getrandbits(8)))
        elif draw == 8:
            header[4] = rng.choice((0, 1, 190, 191, 192, 197, rng.getrandbits(8)))
        elif draw == 9:
            header[2] = rng.getrandbits(8)
        elif draw == 10:
            del payload[rng.randrange(len(payload) + 1) :]
        else:
            payload += rng.randbytes(rng.randrange(40))
    if rng.random() < 0.02:
        header[0] = rng.getrandbits(8)
    if rng.random() < 0.02:
        message_id = rng.choice(IDS)
    is_v1 = rng.random() < 0.02 and message_id < 256
    sealed = frame_of(message_id, bytes(payload[:255]), bytes(header), is_v1=is_v1)
    return sealed + rng.randbytes(13) if header[0] == SIGNED and not is_v1 else sealed


def draw_frame(rng: Random) -> bytes:
    """Any message of the dialect, with any fields."""
    message_id = rng.choice(IDS)
    size = dialect.mavlink_map[message_id].unpacker.size
    kind = rng.randrange(3)
    if kind == 0:
        payload = rng.randbytes(size)
    elif kind == 1:
        payload = b"".join(rng.choices(NUMBERS, k=1 + size // 2))[:size]
    else:
        payload = bytes(size)
    sender = bytes([0, 0, rng.getrandbits(8), rng.choice((1, 2, 3, 4, 254, 255)), rng.choice((1, 191, 190, 42))])
    return frame_of(message_id, payload[:255], sender)
