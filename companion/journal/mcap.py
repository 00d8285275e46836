"""Records of an MCAP file, those of which a black box is made: https://mcap.dev/spec. Bytes in, bytes out.

Own code, held to the `mcap` library by tests: that library writes a message at ten times the cost, and asks for two
compiled compressors on the board.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C, 0x0F
HEAD: Final = frozenset({HEADER, SCHEMA, CHANNEL, METADATA})  # records before the first chunk
_RECORD: Final = Struct("<BQ")  # opcode, length
_MESSAGE: Final = Struct("<BQHIQQ")  # ... channel, sequence, log time, publish time
_MESSAGE_BYTES: Final = _MESSAGE.size - _RECORD.size
_DATAGRAM: Final = Struct("<BQHIQQd")  # ... arrival
_DATAGRAM_BYTES: Final = _DATAGRAM.size - _RECORD.size
_CHUNK: Final = Struct("<QQQIIQ")  # first and last log time, size, CRC-32, length of the compression's name, size


# --- out ---


def begin(profile: str, library: str) -> bytes:
    """Opens a file."""
    return MAGIC + _record(HEADER, _text(profile) + _text(library))


def schema(schema_id: int, name: str, data: bytes) -> bytes:
    """A JSON schema."""
    body = schema_id.to_bytes(2, "little") + _text(name) + _text("jsonschema") + _prefixed(data)
    return _record(SCHEMA, body)


def channel(channel_id: int, schema_id: int, topic: str, encoding: str) -> bytes:
    """A channel of messages; schema 0: none."""
    body = channel_id.to_bytes(2, "little") + schema_id.to_bytes(2, "little") + _text(topic) + _text(encoding)
    return _record(CHANNEL, body + bytes(4))


def metadata(name: str, values: Mapping[str, str]) -> bytes:
    """Names and values, for people."""
    pairs = b"".join(_text(key) + _text(value) for key, value in values.items())
    return _record(METADATA, _text(name) + _prefixed(pairs))


def message(channel_id: int, sequence: int, time_ns: int, data: bytes) -> bytes:
    """A message, to be put into a chunk."""
    size = _MESSAGE_BYTES + len(data)
    return _MESSAGE.pack(MESSAGE, size, channel_id, sequence & 0xFFFFFFFF, time_ns, time_ns) + data


def datagram(channel_id: int, sequence: int, time_ns: int, arrived_s: float, data: bytes) -> bytes:
    """As `message`, of an arrival time (float64) and a datagram: most of what a tick records."""
    size = _DATAGRAM_BYTES + len(data)
    return _DATAGRAM.pack(MESSAGE, size, channel_id, sequence & 0xFFFFFFFF, time_ns, time_ns, arrived_s) + data


def chunk(records: bytes, first_ns: int, last_ns: int) -> bytes:
    """Messages, not compressed, with their CRC."""
    head = _CHUNK.pack(first_ns, last_ns, len(records), zlib.crc32(records), 0, len(records))
    return _record(CHUNK, head + records)


def end() -> bytes:
    """Closes a file, without an index."""
    return _record(DATA_END, bytes(4)) + _record(FOOTER, bytes(20)) + MAGIC


def _record(opcode: int, body: bytes) -> bytes:
    return _RECORD.pack(opcode, len(body)) + body


def _prefixed(data: bytes) -> bytes:
    return len(data).to_bytes(4, "little") + data


def _text(text: str) -> bytes:
    return _prefixed(text.encode())


# --- in ---


class McapError(Exception):
    """A file is damaged here: `offset` bytes from its start is where the last whole record ends."""

    def __init__(self, offset: int, why: str) -> None:
        super().__init__(why)
        self.offset = offset
        self.why = why


class TornError(McapError):
    """It ends here before its end, as a loss of power, a full disk or a killed process leaves it."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it was found. `record`: all of its bytes."""

    channel_id: int
    sequence: int
    time_ns: int
    data: bytes
    record: bytes


def read_head(data: bytes) -> bytes:
    """The beginning of a file, up to its first chunk. TornError, McapError."""
    written = len(data.rstrip(b"\0"))
    if not data.startswith(MAGIC):
        if MAGIC.startswith(data[:written]):
            raise TornError(0, "ends in its first bytes" if written == len(data) else _zeros(written))
        raise McapError(0, "no MCAP file")
    at = len(MAGIC)
    while at < len(data) and data[at] in HEAD:
        at += len(_read_record(data, at, written))
    return data[:at]


def read_chunks(data: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    """Offset and body of each chunk, from byte `at` on, behind the head. TornError, McapError where that ends early.

    A file that was closed is not torn.
    """
    written = len(data.rstrip(b"\0"))  # no record of ours ends in a zero, but DataEnd
    end_bytes = end()
    while True:
        rest = data[at : max(at, written)]
        if rest == end_bytes:
            return
        if end_bytes.startswith(data[at : at + len(end_bytes) + 1]):
            raise TornError(at, "ends without its footer")
        if end_bytes.startswith(rest):
            raise TornError(at, _zeros(written))
        if rest[0] != CHUNK:
            raise McapError(at, "bytes that are no chunk")
        try:
            record = _read_record(data, at, written)
        except TornError:
            if data.endswith(end_bytes):  # nothing that was cut off ends so
                raise McapError(at, "a record that does not end in its file, which was closed") from None
            raise
        yield at, record[_RECORD.size :]
        at += len(record)


def _read_record(data: bytes, at: int, written: int) -> bytes:
    """The one that begins at byte `at`, whole. `written`: where zeros begin that go to the end of the file."""
    length = _RECORD.unpack_from(data, at)[1] if at + _RECORD.size <= len(data) else len(data)
    end_at = at + _RECORD.size + length
    if end_at > len(data):
        raise TornError(at, "ends in the middle of a record")
    if end_at > written and written < len(data):
        raise TornError(at, _zeros(written))
    return data[at:end_at]


def _zeros(written: int) -> str:
    return f"zeros from byte {written} to its end, as a power cut leaves them"


def read_messages(body: bytes, offset: int) -> list[Message]:
    """Messages of a chunk. McapError: it is damaged."""
    try:
        _, _, size, crc, named, stored = _CHUNK.unpack_from(body)
    except struct.error:
        raise McapError(offset, "a chunk without its head") from None
    records = body[_CHUNK.size :]
    if named or size != stored or stored != len(records):
        raise McapError(offset, "a chunk that is compressed, or of another size")
    if zlib.crc32(records) != crc:
        raise McapError(offset, "a chunk whose CRC is wrong")
    found: list[Message] = []
    at = 0
    while at < len(records):
        if at + _MESSAGE.size > len(records):
            raise McapError(offset, "a chunk that ends in the middle of a message")
        opcode, length, channel_id, sequence, time_ns, _ = _MESSAGE.unpack_from(records, at)
        end_at = at + _RECORD.size + length
        if opcode != MESSAGE or length < _MESSAGE_BYTES or end_at > len(records):
            raise McapError(offset, "a chunk with what is no message")
        found.append(Message(channel_id, sequence, time_ns, records[at + _MESSAGE.size : end_at], records[at:end_at]))
        at = end_at
    return found
