"""A record that was changed, removed or moved is found and named; a log that ends early is read to there."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from companion.journal import mcap
from companion.journal.channels import Channel, unsealed
from companion.journal.journal import BEGIN
from companion.journal.reading import Break, CutOff, Flight, Item, Recorded, find_flights, read_flight
from companion.journal.recorder import head_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter, SegmentFiles, find_segments
from companion.journal.summary import summarise_flight
from tests.unit.journal.journal_kit import (
    START,
    Messages,
    chunks_of,
    file_of,
    fly_ticks,
    forge,
    recorded,
    recorder_of,
    sealed_anew,
)

TICKS = 40


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    return recorded(tmp_path, TICKS)


def breaks(items: list[Item]) -> list[str]:
    return [item.what for item in items if isinstance(item, Break)]


def of_tick(messages: Messages, tick: int) -> slice:
    """Entries of one tick, its own the last."""
    ends = [k + 1 for k, m in enumerate(messages) if m.channel_id == Channel.TICK]
    return slice(ends[tick - 2], ends[tick - 1])


def change_input(messages: Messages) -> Messages:
    at = of_tick(messages, 17).start
    data = messages[at].data
    return [*messages[:at], replace(messages[at], data=data[:-1] + bytes([data[-1] ^ 1])), *messages[at + 1 :]]


def change_time(messages: Messages) -> Messages:
    """Of arrival: the first eight bytes."""
    at = of_tick(messages, 17).start
    data = messages[at].data
    return [*messages[:at], replace(messages[at], data=bytes([data[0] ^ 1]) + data[1:]), *messages[at + 1 :]]


def change_cut(messages: Messages) -> Messages:
    at = of_tick(messages, 17).stop - 1
    data = messages[at].data.replace(b'"cuts":[]', b'"cuts":[ ]')
    assert data != messages[at].data
    return [*messages[:at], replace(messages[at], data=data), *messages[at + 1 :]]


def remove_input(messages: Messages) -> Messages:
    at = of_tick(messages, 17).start
    return [*messages[:at], *messages[at + 1 :]]


def remove_ticks(messages: Messages) -> Messages:
    return [*messages[: of_tick(messages, 17).start], *messages[of_tick(messages, 19).stop :]]


def swap_ticks(messages: Messages) -> Messages:
    first, second = of_tick(messages, 17), of_tick(messages, 18)
    return [*messages[: first.start], *messages[second], *messages[first], *messages[second.stop :]]


def copy_tick(messages: Messages) -> Messages:
    tick = of_tick(messages, 17)
    return [*messages[: tick.stop], *messages[tick], *messages[tick.stop :]]


def remove_end(messages: Messages) -> Messages:
    return messages[:-1]


def add_behind_end(messages: Messages) -> Messages:
    return [*messages, messages[-2]]


CHANGES: dict[Callable[[Messages], Messages], list[str]] = {
    change_input: ["tick 17, or what came before it since the last, was changed"],
    change_time: ["tick 17, or what came before it since the last, was changed"],
    change_cut: ["tick 17, or what came before it since the last, was changed"],
    remove_input: ["tick 17, or what came before it since the last, was changed: entry "],
    remove_ticks: ["ticks 17 to 19 are missing"],
    swap_ticks: ["ticks 17 to 17 are missing", "tick 17 is found behind tick 18: moved, or a copy"],
    copy_tick: ["tick 17 is found behind tick 17: moved, or a copy"],
    add_behind_end: ["entries behind the last one"],
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_was_changed_is_named(change: Callable[[Messages], Messages], flight: Flight) -> None:
    assert breaks(list(read_flight(flight))) == []
    forge(flight.segments[1], change)
    found = breaks(list(read_flight(flight)))
    assert len(found) >= len(CHANGES[change])
    for said, wanted in zip(found, CHANGES[change], strict=False):
        assert said.startswith(wanted)
    replayed = replay_flight(flight)
    assert replayed.breaks == found
    assert not replayed.is_same


def test_a_changed_byte_without_its_crc_is_named_by_its_place(flight: Flight) -> None:
    path = flight.segments[1]
    data = bytearray(path.read_bytes())
    offset, body = list(mcap.read_chunks(bytes(data), len(mcap.read_head(bytes(data)))))[2]
    data[offset + len(body) // 2] ^= 1
    path.write_bytes(data)
    found = breaks(list(read_flight(flight)))
    assert found[0] == f"{path.name}, byte {offset}: a chunk whose CRC is wrong"
    assert found[1].startswith("ticks ")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("time_s", value) for value in (b"NaN", b"-Infinity", b"1e308", b"1e9")),
        ("cuts", b'[{"reason":"SEPARATION","by_mps":1' + b"0" * 400 + b"}]"),
        ("setpoint_ned_mps", b"[0.0,0.0,1" + b"0" * 400 + b"]"),
    ],
)
def test_a_number_that_no_tick_has_is_told_and_can_be_printed(key: str, value: bytes, flight: Flight) -> None:
    """Of somebody who makes the chain anew."""

    def change(messages: Messages) -> Messages:
        at = of_tick(messages, 17).stop - 1
        old = json.dumps(json.loads(unsealed(messages[at].data)[0])[key], separators=(",", ":")).encode()
        data = messages[at].data.replace(b'"' + key.encode() + b'":' + old, b'"' + key.encode() + b'":' + value)
        assert data != messages[at].data
        return sealed_anew([*messages[:at], replace(messages[at], data=data), *messages[at + 1 :]])

    forge(flight.segments[1], change)
    assert breaks(list(read_flight(flight)))[0].endswith("behind tick 16: makes no sense")
    assert summarise_flight(flight).lines()


@pytest.mark.parametrize("byte", [2, 3, 5])
def test_a_chunk_whose_length_was_changed_is_no_cut_of_a_file_that_was_closed(byte: int, flight: Flight) -> None:
    """Or all behind it would pass for lost by a power cut."""
    path = flight.segments[1]
    data = bytearray(path.read_bytes())
    offset, _ = list(mcap.read_chunks(bytes(data), len(mcap.read_head(bytes(data)))))[2]
    data[offset + 1 + byte] ^= 0x40
    path.write_bytes(data)
    found = breaks(list(read_flight(flight)))
    assert found[0].startswith(f"{path.name}, byte {offset}: ")


def test_a_log_without_its_last_entry_says_so(flight: Flight) -> None:
    forge(flight.segments[1], remove_end)
    items = list(read_flight(flight))
    assert breaks(items) == []
    assert isinstance(items[-1], CutOff)
    assert "entries were taken off" in items[-1].what


def test_a_chain_that_was_made_anew_has_another_head(flight: Flight) -> None:
    """Who writes all that follows anew is not found by the log alone, but by the head that the flight log has."""
    before = replay_flight(flight).head
    forge(flight.segments[1], change_input)
    assert replay_flight(flight).breaks
    forge(flight.segments[1], sealed_anew)
    replayed = replay_flight(flight)
    assert replayed.breaks == []
    assert replayed.head != before


def test_a_log_cut_at_any_byte_is_read_to_its_last_whole_chunk(flight: Flight) -> None:
    path = flight.segments[1]
    data = path.read_bytes()
    head, chunks = chunks_of(data)
    whole: list[tuple[int, int]] = []  # offset from which a chunk is there, ticks up to it
    ticks = 0
    for (offset, body), messages in zip(mcap.read_chunks(data, len(head)), chunks, strict=True):
        ticks += sum(m.channel_id == Channel.TICK for m in messages)
        whole.append((offset + 9 + len(body), ticks))
    ended_at = whole[-1][0]
    for size in range(len(data)):
        if size > len(head) and size % 61 and all(abs(size - at) > 3 for at, _ in whole):
            continue  # each byte about a chunk's edge, and every 61st of the others
        path.write_bytes(data[:size])
        items = list(read_flight(flight))
        expected = max((count for at, count in whole if at <= size), default=0)
        assert sum(isinstance(item, Recorded) and not item.is_end for item in items) == expected
        assert breaks(items) == []
        assert isinstance(items[-1], CutOff)
        assert items[-1].has_last_entry == (size >= ended_at)
        assert f"{path.name}, byte " in items[-1].what


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9])
def test_a_log_that_was_cut_is_replayed_to_there(share: float, flight: Flight) -> None:
    path = flight.segments[1]
    data = path.read_bytes()
    first = len(chunks_of(data)[0])
    path.write_bytes(data[: first + int(share * (len(data) - first))])
    replayed = replay_flight(flight)
    assert replayed.ends.startswith("without being closed: ")
    if share:
        assert 0 < replayed.same == replayed.summary.ticks < TICKS
        assert replayed.is_same
    else:
        assert replayed.stopped == "the beginning is missing"


def test_missing_segments_are_named(tmp_path: Path) -> None:
    flight = recorded(tmp_path, TICKS)
    (key, path), *_ = find_segments(tmp_path).items()
    assert key == (3, 1, 1)
    moved = Flight(flight.vehicle_id, 1, {2: path})
    assert breaks(list(read_flight(moved)))[0] == "segments 1 to 1 are missing"


def test_zeros_behind_the_last_whole_chunk_are_what_a_power_cut_leaves(flight: Flight) -> None:
    """The size of the file was on the disk before its bytes; the chunk that was being written is torn."""
    path = flight.segments[1]
    data = path.read_bytes()
    head = mcap.read_head(data)
    offset, body = list(mcap.read_chunks(data, len(head)))[3]
    ticks = sum(message.channel_id == Channel.TICK for chunk in chunks_of(data)[1][:3] for message in chunk)
    assert ticks > 10
    for torn in (0, 1, 8, 9, 40, 9 + len(body) // 2, 9 + len(body) - 1):
        path.write_bytes(data[: offset + torn] + bytes(100_000))
        written = len(data[: offset + torn].rstrip(b"\0"))
        replayed = replay_flight(flight)
        assert replayed.breaks == []
        zeros = f"zeros from byte {written} to its end, as a power cut leaves them"
        assert replayed.ends == f"without being closed: {path.name}, byte {offset}: {zeros}"
        assert (replayed.same, replayed.is_same) == (ticks, True)


def test_other_bytes_behind_the_last_whole_chunk_are_a_broken_chain(flight: Flight) -> None:
    path = flight.segments[1]
    data = path.read_bytes()
    offset, body = list(mcap.read_chunks(data, len(mcap.read_head(data))))[3]
    written = data[: offset + 9 + len(body) // 2] + bytes(100_000)
    for tail in (b"x", data[offset + 9 + len(body) :], b"\1" * 100):
        path.write_bytes(written + tail)
        replayed = replay_flight(flight)
        assert replayed.breaks
        assert not replayed.is_same
    for tail in (b"x", mcap.end(), bytes(100) + b"x"):  # behind the end of a closed file
        path.write_bytes(data + tail)
        assert replay_flight(flight).breaks == [f"{path.name}, byte {len(data) - len(mcap.end())}: {ODD_BYTES}"]


ODD_BYTES = "bytes that are no chunk"


def test_a_record_between_chunks_or_a_changed_end_is_a_broken_chain(flight: Flight) -> None:
    path = flight.segments[1]
    data = path.read_bytes()
    offset, _ = list(mcap.read_chunks(data, len(mcap.read_head(data))))[2]
    for changed in (
        data[:offset] + mcap.metadata("flown", {"by": "another"}) + data[offset:],
        data[: -len(mcap.end()) + 10] + b"\1" + data[-len(mcap.end()) + 11 :],
    ):
        path.write_bytes(changed)
        assert replay_flight(flight).breaks[0].endswith(ODD_BYTES)


def test_any_changed_byte_of_the_header_breaks_the_chain(flight: Flight) -> None:
    path = flight.segments[1]
    data = path.read_bytes()
    first = len(mcap.read_head(data))
    for at in (*range(0, first, 23), first - 1):
        path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        assert not replay_flight(flight).is_same
    path.write_bytes(data[:200] + bytes([data[200] ^ 1]) + data[201:])
    replayed = replay_flight(flight)
    assert replayed.same == 0
    assert "tick 1, or what came before it or the file's header, was changed" in replayed.breaks


def test_every_segment_has_the_header_of_the_first(tmp_path: Path) -> None:
    made = SegmentFiles(tmp_path, 3, head_of(START), segment_bytes=12_000, waits_for_disk=False)
    recorder, _ = recorder_of(DirectWriter(made))
    fly_ticks(recorder, TICKS)
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    assert replay_flight(flight).is_same
    data = flight.segments[2].read_bytes()
    flight.segments[2].write_bytes(data.replace(b"its digest", b"my  digest"))
    assert replay_flight(flight).breaks == [f"{flight.segments[2].name}: its header is not the first segment's"]


def test_a_box_of_the_format_before_is_read(flight: Flight) -> None:
    """Its chain begins with zeros, behind the header."""
    path = flight.segments[1]
    head, chunks = chunks_of(path.read_bytes())
    start, *others = [message for chunk in chunks for message in chunk]
    older = [replace(start, data=start.data.replace(b'"format":3', b'"format":1')), *others]
    path.write_bytes(file_of(head, sealed_anew(older, BEGIN)))
    replayed = replay_flight(flight)
    assert (replayed.start["format"], replayed.same, replayed.is_same) == (1, TICKS, True)
    path.write_bytes(
        file_of(head, sealed_anew([replace(start, data=start.data.replace(b'"format":3', b'"format":4')), *others]))
    )
    assert replay_flight(flight).stopped == "format 4: this program reads 1 to 3"
