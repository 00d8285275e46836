"""One MAVLink 2 frame <-> one message, at half the cost of the generated code. Held equal to it by a test.

The generated `decode` and `pack` carry MAVLink 1, signing and arrays through every call. Most traffic is unsigned
MAVLink 2 with plain fields; whatever is not goes to the generated code.
"""

from __future__ import annotations

import struct
from typing import Any

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect

MAGIC_V2 = 0xFD
HEADER_BYTES, CRC_BYTES = 10, 2
_HEADER = struct.Struct("<BBBBBBBHB")
_PLAIN = {
    message_id: (message, message.unpacker, bytes([message.crc_extra]), message.orders)
    for message_id, message in dialect.mavlink_map.items()
    if sum(message.lengths) == len(message.lengths) and "s" not in message.unpacker.format  # no arrays, no strings
}
_CRC_EXTRA = {message_id: bytes([message.crc_extra]) for message_id, message in dialect.mavlink_map.items()}
_generated = dialect.MAVLink(None)


def decode(frame: bytes) -> Any:
    """A whole frame -> its message, with header. MAVError when it is not valid, or not of the dialect."""
    if frame[0] != MAGIC_V2 or len(frame) <= HEADER_BYTES or frame[2]:
        return _decode_generated(frame)
    plain = _PLAIN.get(frame[7] | frame[8] << 8 | frame[9] << 16)
    end = HEADER_BYTES + frame[1]
    if plain is None or len(frame) != end + CRC_BYTES or frame[1] > plain[1].size:
        return _decode_generated(frame)
    message, unpacker, crc_extra, orders = plain
    if mcrf4xx(frame[1:end] + crc_extra) != frame[end] | frame[end + 1] << 8:
        raise dialect.MAVError(f"invalid CRC in {message.msgname}")
    values = unpacker.unpack(frame[HEADER_BYTES:end].ljust(unpacker.size, b"\0"))
    decoded = message(*[values[at] for at in orders])
    header = decoded._header
    header.mlen, header.compat_flags, header.seq, header.srcSystem, header.srcComponent = frame[1], *frame[3:7]
    return decoded


def _decode_generated(frame: bytes) -> Any:
    try:
        return _generated.decode(bytearray(frame))
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise dialect.MAVError(str(error)) from error


def pack(message: Any, *, seq: int, system: int, component: int) -> bytes:
    """A message -> an unsigned MAVLink 2 frame."""
    message_id = type(message).id  # some messages have a field named id
    plain = _PLAIN.get(message_id)
    if plain is None:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        mav.seq = seq
        packed: bytes = message.pack(mav)
        return packed
    unpacker = plain[1]
    payload = unpacker.pack(*[getattr(message, name) for name in message.ordered_fieldnames])
    return frame(message_id, payload, seq=seq, system=system, component=component)


def frame(message_id: int, payload: bytes, *, seq: int, system: int, component: int) -> bytes:
    """An unsigned MAVLink 2 frame of a payload of the dialect's `message_id`, whose fields are in the wire's order."""
    payload = payload.rstrip(b"\0") or b"\0"  # MAVLink 2 cuts trailing zeros off, but leaves one byte
    header = (MAGIC_V2, len(payload), 0, 0, seq, system, component, message_id & 0xFFFF, message_id >> 16)
    framed: bytes = _HEADER.pack(*header) + payload
    crc: int = mcrf4xx(framed[1:] + _CRC_EXTRA[message_id])
    return framed + crc.to_bytes(2, "little")
