"""A signed autopilot link: with pymavlink's own signing at the other end, and against those who have no key."""

from __future__ import annotations

from hashlib import sha256
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from companion.mavlink import dialect
from companion.mavlink.autopilot_link.signing import (
    BEGUN,
    FLOOR,
    OLD,
    STREAMS_MAX,
    LinkSigning,
    as_signed,
    timestamp_at,
)
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import whole
from companion.mavlink.peers.frame_mac import TIMESTAMP_MAX, UNITS_PER_S, seal, timestamp_of
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import AUTOPILOT, HOME, ME, TICK_S, heartbeat, position

KEY = sha256(b"a passphrase").digest()
OTHER = sha256(b"another").digest()
NOW = timestamp_at(1_800_000_000.0)


def frame(message: Any, system: int = ME, component: int = AUTOPILOT, seq: int = 0) -> bytes:
    return wire.pack(message, seq=seq, system=system, component=component)


def signed(
    message: Any, timestamp: int, *, key: bytes = KEY, link: int = 0, system: int = ME, component: int = AUTOPILOT
) -> bytes:
    return seal(as_signed(frame(message, system, component)), key, link, timestamp)


def link_end(timestamp: int = NOW) -> LinkSigning:
    return LinkSigning(KEY, timestamp=timestamp)


def pymavlink_end(key: bytes = KEY, timestamp: int = NOW) -> Any:
    """What others make of MAVLink 2's signing: they take nothing unsigned."""
    mav = ardupilotmega.MAVLink(None, srcSystem=ME, srcComponent=AUTOPILOT)
    mav.signing.secret_key = key
    mav.signing.timestamp = timestamp
    mav.signing.sign_outgoing = True
    mav.robust_parsing = True
    return mav


def taken_by(mav: Any, data: bytes) -> list[str]:
    return [m.get_type() for m in mav.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]


# --- pymavlink at the other end ---


def test_pymavlink_takes_what_is_sealed_and_nothing_else() -> None:
    far, near = pymavlink_end(), link_end()
    texts = dialect.MAVLink_statustext_message(4, b"of arrays and strings")
    assert taken_by(far, near.seal(frame(heartbeat(), component=191), 0.0)) == ["HEARTBEAT"]
    assert taken_by(far, near.seal(frame(texts, component=191), 0.0)) == ["STATUSTEXT"]
    assert taken_by(far, frame(heartbeat(), component=191)) == []
    assert taken_by(far, LinkSigning(OTHER, timestamp=NOW + OLD).seal(frame(heartbeat(), component=191), 0.0)) == []


def test_what_pymavlink_signs_is_admitted_and_reads_as_unsigned_does() -> None:
    far, near = pymavlink_end(), link_end()
    for message in (
        ardupilotmega.MAVLink_local_position_ned_message(1000, 1.0, 2.0, -8.0, 0.0, 0.0, 0.0),
        ardupilotmega.MAVLink_statustext_message(4, b"of arrays and strings"),
    ):
        data = message.pack(far)
        far.seq += 1
        assert near.admits(data)
        assert wire.decode(data).to_dict() == message.to_dict()
    assert (near.signed, near.refused) == (2, 0)
    assert not near.admits(pymavlink_end(OTHER).heartbeat_encode(2, 12, 0, 0, 3).pack(pymavlink_end(OTHER)))


def test_signed_frame_with_a_wrong_checksum_is_no_message() -> None:
    data = bytearray(signed(position(), NOW))
    data[12] ^= 1
    with pytest.raises(dialect.MAVError):
        wire.fields(bytes(data))


# --- who has no key ---


def test_frame_without_the_key_leaves_no_trace() -> None:
    near = link_end()
    for data, why in (
        (frame(heartbeat()), "unsigned"),
        (signed(heartbeat(), TIMESTAMP_MAX, key=OTHER), "another key"),
        (signed(heartbeat(), NOW)[:-1] + b"\0", "another key"),
    ):
        before = near.refusals[why]
        assert not near.admits(data)
        assert near.refusals[why] == before + 1
    assert near.timestamp == NOW
    assert near.admits(signed(heartbeat(), NOW))
    assert near.counters() == {
        "frames of the autopilot refused, another key": 2,
        "frames of the autopilot refused, unsigned": 1,
    }


