"""Bytes -> messages: what is damaged, foreign or hostile is dropped, and costs no one behind it."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import BAD_STARTS_MAX, MAGIC_V1, MAGIC_V2, SIGNATURE_BYTES, SIGNED, Framing

BOTH = pytest.mark.parametrize("is_stream", [False, True], ids=["datagrams", "stream"])
LONGEST_FRAME = 280


def position(x: float = 1.0) -> Any:
    return dialect.MAVLink_local_position_ned_message(1000, x, 2.0, 3.0, 0.5, 0.25, 0.125)


def heartbeat() -> Any:
    return dialect.MAVLink_heartbeat_message(2, 12, 0x81, 6 << 16, 4, 3)


def packed(*messages: Any, v1: bool = False, system: int = 7, component: int = 1) -> bytes:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    return b"".join(m.pack(mav, force_mavlink1=v1) for m in messages)


def signed(message: Any) -> bytes:
    mav = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
    mav.signing.secret_key = bytes(range(32))
    mav.signing.sign_outgoing = True
    return bytes(message.pack(mav))


def foreign() -> bytes:
    """A frame of ArduPilot's own that this dialect does not hold."""
    message = ardupilotmega.MAVLink_rangefinder_message(4.0, 1.0)
    assert message.get_msgId() not in dialect.mavlink_map
    return bytes(message.pack(ardupilotmega.MAVLink(None, srcSystem=7, srcComponent=1)))


def names(messages: list[Any]) -> list[str]:
    return [m.get_type() for m in messages]


def in_pieces(framing: Framing, data: bytes, size: int) -> list[Any]:
    found = []
    for at in range(0, len(data), size):
        found += framing.parse(data[at : at + size])
    return found


@BOTH
@pytest.mark.parametrize("v1", [False, True], ids=["MAVLink 2", "MAVLink 1"])
def test_several_frames_come_out_in_order_with_their_senders(is_stream: bool, v1: bool) -> None:
    framing = Framing(is_stream=is_stream)
    found = framing.parse(packed(heartbeat(), position(5.0), heartbeat(), v1=v1, system=9, component=191))
    assert names(found) == ["HEARTBEAT", "LOCAL_POSITION_NED", "HEARTBEAT"]
    assert found[1].x == 5.0
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in found} == {(9, 191)}
    assert framing.bad == 0


@BOTH
def test_old_and_new_frames_may_be_mixed(is_stream: bool) -> None:
    data = packed(heartbeat(), v1=True) + packed(position()) + packed(position(), v1=True)
    assert len(Framing(is_stream=is_stream).parse(data)) == 3


@BOTH
def test_signed_frames_are_read_and_their_signatures_skipped(is_stream: bool) -> None:
    data = signed(position(4.0)) + packed(heartbeat()) + signed(heartbeat())
    found = Framing(is_stream=is_stream).parse(data)
    assert names(found) == ["LOCAL_POSITION_NED", "HEARTBEAT", "HEARTBEAT"]
    assert found[0].x == 4.0


def test_frame_is_read_with_its_sender_and_the_rest_is_counted() -> None:
    framing = Framing()
    noise, unknown = b"\x00\xfd\x01", foreign()
    found = framing.read_messages(
        packed(heartbeat(), system=9, component=191) + noise + packed(position(), v1=True) + unknown
    )
    assert [(one.message_id, one.system, one.component, one.frame) for one in found] == [
        (0, 9, 191, packed(heartbeat(), system=9, component=191)),
        (32, 7, 1, packed(position(), v1=True)),
    ]
    assert found[1].message.z == 3.0
    assert (framing.garbage_bytes, framing.passed_over) == (len(noise), 1)


@BOTH
def test_unknown_messages_are_passed_over(is_stream: bool) -> None:
    framing = Framing(is_stream=is_stream)
    assert names(framing.parse(foreign() + packed(heartbeat()) + foreign() + packed(position()) + foreign())) == [
        "HEARTBEAT",
        "LOCAL_POSITION_NED",
    ]


@BOTH
def test_only_wanted_messages_are_decoded(is_stream: bool) -> None:
    framing = Framing(frozenset({dialect.MAVLINK_MSG_ID_HEARTBEAT}), is_stream=is_stream)
    assert names(framing.parse(packed(position(), heartbeat(), position(), heartbeat()))) == ["HEARTBEAT"] * 2
    assert framing.bad == 0


@BOTH
def test_damaged_byte_costs_its_own_frame_at_most(is_stream: bool) -> None:
    for at in range(len(packed(position()))):
        data = bytearray(packed(position()) + packed(heartbeat()) * 12)
        data[at] ^= 0x55
        found = names(Framing(is_stream=is_stream).parse(bytes(data)))
        assert "LOCAL_POSITION_NED" not in found, at
        assert found.count("HEARTBEAT") >= 1, at  # a damaged length may hide some, never all


def test_truncated_datagram_is_dropped_and_the_next_one_read() -> None:
    for size in range(1, len(packed(position()))):
        framing = Framing()
        assert framing.parse(packed(position())[:size]) == []
        assert framing.bad >= 1
        assert names(framing.parse(packed(heartbeat()))) == ["HEARTBEAT"]


