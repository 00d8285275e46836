"""Frames against pymavlink as the oracle: what we pack it reads, what it packs we read, and noise harms neither."""

from __future__ import annotations

import math
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.autopilot_link.signing import LinkSigning, as_signed
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from companion.mavlink.own_messages import BEACON_PAYLOAD
from companion.mavlink.peers.frame_mac import seal
from companion.mavlink.schema.tables import beacon as schema
from mission.common.frames import LocalFrame, Vec3, Wgs84

SWARM_XML = Path(dialect.__file__).with_name("swarm.xml")
OWN = {
    dialect.MAVLINK_MSG_ID_SWARM_BEACON,
    dialect.MAVLINK_MSG_ID_SWARM_RANGES,
    dialect.MAVLINK_MSG_ID_SWARM_RELATIVE,
    dialect.MAVLINK_MSG_ID_SWARM_TRUNKS,
    dialect.MAVLINK_MSG_ID_SWARM_LIDAR_SCAN,
    dialect.MAVLINK_MSG_ID_SWARM_RECORD_VECTOR,
    dialect.MAVLINK_MSG_ID_SWARM_RECORD,
    dialect.MAVLINK_MSG_ID_SWARM_SIGNED_RECORD,
    dialect.MAVLINK_MSG_ID_SWARM_BASE_VECTOR,
    dialect.MAVLINK_MSG_ID_SWARM_MANIFEST,
    dialect.MAVLINK_MSG_ID_SWARM_ORDER,
    dialect.MAVLINK_MSG_ID_PROTOCOL_VERSION,
}
STANDARD = sorted(set(dialect.mavlink_map) - OWN)
BITS = {"B": 8, "H": 16, "I": 32, "Q": 64}


@pytest.mark.parametrize("message_id", STANDARD, ids=lambda i: dialect.mavlink_map[i].msgname)
def test_standard_messages_are_the_standards_to_the_byte(message_id: int) -> None:
    ours, theirs = dialect.mavlink_map[message_id], ardupilotmega.mavlink_map[message_id]
    for what in ("msgname", "crc_extra", "native_format", "ordered_fieldnames", "fieldnames", "lengths", "orders"):
        assert getattr(ours, what) == getattr(theirs, what), what


def test_constants_have_the_standards_values() -> None:
    shared = [
        name
        for name in dir(dialect)
        if name.startswith(("MAV_", "MAVLINK_MSG_ID_", "POSITION_TARGET_")) and hasattr(ardupilotmega, name)
    ]
    assert len(shared) > 100
    ends = tuple(f"{enum}_ENUM_END" for enum in dialect.enums)
    for name in shared:
        if not name.endswith(("ENUM_END", *ends)):
            assert getattr(dialect, name) == getattr(ardupilotmega, name), name


def field_values(message: Any) -> st.SearchStrategy[list[Any]]:
    """Values for a message's constructor, in its order."""
    codes = message.native_format.decode().lstrip("<")
    strategies = []
    for position in message.orders:
        code, length = codes[position], message.array_lengths[position]
        if length and code in "bBhHiIqQ":  # one draw instead of so many
            layout = struct.Struct(f"<{length}{code}")
            octets = st.binary(min_size=layout.size, max_size=layout.size)
            strategies.append(octets.map(lambda data, layout=layout: list(layout.unpack(data))))
            continue
        if code in "fd":
            one: st.SearchStrategy[Any] = st.floats(width=32 if code == "f" else 64, allow_nan=False)
        elif code == "c":
            text = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=length)
            strategies.append(text.map(str.encode))
            continue
        elif code in "BHIQ":
            one = st.integers(0, 2 ** BITS[code] - 1)
        else:
            bits = BITS[code.upper()]
            one = st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        strategies.append(st.lists(one, min_size=length, max_size=length) if length else one)
    return st.tuples(*strategies).map(list)


@st.composite
def messages(draw: st.DrawFn) -> Any:
    message = dialect.mavlink_map[draw(st.sampled_from(STANDARD))]
    return message(*draw(field_values(message)))


BEACON = dialect.MAVLink_swarm_beacon_message
beacon_messages = field_values(BEACON).map(lambda values: BEACON(*values))


def same(a: Any, b: Any) -> bool:
    return a.get_type() == b.get_type() and a.to_dict() == b.to_dict() and a.get_header().seq == b.get_header().seq


frames_of = st.tuples(messages(), st.booleans(), st.binary(max_size=4))


def as_stream(parts: list[tuple[Any, bool, bytes]]) -> bytes:
    """Packed one after the other, MAVLink 1 where it fits, with noise between that starts no frame."""
    mav = dialect.MAVLink(None, srcSystem=3, srcComponent=1)
    data = b""
    for message, v1, noise in parts:
        data += bytes(message.pack(mav, force_mavlink1=v1 and message.get_msgId() < 256))
        mav.seq = (mav.seq + 1) % 256
        data += noise.replace(b"\xfd", b"").replace(b"\xfe", b"")
    return data


