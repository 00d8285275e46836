"""SWARM_RANGES and SWARM_RELATIVE: there and back, as pymavlink has them, and what is not believed."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import RelativeReport
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import BEACON_PAYLOAD, encode_relative_report
from companion.mavlink.packing import MOST, pack_ranges, unpack_ranges
from companion.mavlink.relative import RELATIVE_ID, read_relative_report
from mission.common.frames import LocalFrame, Wgs84
from tests.unit.core.core_kit import beacon

RANGES = ((2, 12.34, 0.05), (250, 0.07, 0.0), (7, 600.0, 2.55))
WORD = RelativeReport(5, 123456, (1.5, -80.25), (3.0, -4.5), 0.75, RANGES, 2.5)
FRAME = LocalFrame(Wgs84(47.0, 8.0, 400.0))


def framed(word: RelativeReport, *, component: int = 191) -> bytes:
    return wire.frame(RELATIVE_ID, encode_relative_report(word), seq=0, system=word.sender, component=component)


def told(word: RelativeReport | None) -> tuple[object, ...]:
    assert word is not None
    ranges = [(k, pytest.approx(m, abs=0.005), pytest.approx(age, abs=0.005)) for k, m, age in word.ranges]
    return (word.sender, word.time_ms, word.odo_ne_m, word.to_leader_ne_m, word.leader_sd_m, ranges, word.position_sd_m)


def test_ranges_come_back() -> None:
    for got, sent in zip(unpack_ranges(pack_ranges(RANGES)), RANGES, strict=True):
        assert got == pytest.approx(sent)
    message = dialect.MAVLink_swarm_ranges_message(0, list(pack_ranges(RANGES)))
    assert unpack_ranges(message.ranges) == unpack_ranges(pack_ranges(RANGES))


def test_no_more_are_told_than_fit_and_what_is_too_far_is_cut() -> None:
    assert len(unpack_ranges(pack_ranges([(1, 1.0, 0.0)] * 40))) == MOST
    assert unpack_ranges(pack_ranges([(1, 1e9, 1e9)]))[0] == pytest.approx((1, 650.0, 2.55))


def test_a_word_comes_back_and_reads_alike_in_pymavlink() -> None:
    frame = framed(WORD)
    assert told(read_relative_report(frame)) == told(WORD)
    message = wire.decode(frame)
    assert (message.time_boot_ms, message.odo_e, message.leader_sd) == (123456, -80.25, 0.75)
    assert len(frame) < 12 + 26 + 4 * len(RANGES) + 1  # trailing zeros are cut off


def test_a_word_of_one_that_does_not_know_the_leader() -> None:
    word = read_relative_report(framed(RelativeReport(5, 1, (0.0, 0.0))))
    assert word is not None
    assert word.to_leader_ne_m is None
    assert word.position_sd_m is None
    assert word.ranges == ()


def test_what_is_no_word_or_not_to_be_believed_is_none() -> None:
    good = framed(WORD)
    assert read_relative_report(good[:-1] + bytes([good[-1] ^ 1])) is None  # checksum
    assert read_relative_report(good[:-3]) is None
    assert read_relative_report(b"") is None
    for odo in ((math.nan, 0.0), (0.0, math.inf), (6e4, 0.0)):
        assert read_relative_report(framed(RelativeReport(5, 1, odo))) is None
    for at in range(len(good)):
        read_relative_report(good[:at])  # nothing raises


def test_words_between_beacons_hide_none_of_them() -> None:
    codec = Codec(2, FRAME)
    codec._pos_ned_m = (0.0, 0.0, 0.0)
    payload = codec.encode_beacon(beacon(2))
    assert payload is not None
    one = wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=2, component=191)
    words: list[bytes] = []

    def take(frame: bytes) -> bool:
        words.append(frame)
        return read_relative_report(frame) is not None

    many = (framed(WORD) + one) * 60  # more than BAD_STARTS_MAX
    assert len(swarm_beacon.beacons(many, take)) == 60
    assert len(words) == 60


def test_in_a_swarm_that_flies_by_ranges_beacons_tell_no_place_but_the_acting_leaders() -> None:
    codec = Codec(2, FRAME, start_ned_m=(30.0, 40.0, 0.0), broadcasts_position=False)
    codec._pos_ned_m = (31.0, 42.0, -8.0)
    payload = codec.encode_beacon(beacon(2))
    assert payload is not None
    fields = swarm_beacon.WireBeacon._make(BEACON_PAYLOAD.unpack(payload))
    assert (fields.lat, fields.lon, fields.alt) == (2**31 - 1, 2**31 - 1, 408_000)
    payload = codec.encode_beacon(beacon(2), (100.0, 0.0, -8.0))
    assert payload is not None
    fields = swarm_beacon.WireBeacon._make(BEACON_PAYLOAD.unpack(payload))
    assert FRAME.to_ned(Wgs84(fields.lat / 1e7, fields.lon / 1e7, 408.0))[0] == pytest.approx(100.0, abs=0.1)
