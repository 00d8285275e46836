"""Frames in datagrams: what is taken, what is skipped, what goes out together."""

from __future__ import annotations

import random

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.protocols.links import DATAGRAM_MAX_BYTES, QUEUE_MAX_FRAMES, Packed, Port


def frame(message: object, seq: int = 0) -> bytes:
    codec = mav.MAVLink(None, srcSystem=245, srcComponent=191)
    codec.seq = seq
    packed: bytes = message.pack(codec)  # type: ignore[attr-defined]
    return packed


HEARTBEAT = frame(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
PING = frame(mav.MAVLink_ping_message(0xFD, 0xFDFD, 0, 0))


def ids(port: Port, datagram: bytes) -> list[int]:
    return [incoming.message_id for incoming in port.parse_datagram(datagram)]


def test_all_frames_of_a_datagram_are_read_in_order() -> None:
    assert ids(Port(1), HEARTBEAT + PING + HEARTBEAT) == [0, 4, 0]


def test_sender_and_frame_come_with_the_message() -> None:
    (incoming,) = Port(1).parse_datagram(PING)
    assert (incoming.system, incoming.component, incoming.frame) == (245, 191, PING)


def test_a_stray_magic_byte_does_not_swallow_the_message_behind_it() -> None:
    port = Port(1)
    assert ids(port, b"\xfd" + HEARTBEAT + b"\xfd\x09\x00" + PING + b"\xfe") == [0, 4]
    assert port.counts.garbage_bytes == 5
    assert port.counts.frames == 2


def test_nothing_is_carried_over_to_the_next_datagram() -> None:
    port = Port(1)
    assert ids(port, HEARTBEAT[:8]) == []
    assert ids(port, HEARTBEAT[8:]) == []
    assert ids(port, HEARTBEAT) == [0]


def test_a_frame_with_a_wrong_checksum_is_dropped() -> None:
    broken = bytearray(HEARTBEAT)
    broken[-1] ^= 1
    assert ids(Port(1), bytes(broken) + PING) == [4]


def test_a_frame_of_an_unknown_message_is_skipped_as_a_whole() -> None:
    unknown = bytearray(PING)
    unknown[7:10] = (13000).to_bytes(3, "little")
    port = Port(1)
    assert ids(port, HEARTBEAT + bytes(unknown) + HEARTBEAT) == [0, 0]
    assert (port.counts.unknown, port.counts.garbage_bytes) == (1, 0)


def test_mavlink_1_is_understood() -> None:
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    v1 = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(codec, force_mavlink1=True)
    (incoming,) = Port(1).parse_datagram(v1)
    assert (incoming.message_id, incoming.system, incoming.component) == (0, 255, 190)


def test_a_signed_frame_is_understood() -> None:
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    codec.signing.secret_key = b"k" * 32
    codec.signing.sign_outgoing = True
    signed = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(codec)
    assert ids(Port(1), signed + PING) == [0, 4]


def test_garbage_never_raises_and_is_counted() -> None:
    rng = random.Random(1)
    port = Port(1)
    for _ in range(500):
        noise = bytes(rng.choices((0, 1, 9, 76, 0xFD, 0xFE, 0xFF), k=rng.randrange(60)))
        cut = rng.randrange(len(PING))
        list(port.parse_datagram(noise + PING[:cut] + noise + HEARTBEAT[cut:]))
    assert port.counts.garbage_bytes > 1000


def test_answers_leave_in_order_in_datagrams_of_whole_frames() -> None:
    port = Port(7)
    for seq in range(100):
        port.send(mav.MAVLink_ping_message(1, seq, 1, 1))
    datagrams = port.drain()
    assert len(datagrams) > 1
    assert max(map(len, datagrams)) <= DATAGRAM_MAX_BYTES
    reader = Port(1)
    read = [incoming for datagram in datagrams for incoming in reader.parse_datagram(datagram)]
    assert [incoming.message.seq for incoming in read] == list(range(100))
    assert [incoming.frame[4] for incoming in read] == list(range(100))  # the channel's sequence
    assert port.drain() == []


def test_a_queue_that_nobody_drains_is_bounded_and_loses_the_oldest() -> None:
    port = Port(7)
    for seq in range(QUEUE_MAX_FRAMES + 10):
        port.send(mav.MAVLink_ping_message(1, seq, 1, 1))
    first = next(iter(Port(1).parse_datagram(port.drain()[0])))
    assert first.message.seq == 10


def test_a_packed_message_is_the_frame_that_its_object_gives() -> None:
    values = (4_000_000_000, 1.5, -2.25, -8.0, 0.1, 0.0, 0.0)
    plain = mav.MAVLink_local_position_ned_message(*values)
    ready = Packed(plain.id, plain.unpacker.pack(*values))
    one, other = Port(7), Port(7)
    assert [one.pack(plain) for _ in range(3)] == [other.pack(ready) for _ in range(3)]