@given(st.lists(frames_of, min_size=1, max_size=4), st.integers(1, 300))
@settings(max_examples=40)
def test_valid_streams_are_read_as_pymavlink_reads_them(parts: list[tuple[Any, bool, bytes]], size: int) -> None:
    data = as_stream(parts)
    oracle = ardupilotmega.MAVLink(None)
    oracle.robust_parsing = True
    expected = [m for m in oracle.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]
    assert len(expected) == len(parts)
    whole = Framing().parse(data)
    stream = Framing(is_stream=True)
    pieces = [m for at in range(0, len(data), size) for m in stream.parse(data[at : at + size])]
    for found in (whole, pieces):
        assert len(found) == len(expected)
        assert all(map(same, found, expected))


@given(messages() | beacon_messages, st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
@settings(max_examples=60)
def test_frames_are_packed_as_pymavlink_packs_them(message: Any, seq: int, system: int, component: int) -> None:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.seq = seq
    assert wire.pack(message, seq=seq, system=system, component=component) == bytes(message.pack(mav))


@given(messages() | beacon_messages, st.integers(0, 255), st.integers(1, 255), st.integers(0, 255))
@settings(max_examples=60)
def test_fields_are_those_that_pymavlink_reads(message: Any, seq: int, system: int, component: int) -> None:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.seq = seq
    frame = bytes(message.pack(mav))
    (incoming,) = Framing().read_messages(frame)
    assert (incoming.message_id, incoming.frame) == (message.get_msgId(), frame)
    assert (incoming.system, incoming.component) == (system, component)
    decoded = wire.decode(frame)
    for name in message.ordered_fieldnames:
        assert getattr(incoming.message, name) == getattr(decoded, name), name


vectors = st.tuples(*[st.floats(width=32, allow_nan=False)] * 3)


@given(messages(), st.binary(min_size=32, max_size=32), st.integers(0, 255), st.integers(0, 2**48 - 1))
@settings(max_examples=60)
def test_frames_are_signed_as_pymavlink_signs_them(message: Any, key: bytes, link: int, timestamp: int) -> None:
    mav = dialect.MAVLink(None, srcSystem=3, srcComponent=1)
    mav.signing.secret_key, mav.signing.link_id, mav.signing.timestamp = key, link, timestamp
    unsigned = bytes(message.pack(mav))
    mav.signing.sign_outgoing = True
    frame = bytes(message.pack(mav))
    assert seal(as_signed(unsigned), key, link, timestamp) == frame
    assert LinkSigning(key, timestamp=timestamp).admits(frame)
    assert same(wire.decode(frame), wire.decode(unsigned))
    for name in message.ordered_fieldnames:
        assert getattr(wire.fields(frame), name) == getattr(wire.fields(unsigned), name), name


@given(vectors, st.floats(-math.pi, math.pi), st.integers(0, 2**32 - 1), st.integers(1, 250))
@settings(max_examples=40)
def test_setpoint_is_packed_as_pymavlink_packs_it(vel: Vec3, yaw_rad: float, time_ms: int, vehicle_id: int) -> None:
    zero = (0.0, 0.0, 0.0)
    message = dialect.MAVLink_set_position_target_local_ned_message(
        time_ms, vehicle_id, 1, 1, 0x9C7, *zero, *vel, *zero, yaw_rad, 0.0
    )
    payload = Codec(vehicle_id, LocalFrame(Wgs84(47.0, 8.0, 400.0))).setpoint(vel, yaw_rad, time_ms)
    framed = wire.frame(message.id, payload, seq=7, system=vehicle_id, component=191)
    assert framed == wire.pack(message, seq=7, system=vehicle_id, component=191)


@given(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1))
@settings(max_examples=40)
def test_timesync_is_packed_as_pymavlink_packs_it(tc1_ns: int, ts1_ns: int) -> None:
    payload = Codec(3, LocalFrame(Wgs84(47.0, 8.0, 400.0))).timesync(tc1_ns, ts1_ns)
    framed = wire.frame(dialect.MAVLINK_MSG_ID_TIMESYNC, payload, seq=7, system=3, component=191)
    assert framed == wire.pack(dialect.MAVLink_timesync_message(tc1_ns, ts1_ns), seq=7, system=3, component=191)


@given(messages() | beacon_messages, st.integers(0, 400), st.integers(1, 255))
@settings(max_examples=60)
def test_damaged_frame_is_read_or_refused_as_pymavlink_does(message: Any, at: int, change: int) -> None:
    frame = bytearray(message.pack(dialect.MAVLink(None, srcSystem=3, srcComponent=1)))
    frame[at % len(frame)] ^= change
    try:
        expected: Any = dialect.MAVLink(None).decode(bytearray(frame))
    except dialect.MAVError:
        expected = None
    try:
        found: Any = wire.decode(bytes(frame))
    except dialect.MAVError:
        found = None
    assert (found is None) == (expected is None)
    assert found is None or found.get_type() == expected.get_type()