def test_stream_may_break_at_any_byte() -> None:
    messages = [position(float(k)) for k in range(6)]
    data = packed(*messages[:2]) + packed(messages[2], v1=True) + signed(messages[3]) + packed(*messages[4:])
    for size in range(1, len(data) + 1):
        framing = Framing(is_stream=True)
        assert [m.x for m in in_pieces(framing, data, size)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        assert framing.bad == 0


@BOTH
@pytest.mark.parametrize("noise", [b"\xfd", b"\xfe", b"\xfd\xfd\xfe", b"\x00\x7f\x80", b"\xfd\xff", b"\xfe\x00"])
def test_stray_bytes_before_a_frame_do_not_swallow_it(is_stream: bool, noise: bytes) -> None:
    """In a stream it may take as many bytes as the longest frame has until the stray start is found out."""
    framing = Framing(is_stream=is_stream)
    found = framing.parse(noise + packed(position(7.0)))
    if is_stream:
        found += framing.parse(packed(heartbeat()) * (2 * LONGEST_FRAME // len(packed(heartbeat()))))
        assert names(found).count("HEARTBEAT") >= 2 * LONGEST_FRAME // len(packed(heartbeat())) - 1
    assert [m.x for m in found if m.get_type() == "LOCAL_POSITION_NED"] == [7.0]


@BOTH
@pytest.mark.parametrize("garbage", [b"", b"\0", b"\xfd", b"\xfe", bytes(range(256)) * 4, b"\xfd\x09\x00"])
def test_garbage_gives_nothing_and_what_follows_is_read(is_stream: bool, garbage: bytes) -> None:
    framing = Framing(is_stream=is_stream)
    assert framing.parse(garbage) == []
    tail = packed(heartbeat()) * 40
    assert len(framing.parse(tail)) >= 20
    assert names(framing.parse(packed(position()))) == ["LOCAL_POSITION_NED"]


@pytest.mark.parametrize(
    "pattern",
    [
        b"\xfd",
        b"\xfe",
        b"\xfd\xfe",
        b"\xfd\xff\x00\x00\x00\x00\x00\x20\x00\x00",  # a long frame of a wanted message every ten bytes
        b"\xfe\xf5",  # every other byte starts an old frame of EXTENDED_SYS_STATE
        b"\xfd\xff\x01\x00\x00",
    ],
)
@BOTH
def test_hostile_64_kilobytes_take_bounded_work(
    pattern: bytes, is_stream: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No more than BAD_STARTS_MAX frames are tried, and no more is kept than one frame."""
    data = (pattern * 65536)[:65536]
    framing = Framing(is_stream=is_stream)
    tried = 0
    decode = wire.decode

    def counting(frame: bytes) -> Any:
        nonlocal tried
        tried += 1
        assert len(frame) <= LONGEST_FRAME
        return decode(frame)

    monkeypatch.setattr(wire, "decode", counting)
    assert framing.parse(data) == []
    assert tried <= BAD_STARTS_MAX
    assert framing.bad <= BAD_STARTS_MAX
    assert len(framing._tail) <= LONGEST_FRAME
    framing.parse(packed(heartbeat()) * 40)
    assert names(framing.parse(packed(position()))) == ["LOCAL_POSITION_NED"]


@pytest.mark.parametrize(
    "pattern", [b"\xfd", b"\xfd\xff\x00\x00\x00\x00\xbf" + swarm_beacon.MESSAGE_ID.to_bytes(3, "little")]
)
def test_hostile_datagram_of_the_peers_takes_bounded_work(pattern: bytes) -> None:
    """A beacon is found behind fewer bad starts than the limit; behind more of them nobody looks for it."""
    message = dialect.MAVLink_swarm_beacon_message
    fields = message(**dict.fromkeys(message.fieldnames, 1) | {"members": [1] * 96})
    beacon = packed(fields, component=swarm_beacon.COMPONENT)
    assert [found for _, found, _ in swarm_beacon.beacons(pattern * (BAD_STARTS_MAX - 1) + beacon)] == [beacon]
    assert list(swarm_beacon.beacons(pattern * BAD_STARTS_MAX + beacon)) == []


@BOTH
def test_noise_of_fewer_bad_starts_costs_no_message(is_stream: bool) -> None:
    noise = (b"\xfe" + bytes(7)) * (BAD_STARTS_MAX - 1)  # each an old frame without payload, whose checksum is wrong
    found = Framing(is_stream=is_stream).parse(noise + packed(heartbeat(), position()))
    assert names(found) == ["HEARTBEAT", "LOCAL_POSITION_NED"]


def test_text_that_is_not_utf8_is_no_exception() -> None:
    message = dialect.MAVLink_statustext_message(4, b"\xff\xfe\xfa bad")
    framing = Framing()
    framing.parse(packed(message) + packed(heartbeat()))
    assert names(framing.parse(packed(heartbeat()))) == ["HEARTBEAT"]


def test_what_marks_a_frame_is_what_the_dialect_says() -> None:
    assert (MAGIC_V1, MAGIC_V2) == (dialect.PROTOCOL_MARKER_V1, dialect.PROTOCOL_MARKER_V2)
    assert (SIGNED, SIGNATURE_BYTES) == (dialect.MAVLINK_IFLAG_SIGNED, dialect.MAVLINK_SIGNATURE_BLOCK_LEN)