def test_no_byte_of_a_frame_may_change() -> None:
    data = signed(heartbeat(), NOW)
    near = link_end()
    for at in range(len(data)):
        assert not near.admits(data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :]), at
    assert near.admits(data)


def test_recorded_frame_is_taken_once_and_none_before_it() -> None:
    near = link_end()
    first, second = signed(heartbeat(), NOW + 1), signed(position(), NOW + 2)
    assert near.admits(second)
    assert not near.admits(second)
    assert not near.admits(first)
    assert near.refusals == {"repeated": 2}


def test_recording_is_refused_by_a_new_start_unless_it_is_of_the_last_minute() -> None:
    near = link_end()
    assert not near.admits(signed(heartbeat(), NOW - OLD - 1))
    assert near.refusals == {"old": 1}
    assert near.admits(signed(heartbeat(), NOW - OLD))


def test_as_many_senders_as_an_autopilot_remembers() -> None:
    near = link_end()
    taken = [near.admits(signed(heartbeat(), NOW + k, system=k)) for k in range(1, STREAMS_MAX + 3)]
    assert taken == [True] * STREAMS_MAX + [False] * 2
    assert near.admits(signed(heartbeat(), NOW + 100, system=1))


# --- timestamps ---


def test_timestamps_only_grow_and_follow_the_clock() -> None:
    near = link_end()
    sent = [timestamp_of(near.seal(frame(heartbeat()), now_s)) for now_s in (5.0, 5.0, 6.0, 2.0)]
    assert sent[0] == NOW + 1
    assert sent[1] == NOW + 2
    assert sent[2] == NOW + UNITS_PER_S
    assert sent[3] == NOW + UNITS_PER_S + 1


def test_clock_that_is_not_set_is_2026() -> None:
    assert timestamp_at(0.0) == timestamp_at(-1e12) == FLOOR
    assert timestamp_at(BEGUN + 400e6) == 400_000_000 * UNITS_PER_S
    assert timestamp_at(1e12) == TIMESTAMP_MAX


def test_board_without_a_clock_is_heard_once_it_has_heard_its_autopilot() -> None:
    far, near = pymavlink_end(timestamp=NOW), LinkSigning(KEY)
    far.parse_buffer(link_end().seal(frame(heartbeat(), system=255, component=190), 0.0))  # has heard somebody before
    assert taken_by(far, near.seal(frame(heartbeat(), component=191), 0.0)) == []
    assert not near.admits(signed(heartbeat(), NOW + 5, key=OTHER))
    assert taken_by(far, near.seal(frame(heartbeat(), component=191), 0.1)) == []
    assert near.admits(far.heartbeat_encode(2, 12, 0, 0, 3).pack(far))
    assert taken_by(far, near.seal(frame(heartbeat(), component=191), 0.2)) == ["HEARTBEAT"]


# --- the endpoint behind it ---


def behind_key() -> Endpoint:
    return Endpoint(mission(), ME, autopilot_gate=link_end())


def test_endpoint_acts_on_signed_frames_alone() -> None:
    one = behind_key()
    one.from_autopilot(b"".join(map(frame, (HOME, position(), heartbeat()))), 10.0)
    one.from_autopilot(signed(heartbeat(), NOW + 9, key=OTHER), 10.0)
    assert one.codec.make is None
    assert one.read_autopilot(frame(heartbeat())) == []
    for k, message in enumerate((HOME, position(), heartbeat())):
        one.from_autopilot(signed(message, NOW + k), 10.0)
    assert one.codec.make is not None
    assert one.autopilot_gate.refused == 5


def test_all_that_an_endpoint_sends_its_autopilot_is_taken_by_pymavlink() -> None:
    far, one = pymavlink_end(), behind_key()
    assert taken_by(far, one.hello()) == ["HEARTBEAT"]
    types = []
    for k in range(8):
        for j, message in enumerate((HOME, position(boot_ms=1000 + 50 * k), heartbeat())):
            one.from_autopilot(signed(message, NOW + OLD + 10 * k + j), 10.0 + k * TICK_S)
        out = one.tick(10.0 + k * TICK_S).autopilot
        taken = taken_by(far, out)
        assert len(taken) == len(whole(out))
        types += taken
    assert {"HEARTBEAT", "COMMAND_LONG", "TIMESYNC"} <= set(types)