@given(st.binary(max_size=600), st.booleans(), st.integers(1, 100))
@settings(max_examples=40)
def test_no_bytes_raise_and_no_more_than_a_frame_is_kept(data: bytes, is_stream: bool, size: int) -> None:
    framing = Framing(is_stream=is_stream)
    for at in range(0, len(data), size):
        framing.parse(data[at : at + size])
        assert len(framing._tail) <= 280
    assert framing.bad <= len(data)
    list(swarm_beacon.beacons(data))


@given(st.lists(st.sampled_from([0xFD, 0xFE, 0x00, 0x01, 0xFF, 0x20, 0x84, 0xCB]), max_size=300).map(bytes))
@settings(max_examples=40)
def test_bytes_that_look_like_frames_raise_neither(data: bytes) -> None:
    for framing in (Framing(), Framing(is_stream=True)):
        framing.parse(data)
    list(swarm_beacon.beacons(data))


# --- the beacon, unpacked by hand ---


def packed(message: Any, system: int = 5, component: int = swarm_beacon.COMPONENT) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component)))


def agrees(wire: swarm_beacon.WireBeacon, message: Any) -> bool:
    """Field for field; floats by their bits, as NaN is to come through too."""
    for name in BEACON.ordered_fieldnames:
        ours, theirs = getattr(wire, name), getattr(message, name)
        if name == "members":
            theirs = bytes(theirs)
        if isinstance(ours, float):
            ours, theirs = struct.pack("<f", ours), struct.pack("<f", theirs)
        if ours != theirs:
            return False
    return True


@given(beacon_messages, st.integers(1, 250))
@settings(max_examples=40)
def test_beacon_by_hand_equals_the_full_decode(message: Any, system: int) -> None:
    frame = packed(message, system)
    ((sender, found, wire),) = swarm_beacon.beacons(frame)
    assert (sender, found) == (system, frame)
    (decoded,) = Framing().parse(frame)
    assert agrees(wire, decoded)


@given(beacon_messages, st.integers(0, 255), st.integers(1, 250))
@settings(max_examples=40)
def test_beacon_is_packed_as_pymavlink_packs_it(message: Any, seq: int, system: int) -> None:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=swarm_beacon.COMPONENT)
    mav.seq = seq
    values = [getattr(message, field.name) for field in schema.BEACON.on_wire]
    payload = BEACON_PAYLOAD.pack(*[bytes(value) if isinstance(value, list) else value for value in values])
    framed = wire.frame(BEACON.id, payload, seq=seq, system=system, component=swarm_beacon.COMPONENT)
    assert framed == bytes(message.pack(mav))


def test_table_is_the_message_of_the_dialect() -> None:
    element = next(m for m in ET.parse(SWARM_XML).getroot().iter("message") if m.get("name") == "SWARM_BEACON")
    xml = {f.attrib["name"]: (f.attrib["type"], f.get("units", "")) for f in element.iter("field")}
    assert {field.name: (field.type, field.unit) for field in schema.BEACON.on_wire} == xml
    names = tuple(field.name for field in schema.BEACON.on_wire)
    assert names == tuple(BEACON.ordered_fieldnames) == swarm_beacon.WireBeacon._fields
    assert BEACON.unpacker.size == BEACON_PAYLOAD.size


@given(beacon_messages, st.integers(0, 1000), st.integers(1, 255))
@settings(max_examples=40)
def test_damaged_beacon_is_refused_by_hand_whenever_pymavlink_refuses_it(message: Any, at: int, change: int) -> None:
    frame = bytearray(packed(message))
    frame[at % len(frame)] ^= change
    wires = [wire for _, _, wire in swarm_beacon.beacons(bytes(frame))]
    decoded = [m for m in Framing().parse(bytes(frame)) if m.get_type() == "SWARM_BEACON"]
    assert len(wires) <= len(decoded)
    assert all(map(agrees, wires, decoded))


@given(beacon_messages, st.binary(max_size=40), st.binary(max_size=40))
@settings(max_examples=40)
def test_noise_about_a_beacon_does_not_hide_it(message: Any, before: bytes, after: bytes) -> None:
    frame = packed(message)
    assert frame in [found for _, found, _ in swarm_beacon.beacons(before + frame + after)]


def test_beacons_of_other_components_and_other_messages_are_not_a_companions() -> None:
    message = BEACON(**dict.fromkeys(BEACON.fieldnames, 0) | {"members": [0] * 96})
    heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    data = packed(message, component=1) + packed(heartbeat) + packed(message, system=8)
    assert [sender for sender, _, _ in swarm_beacon.beacons(data)] == [8]


def test_truncated_beacon_is_none() -> None:
    frame = packed(BEACON(**dict.fromkeys(BEACON.fieldnames, 1) | {"members": [1] * 96}))
    for size in range(len(frame)):
        assert swarm_beacon.unpack(frame[:size]) is None
        assert list(swarm_beacon.beacons(frame[:size])) == []
