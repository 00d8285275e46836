"""One MAVLink 2 frame <-> one message, at a fraction of the cost of the generated code. Held equal to it by tests.

The generated `decode` and `pack` carry MAVLink 1, signing and arrays through every call, and build an object with its
header for each message. Most traffic is MAVLink 2 with plain fields, signed (which is not read here) or not; the rest
goes to the generated code.
"""

from __future__ import annotations

import struct
from collections import namedtuple
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect

_V2: Final = dialect.PROTOCOL_MARKER_V2
HEADER_BYTES: Final = 10
CRC_BYTES: Final = 2
_SIGNED: Final = 0x01  # incompatibility flag
_SIGNATURE_BYTES: Final = 13
_HEADER: Final = struct.Struct("<BBBBBBBHB")
_CRC_EXTRA: Final = {message_id: bytes([message.crc_extra]) for message_id, message in dialect.mavlink_map.items()}
_PLAIN: Final = {
    message_id: message
    for message_id, message in dialect.mavlink_map.items()
    if sum(message.lengths) == len(message.lengths) and "s" not in message.unpacker.format  # no arrays, no strings
}
_generated = dialect.MAVLink(None)
_new_type: Any = namedtuple  # under its own name mypyc takes it for a class statement, and drops it


# --- in ---


def fields(frame: bytes) -> Any:
    """A whole frame -> its message's fields as attributes. MAVError when it is not valid, or not of the dialect."""
    if frame[0] != _V2 or len(frame) <= HEADER_BYTES or frame[2] & ~_SIGNED:
        return _decode_generated(frame)
    message_id = frame[7] | frame[8] << 8 | frame[9] << 16
    if message_id not in _PLAIN:
        return _decode_generated(frame)
    unpack, size, crc_extra, make = _plain(message_id)
    length = frame[1]
    end = HEADER_BYTES + length
    if length > size or len(frame) != end + CRC_BYTES + (_SIGNATURE_BYTES if frame[2] else 0):
        return _decode_generated(frame)
    if mcrf4xx(frame[1:end] + crc_extra) != frame[end] | frame[end + 1] << 8:
        raise dialect.MAVError("invalid CRC")
    return make(unpack(frame[HEADER_BYTES:end].ljust(size, b"\0")))  # MAVLink 2 cuts trailing zeros off


def decode(frame: bytes) -> Any:
    """A whole frame -> pymavlink's message, with its header. MAVError as for `fields`; slower."""
    values = fields(frame)
    if not isinstance(values, tuple):
        return values
    message = _PLAIN[frame[7] | frame[8] << 8 | frame[9] << 16]
    decoded = message(*[values[at] for at in message.orders])
    header = decoded.get_header()
    header.mlen, header.compat_flags, header.seq, header.srcSystem, header.srcComponent = frame[1], *frame[3:7]
    return decoded


@cache
def _plain(message_id: int) -> tuple[Callable[[bytes], Any], int, bytes, Callable[[Any], Any]]:
    """Decoder of a plain message: struct, its size, CRC extra, fields by name.

    Made at its first frame: a companion hears few of the dialect's messages.
    """
    message = _PLAIN[message_id]
    named = _new_type(message.msgname, message.ordered_fieldnames)
    return message.unpacker.unpack, message.unpacker.size, _CRC_EXTRA[message_id], partial(tuple.__new__, named)


def _decode_generated(frame: bytes) -> Any:
    try:
        return _generated.decode(bytearray(frame))
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise dialect.MAVError(str(error)) from error


# --- out ---


class Sender:
    """Packs what one program sends on one link: its identity and its count of frames."""

    __slots__ = ("_component", "_flags", "_seq", "_system")

    def __init__(self, system: int, component: int, flags: int = 0) -> None:
        """`flags`: incompatibility flags of the frames that `frame` makes."""
        self._system, self._component, self._flags = system, component, flags
        self._seq = 0

    def pack(self, message: Any) -> bytes:
        """The next frame, of pymavlink's message."""
        packed = pack(message, seq=self._seq, system=self._system, component=self._component)
        self._seq = (self._seq + 1) & 0xFF
        return packed

    def frame(self, message_id: int, payload: bytes) -> bytes:
        """The next frame, of a payload as for `frame`."""
        framed = frame(
            message_id, payload, seq=self._seq, system=self._system, component=self._component, flags=self._flags
        )
        self._seq = (self._seq + 1) & 0xFF
        return framed


def pack(message: Any, *, seq: int, system: int, component: int) -> bytes:
    """pymavlink's message -> an unsigned MAVLink 2 frame."""
    message_id = type(message).id  # some messages have a field named id
    plain = _PLAIN.get(message_id)
    if plain is None:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        mav.seq = seq
        packed: bytes = message.pack(mav)
        return packed
    payload = plain.unpacker.pack(*[getattr(message, name) for name in plain.ordered_fieldnames])
    return frame(message_id, payload, seq=seq, system=system, component=component)


def frame(message_id: int, payload: bytes, *, seq: int, system: int, component: int, flags: int = 0) -> bytes:
    """A MAVLink 2 frame of a payload of the dialect's `message_id`, whose fields are in the wire's order.

    `flags`: incompatibility flags; of one that says that it is signed, the signature is to follow.
    """
    payload = payload.rstrip(b"\0") or b"\0"  # MAVLink 2 cuts trailing zeros off, but leaves one byte
    framed: bytes = (
        _HEADER.pack(_V2, len(payload), flags, 0, seq, system, component, message_id & 0xFFFF, message_id >> 16)
        + payload
    )
    crc: int = mcrf4xx(framed[1:] + _CRC_EXTRA[message_id])
    return framed + crc.to_bytes(2, "little")
